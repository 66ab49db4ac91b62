from __future__ import annotations

from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FormatError, ParameterError, ShapeError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import adjoint, invert_transform, rotation_angle
from seismo3d.robot import Camera, LensErrors, Mapper, MapperSettings, RgbdFrame, follower
from seismo3d.robot.ekf import log_motion
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.locator import Locator
from seismo3d.synthetic.rgbd import DepthNoise, RgbdSequence, rgbd_sequence

SETTINGS = MapperSettings(voxel_size=0.02, keep_every=2)


@pytest.fixture(scope="module")
def room() -> tuple[RgbdSequence, list[RgbdFrame]]:
    """Forty frames of a room, a twelfth of the way round."""
    sequence = rgbd_sequence("room", frames=40, size=(160, 120), period=16.0, seed=3)
    return sequence, [RgbdFrame.of(f.colour, f.depth, f.stamp) for f in sequence]


def make_mapper(sequence: RgbdSequence, **more: object) -> Mapper:
    settings = MapperSettings(**{"voxel_size": 0.02, "keep_every": 2, **more})  # type: ignore[arg-type]
    return Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)


def pose_errors(mapper: Mapper, sequence: RgbdSequence) -> tuple[np.ndarray, np.ndarray]:
    """Metres and radians from the truth, the first frame's camera being the world."""
    found = mapper.trajectory
    first = invert_transform(sequence.poses[0])
    between = [invert_transform(first @ sequence.poses[i]) @ T for i, T in zip(found.frames, found.T_world_camera)]
    shift = np.array([np.linalg.norm(T[:3, 3]) for T in between])
    return shift, np.array([rotation_angle(T[:3, :3]) for T in between])


@pytest.fixture(scope="module")
def mapped(room: tuple[RgbdSequence, list[RgbdFrame]]) -> Mapper:
    sequence, frames = room
    mapper = make_mapper(sequence)
    for frame in frames:
        mapper.add(frame)
    return mapper


def test_every_frame_is_located_near_the_truth(room: tuple[RgbdSequence, list[RgbdFrame]], mapped: Mapper) -> None:
    sequence, frames = room
    assert mapped.trajectory.frames.tolist() == list(range(len(frames)))
    shift, turn = pose_errors(mapped, sequence)
    assert shift.max() < 0.01 * sequence.path_length + 0.004  # noise of 2 mm at a metre, 4,800 vertices
    assert turn.max() < np.radians(0.4)


