from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot import RgbdFrame
from seismo3d.robot._kernels_frame import depth_sigma, unpack_pixels
from seismo3d.robot.ekf import exp_motion
from seismo3d.robot.frames import Measurer, MeasureSettings, Timing, smooth_depth
from seismo3d.robot.landmarks import View, time_sightings, views_apart
from seismo3d.robot.moving import MotionMemory
from seismo3d.robot.room import Room, room_to_grow

LENS = PinholeCamera(130.0, 131.0, 79.5, 59.5, (0.05,), 1000.0)
POOL = ThreadPoolExecutor(2)


def ray_grid() -> np.ndarray:
    grid = np.stack(np.meshgrid(np.arange(160), np.arange(120)), axis=-1).reshape(-1, 2).astype(float)
    return np.c_[LENS.rays(grid), np.ones(len(grid))].reshape(120, 160, 3)


def wall(T_world_camera: np.ndarray) -> np.ndarray:
    """Depth of the wall z = 2 + 0.2 x - 0.1 y seen from poses of shape (120, 4, 4), one a row."""
    normal = np.array([-0.2, 0.1, 1.0])
    direction = np.einsum("rij,rcj->rci", T_world_camera[:, :3, :3], ray_grid())
    return (2.0 - T_world_camera[:, :3, 3] @ normal)[:, None] / (direction @ normal)


def test_vertices_and_normals_of_a_wall() -> None:
    still = np.repeat(np.eye(4)[None], 120, axis=0)
    frame = RgbdFrame.of(None, wall(still) * 1000.0, 0.0)
    measured = Measurer(LENS, MeasureSettings(), POOL).measure(frame, np.zeros(6), Timing())
    inner = measured.vertices[4:-4, 4:-4].astype(float)
    np.testing.assert_allclose(inner @ np.array([-0.2, 0.1, 1.0]), 2.0, atol=2e-3)
    normal = np.array([0.2, -0.1, -1.0]) / np.sqrt(1.05)
    assert (measured.normals[4:-4, 4:-4] @ normal).min() > 0.999
    trust = unpack_pixels(measured.pixels)[2].reshape(120, 160)[10:-10, 10:-10]
    assert trust.max() < (depth_sigma(1.0) / depth_sigma(1.5)) ** 2
    assert trust.min() > 0.0


@pytest.mark.parametrize("kind", [">f4", ">u2", np.float16, np.longdouble])
def test_depth_is_read_whatever_it_is_stored_as(kind: str | type) -> None:
    depth = np.round(wall(np.repeat(np.eye(4)[None], 120, axis=0)) * 100.0) * 8.0
    lens = PinholeCamera(130.0, 131.0, 79.5, 59.5, (0.05,), 800.0)
    usual, stored = (
        Measurer(lens, MeasureSettings(), POOL).measure(RgbdFrame.of(None, given, 0.0), np.zeros(6), Timing()).depth
        for given in (depth, np.asfortranarray(depth.astype(kind)))
    )
    np.testing.assert_array_equal(stored, usual)


def test_shutter_is_frozen() -> None:
    """Rows seen from a turning, moving camera become what it sees at the middle row's time."""
    twist, readout = np.array([0.5, -0.3, 0.2, 0.2, 0.1, 0.3]), 0.03
    times = (np.arange(120) / 120 - 0.5) * readout
    rolling = wall(np.array([exp_motion(twist * t) for t in times]))
    exact = wall(np.repeat(np.eye(4)[None], 120, axis=0))
    frame = RgbdFrame.of(None, rolling * 1000.0, 0.0)
    measurer = Measurer(LENS, MeasureSettings(), POOL)
    off = {}
    for name, timing in (("frozen", Timing(readout)), ("rolling", Timing())):
        depth = measurer.measure(frame, twist, timing).depth[12:-12, 12:-12]
        off[name] = np.abs(depth - exact[12:-12, 12:-12])[depth > 0]
    assert np.median(off["frozen"]) < 0.25 * np.median(off["rolling"])
    assert np.median(off["frozen"]) < 0.001


def test_colour_of_another_time_lands_on_its_depth() -> None:
    twist, lead = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]), 0.02
    still = np.repeat(np.eye(4)[None], 120, axis=0)
    rgb = np.zeros((120, 160, 3), np.uint8)
    rgb[:, 80:] = 200  # an edge at column 80 of the colour image
    frame = RgbdFrame(0.02, 0.0, rgb, wall(still) * 1000.0)
    measured = Measurer(LENS, MeasureSettings(), POOL).measure(frame, twist, Timing(0.0, lead))
    edge = np.argmax(measured.colour[60, :, 0] > 100)
    # turned by 0.02 rad to the right since, the colour's camera shows things 2.6 pixels farther left
    assert edge == pytest.approx(80 + 130 * np.tan(0.02), abs=1.0)


def test_pixels_know_their_time() -> None:
    pixels = np.array([[10.0, 0.0], [10.0, 60.0], [10.0, 119.0]])
    seen = time_sightings(
        np.zeros((3, 3)), pixels, LENS, np.array([0, 0.4, 0, 0.1, 0, 0.2]), Timing(0.03, 0.01), (120, 160)
    )
    np.testing.assert_allclose(seen.delay, 0.01 + 0.03 * (pixels[:, 1] / 120 - 0.5))
    exact = [exp_motion(np.array([0, 0.4, 0, 0.1, 0, 0.2]) * t) for t in seen.delay]
    np.testing.assert_allclose(seen.T_depth_pixel, exact, atol=1e-6)  # third order in the time


