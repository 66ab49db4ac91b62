from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import invert_transform
from seismo3d.robot import Camera, Mapper, MapperSettings, RgbdFrame
from seismo3d.robot.ekf import MotionFilter
from seismo3d.robot.frames import Timing
from seismo3d.robot.landmarks import Sightings, time_sightings
from seismo3d.robot.semantic_landmarks import N_MOST, LandmarkBook
from seismo3d.synthetic.rgbd import rgbd_sequence

LENS = PinholeCamera(260.0, 260.0, 159.5, 119.5)


def sightings_of(points: np.ndarray) -> Sightings:
    """What a camera at the origin sees; landmark k of view 0."""
    pixels = LENS.project(points)
    names = np.column_stack([np.zeros(len(points), np.int64), np.arange(len(points))])
    return time_sightings(points, pixels, LENS, np.zeros(6), Timing(), (240, 320), names=names)


@pytest.fixture
def points() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 6), np.linspace(-0.6, 0.6, 5))
    return np.column_stack([x.ravel(), y.ravel(), np.full(30, 2.0)])


def test_landmarks_seen_often_and_in_agreement_enter_the_state(points: np.ndarray) -> None:
    motion, book, seen = MotionFilter(0.0, np.eye(4)), LandmarkBook(), sightings_of(points)
    weights = np.ones(30)
    weights[5] = 0.0  # never where it should be
    for frame in range(1, 8):
        motion.predict(frame / 30)
        own = book.take_in(motion, seen, LENS, np.eye(4))
        assert own.sum() == len(book.names)
        book.learn(motion, seen, weights, np.eye(4))
        assert (len(book.names) > 0) == (frame >= 4)
    assert len(book.names) == N_MOST == len(motion.landmarks)  # bounded, however many there are
    assert (0, 5) not in book.names
    np.testing.assert_allclose(motion.landmarks, points[[k for _, k in book.names]], atol=1e-6)


def test_landmarks_out_of_sight_are_marginalised(points: np.ndarray) -> None:
    motion, book, seen = MotionFilter(0.0, np.eye(4)), LandmarkBook(), sightings_of(points)
    for _ in range(5):
        book.learn(motion, seen, np.ones(30), np.eye(4))
    before = set(book.names)
    nothing = seen.only(np.zeros(30, dtype=bool))
    for _ in range(31):
        assert len(motion.landmarks) == N_MOST
        book.take_in(motion, nothing, LENS, np.eye(4))
    assert len(motion.landmarks) == len(book.names) == 0
    assert motion.covariance.shape == (12, 12)
    book.learn(motion, seen, np.ones(30), np.eye(4))
    assert not before & set(book.names)  # they must be seen often again


def test_without_depth_the_landmarks_hold_the_pose() -> None:
    """Depth fails for half a second while the camera turns by 19 degrees; the colour goes on."""
    sequence = rgbd_sequence("room", frames=46, size=(320, 240), period=10.0, seed=4)
    settings = MapperSettings(voxel_size=0.02)
    first = invert_transform(sequence.poses[0])
    misses = {}
    for filtered in (True, False):
        mapper = Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)
        for k in range(46):
            frame = sequence[k]
            depth, colour = np.nan_to_num(frame.depth), frame.colour
            if k >= 30:
                depth, colour = np.zeros_like(depth), colour if filtered else np.zeros_like(colour)
            found = mapper.add(RgbdFrame.of(colour, depth, frame.stamp))
        assert found.state == "empty"
        misses[filtered] = np.linalg.norm((first @ sequence.poses[45] - found.T_world_camera)[:3, 3])
        spread = np.sqrt(np.trace(found.covariance[3:, 3:]))
        assert misses[filtered] < 4.0 * spread
    assert misses[True] < 0.03
    assert misses[True] < 0.5 * misses[False]
