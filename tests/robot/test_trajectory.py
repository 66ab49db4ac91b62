"""Poses at the stamps of colour, and the file of them."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import make_transform
from seismo3d.robot.trajectory import TimedPose, Trajectory


def timed(stamp: float, time: float, x: float, frame: int) -> TimedPose:
    return TimedPose(stamp, time, make_transform(np.eye(3), [x, 0.0, 0.0]), np.zeros(6), frame)


def test_poses_are_those_at_the_stamps() -> None:
    poses = [timed(0.1 * k + 0.02, 0.1 * k, 0.5 * k, k) for k in range(4)]
    path = Trajectory.of(poses)
    np.testing.assert_allclose(path.times, [0.02, 0.12, 0.22, 0.32])
    np.testing.assert_allclose(path.T_world_camera[:3, 0, 3], [0.1, 0.6, 1.1], atol=1e-12)
    assert path.length == pytest.approx(1.4)  # the last one has no pose after it, and stands still


@pytest.mark.parametrize("lag", [0.0, 0.02])
def test_frames_of_one_time_are_passed_over(lag: float) -> None:
    times = [0.0, 0.0, 0.1, 0.1, 0.2]
    poses = [timed(time + lag, time, 5.0 * time, k) for k, time in enumerate(times)]
    np.testing.assert_allclose(Trajectory.of(poses).T_world_camera[:4, 0, 3], 5.0 * (np.array(times) + lag)[:4])
