from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from seismo3d.seismic import restored_throws
from seismo3d.seismic._kernels_restore import read_between, spread
from seismo3d.seismic.both_walls import tell_throw
from seismo3d.seismic.fault_ages import HistorySettings
from seismo3d.seismic.layer_strain import LayerSlopes, Strain
from seismo3d.seismic.restored_throws import restore_throws
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import ThrowSettings, gather_sides, match_sides
from seismo3d.synthetic import SyntheticFault, fault_cube

SHAPE = (72, 72, 96)
SETTINGS = ThrowSettings()
NOWHERE = LayerSlopes(np.zeros((0, 3)), np.zeros((2, 0), np.float32), 128)
OLD = SyntheticFault((36, 36, 48), 0.0, 68.0, 9.0)
YOUNG = SyntheticFault((36, 36, 48), 90.0, 66.0, 13.0, trend=(0.0, 0.006))


@cache
def crossed(rake=90.0):
    """Flat layers cut by an old fault along inlines, then by a young one along crosslines, and both as sheets."""
    faults = OLD, replace(YOUNG, rake_deg=rake)
    cube = fault_cube(
        "clean", seed=5, shape=SHAPE, population=None, faults=faults, fold_slope=(0.0, 0.0), tilt=(0.0, 0.0),
        wavelength=(12.0, 12.0),
    )  # fmt: skip
    return cube, [sheet_of(cube.faults == number, axis) for number, axis in ((1, 1), (2, 0))]


def sheet_of(fault, axis, part=slice(None)):
    """The middle of a fault's voxels along an axis as a sheet."""
    places = np.arange(SHAPE[axis], dtype=np.float64)
    voxels = np.moveaxis(fault, axis, 2)
    count = voxels.sum(axis=2)
    w = np.where(count > 0, (voxels * places).sum(axis=2) / np.maximum(count, 1), np.nan)
    emptied = np.full_like(w, np.nan)
    emptied[part] = w[part]
    across = np.eye(2)[axis]
    # rows go along (-across[1], across[0]): inlines come down from the last
    w, first = (emptied[::-1], 1.0 - SHAPE[0]) if axis == 1 else (emptied, 0.0)
    w = np.ascontiguousarray(w[:, ::2], np.float32)
    return Sheet(np.zeros(2), across, 0, 2, first, w, np.where(np.isfinite(w), 1.0, np.nan).astype(np.float32))


def measured(sheets, rake=90.0):
    cube, _ = crossed(rake)
    volume, valid = cube.seismic, np.ones(SHAPE, bool)
    slopes = np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.float32)
    sides = [gather_sides(volume, valid, slopes, sheet, settings=SETTINGS) for sheet in sheets]
    throws = [
        match_sides(sheet, side.both, side.known, settings=SETTINGS) for sheet, side in zip(sheets, sides, strict=True)
    ]
    return throws, lambda number: sides[number]


def error(sheet, throw, truth):
    """Errors of the throws in the hanging wall of the young fault, clear of both faults' ends."""
    rows, columns = np.nonzero(np.isfinite(throw.throw))
    points = sheet.points(rows.astype(float), columns.astype(float), sheet.w[rows, columns].astype(float))
    beyond = points[:, 0] < 28.0 - (points[:, 2] - 48.0) / np.tan(np.radians(66.0))
    inner = beyond & (points[:, 2] > 30.0) & (points[:, 2] < 88.0)
    assert inner.sum() > 200
    return np.abs(throw.throw[rows, columns][inner] - truth)


def test_an_old_fault_is_measured_as_it_lay_before_the_young_one_moved():
    _, sheets = crossed()
    throws, read = measured(sheets)
    found = restore_throws(sheets, throws, read, NOWHERE, settings=SETTINGS, history=HistorySettings())
    today, then = (np.median(error(sheets[0], throw, 9.0)) for throw in (throws[0], found[0]))
    assert then < 0.4
    assert then < 0.6 * today
    # the young one lies as it did
    np.testing.assert_array_equal(found[1].throw, throws[1].throw)
    assert [throw.generation for throw in found] == [1, 0]
    assert found[0].family != found[1].family


def test_the_throw_of_a_fault_both_of_whose_walls_moved_is_told_at_its_places(monkeypatch):
    _, sheets = crossed()
    throws, read = measured(sheets)
    monkeypatch.setattr(restored_throws, "tell_strains", lambda motions, *_: [Strain(0.5)] * len(motions))
    # its throw changes too little to say that it dies away within the cube
    found = restore_throws(sheets, throws, read, NOWHERE, settings=SETTINGS, history=HistorySettings())
    np.testing.assert_array_equal(found[1].throw, throws[1].throw)
    assert [throw.lift for throw in found] == [1.0, 1.0]
    found = restore_throws(sheets, throws, read, NOWHERE, settings=SETTINGS, history=HistorySettings(dying=1.0))
    # the old one lies as the young one has strained it
    assert [throw.lift for throw in found] == [1.0, 0.5]
    told = tell_throw(throws[1].throw.astype(float), 0.5, throws[1].strike_share, sheets[1].step)
    np.testing.assert_allclose(found[1].throw, told, rtol=1e-6)
    inner = np.isfinite(told) & (throws[1].fit > 0.5)
    # throw grows down the fault: by as much more as half of it grows over a throw
    assert (found[1].throw - throws[1].throw)[inner].mean() == pytest.approx(0.5 * 13.0 * 13.0 * 0.006, abs=0.2)