def test_mesh_lies_on_the_true_surface(room: tuple[RgbdSequence, list[RgbdFrame]], mapped: Mapper) -> None:
    sequence, _ = room
    mesh = mapped.mesh()
    T = sequence.poses[0]
    points = (mesh.points @ T[:3, :3].T + T[:3, 3])[::7]
    off = np.abs(sequence.scene.distance_to_surface(points))
    assert np.median(off) < 0.005  # a quarter of a voxel
    assert len(points) > 1000
    # triangles face the camera's side: the free side
    corners = mesh.points[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = mapped.trajectory.T_world_camera[:, :3, 3].mean(axis=0) - corners.mean(axis=1)
    assert (np.einsum("ni,ni->n", normals, towards) > 0).mean() > 0.97


def test_number_of_threads_does_not_matter(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    sequence, frames = room
    made = []
    for threads in (1, 3):
        mapper = make_mapper(sequence, n_threads=threads)
        for frame in frames[:6]:
            mapper.add(frame)
        made.append(mapper)
    np.testing.assert_array_equal(made[0].trajectory.T_world_camera, made[1].trajectory.T_world_camera)
    np.testing.assert_array_equal(made[0].mesh().points, made[1].mesh().points)


def test_a_settled_map_has_all_its_frames(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    """Reading the map after each frame, settling it, or going on leads to the same map."""
    sequence, frames = room
    made = []
    for pause in ("read", "settle", "none"):
        mapper = make_mapper(sequence, n_threads=2)
        for frame in frames[:6]:
            mapper.add(frame)
            if pause == "read":
                assert mapper.state.surface.n_blocks > 0
            elif pause == "settle":
                mapper.settle()
                assert mapper.state.fusing is None
                assert all(isinstance(kept, KeptFrame) for kept in mapper.state.packing)
        made.append(mapper.state.surface)
    for other in made[1:]:
        n = other.n_blocks
        assert n == made[0].n_blocks
        for name in ("keys", "distance", "root", "colour"):
            np.testing.assert_array_equal(getattr(other, name)[:n], getattr(made[0], name)[:n])


def test_what_goes_wrong_beside_is_raised_where_the_map_is_read(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    sequence, frames = room
    mapper = make_mapper(sequence, n_threads=2)
    mapper.add(frames[0])
    failed: Future[None] = Future()
    failed.set_exception(MemoryError("no room"))
    mapper.state.fusing = failed
    with pytest.raises(MemoryError, match="no room"):
        mapper.settle()
    mapper.settle()


def test_empty_depth_is_a_state_and_the_next_frame_is_found(
    room: tuple[RgbdSequence, list[RgbdFrame]],
) -> None:
    sequence, frames = room
    mapper = make_mapper(sequence)
    states = []
    for number, frame in enumerate(frames[:16]):
        if 6 <= number < 10:
            frame = RgbdFrame.of(np.zeros_like(frame.rgb), np.zeros_like(frame.depth), frame.time)
        states.append(mapper.add(frame).state)
    assert states[:6] == ["started", *["tracked"] * 5]
    assert states[6:10] == ["empty"] * 4
    assert states[-1] == "tracked"
    assert pose_errors(mapper, sequence)[0].max() < 0.01


@pytest.mark.parametrize("plain", [True, False])
def test_along_a_plain_wall_the_camera_slides_and_texture_holds_it(plain: bool, rng: np.random.Generator) -> None:
    lens = PinholeCamera(130.0, 130.0, 79.5, 59.5, (), 1.0, 160, 120)
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0), settings=SETTINGS)
    paint = np.full((120, 160, 3), 128, np.uint8)
    if not plain:
        paint = np.kron(rng.integers(40, 220, (20, 27, 1)), np.ones((6, 6, 3)))[:120, :160].astype(np.uint8)
    found = []
    for number in range(12):
        depth = 1.5 + 0.003 * rng.standard_normal((120, 160)).astype(np.float32)
        found.append(mapper.add(RgbdFrame.of(paint, depth, number / 30.0)))
    located = found[-1].located
    assert located is not None
    if plain:
        assert [tracked.state for tracked in found] == ["started", *["sliding"] * 11]
        # across the wall as it is mapped, which noise has turned by a few mrad
        across = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        along = np.eye(6)[[2, 3, 4]]
        assert located.blind.shape == (3, 6)
        for covariance in (located.covariance, found[-1].covariance):
            assert across @ covariance @ across < 0.01**2
            assert (np.einsum("ni,ij,nj->n", along, covariance, along) > 0.1**2).all()
    else:
        assert [tracked.state for tracked in found] == ["started", *["tracked"] * 11]
        assert not len(located.blind)
        assert (located.covariance[3:, 3:].diagonal() < 0.01**2).all()


def look_along_bare_walls(
    forward: float, rng: np.random.Generator, lens: PinholeCamera, *, kind: str, end: float = np.inf
) -> RgbdFrame:
    """What a structured-light camera sees of unpainted walls, from so far in."""
    columns, rows = np.meshgrid(np.arange(lens.width) - lens.cx, np.arange(lens.height) - lens.cy)
    rays = np.stack([columns / lens.fx, rows / lens.fy, np.ones_like(rows)], axis=-1)
    half = {"corridor": [1.0, 1.1, np.inf], "floor": [np.inf, 0.6, np.inf]}
    if kind == "tunnel":
        depth = 1.2 / np.hypot(rays[..., 0], rays[..., 1])
    else:
        depth = (np.array(half[kind]) / np.abs(rays)).min(axis=-1)
    if kind == "floor":
        depth[rays[..., 1] <= 0.0] = np.inf
    depth = np.minimum(depth, end - forward)
    with np.errstate(divide="ignore"):
        disparity = 43.5 / depth + 0.0625 * rng.standard_normal(depth.shape)
    depth = 43.5 / np.maximum(np.round(8.0 * disparity) / 8.0, 1.0)
    grey = np.clip(128.0 + 2.0 * rng.standard_normal(depth.shape), 0, 255).astype(np.uint8)
    seen = np.where(depth < 4.5, depth, 0.0).astype(np.float32)
    return RgbdFrame.of(np.repeat(grey[..., None], 3, axis=2), seen, forward / 0.6)


@pytest.mark.parametrize(("kind", "n_blind"), [("corridor", 1), ("tunnel", 2), ("floor", 3)])
def test_bare_walls_do_not_say_how_far_along_them_the_camera_is(
    kind: str, n_blind: int, rng: np.random.Generator
) -> None:
    """A camera flies at 0.6 m/s, of which nothing tells: its pose is as unsure as its speed, and the walls are one."""
    lens = PinholeCamera(200.0, 200.0, 119.5, 89.5, (), 1.0, 240, 180)
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0), settings=SETTINGS)
    found = [mapper.add(look_along_bare_walls(0.02 * k, rng, lens, kind=kind)) for k in range(25)]
    assert [tracked.state for tracked in found[4:]] == ["sliding"] * 21
    off = found[-1].T_world_camera[:3, 3] - [0.0, 0.0, 0.48]
    spread = np.sqrt(found[-1].covariance.diagonal()[3:])
    assert found[-1].located is not None
    assert len(found[-1].located.blind) == n_blind
    assert spread[2] > 0.2  # a speed of half a metre a second, over 0.8 s
    assert abs(off[2]) < 2.5 * spread[2]
    if kind != "floor":
        assert (spread[:2] < 0.05).all()
    # walls that slid along themselves are as thin as if they had not
    points = mapper.mesh().points
    across = {
        "corridor": np.minimum(np.abs(np.abs(points[:, 0]) - 1.0), np.abs(np.abs(points[:, 1]) - 1.1)),
        "tunnel": np.abs(np.hypot(points[:, 0], points[:, 1]) - 1.2),
        "floor": np.abs(points[:, 1] - 0.6),
    }
    assert np.median(across[kind]) < 0.02


