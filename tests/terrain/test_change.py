from __future__ import annotations

import numpy as np
import pytest
from fake_terrain import CELL, make_hills, place, shift

from seismo3d.errors import GeometryError, ParameterError
from seismo3d.terrain import compare, compare_points, register


def test_what_was_dug_is_found_after_registration(hills, rng):
    after = shift(hills, 0.6, 1.4) + 2.0 + rng.normal(0.0, 0.3, hills.shape)
    after[50:70, 80:110] -= 10.0
    before = place(hills + rng.normal(0.0, 0.3, hills.shape))
    found = register(before, place(after))
    change = compare(before, place(after), registration=found)
    assert change.lost == pytest.approx(10.0 * 600 * CELL**2, rel=0.1)
    assert change.gained < 0.1 * change.lost
    dug = change.significant.values[52:66, 84:106]
    assert dug.mean() > 0.95
    assert np.isnan(change.difference.values).sum() > 0  # the rim, carried off the map


def test_the_level_of_detection_holds_at_its_confidence(rng):
    a, b = rng.normal(0.0, 0.5, (2, 200, 200))
    change = compare(a, b, sigma_before=0.5, sigma_after=0.5)
    np.testing.assert_allclose(change.detection, 1.95996 * np.hypot(0.5, 0.5), rtol=1e-4)
    assert np.mean(np.abs(change.difference) > change.detection) == pytest.approx(0.05, abs=0.005)
    # single cells beyond it are chance
    assert change.significant.mean() < 0.001


def test_registration_error_adds_where_it_is_steep(hills, rng):
    noisy = hills + rng.normal(0.0, 1.0, hills.shape)
    found = register(hills, noisy)
    plain = compare(hills, noisy, sigma_before=0.0, sigma_after=0.0)
    joined = compare(hills, noisy, registration=found, sigma_before=0.0, sigma_after=0.0)
    assert plain.detection[5, 5] == 0.0
    assert joined.detection[5, 5] > 0.0


def test_points_that_rose(rng):
    def plane(n: int) -> np.ndarray:
        xy = rng.uniform(0.0, 40.0, (n, 2))
        return np.column_stack([xy, 0.5 * xy[:, 0] + rng.normal(0.0, 0.05, n)])

    before, after = plane(6000), plane(2500)
    after[after[:, 1] > 20.0, 2] += 1.0
    found = compare_points(before, after, spacing=2.0)
    y = found.points[:, 1]
    # one metre up is 1 / sqrt(1 + slope^2) along the normal
    assert np.nanmedian(found.distance[y > 23.0]) == pytest.approx(1.0 / np.sqrt(1.25), abs=0.02)
    assert found.significant[y > 23.0].mean() > 0.95
    assert found.significant[y < 17.0].mean() < 0.15


def test_refusals(hills):
    with pytest.raises(GeometryError, match="before is in EPSG:32611 and after in EPSG:4326"):
        compare(place(hills), place(hills, crs="EPSG:4326"))
    with pytest.raises(ParameterError, match="expected both or neither"):
        compare(hills, hills, sigma_before=1.0)
    far = place(hills)
    far.attrs["transform"] = (CELL, 0.0, 0.0, 0.0, -CELL, 0.0)
    with pytest.raises(GeometryError, match="no common area"):
        compare(place(hills), far)
    with pytest.raises(GeometryError, match="after holds no elevation"):
        compare(hills, np.full_like(hills, np.nan))
    other = make_hills(hills.shape, seed=9)
    with pytest.raises(GeometryError, match=r"is a poor fit, which moves it by .* \(--no-align\)"):
        compare(hills, other, registration=register(hills, other))
    with pytest.raises(ParameterError, match=r"least_patch is 0; expected .* at least 1"):
        compare(hills, hills, least_patch=0)
    with pytest.raises(GeometryError, match="no place with a surface"):
        compare_points(np.eye(3), np.eye(3), spacing=0.1)