def test_total_variation_smooths_but_keeps_edges_and_holes(rng: np.random.Generator) -> None:
    depth = np.where(np.arange(80) < 40, 1.0, 2.0) * np.ones((60, 1))
    noisy = (depth + 0.01 * rng.normal(size=depth.shape)).astype(np.float32)
    noisy[20:25, 10:15] = 0.0
    smooth = smooth_depth(noisy, 0.02)
    assert not smooth[20:25, 10:15].any()
    seen = smooth > 0
    assert np.std((smooth - depth)[seen]) < 0.6 * np.std((noisy - depth)[seen])
    assert (smooth[:, 41:] - smooth[:, 38:39]).min() > 0.9


def test_what_moves_loses_its_weight_and_what_stays_keeps_it() -> None:
    still = np.repeat(np.eye(4)[None], 120, axis=0)
    background = wall(still)
    measurer, memory = Measurer(LENS, MeasureSettings(), POOL), MotionMemory()

    def watch(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        frame = RgbdFrame.of(None, depth * 1000.0, 0.0)
        measured = measurer.measure(frame, np.zeros(6), Timing())
        marked = memory.watch(measured, LENS, np.eye(4))
        return marked, unpack_pixels(measured.pixels)[2].reshape(120, 160)

    for _ in range(3):
        marked, _ = watch(background)
        assert not marked.any()
    intruder = background.copy()
    intruder[40:80, 50:90] = 1.0
    marked, trust = watch(intruder)
    assert marked[22:38, 27:43].all()
    assert not marked[:15].any()
    assert not trust[45:75, 55:85].any()
    assert trust[100:110, 20:140].min() > 0.0
    for _ in range(68):  # once it has stood still for twice as long as the memory reaches, it is mapped
        marked, trust = watch(intruder)
    assert not marked.any()
    assert trust[50:70, 60:80].min() > 0.0


def test_settings_are_checked() -> None:
    with pytest.raises(ParameterError, match="far"):
        MeasureSettings(near=1.0, far=0.5)
    with pytest.raises(ParameterError, match="far"):
        MeasureSettings(far=100.0)


def test_memory_is_used_again_once_no_part_of_it_is_held() -> None:
    room = Room()
    whole = room.empty((40, 30), np.float32)
    whole[:] = 1.0
    place, part = whole.__array_interface__["data"][0], whole[3:, ::2]
    del whole
    other = room.empty((40, 30), np.float32)
    other[:] = 2.0
    assert (part == 1.0).all()
    del part
    again = room.empty((30, 40), np.int32)
    assert again.__array_interface__["data"][0] == place
    assert again.shape == (30, 40)
    assert again.dtype == np.int32
    assert room.empty((0, 3), np.uint8).shape == (0, 3)


def test_room_to_grow_is_zero_and_can_be_written_to() -> None:
    room = room_to_grow((1000, 3), np.uint16)
    assert room.shape == (1000, 3)
    assert room.dtype == np.uint16
    assert not room.any()
    room[7] = [1, 2, 3]
    assert room.sum() == 6


def test_frames_do_not_write_into_each_other() -> None:
    """A frame that is held stays as it is while others are measured; one of odd size ends in zeros every time."""
    rng = np.random.default_rng(2)
    lens = PinholeCamera(130.0, 131.0, 80.0, 60.0, (), 1000.0)
    measurer = Measurer(lens, MeasureSettings(), POOL)
    frames = [
        RgbdFrame.of(rng.integers(1, 255, (121, 161, 3)).astype(np.uint8), 1500.0 + 3.0 * rng.random((121, 161)), 0.0)
        for _ in range(4)
    ]
    first = measurer.measure(frames[0], np.zeros(6), Timing())
    names = ("depth", "vertices", "normals", "pixels", "colour")
    copies = {name: getattr(first, name).copy() for name in names}
    for frame in frames[1:]:
        later = measurer.measure(frame, np.zeros(6), Timing())
        assert later.colour[:120, :160].any()
        for image in (later.pixels.reshape(121, 161), later.colour):
            assert not image[120].any()
            assert not image[:, 160].any()
    for name, copy in copies.items():
        np.testing.assert_array_equal(getattr(first, name), copy)


@pytest.mark.parametrize("beside", [None, ThreadPoolExecutor(1)])
def test_a_frame_begun_with_is_the_one_that_is_measured(beside: ThreadPoolExecutor | None) -> None:
    rng = np.random.default_rng(3)
    depth = 1500.0 + 3.0 * rng.random((120, 160))
    frame = RgbdFrame.of(rng.integers(1, 255, (120, 160, 3)).astype(np.uint8), depth, 0.0)
    coming = Measurer(LENS, MeasureSettings(), POOL, beside).begin(frame, np.zeros(6), Timing())
    expected = Measurer(LENS, MeasureSettings(), POOL).measure(frame, np.zeros(6), Timing())
    measured = coming.measured()
    np.testing.assert_array_equal(measured.pixels, expected.pixels)
    assert coming.grey is measured.grey
    with pytest.raises(ShapeError, match="expected at least 16 x 16"):
        Measurer(LENS, MeasureSettings(), POOL, beside).begin(
            RgbdFrame.of(None, depth[:8, :8], 0.0), np.zeros(6), Timing()
        )


def test_views_are_apart_by_their_turn_and_half_their_shift() -> None:
    nothing = np.empty((0, 2)), np.empty((0, 3))
    turned = exp_motion(np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0]))
    shifted = turned.copy()
    shifted[:3, 3] = [0.0, 0.0, 0.8]
    views = [View(T, np.empty((0, 0), np.uint8), *nothing) for T in (np.eye(4), turned, shifted)]
    np.testing.assert_allclose(views_apart(views, np.eye(4)), [0.0, 0.3, 0.7], atol=1e-12)
    assert views[2].apart(turned) == pytest.approx(0.4, abs=1e-7)
    assert views_apart([], np.eye(4)).shape == (0,)