def test_at_the_end_of_a_bare_corridor_the_camera_is_sure_again(rng: np.random.Generator) -> None:
    lens = PinholeCamera(200.0, 200.0, 119.5, 89.5, (), 1.0, 240, 180)
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0), settings=SETTINGS)
    forward = 0.02 * np.arange(60)
    found = [mapper.add(look_along_bare_walls(z, rng, lens, kind="corridor", end=4.0)) for z in forward]
    assert {tracked.state for tracked in found[:3]} == {"started", "sliding"}
    assert [tracked.state for tracked in found[-20:]] == ["tracked"] * 20
    along = [tracked.T_world_camera[2, 3] for tracked in found]
    assert along[-1] - along[-20] == pytest.approx(0.02 * 19, abs=0.01)
    assert found[-1].covariance[5, 5] < 0.005**2 + (0.01 * along[-1]) ** 2  # as far as the depth's scale is known


def test_a_noisier_camera_is_followed_too() -> None:
    """One with a third of the usual baseline, whose depth is off by 5 cm at 2.5 m, standard deviation."""
    noise = DepthNoise(throw=16.0, sigma=0.15)
    sequence = rgbd_sequence("room", frames=36, size=(320, 240), period=12.0, seed=3, noise=noise)
    mapper = make_mapper(sequence)
    found = [mapper.add(RgbdFrame.of(f.colour, f.depth, f.stamp)) for f in sequence]
    assert [tracked.state for tracked in found] == ["started", *["tracked"] * 35]
    assert pose_errors(mapper, sequence)[0].max() < 0.015


def test_small_images_show_slanting_walls_too(rng: np.random.Generator) -> None:
    """A pixel of a small image spans several times as much of a wall that is seen aslant as one of a large image."""
    lens = PinholeCamera(130.0, 130.0, 79.5, 59.5, (), 1.0, 160, 120)
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0), settings=SETTINGS)
    found = [mapper.add(look_along_bare_walls(0.02 * k, rng, lens, kind="corridor")) for k in range(6)]
    assert [tracked.state for tracked in found] == ["started", *["sliding"] * 5]
    assert abs(found[-1].T_world_camera[0, 3]) < 0.03


