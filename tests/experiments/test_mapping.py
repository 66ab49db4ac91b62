from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FormatError
from seismo3d.experiments.mapping import measure_trajectory, read_truth
from seismo3d.geometry.rotations import exp_rotation, make_transform
from seismo3d.robot.trajectory import Trajectory


@pytest.fixture
def way(rng: np.random.Generator) -> np.ndarray:
    return np.array([make_transform(exp_rotation(0.3 * rng.normal(size=3)), rng.normal(size=3)) for _ in range(40)])


def test_the_world_of_a_trajectory_does_not_matter(way: np.ndarray) -> None:
    moved = make_transform(exp_rotation([0.4, -0.2, 1.0]), [3.0, 2.0, 1.0]) @ way
    errors = measure_trajectory(way, moved)
    assert max(errors.position, errors.rotation, errors.step_position, errors.step_rotation) < 1e-6


def test_known_errors(way: np.ndarray) -> None:
    """Every pose but the first turned by 0.1 about its own axis: positions stay, rotations are off by 0.1."""
    turned = way.copy()
    turned[1:] = turned[1:] @ make_transform(exp_rotation([0.0, 0.1, 0.0]), np.zeros(3))
    errors = measure_trajectory(way, turned, step=39)
    assert errors.position < 1e-9
    assert errors.rotation == pytest.approx(0.1 * np.sqrt(39 / 40), rel=1e-6)
    assert errors.step_rotation == pytest.approx(0.1, rel=1e-6)
    assert errors.step_position < 1e-9
    assert np.isnan(measure_trajectory(way, turned, step=40).step_position)


def test_truth_is_read_as_trajectories_are_written(way: np.ndarray, tmp_path: Path) -> None:
    times = np.arange(40) / 30 + 1e9
    Trajectory(times, way, np.arange(40), np.zeros(40, np.int64)).save_tum(tmp_path / "t.txt")
    poses, near = read_truth(tmp_path / "t.txt", np.append(times + 0.004, 0.0))
    np.testing.assert_allclose(poses, way, atol=2e-6)
    assert near.tolist() == [True] * 40 + [False]
    with pytest.raises(FormatError, match="no pose within"):
        read_truth(tmp_path / "t.txt", np.zeros(2))
