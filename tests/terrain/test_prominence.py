from __future__ import annotations

import numpy as np
import pytest
from fake_terrain import make_scarp
from scipy import ndimage

from seismo3d.terrain import LineamentSettings, lineaments
from seismo3d.terrain.evidence import measure_levels
from seismo3d.terrain.prominence import measure_prominence
from seismo3d.terrain.tracing import TracedLine


def down_the_middle(n, column):
    rows = np.arange(5.0, n - 5.0)
    return TracedLine(np.column_stack([rows, np.full(len(rows), float(column))]), np.full(len(rows), 5.0), "step", 1)


def ripples(n):
    """Straight ridges 20 cells apart, all alike."""
    return np.broadcast_to(2.0 * np.sin(np.arange(n) / 20.0 * 2.0 * np.pi), (n, n)).copy()


def test_a_lone_scarp_stands_out_and_one_of_many_ridges_does_not(rng):
    alone = measure_levels(make_scarp(n=200), 2, 48.0)
    many = measure_levels(ripples(200) + rng.normal(0.0, 0.01, (200, 200)), 2, 48.0)
    assert measure_prominence(down_the_middle(200, 99.5), alone) > 10.0
    assert measure_prominence(down_the_middle(200, 100.0), many) < 3.0
    assert measure_prominence(down_the_middle(200, 40.0), alone) < 4.0


def test_a_ridge_is_no_trough():
    i, j = np.mgrid[:200, :200].astype(float)
    rough = ndimage.gaussian_filter(np.random.default_rng(0).normal(size=i.shape), 3.0) * 0.1
    groove = 2.0 * np.exp(-0.5 * ((j - 100.0) / 2.5) ** 2)
    trough, ridge = (
        measure_prominence(down_the_middle(200, 100.0), measure_levels(rough + sign * groove, 1, 48.0))
        for sign in (-1.0, 1.0)
    )
    assert trough > ridge > 0.0


def test_too_few_paths_beside_are_no_measure():
    levels = measure_levels(make_scarp(n=200)[:, 88:112], 1, 48.0)
    assert np.isnan(measure_prominence(down_the_middle(200, 12.0), levels))


@pytest.mark.parametrize("least", [0.0, 1000.0])
def test_the_search_keeps_what_stands_out(least):
    found = lineaments(make_scarp(n=200), settings=LineamentSettings(least_prominence=least))
    assert bool(found.lines) == (least == 0.0)
    assert all(line.prominence > 0.0 for line in found.lines)