def test_what_is_mapped_beyond_a_bare_corridor_is_as_unsure_as_the_way_there(rng: np.random.Generator) -> None:
    """Nothing tells how far the corridor is walked along until its end comes into view, and that lies at this place."""
    lens = PinholeCamera(200.0, 200.0, 119.5, 89.5, (), 1.0, 240, 180)
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0), settings=SETTINGS)
    forward = 0.04 * np.arange(75)
    found = [mapper.add(look_along_bare_walls(z, rng, lens, kind="corridor", end=6.0)) for z in forward]
    states = [tracked.state for tracked in found]
    assert states[5:45] == ["sliding"] * 40
    assert states[-10:] == ["tracked"] * 10
    last, spread = found[-1], np.sqrt(found[-1].covariance.diagonal()[3:])
    assert spread[2] > 0.3  # a speed of half a metre a second that nobody knows, over three seconds
    assert abs(last.T_world_camera[2, 3] - forward[-1]) < 3.0 * spread[2]
    assert (spread[:2] < 0.1).all()
    # the ends of the stretch, not the steps beyond it, give way where a loop is closed across it
    information = mapper.graph.information
    own = np.array([np.sqrt(np.linalg.inv(W)[5, 5]) for W in information])
    slid = np.array([states[k.frame] == "sliding" for k in mapper.state.memory.keyframes[1:]])
    assert own[slid].max() > 0.05
    assert own[-2:].max() < 0.01


def test_a_map_is_sure_where_it_began_and_less_on_the_other_side() -> None:
    """Once round a room: what lies behind the first view is known by the way there, and coming back by the start."""
    sequence = rgbd_sequence("room", frames=110, size=(160, 120), period=3.3, seed=5)
    mapper = make_mapper(sequence)
    found = [mapper.add(RgbdFrame.of(f.colour, f.depth, f.stamp)) for f in sequence]
    assert all(tracked.is_located for tracked in found)
    turn = [np.sqrt(np.trace(tracked.covariance[:3, :3])) for tracked in found]
    assert turn[90] > 3.0 * turn[2]  # a dozen views away
    assert min(turn[95:]) < 1.2 * turn[2]  # a round takes 99 frames
    first = invert_transform(sequence.poses[0])
    for tracked, T in zip(found[1:], sequence.poses[1:]):
        off = log_motion(tracked.T_world_camera @ invert_transform(first @ T))
        assert off @ np.linalg.solve(tracked.covariance, off) < 40.0  # chi-square of six degrees: 1 in 2 million


def wave_with_range(frame: RgbdFrame) -> RgbdFrame:
    """A frame with what a time-of-flight camera has wrong: a wave of 1 cm over the range."""
    wavy = frame.depth + 0.01 * np.sin(2.0 * np.pi * frame.depth / 0.8)
    return RgbdFrame.of(frame.rgb, wavy.astype(np.float32), frame.time)


@pytest.mark.parametrize("case", ["as it is", "waves", "focal length", "scale"])
def test_how_far_poses_are_off_is_what_their_covariance_says(
    case: str, room: tuple[RgbdSequence, list[RgbdFrame]]
) -> None:
    """With a lens that is known exactly, and one that is off by twice of what is stated to be its error."""
    sequence, frames = room
    lens, errors = sequence.camera, LensErrors(0.0, 0.0, 0.0)
    if case == "waves":
        frames = [wave_with_range(frame) for frame in frames]
    elif case == "focal length":
        lens, errors = replace(lens, fx=1.02 * lens.fx, fy=1.02 * lens.fy), LensErrors(0.0, 0.01, 0.0)
    elif case == "scale":
        lens, errors = replace(lens, depth_scale=1.02), LensErrors(0.01, 0.0, 0.0)
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0, errors=errors), settings=SETTINGS)
    found = [mapper.add(frame) for frame in frames]
    assert all(tracked.is_located for tracked in found)
    first, ratios = invert_transform(sequence.poses[0]), []
    for tracked, T in zip(found[10:], sequence.poses[10:]):
        off = tracked.T_world_camera[:3, 3] - (first @ T)[:3, 3]
        to_camera = adjoint(invert_transform(tracked.T_world_camera))
        spread = (to_camera @ tracked.covariance @ to_camera.T)[3:, 3:]
        ratios.append(np.linalg.norm(off) / np.sqrt(np.trace(spread)))
    assert 0.3 < np.median(ratios) < 4.0


