"""Poses at the stamps of colour, and the file of them."""

from __future__ import annotations

from pathlib import Path

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


def test_local_maps_are_told_apart(tmp_path: Path) -> None:
    poses = [timed(k, k, x, k) for k, x in enumerate([0.0, 1.0, 9.0, 9.5, 1.5])]
    path = Trajectory.of(poses, maps=[0, 0, 1, 1, 0])
    assert path.length == pytest.approx(1.5)  # not what lies between the maps
    lines = path.save_tum(tmp_path / "a.txt").read_text().splitlines()
    assert [k for k, line in enumerate(lines) if line.startswith("# local map")] == [1, 4, 7]
    assert lines[4] == "# local map 1"
    assert np.loadtxt(lines).shape == (5, 8)
    assert "local map" not in Trajectory.of(poses).save_tum(tmp_path / "b.txt").read_text()
