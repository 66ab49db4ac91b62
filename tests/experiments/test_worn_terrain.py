from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments._kernels_erosion import cut_in, drain
from seismo3d.experiments.worn_terrain import make_worn_mountains


def drained(z):
    n = z.size
    receiver, order, area = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    drain(z, receiver, order, area)
    return receiver, order, area


def test_water_runs_down_a_trough_and_leaves_at_its_mouth():
    i, j = np.mgrid[:9, :9].astype(float)
    receiver, order, area = drained(0.5 * i + np.abs(j - 4.0))
    # down the middle column, to the edge
    assert receiver[5 * 9 + 4] == 4 * 9 + 4
    assert area[4] == area.max()
    assert area[receiver == np.arange(81)].sum() == 81.0
    place = np.empty(81, np.int64)
    place[order] = np.arange(81)
    below = receiver != np.arange(81)
    assert (place[receiver[below]] < place[np.flatnonzero(below)]).all()


def test_rivers_wear_down_to_what_they_drain_to_and_no_deeper():
    i, j = np.mgrid[:9, :9].astype(float)
    z = 0.5 * i + np.abs(j - 4.0)
    before, (receiver, order, area) = z.copy(), drained(z)
    cut_in(z.ravel(), receiver, order, area, np.full(81, 0.5))
    assert (z <= before).all()
    assert (z.ravel() >= z.ravel()[receiver]).all()
    # dz = k sqrt(A) slope dt, implicit: (before - after) = k sqrt(A) (after - below) / distance
    own = 5 * 9 + 4
    fall = 0.5 * np.sqrt(area[own]) * (z.ravel()[own] - z.ravel()[receiver[own]])
    assert before.ravel()[own] - z.ravel()[own] == pytest.approx(fall)


def test_weak_rock_makes_low_ground():
    z, distance = make_worn_mountains(96, np.random.default_rng(0), weakness=3.0, strike_deg=40.0)
    assert z.shape == distance.shape == (96, 96)
    assert z[np.abs(distance) < 2.0].mean() < 0.95 * z[np.abs(distance) > 15.0].mean()
    same, _ = make_worn_mountains(96, np.random.default_rng(0), weakness=3.0, strike_deg=40.0)
    np.testing.assert_array_equal(z, same)