def test_the_offset_of_an_old_fault_tells_the_strike_slip_of_a_young_one():
    """Flat layers show no slip along strike."""
    cube, sheets = crossed(118.0)
    throws, read = measured(sheets, 118.0)
    assert throws[1].strike_share == 0.0
    found = restore_throws(sheets, throws, read, NOWHERE, settings=SETTINGS, history=HistorySettings())
    slip = np.median(cube.slip[cube.faults[cube.faults > 0] == 2], axis=0)
    truth = slip[:2] @ sheets[1].along / slip[2]
    assert abs(truth) > 0.4
    assert found[1].strike_share == pytest.approx(truth, abs=0.12)
    assert found[1].slip_certainty > 0.3
    inner = np.isfinite(found[1].throw) & (found[1].fit > 0.5)
    assert np.abs(found[1].throw - throws[1].throw)[inner].mean() < 0.3


def test_places_that_match_today_lay_apart_by_what_is_not_taken_back():
    """Depths shrink by a tenth where what is taken back has stretched them; so do the throws."""
    _, sheets = crossed()
    throws, _ = measured(sheets)
    part = restored_throws._lay_out(sheets[0], throws[0])
    motion = restored_throws._present_motion(part, throws[0], HistorySettings())
    foot, match = restored_throws._counterparts(part, throws[0], motion)
    lay_apart = 0.9 * part.points()[:, 2] - 0.9 * foot[:, 2]
    columns = np.minimum(np.rint(part.columns / 2).astype(int), sheets[0].w.shape[1] - 1)
    thrown = throws[0].throw[part.rows, columns]
    assert (match > 0.5).mean() > 0.3
    np.testing.assert_allclose(lay_apart[match > 0], 0.9 * thrown[match > 0], rtol=1e-6)
    np.testing.assert_array_equal(lay_apart[match == 0], 0.0)


def test_the_order_of_the_sheets_does_not_matter():
    _, sheets = crossed()
    throws, read = measured(sheets)
    found = restore_throws(sheets, throws, read, NOWHERE, settings=SETTINGS, history=HistorySettings())
    turned = restore_throws(
        sheets[::-1], throws[::-1], lambda n: read(1 - n), NOWHERE, settings=SETTINGS, history=HistorySettings()
    )
    np.testing.assert_array_equal(found[0].throw, turned[1].throw)


def test_parts_of_a_fault_are_matched_together():
    cube, (_, young) = crossed()
    # a strip too small to be matched by itself, whose throw seems to be another
    pieces = [sheet_of(cube.faults == 2, 0, np.s_[:, part]) for part in (slice(0, 52), slice(56, 76))]
    throws, read = measured([*pieces])
    throws[1] = replace(throws[1], throw=np.where(np.isfinite(throws[1].throw), np.float32(-9.0), np.float32(np.nan)))
    found = restore_throws(pieces, throws, read, NOWHERE, settings=SETTINGS, history=HistorySettings())
    known = np.isfinite(found[1].throw)
    assert young.inside.sum() > known.sum() > 0
    assert np.median(found[1].throw[known]) > 11.0


def test_a_young_fault_found_in_parts_is_taken_back_once():
    cube, sheets = crossed()
    pieces = [sheet_of(cube.faults == 2, 0, np.s_[:, part]) for part in (slice(0, 47), slice(49, 96))]
    throws, read = measured([sheets[0], *pieces])
    # by no roughness do they lie on one surface: each is measured by itself
    history = HistorySettings(roughness=0.0)
    found = restore_throws([sheets[0], *pieces], throws, read, NOWHERE, settings=SETTINGS, history=history)
    whole_throws, whole_read = measured(sheets)
    whole = restore_throws(sheets, whole_throws, whole_read, NOWHERE, settings=SETTINGS, history=HistorySettings())
    assert np.median(error(sheets[0], found[0], 9.0)) < np.median(error(sheets[0], whole[0], 9.0)) + 0.1


def test_without_an_order_throws_are_those_of_today():
    _, sheets = crossed()
    throws, read = measured(sheets)
    history = HistorySettings(least_gain=np.inf)
    found = restore_throws(sheets, throws, read, NOWHERE, settings=SETTINGS, history=history)
    for throw, before in zip(found, throws, strict=True):
        np.testing.assert_array_equal(throw.throw, before.throw)
    assert [throw.generation for throw in found] == [0, 0]
    assert restore_throws([], [], read, NOWHERE, settings=SETTINGS, history=history) == []


@pytest.mark.parametrize("beyond", [(-0.5, 1.0), (1.0, 4.0), (np.nan, 1.0)])
def test_values_are_spread_by_bilinear_weights(beyond):
    rows, columns = np.array([1.25, beyond[0]]), np.array([2.5, beyond[1]])
    sums, weight = np.zeros((1, 4, 5)), np.zeros((4, 5))
    spread(rows, columns, np.array([[8.0, 99.0]]), sums, weight)
    np.testing.assert_allclose(weight[1:3, 2:4], [[0.375, 0.375], [0.125, 0.125]])
    np.testing.assert_allclose(sums[0], 8.0 * weight)
    assert weight.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("shape", [(1, 5), (7, 1), (9, 12)])
def test_a_grid_is_read_between_its_places(rng, shape):
    grid = rng.normal(size=shape)
    rows, columns = (np.append(rng.uniform(-2, n + 1, 200), np.arange(4.0)) for n in shape)
    inner = [np.clip(at, 0, n - 1) for at, n in zip((rows, columns), shape, strict=True)]
    expected = ndimage.map_coordinates(grid, inner, order=1)
    np.testing.assert_allclose(read_between(grid, rows, columns), expected, atol=1e-12)
    np.testing.assert_array_equal(read_between(grid, np.array([np.nan]), np.array([np.nan])), grid[:1, 0])
