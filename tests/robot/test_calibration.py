from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from seismo3d.errors import ShapeError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import exp_rotation, make_transform
from seismo3d.robot import Camera, RgbdFrame, calibrate_timing
from seismo3d.robot.calibration import _vertex
from seismo3d.synthetic.rgbd import RgbdSequence, rgbd_sequence

READOUT, DELAY, BANDS = 0.03, 0.02, 4


@pytest.fixture(scope="module")
def scene() -> RgbdSequence:
    return rgbd_sequence("room", frames=1, size=(400, 300), seed=4)


def shake(scene: RgbdSequence, stamps: np.ndarray) -> RgbdSequence:
    """The room seen by a camera that turns to and fro, at 2 rad/s at most."""
    turns = [exp_rotation([0.18 * np.sin(7.0 * t), 0.22 * np.sin(8.0 * t), 0.0]) for t in stamps]
    poses = np.array([scene.poses[0] @ make_transform(R, np.zeros(3)) for R in turns])
    held = {f.name: getattr(scene, f.name) for f in fields(scene)}
    return RgbdSequence(**{**held, "stamps": stamps, "poses": poses})


def rolled(scene: RgbdSequence, end: float) -> RgbdFrame:
    """A frame whose bands of rows were exposed one after the other."""
    rows = np.array_split(np.arange(300), BANDS)
    moved = shake(scene, np.array([end + (part.mean() / 300 - 1.0) * READOUT for part in rows]))
    colour, depth = np.zeros((300, 400, 3), np.uint8), np.zeros((300, 400), np.float32)
    for number, part in enumerate(rows):
        frame = moved[number]
        colour[part], depth[part] = frame.colour[part], frame.depth[part]
    return RgbdFrame.of(colour, depth, end)


def test_shutter_is_found_from_frames_alone(scene: RgbdSequence) -> None:
    frames = [rolled(scene, k / 30) for k in range(14)]
    found = calibrate_timing(frames, Camera(scene.camera, depth_delay=0.0))
    assert found.readout == pytest.approx(READOUT, abs=0.012)
    assert found.misfit < found.misfit_before - 0.05
    assert found.applied(Camera(scene.camera)).readout == found.readout


def test_delay_of_depth_is_found_from_frames_alone(scene: RgbdSequence) -> None:
    stamps = np.arange(36) / 30
    colour, depth = shake(scene, stamps), shake(scene, stamps - DELAY)
    frames = [RgbdFrame.of(colour[k].colour, depth[k].depth, stamps[k]) for k in range(36)]
    found = calibrate_timing(frames, Camera(scene.camera, readout=0.0))
    assert found.depth_delay == pytest.approx(DELAY, abs=0.008)


def test_a_global_shutter_is_left_alone(scene: RgbdSequence) -> None:
    moved = shake(scene, np.arange(10) / 30)
    frames = [RgbdFrame.of(f.colour, f.depth, f.stamp) for f in moved]
    found = calibrate_timing(frames, Camera(scene.camera))
    assert found.readout < 0.012
    assert abs(found.depth_delay) < 0.008


def test_what_the_camera_states_is_kept(scene: RgbdSequence) -> None:
    frames = [RgbdFrame.of(f.colour, f.depth, f.stamp) for f in shake(scene, np.arange(3) / 30)]
    found = calibrate_timing(frames, Camera(scene.camera, readout=0.01, depth_delay=-0.005))
    assert (found.readout, found.depth_delay) == (0.01, -0.005)


def test_sizes_are_told_as_they_are() -> None:
    depth, lens = np.ones((48, 64)), PinholeCamera(60.0, 60.0, 31.5, 23.5, width=128, height=96)
    with pytest.raises(ShapeError, match=r"rgb has shape \(24, 32, 3\) and depth \(48, 64\)"):
        calibrate_timing([RgbdFrame.of(np.zeros((24, 32, 3), np.uint8), depth, 0.0)], Camera(lens))
    with pytest.raises(ShapeError, match=r"depth has shape \(48, 64\); the camera says \(96, 128\)"):
        calibrate_timing([RgbdFrame.of(None, depth, 0.0)], Camera(lens))


def test_vertex_of_a_parabola_stays_among_its_points() -> None:
    x = [-1.0, 0.0, 1.0]
    assert _vertex(x, [(v - 0.3) ** 2 for v in x]) == pytest.approx(0.3)
    assert _vertex(x, [(v - 5.0) ** 2 for v in x]) == 1.0
    assert _vertex(x, [1.0, 3.0, 0.5]) == 1.0  # opens downwards: the least point
