from __future__ import annotations

import json

import numpy as np
import pytest

from seismo3d.experiments.mapped_faults import compare_places, compare_strikes, read_faults
from seismo3d.geometry.map_grid import MapGrid
from seismo3d.terrain.lineament_search import Lineament, LineamentSet

SIDE = 300
GRID = MapGrid((SIDE, SIDE), (30.0, 0.0, 400_000.0, 0.0, -30.0, 3_800_000.0), "EPSG:32611", "metre")


def line(start, end):
    n = int(np.hypot(*np.subtract(end, start))) + 1
    places = np.linspace(start, end, n)
    points = GRID.to_map(places)
    way = points[-1] - points[0]
    strike = float(np.degrees(np.arctan2(*way)) % 180.0)
    return Lineament(points, places, np.full(n, 5.0), "step", float(np.hypot(*way)), strike, 0.8, 9.0)


def made(*lines):
    return LineamentSet(lines, None, GRID)


LINES = made(line((20, 40), (280, 60)), line((10, 150), (200, 165)), line((100, 250), (290, 262)))
ALIKE = [one.points + np.array([0.0, 150.0]) for one in LINES.lines]
ACROSS = [line((40, 10), (60, 290)).points, line((150, 20), (170, 280)).points]


@pytest.fixture(scope="module")
def rough():
    # texture of every strike
    return 20.0 * np.random.default_rng(0).normal(size=(SIDE, SIDE))


def test_lines_beside_faults_agree_and_lines_across_them_do_not(rough, rng):
    place = compare_places(LINES, ALIKE, draws=300, rng=rng)
    assert place.value == 1.0
    assert place.p < 0.05
    assert place.by_chance < 0.6
    strike, beside, turned = compare_strikes(rough, LINES, ALIKE, draws=300, rng=rng)
    assert strike.value > 0.9
    assert strike.p < 0.05
    assert turned.by_chance < 0.3
    # the same strikes, 150 m aside
    assert beside.value == pytest.approx(1.0, abs=1e-3)
    assert beside.p < 0.05
    assert compare_strikes(rough, LINES, ACROSS, draws=300, rng=rng)[0].p > 0.5


def test_strikes_far_from_all_faults_are_not_compared(rough, rng):
    lines = made(line((20, 10), (200, 12)))
    far = [lines.lines[0].points - np.array([0.0, 6000.0])]
    assert np.isnan(compare_strikes(rough, lines, far, draws=20, rng=rng)[1].p)


def test_faults_are_cut_to_the_map(tmp_path):
    pytest.importorskip("rasterio")
    from rasterio.warp import transform

    path = tmp_path / "faults.geojson"
    x, y = [390_000.0, 420_000.0], [3_796_000.0, 3_796_000.0]
    lon, lat = transform("EPSG:32611", "OGC:CRS84", x, y)
    shape = {"type": "LineString", "coordinates": np.column_stack([lon, lat]).tolist()}
    path.write_text(json.dumps({"features": [{"geometry": shape}]}))
    (fault,) = read_faults(path, GRID)
    assert fault[:, 0].min() >= 400_000.0
    assert fault[:, 0].max() <= 409_000.0
    np.testing.assert_allclose(fault[:, 1], 3_796_000.0, atol=1.0)
    np.testing.assert_allclose(np.hypot(*np.diff(fault, axis=0).T), 30.0, rtol=1e-6)
