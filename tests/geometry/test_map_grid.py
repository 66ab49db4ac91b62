from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import GeometryError, ParameterError
from seismo3d.geometry.map_grid import (
    MapGrid,
    as_six,
    elevation_values,
    refuse_apart,
    refuse_other_systems,
)


def test_places_and_map_are_inverse():
    grid = MapGrid((50, 60), (3.0, 0.4, 100.0, 0.3, -2.0, 900.0), "EPSG:32611", "metre")
    places = np.array([[0.0, 0.0], [10.5, 3.25]])
    np.testing.assert_allclose(grid.to_places(grid.to_map(places)), places, atol=1e-9)
    np.testing.assert_allclose(grid.to_map([[-0.5, -0.5]]), [[100.0, 900.0]])


def test_blocks_cover_the_same_ground():
    grid = MapGrid((50, 60), (2.0, 0.0, 100.0, 0.0, -2.0, 900.0), "", "metre")
    np.testing.assert_allclose(grid.reduced(2).to_map([[0.0, 0.0]]), grid.to_map([[0.5, 0.5]]))


def test_degrees_have_metres():
    grid = MapGrid((10, 10), (0.001, 0.0, 10.0, 0.0, -0.001, 60.005), "EPSG:4326", "degree")
    assert grid.metres_per_unit[0] == pytest.approx(0.5 * grid.metres_per_unit[1], rel=1e-3)


def test_metres_of_web_maps_are_those_on_the_ground():
    north = 6_378_137.0 * np.arcsinh(np.tan(np.radians(60.0)))  # y of 60 degrees north
    grid = MapGrid((100, 100), (30.0, 0.0, 1e6, 0.0, -30.0, north + 1500.0), "EPSG:3857", "metre")
    np.testing.assert_allclose(grid.metres_per_unit, 0.5, rtol=1e-4)
    np.testing.assert_allclose(grid.cell_m, 15.0, rtol=1e-4)


def test_refusals():
    with pytest.raises(ParameterError, match="cells have an area"):
        as_six((0.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    with pytest.raises(GeometryError, match="every cell is nodata"):
        elevation_values(np.full((9, 9), np.nan))
    here = MapGrid((9, 9), (1.0, 0, 0, 0, -1.0, 0), "EPSG:32611", "metre")
    there = MapGrid((9, 9), (1.0, 0, 0, 0, -1.0, 0), "EPSG:32612", "metre")
    with pytest.raises(GeometryError, match="a is in EPSG:32611 and b in EPSG:32612"):
        refuse_other_systems(here, there, ("a", "b"))
    with pytest.raises(GeometryError, match="b has no georeference and a has one"):
        refuse_other_systems(here, MapGrid.from_elevation(np.ones((9, 9))), ("a", "b"))


def test_maps_that_touch_do_not_overlap():
    here = MapGrid((10, 20), (2.0, 0, 100.0, 0, -2.0, 50.0), "EPSG:32611", "metre")
    beside = MapGrid((10, 20), (2.0, 0, 140.0, 0, -2.0, 50.0), "EPSG:32611", "metre")
    # rows that run south to north cover the same ground
    mirrored = MapGrid((10, 20), (2.0, 0, 139.0, 0, 2.0, 30.0), "EPSG:32611", "metre")
    with pytest.raises(GeometryError, match="a covers x 100 to 140, y 30 to 50; b covers x 140 to 180"):
        refuse_apart(here, beside, ("a", "b"))
    refuse_apart(here, mirrored, ("a", "b"))
    refuse_apart(here, MapGrid.from_elevation(np.ones((9, 9))), ("a", "b"))