def test_a_place_that_looks_alike_on_a_bare_wall_is_not_where_the_camera_is(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    lens = PinholeCamera(130.0, 130.0, 79.5, 59.5, (), 1.0, 160, 120)
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0), settings=SETTINGS)
    for k in range(8):
        mapper.add(look_along_bare_walls(0.02 * k, rng, lens, kind="corridor"))
    farther = np.eye(4)
    farther[2, 3] = 1.0
    monkeypatch.setattr(Locator, "places", lambda _, states, _asked: [(state, farther) for state in states])
    monkeypatch.setattr(follower, "is_certain", lambda _: False)
    tracked = mapper.add(look_along_bare_walls(0.16, rng, lens, kind="corridor"))
    assert tracked.state == "sliding"
    assert abs(tracked.T_world_camera[2, 3]) < 0.5


def look_along_a_corridor(
    forward: float, rng: np.random.Generator, lens: PinholeCamera
) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth of a painted corridor, 2 m wide and 2.4 m high, from so far in."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    columns, rows = np.meshgrid(np.arange(lens.width) - lens.cx, np.arange(lens.height) - lens.cy)
    rays = np.stack([columns / lens.fx, rows / lens.fy, np.ones_like(rows)], axis=-1)
    walls = np.where(rays > 0.0, [1.0, 1.2, 12.0], [-1.0, -1.2, 12.0]) / rays
    walls[..., 2] -= forward
    depth, wall = walls.min(axis=-1), walls.argmin(axis=-1)
    places = rays * depth[..., None] + [0.0, 0.0, forward]
    paint = gaussian_filter(np.random.default_rng(5).normal(size=(6, 200, 700)), (0.0, 1.0, 1.0))
    side = 2 * wall + (np.take_along_axis(rays, wall[..., None], axis=-1)[..., 0] > 0.0)
    across, along = (
        np.where(wall == 1, places[..., 0], places[..., 1]),
        np.where(wall == 2, places[..., 0], places[..., 2]),
    )
    grey = 128.0 + 160.0 * map_coordinates(paint, [side, 50.0 * across + 100.0, 50.0 * along + 80.0], order=1)
    grey = np.clip(grey + 3.0 * rng.standard_normal(grey.shape), 0, 255).astype(np.uint8)
    depth = depth + 0.0015 * depth**2 * rng.standard_normal(depth.shape)
    return np.repeat(grey[..., None], 3, axis=2), np.where(depth < 4.5, depth, 0.0).astype(np.float32)


@pytest.mark.parametrize("scale", [1, 2])
def test_along_a_corridor_landmarks_on_its_slanting_walls_move_the_camera(rng: np.random.Generator, scale: int) -> None:
    """Of the larger image thousands of normals are paired, whose noise holds the camera where it was."""
    lens = PinholeCamera(
        260.0 * scale, 260.0 * scale, 160 * scale - 0.5, 120 * scale - 0.5, (), 1.0, 320 * scale, 240 * scale
    )
    mapper = Mapper(Camera(lens, readout=0.0, depth_delay=0.0), settings=SETTINGS)
    for number in range(6):
        tracked = mapper.add(RgbdFrame.of(*look_along_a_corridor(0.03 * number, rng, lens), number / 30.0))
        assert tracked.is_located
    np.testing.assert_allclose(tracked.T_world_camera[:3, 3], [0.0, 0.0, 0.15], atol=0.01)


