"""Errors of trajectories are those that the evo package computes."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments.mapping import measure_trajectory
from seismo3d.geometry.rotations import exp_rotation, make_transform

pytest.importorskip("evo")


@pytest.fixture
def ways(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A path, and the same as a drifting, shaking tracker would find it, in another world."""
    times = np.linspace(0.0, 2.0 * np.pi, 60)
    truth = np.array(
        [make_transform(exp_rotation([0.2 * np.sin(t), t, 0.0]), [np.cos(t), 0.2 * t, np.sin(2 * t)]) for t in times]
    )
    world = make_transform(exp_rotation([0.3, -0.2, 0.5]), [1.0, 2.0, 3.0])
    shaken = [
        T @ make_transform(exp_rotation(0.01 * rng.normal(size=3) + [0.0, 2e-4 * k, 0.0]), 0.02 * rng.normal(size=3))
        for k, T in enumerate(truth)
    ]
    return truth, world @ np.array(shaken)


def test_absolute_error_is_that_of_evo(ways: tuple[np.ndarray, np.ndarray]) -> None:
    from evo.core import metrics
    from evo.core.trajectory import PosePath3D

    truth, found = (PosePath3D(poses_se3=list(poses)) for poses in ways)
    found.align(truth)
    measured = metrics.APE(metrics.PoseRelation.translation_part)
    measured.process_data((truth, found))
    errors = measure_trajectory(*ways)
    assert errors.position == pytest.approx(measured.get_statistic(metrics.StatisticsType.rmse), rel=1e-6)


def test_relative_error_is_that_of_evo(ways: tuple[np.ndarray, np.ndarray]) -> None:
    from evo.core import metrics
    from evo.core.trajectory import PosePath3D

    truth, found = (PosePath3D(poses_se3=list(poses)) for poses in ways)
    errors = measure_trajectory(*ways, step=10)
    for relation, ours in (
        (metrics.PoseRelation.translation_part, errors.step_position),
        (metrics.PoseRelation.rotation_angle_rad, errors.step_rotation),
    ):
        measured = metrics.RPE(relation, delta=10, delta_unit=metrics.Unit.frames, all_pairs=True)
        measured.process_data((truth, found))
        assert ours == pytest.approx(measured.get_statistic(metrics.StatisticsType.rmse), rel=1e-6)
