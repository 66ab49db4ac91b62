from __future__ import annotations

import json

import numpy as np
import pytest
from fake_terrain import make_rivers, make_scarp, place
from scipy import ndimage

from seismo3d.errors import GeometryError, ShapeError
from seismo3d.geometry.map_grid import MapGrid
from seismo3d.terrain import lineaments, scarps, to_geojson, write_lineaments
from seismo3d.terrain.choosing import share_along
from seismo3d.terrain.joining import drop_echoes, fuse_lines, join_lines, part_from
from seismo3d.terrain.lineament_search import LineamentSet, make_lineament
from seismo3d.terrain.tracing import TracedLine


@pytest.fixture(scope="module")
def scarp_map():
    return place(make_scarp(azimuth_deg=20.0))


@pytest.fixture(scope="module")
def found(scarp_map):
    return lineaments(scarp_map)


def test_a_scarp_is_one_line_of_the_right_strike(found):
    longest = found.lines[0]
    assert len(found) == 1
    assert longest.strike_deg == pytest.approx(20.0, abs=2.0)
    assert longest.length > 0.85 * 2000.0 / np.cos(np.radians(20.0))
    assert longest.confidence > 0.9
    # the scarp runs through the middle: the distance of each point from it, in cells
    a = np.radians(20.0)
    off = (longest.places - 99.5) @ [np.cos(a), np.sin(a)]
    assert np.percentile(np.abs(off), 90) < 4.0


def test_no_lineaments_have_no_scarps(scarp_map, found):
    """A set without lines is an answer, not a set that is still to be found."""
    assert scarps(scarp_map, LineamentSet((), None, found.grid)) == ()


def test_its_height_and_facing_are_measured(scarp_map, found):
    (scarp, *_) = scarps(scarp_map, found)
    assert scarp.height_m == pytest.approx(3.0, rel=0.1)
    assert scarp.facing_deg == pytest.approx(110.0, abs=4.0)
    assert np.nanmedian(scarp.height) == pytest.approx(3.0, rel=0.15)
    assert scarp.slope_profile_deg.max() > 2.0


@pytest.mark.parametrize("name", ["hill", "noisy plane", "rivers", "slope"])
def test_nothing_is_found_where_nothing_is(name, rng):
    i, j = np.mgrid[:256, :256].astype(float)
    z = {
        "hill": 80.0 * np.exp(-((i - 120) ** 2 + (j - 140) ** 2) / (2 * 45.0**2)),
        "noisy plane": 0.1 * i + 0.05 * j + rng.normal(0.0, 0.2, i.shape),
        "rivers": make_rivers(),
        "slope": 0.3 * i,
    }[name]
    total = sum(np.linalg.norm(np.diff(line.places, axis=0), axis=1).sum() for line in lineaments(z).lines)
    assert total <= 0.02 * np.hypot(*z.shape)


def test_a_turned_map_gives_a_turned_line(found):
    turned = lineaments(place(np.ascontiguousarray(np.rot90(make_scarp(azimuth_deg=20.0)))))
    assert turned.lines[0].strike_deg == pytest.approx((found.lines[0].strike_deg - 90.0) % 180.0, abs=2.0)


def test_holes_do_not_hide_it(scarp_map, rng):
    holed = scarp_map.copy()
    holed.values[rng.random(holed.shape) < 0.1] = np.nan
    assert lineaments(holed).lines[0].strike_deg == pytest.approx(20.0, abs=2.0)
    assert np.isnan(lineaments(holed).likelihood.values).sum() == np.isnan(holed.values).sum()


def test_cells_that_are_not_square(found):
    z = make_scarp(azimuth_deg=20.0)[::1, ::2]
    flat = place(z)
    flat.attrs["transform"] = (20.0, 0.0, 400_000.0, 0.0, -10.0, 3_800_000.0)
    assert lineaments(flat).lines[0].strike_deg == pytest.approx(found.lines[0].strike_deg, abs=3.0)


def test_lines_on_degrees_and_files(tmp_path, scarp_map, found):
    paths = write_lineaments(tmp_path, found, scarps=scarps(scarp_map, found))
    assert [path.name for path in paths] == [
        "lineaments.geojson", "lineaments.csv", "likelihood.tif", "scarp_profiles.csv",
    ]  # fmt: skip
    made = json.loads(paths[0].read_text())
    lon, lat = np.array(made["features"][0]["geometry"]["coordinates"]).T
    # UTM zone 11 lies between 120 and 114 degrees west
    assert (lon > -120.0).all()
    assert (lon < -114.0).all()
    assert (np.abs(lat - 34.3) < 0.2).all()
    assert made["features"][0]["properties"]["scarp_height_m"] == pytest.approx(3.0, rel=0.1)
    assert to_geojson(lineaments(make_scarp()))["crs"]["properties"]["name"] == "cells (column, row)"


def line(*ends, score=5.0, kind="step", factor=1):
    (a, b) = np.array(ends, dtype=float)
    n = int(np.hypot(*(b - a))) + 1
    return TracedLine(a + np.linspace(0, 1, n)[:, None] * (b - a), np.full(n, score), kind, factor)


