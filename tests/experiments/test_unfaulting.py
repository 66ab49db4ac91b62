from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments.unfaulting import correlate_sides, measure, run_cube


def wall(shape=(24, 24, 64)):
    """Places of an upright surface between two crosslines, and its normals."""
    rows, samples = np.meshgrid(np.arange(4, shape[0] - 4.0), np.arange(14, shape[2] - 14.0), indexing="ij")
    points = np.column_stack([rows.ravel(), np.full(rows.size, 12.0), samples.ravel()])
    return points, np.tile([0.0, 1.0, 0.0], (len(points), 1))


@pytest.mark.parametrize(("shift", "expected"), [(0.0, 1.0), (8.0, -1.0), (16.0, 1.0), (4.0, 0.0)])
def test_sides_of_layers_correlate_as_their_shift_lets_them(shift, expected):
    j, k = np.meshgrid(np.arange(24.0), np.arange(64.0), indexing="ij")
    layers = np.sin(2 * np.pi * (k - np.where(j > 12, shift, 0.0) + 0.3) / 16.0)
    found = correlate_sides(np.broadcast_to(layers, (24, 24, 64)), *wall())
    np.testing.assert_allclose(found, expected, atol=0.2)


def test_sides_without_data_are_not_told():
    points, normals = wall()
    volume = np.random.default_rng(1).normal(size=(24, 24, 64))
    volume[:, 16] = 0.0
    assert np.isnan(correlate_sides(volume, points, normals)).all()


def test_off_the_faults_is_where_none_is_near():
    j, k = np.meshgrid(np.arange(64.0), np.arange(64.0), indexing="ij")
    layers = np.sin(2 * np.pi * (k - np.where(j > 32, 8.0, 0.0)) / 16.0) + 2.0
    points, normals = wall((24, 64, 64))
    points[:, 1] = 32.0
    on, off = measure(np.broadcast_to(layers, (24, 64, 64)), [points], [normals])
    assert on < -0.9
    assert off > 0.99


def test_layers_come_together_nearly_as_well_as_by_the_exact_inverse():
    found = run_cube("small_throws", 2005, shape=(64, 64, 64))
    assert found.before < 0.6 < found.after
    assert found.off > 0.7
    assert found.exact > found.before + 0.2
    assert found.exact < found.exact_off
    assert found.after > found.exact - 0.1
