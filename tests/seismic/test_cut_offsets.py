from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from seismo3d.seismic._kernels_cut_offsets import carry_to_places
from seismo3d.seismic.cut_offsets import CutSettings, offset_sheets
from seismo3d.seismic.sheets import Sheet

PATCH = (6.0, 10.0)
STEP = 2
ROWS, COLUMNS = 90, 50


def make_sheet(w, *, origin=(0.0, 0.0), across=(0.0, 1.0)):
    w = np.asarray(w, np.float32)
    score = np.where(np.isfinite(w), 1.0, np.nan).astype(np.float32)
    return Sheet(np.array(origin), np.array(across), 0, STEP, 0.0, w, score)


def places():
    return np.meshgrid(np.arange(ROWS, dtype=float), np.arange(COLUMNS, dtype=float), indexing="ij")


def cutting(at, dip=0.0):
    """A sheet across those of this file, where their row is `at` and `dip` more for each column."""
    _, columns = np.meshgrid(np.arange(160.0), np.arange(COLUMNS, dtype=float), indexing="ij")
    # rows of a sheet whose normal is along crosslines go against the inlines
    return make_sheet(-at - dip * columns, origin=(0.0, -30.0), across=(1.0, 0.0))


def blurred(parts, side):
    """The position that a patch of the scan finds: over from one part to the other."""
    share = gaussian_filter(side.astype(float), (PATCH[0], PATCH[1] / STEP), mode="nearest")
    return parts[0] * (1.0 - share) + parts[1] * share


def older(offset, dip=0.0):
    rows, columns = places()
    plane = 40.0 + 0.1 * rows + 0.5 * columns
    side = rows < 45.0 + dip * columns
    return plane, side, np.where(side, plane + offset, plane)


@pytest.mark.parametrize("offset", [3.0, -6.0])
@pytest.mark.parametrize("dip", [0.0, 0.4])
def test_a_cut_sheet_is_offset_at_the_cut(offset, dip):
    plane, side, true = older(offset, dip)
    sheet, cut = make_sheet(blurred((plane, plane + offset), side)), cutting(45.0, dip)
    assert np.abs(sheet.w - true).max() > 0.35 * abs(offset)
    mended, left = offset_sheets([sheet, cut], patch=PATCH)
    assert left is cut
    error = np.abs(mended.w - true)
    assert error.max() < 0.25 * abs(offset)
    assert np.median(error) < 0.02


def test_leftovers_cut_nothing_and_are_cut():
    plane, side, _ = older(3.0)
    w = blurred((plane, plane + 3.0), side)
    sheet, cut = make_sheet(w), cutting(45.0)
    assert offset_sheets([sheet, replace(cut, leftover=True)], patch=PATCH)[0] is sheet
    whole = offset_sheets([sheet, cut], patch=PATCH)[0]
    leftover = offset_sheets([replace(sheet, leftover=True), cut], patch=PATCH)[0]
    np.testing.assert_array_equal(leftover.w, whole.w)
    assert leftover.leftover


def test_sheets_that_cross_without_an_offset_stay_the_same_objects():
    plane, _, _ = older(0.0)
    sheets = [make_sheet(plane), cutting(45.0)]
    assert all(one is other for one, other in zip(offset_sheets(sheets, patch=PATCH), sheets, strict=True))


def test_a_bend_that_no_sheet_cuts_stays():
    plane, side, _ = older(6.0)
    bent = make_sheet(blurred((plane, plane + 6.0), side))
    beside = cutting(300.0)
    assert offset_sheets([bent, beside], patch=PATCH)[0] is bent
    assert offset_sheets([bent], patch=PATCH) == [bent]


def test_an_offset_that_is_not_alike_along_the_cut_is_none():
    plane, side, _ = older(0.0)
    _, columns = places()
    turning = 4.0 * np.sign(columns - 24.5)
    sheets = [make_sheet(blurred((plane, plane + turning), side)), cutting(45.0)]
    assert offset_sheets(sheets, patch=PATCH)[0] is sheets[0]


def test_two_cuts_and_any_order_of_the_sheets():
    rows, columns = places()
    plane = 40.0 + 0.5 * columns
    low, high = rows < 25.0, rows >= 65.0
    true = plane + 4.0 * low - 5.0 * high
    share = [gaussian_filter(side.astype(float), (6.0, 5.0), mode="nearest") for side in (low, high)]
    sheets = [make_sheet(plane + 4.0 * share[0] - 5.0 * share[1]), cutting(25.0), cutting(65.0)]
    mended = offset_sheets(sheets, patch=PATCH)
    assert np.abs(mended[0].w - true).max() < 0.5 * np.abs(sheets[0].w - true).max()
    turned = offset_sheets(sheets[::-1], patch=PATCH)
    np.testing.assert_array_equal(turned[2].w, mended[0].w)


def test_what_lies_outside_a_sheet_stays_unknown():
    plane, side, _ = older(5.0)
    w = blurred((plane, plane + 5.0), side)
    w[10:14, 20:30] = np.nan
    mended = offset_sheets([make_sheet(w), cutting(45.0)], patch=PATCH)[0]
    np.testing.assert_array_equal(np.isnan(mended.w), np.isnan(w.astype(np.float32)))


def test_planes_are_carried_exactly():
    rows, columns = places()
    rng = np.random.default_rng(4)
    known = rng.uniform(size=rows.shape) * (rows > 20)
    sides = np.where(known > 0.0, columns > 30, -1).astype(np.int64)
    w = np.where(sides > 0, 3.0 - 0.2 * rows + 0.7 * columns, -9.0 + 0.3 * rows)
    at = np.array([15, 15, 40, 40]), np.array([29, 33, 30, 31])
    taps = np.hanning(43)[1:-1], np.hanning(37)[1:-1]
    height, weight = np.zeros(4), np.zeros(4)
    wanted = np.array([0, 1, 0, 0])
    carry_to_places(w, known, sides, *at, wanted, *taps, (0.0, 0.0), (0.0, 0.0), height, weight)
    np.testing.assert_allclose(height, [-4.5, 3.0 - 3.0 + 23.1, 3.0, -9.0 + 12.0], atol=1e-9)
    assert (weight > 10.0).all()
    none = np.full_like(sides, -1)
    carry_to_places(w, known, none, *at, wanted, *taps, (0.0, 0.0), (0.0, 0.0), height, weight)
    assert not weight.any()
    assert not height.any()


def test_settings_decide_what_is_an_offset():
    plane, side, _ = older(3.0)
    sheets = [make_sheet(blurred((plane, plane + 3.0), side)), cutting(45.0)]
    assert offset_sheets(sheets, patch=PATCH, settings=CutSettings(least_offset=4.0))[0] is sheets[0]