def test_pieces_in_line_are_joined_whatever_their_sense():
    pieces = [line((0, 0), (0, 40)), line((0, 90), (0, 50)), line((0, 100), (0, 140)), line((60, 100), (100, 100))]
    joined = join_lines(pieces, gap=15.0)
    assert [round(one.length) for one in joined] == [140, 40]
    assert (np.abs(np.diff(joined[0].places[:, 1])) < 2.0).all()


def test_lines_beside_each_other_are_fused_and_crossing_ones_are_not():
    lines = [line((0, 0), (0, 80), score=9.0), line((3, 50), (3, 150)), line((-40, 60), (40, 60))]
    fused = fuse_lines(lines, near=4.0)
    assert sorted(round(one.length, -1) for one in fused) == [80, 150]
    assert len(drop_echoes([lines[0], line((6, 10), (6, 60))], near=8.0)) == 1


def test_a_line_does_not_go_on_where_it_would_stand_out_less():
    fault, slope = line((0, 0), (0, 80), score=9.0), line((3, 50), (3, 150))
    onwards = line((0, 90), (0, 150))

    def judge(one):
        # what leaves the row of the fault does not stand out
        return 10.0 if np.abs(one.places[:, 0]).max() < 0.5 else 1.0

    assert [round(one.length, -1) for one in fuse_lines([fault, slope], near=4.0, judge=judge)] == [80, 100]
    joined = join_lines([fault, line((4, 84), (9, 140)), onwards], gap=15.0, judge=judge)
    assert [round(one.length, -1) for one in joined] == [150, 60]
    kept = drop_echoes([slope, line((0, 60), (0, 140), score=2.0)], near=8.0, judge=judge)
    assert np.abs(kept[0].places[:, 0]).max() == 0.0
    assert len(kept) == 1


def test_what_a_line_shares_with_another_is_the_others():
    fault, leaving = line((0, 0), (0, 200)), line((0, 60), (40, 250))
    rest = part_from(leaving, [fault], near=8.0)
    assert rest.places[:, 0].min() == pytest.approx(8.0, abs=1.0)
    np.testing.assert_array_equal(rest.places[-1], leaving.places[-1])
    across = line((-40, 100), (40, 100))
    assert part_from(across, [fault], near=8.0) is across


def test_a_low_scarp_on_a_slope_has_its_height(rng):
    i, j = np.mgrid[:200, :200].astype(float)
    z = -0.1 * j - 0.5 * (j > 99.5) + ndimage.gaussian_filter(rng.normal(size=i.shape), 2.0) * 0.05
    (scarp, *_) = scarps(place(z, cell=1.0))
    assert scarp.height_m == pytest.approx(0.5, rel=0.15)


@pytest.mark.parametrize(("width", "cell"), [(6.0, 1.0), (14.0, 1.0), (20.0, 5.0)])
def test_a_worn_scarp_keeps_its_height_and_tells_its_age(width, cell):
    elevation = place(make_scarp(n=200, height=3.0, width=width) * cell, cell=cell)
    middle = TracedLine(np.column_stack([np.arange(2.0, 198.0), np.full(196, 99.5)]), np.full(196, 9.0), "step", 1)
    grid = MapGrid.from_elevation(elevation)
    found = LineamentSet((make_lineament(middle, grid, (1.0, 1.0), 3.5, 10.0),), None, grid)
    (scarp,) = scarps(elevation, found)
    assert scarp.height_m == pytest.approx(3.0 * cell, rel=0.1)
    # its width is twice the root of the age
    assert scarp.morphologic_age == pytest.approx(0.25 * (width * cell) ** 2, rel=0.25)
    assert scarp.offset.max() >= 2.4 * width * cell
    (short,) = scarps(elevation, found, half_width=1.5 * width * cell)
    assert np.isnan(short.morphologic_age)


def test_a_line_ends_at_the_map():
    beyond = TracedLine(np.column_stack([np.arange(-8.0, 60.0), np.full(68, 20.0)]), np.full(68, 5.0), "step", 1)
    made = make_lineament(beyond, MapGrid.from_elevation(np.zeros((50, 50))), (1.0, 1.0), 3.5, 10.0)
    assert made.length == pytest.approx(49.0, abs=1.0)
    assert len(made.score) == len(made.places)
    assert (np.diff(made.places[:, 1]) > 0.0).all()


def test_the_place_is_the_middle_of_the_scarp(found):
    a = np.radians(20.0)
    off = (found.lines[0].places - 99.5) @ [np.cos(a), np.sin(a)]
    assert abs(np.median(off)) < 1.5


def test_share_along_tells_rivers_from_scarps():
    i, j = np.mgrid[:50, :50].astype(float)
    slope = (np.ones_like(i), np.zeros_like(j))
    down, across = line((5, 20), (45, 20)), line((20, 5), (20, 45))
    assert share_along(down.places, slope) == pytest.approx(1.0)
    assert share_along(across.places, slope) == pytest.approx(0.0)


def test_refusals():
    with pytest.raises(ShapeError, match="at least 48 rows"):
        lineaments(np.ones((20, 100)))
    with pytest.raises(GeometryError, match="every cell is nodata"):
        lineaments(np.full((60, 60), np.nan))
