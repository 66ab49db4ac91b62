from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from seismo3d.experiments.terrain_forms import make_dunes
from seismo3d.experiments.worn_terrain import make_worn_mountains
from seismo3d.terrain import lineaments
from seismo3d.terrain.contours import follows_contour
from seismo3d.terrain.valleys import measure_floor

SIDE = 240
"""Rows and columns of made-up ground."""
DOWNWARDS, RIGHT = np.mgrid[:SIDE, :SIDE].astype(float)
DOWN = np.column_stack([np.arange(20.0, 220.0), np.full(200, 120.0)])
ACROSS = DOWN[:, ::-1].copy()


@pytest.fixture(scope="module")
def ridges():
    rough = ndimage.gaussian_filter(np.random.default_rng(2).normal(size=(SIDE, SIDE)), 6.0)
    return 12.0 * rough / rough.std()


def notched(ground, column, floor):
    """Ground with a valley down a column whose floor is given."""
    share = np.exp(-0.5 * ((RIGHT - column) / 3.0) ** 2)
    return ground * (1.0 - share) + floor * share


def test_the_floor_of_a_valley_over_a_divide(ridges):
    saddle = -20.0 + 10.0 * np.cos((DOWNWARDS - 120.0) / 40.0)
    floor = measure_floor(notched(ridges, 120.0, saddle), DOWN)
    assert floor.lower == 0.0
    assert floor.unevenness < 0.8
    assert floor.turn_back > 0.8
    assert floor.crosses_divides


def test_the_floor_of_a_river_only_falls(ridges):
    floor = measure_floor(notched(ridges, 120.0, -20.0 - 0.1 * DOWNWARDS), DOWN)
    assert floor.turn_back < 0.02
    assert not floor.crosses_divides


def test_a_way_over_ridges_and_valleys_is_no_valley(ridges):
    asides = np.arange(-60.0, 61.0, 10.0)
    ways = [DOWN + np.array([0.0, a]) for a in asides] + [ACROSS + np.array([a, 0.0]) for a in asides]
    # one of ten lies lower than nine of ten beside it
    assert sum(measure_floor(ridges, way).crosses_divides for way in ways) <= 3


def test_too_few_paths_beside_tell_nothing(ridges):
    assert measure_floor(ridges[:, 110:130].copy(), DOWN - np.array([0.0, 110.0])) is None


def test_weak_rock_across_mountains_is_found_and_is_a_valley():
    z, distance = make_worn_mountains(200, np.random.default_rng(3), weakness=3.0, strike_deg=35.0)
    (longest, *others) = lineaments(z).lines
    assert longest.kind == "valley"
    assert not others
    assert longest.strike_deg == pytest.approx(35.0, abs=4.0)
    assert longest.length > 0.8 * 200.0 / np.cos(np.radians(35.0))
    off = np.abs(ndimage.map_coordinates(distance, longest.places[:, ::-1].T, order=1, mode="nearest"))
    assert np.percentile(off, 90) < 3.0


@pytest.mark.parametrize("seed", [0, 1])
def test_water_alone_makes_none(seed):
    z, _ = make_worn_mountains(200, np.random.default_rng(seed))
    total = sum(np.linalg.norm(np.diff(line.places, axis=0), axis=1).sum() for line in lineaments(z).lines)
    assert total <= 0.02 * np.hypot(*z.shape)


def test_troughs_side_by_side_are_none():
    found = lineaments(make_dunes(256, np.random.default_rng(0)))
    assert not [line for line in found.lines if line.kind == "valley"]


def test_the_edge_of_a_terrace_keeps_to_its_height(ridges):
    # a bench of one height through ground that rises and falls on both sides of it
    share = np.exp(-0.5 * ((RIGHT - 120.0) / 4.0) ** 2)
    bench = ridges * (1.0 - share) + (0.5 * np.tanh(RIGHT - 120.0)) * share
    assert follows_contour(ndimage.gaussian_filter(bench, 2.0), DOWN)


def test_a_scarp_goes_up_and_down_with_the_ground(ridges):
    assert not follows_contour(ridges - 3.0 * np.tanh((RIGHT - 120.0) / 3.0), DOWN)


def test_on_a_plain_or_beside_one_nothing_is_said(ridges):
    plain = 0.05 * RIGHT - np.tanh((RIGHT - 120.0) / 3.0)
    assert not follows_contour(plain, DOWN)
    front = np.where(RIGHT < 120.0, 30.0 + ridges, 0.0)
    assert not follows_contour(ndimage.gaussian_filter(front, 2.0), DOWN + np.array([0.0, 4.0]))


def test_a_valley_is_no_terrace(ridges):
    assert not follows_contour(ndimage.gaussian_filter(notched(ridges, 120.0, -40.0), 2.0), DOWN)