def test_frames_of_one_time_are_no_surer_than_others(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    """A recording without stamps: the camera moves on, and a mean over the frames says less and less of where it is."""
    sequence, frames = room
    spreads = []
    for stamped in (True, False):
        mapper = make_mapper(sequence)
        found = [mapper.add(RgbdFrame.of(f.rgb, f.depth, f.time if stamped else 0.0)) for f in frames[:25]]
        assert all(tracked.state == "tracked" for tracked in found[1:])
        assert pose_errors(mapper, sequence)[0].max() < 0.01
        spreads.append(np.sqrt(found[-1].covariance.diagonal()))
    assert (spreads[1] > 0.8 * spreads[0]).all()


def test_a_map_waits_for_the_first_frame_with_depth(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    sequence, frames = room
    mapper = make_mapper(sequence)
    nothing = RgbdFrame.of(frames[0].rgb, np.zeros_like(frames[0].depth), frames[0].time)
    assert mapper.add(nothing).state == "empty"
    assert mapper.add(frames[1]).state == "started"
    assert mapper.trajectory.frames.tolist() == [1]


def test_a_stranger_is_lost_and_does_not_enter_the_map(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    sequence, frames = room
    mapper = make_mapper(sequence)
    for frame in frames[:5]:
        mapper.add(frame)
    before = mapper.mesh().points
    rows, columns = np.mgrid[:120, :160]
    ball = np.sqrt(np.maximum(0.0, 0.3 - ((columns - 80) / 130.0) ** 2 - ((rows - 60) / 130.0) ** 2))
    stranger = RgbdFrame.of(np.full((120, 160, 3), 90, np.uint8), (3.4 - 4.0 * ball).astype(np.float32), frames[5].time)
    found = mapper.add(stranger)
    assert found.state == "lost"
    assert not found.is_located
    np.testing.assert_array_equal(mapper.mesh().points, before)
    assert mapper.add(frames[6]).state in ("tracked", "relocated")


def test_relocation_far_from_the_prediction(
    mapped: Mapper, room: tuple[RgbdSequence, list[RgbdFrame]], tmp_path: Path
) -> None:
    """A map that was read knows its last pose; the camera comes back elsewhere."""
    sequence, frames = room
    again = Mapper.load(mapped.save(tmp_path / "map.npz"))
    states = [again.add(RgbdFrame.of(frames[k].rgb, frames[k].depth, 1e6 + k / 30)).state for k in range(3)]
    assert states[0] in ("tracked", "relocated")
    T = again.trajectory.T_world_camera[-3:]
    truth = invert_transform(sequence.poses[0]) @ sequence.poses[:3]
    assert np.linalg.norm(T[:, :3, 3] - truth[:, :3, 3], axis=1).max() < 0.02


def test_save_and_load_keep_everything(mapped: Mapper, tmp_path: Path) -> None:
    read = Mapper.load(mapped.save(tmp_path / "map.npz"))
    np.testing.assert_array_equal(read.mesh().points, mapped.mesh().points)
    np.testing.assert_array_equal(read.trajectory.T_world_camera, mapped.trajectory.T_world_camera)
    assert read.settings == mapped.settings
    assert len(read.state.views) == len(mapped.state.views)
    np.testing.assert_array_equal(read.state.views[-1].grey, mapped.state.views[-1].grey)
    (tmp_path / "bad.npz").write_bytes(b"nothing")
    with pytest.raises(FormatError, match="is no NPZ archive, or is damaged"):
        Mapper.load(tmp_path / "bad.npz")


def test_two_cameras_with_their_own_clocks_make_one_map(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    """The second camera is the first, turned by its place on the body, half a frame later and on another clock."""
    sequence, frames = room
    place = np.eye(4)
    place[:3, 3] = [0.03, 0.0, 0.0]
    cameras = [
        Camera(sequence.camera, readout=0.0, depth_delay=0.0),
        Camera(sequence.camera, place, clock_offset=-100.0, readout=0.0, depth_delay=0.0),
    ]
    truth = invert_transform(sequence.poses[0])
    shifted = rgbd_sequence("room", frames=20, size=(160, 120), period=16.0, seed=3)
    moved = RgbdSequence(
        **{name: getattr(shifted, name) for name in shifted.__slots__} | {"poses": shifted.poses @ place}
    )
    mapper = Mapper(cameras, settings=SETTINGS)
    for k in range(12):
        if k % 2 == 0:
            mapper.add(frames[k])
        else:
            f = moved[k]
            mapper.add(RgbdFrame.of(f.colour, f.depth, f.stamp + 100.0, camera=1))
    found = mapper.trajectory
    expected = np.array([truth @ sequence.poses[k] @ (place if k % 2 else np.eye(4)) for k in range(12)])
    assert np.linalg.norm(found.T_world_camera[:, :3, 3] - expected[:, :3, 3], axis=1).max() < 0.01
    assert np.diff(found.times).max() < 0.05


def test_occupancy_and_elevation_agree_with_the_scene() -> None:
    sequence = rgbd_sequence("terrain", frames=24, size=(160, 120), period=16.0, seed=1)
    mapper = make_mapper(sequence, voxel_size=0.03)
    for f in sequence:
        mapper.add(RgbdFrame.of(f.colour, f.depth, f.stamp))
    ground = mapper.elevation(cell=0.1)
    rows, columns = np.nonzero(np.isfinite(ground.values))
    xyz = np.column_stack([ground.x.values[columns], ground.y.values[rows], ground.values[rows, columns]])
    T = sequence.poses[0] @ ground.attrs["T_world_map"]
    world = xyz @ T[:3, :3].T + T[:3, 3]
    off = sequence.scene.distance_to_surface(world)
    assert len(off) > 150
    assert np.median(np.abs(off)) < 0.02
    occupancy = mapper.occupancy(cell=0.1)
    assert (occupancy.cells == 0).sum() > 100
    np.testing.assert_allclose(occupancy.T_world_map, ground.attrs["T_world_map"])


def test_refusals(room: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    sequence, frames = room
    mapper = make_mapper(sequence)
    with pytest.raises(ParameterError, match=r"frame\.camera is 3"):
        mapper.add(RgbdFrame.of(frames[0].rgb, frames[0].depth, 0.0, camera=3))
    with pytest.raises(ShapeError, match="rgb has shape"):
        mapper.add(RgbdFrame.of(frames[0].rgb[:50], frames[0].depth, 0.0))
    with pytest.raises(ShapeError, match="the camera says"):
        mapper.add(RgbdFrame.of(None, frames[0].depth[:50], 0.0))
    with pytest.raises(ParameterError, match="time is nan"):
        RgbdFrame.of(frames[0].rgb, frames[0].depth, float("nan"))
    with pytest.raises(ParameterError, match="depth_time is inf"):
        RgbdFrame(0.0, float("inf"), frames[0].rgb, frames[0].depth)
    for colour in (frames[0].rgb / 255.0, frames[0].rgb.astype(np.uint16) * 257):
        with pytest.raises(ShapeError, match="Scale and convert it"):
            RgbdFrame.of(colour, frames[0].depth, 0.0)
        with pytest.raises(ShapeError, match="expected uint8"):
            RgbdFrame(0.0, 0.0, colour, frames[0].depth)
    wide = RgbdFrame.of(frames[0].rgb.astype(np.int64), frames[0].depth, 0.0)
    np.testing.assert_array_equal(wide.rgb, frames[0].rgb)
    with pytest.raises(ParameterError, match="terms is 'magic'"):
        MapperSettings(terms="magic")
    with pytest.raises(ParameterError, match="empty sequence"):
        Mapper([])


@pytest.mark.parametrize(("terms", "reach"), [("planes", 0.15), ("features", 0.02), ("two_stage", 0.15)])
def test_each_kind_of_term_alone_locates_frames(
    room: tuple[RgbdSequence, list[RgbdFrame]], mapped: Mapper, terms: str, reach: float
) -> None:
    """The view has few planes, along which planes alone slide; both together don't."""
    sequence, frames = room
    mapper = make_mapper(sequence, terms=terms)
    for frame in frames[:8]:
        assert mapper.add(frame).is_located
    alone = pose_errors(mapper, sequence)[0].max()
    assert pose_errors(mapped, sequence)[0][:8].max() < alone + 0.002 < reach  # noise of 2 mm at a metre


def test_real_sequence_beats_the_bar(real_data: Path) -> None:
    """A hand-held structured-light camera that turns quickly: every frame, its shutter and its clocks."""
    from seismo3d.robot import read_sequence

    sequence = read_sequence(real_data / "rgbd/tum_fr1_rpy_a")
    mapper = Mapper(sequence.camera)
    for frame in sequence:
        mapper.add(frame)
    found = mapper.trajectory
    assert len(found) == 150
    truth = np.loadtxt(real_data / "rgbd/tum_fr1_rpy_a/groundtruth.txt")
    nearest = np.abs(found.times[:, None] - truth[None, :, 0]).argmin(axis=1)
    p, q = found.T_world_camera[:, :3, 3], truth[nearest, 1:4]
    a, b = p - p.mean(axis=0), q - q.mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    assert np.sqrt(((b - a @ R.T) ** 2).sum(axis=1).mean()) < 0.015
    assert mapper.cameras[0].readout == pytest.approx(0.033, abs=0.008)
