"""Which located frames are believed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from seismo3d.geometry.rotations import invert_transform
from seismo3d.robot import Camera, Mapper, MapperSettings, RgbdFrame
from seismo3d.robot.locator import is_sound
from seismo3d.robot.tracking import Located
from seismo3d.synthetic.rgbd import rgbd_sequence


def located_by(n_landmarks: int, spread: float, *, share: float = 0.05) -> Located:
    weights = np.ones(n_landmarks)
    return Located(np.eye(4), np.eye(6), 30, n_landmarks, share, 1.0, spread, True, None, weights, np.empty((0, 6)))


@pytest.mark.parametrize(
    ("n_landmarks", "spread", "n_lost", "sound"),
    [
        (20, 4.0, 0, True), (19, 4.0, 0, False), (10, 0.5, 0, True), (9, 0.5, 0, False), (10, 1.5, 0, False),
        (10, 0.5, 1, False), (20, 0.5, 1, True), (20, 4.0, 1, False), (40, 4.0, 1, True), (150, 6.0, 0, False),
    ],
)  # fmt: skip
def test_landmarks_that_meet_closely_need_be_fewer(n_landmarks: int, spread: float, n_lost: int, sound: bool) -> None:
    assert is_sound(located_by(n_landmarks, spread), np.eye(4), n_lost=n_lost) is sound


def test_half_of_the_depth_missing_in_blobs_leaves_enough() -> None:
    """Of every fourth frame of a fast round: few vertices lie where both the map and the frame have depth."""
    sequence = rgbd_sequence("room", frames=13, size=(320, 240), period=9.0)
    mapper = Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=MapperSettings())
    for number in range(0, 13, 4):
        frame = sequence[number]
        holes = gaussian_filter(np.random.default_rng(number).standard_normal(frame.depth.shape), 8.0) < 0.0
        depth = np.where(holes, 0.0, frame.depth).astype(np.float32)
        found = mapper.add(RgbdFrame.of(frame.colour, depth, frame.stamp))
        assert found.is_located
    truth = invert_transform(sequence.poses[0]) @ sequence.poses[12]
    np.testing.assert_allclose(found.T_world_camera[:3, 3], truth[:3, 3], atol=0.01)
