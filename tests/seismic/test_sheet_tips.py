from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.seismic.sheet_tips import continue_sheet, likeness_beyond, share_in_view, share_out_of_view
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetSides

ROWS, COLUMNS, FIRST, STEP, BEYOND = 12, 15, 40, 2, 16


def sheet_of(w):
    w = np.asarray(w, np.float32)
    return Sheet(np.zeros(2), np.array([1.0, 0.0]), FIRST, STEP, 0.0, w, np.ones_like(w))


def plane(tilt=0.5):
    """A sheet that leans by `tilt` traces a sample, a trace farther from row to row."""
    return sheet_of(np.arange(ROWS)[:, None] + tilt * STEP * np.arange(COLUMNS))


def test_a_plane_goes_on_as_the_plane_beyond_both_ends_and_nowhere_else():
    beyond = continue_sheet(plane(), 1000)
    assert (beyond.first_sample, beyond.step) == (FIRST - BEYOND, STEP)
    n_more = BEYOND // STEP
    columns = np.arange(-n_more, COLUMNS + n_more)
    off = (columns < 0) | (columns >= COLUMNS)
    assert np.isnan(beyond.w[:, ~off]).all()
    expected = np.arange(ROWS)[:, None] + 0.5 * STEP * columns[off]
    np.testing.assert_allclose(beyond.w[:, off], expected, atol=1e-5)


def test_a_bent_sheet_goes_on_as_its_last_nodes_lie():
    w = np.concatenate([np.zeros(8), 0.5 * np.arange(1, 8)])
    beyond = continue_sheet(sheet_of(np.tile(w, (ROWS, 1))), 1000)
    np.testing.assert_allclose(beyond.w[:, :8], 0.0, atol=1e-6)
    np.testing.assert_allclose(beyond.w[0, -8:], 3.5 + 0.5 * np.arange(1, 9), atol=1e-5)


def test_a_continuation_stays_within_the_cube():
    low = replace(plane(), first_sample=6)
    beyond = continue_sheet(low, 6 + STEP * COLUMNS + 4)
    samples = beyond.first_sample + STEP * np.flatnonzero(np.isfinite(beyond.w).any(axis=0))
    assert samples.min() == 0
    assert samples.max() == 6 + STEP * COLUMNS + 2


def test_each_row_goes_on_from_its_own_ends():
    w = plane().w.copy()
    w[3, :4] = np.nan
    w[5] = np.nan
    beyond = continue_sheet(sheet_of(w), 1000)
    n_more = BEYOND // STEP
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(beyond.w[3]))[:n_more] - n_more, np.arange(-4, 4))
    assert np.isnan(beyond.w[5]).all()


def sides_beyond(above, below, known=1.0):
    """Sides beyond the ends of `plane`: one equals the other times so much above it, and below it."""
    n = (COLUMNS - 1) * STEP + 1 + 2 * BEYOND
    one = np.random.default_rng(2).normal(size=(ROWS, n))
    other = np.where(np.arange(n) < n // 2, above, below) * one
    there = np.full((2, ROWS, n), known, np.float32)
    return SheetSides(np.stack([one, other]).astype(np.float32), there, np.zeros_like(there))


@pytest.mark.parametrize(
    ("above", "below", "expected"),
    [(1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 1.0, -1.0), (1.0, 0.5, 0.8)],
    ids=["alike", "one side silent below", "opposite above", "half below"],
)
def test_likeness_is_the_lesser_of_both_ends(above, below, expected):
    assert likeness_beyond(plane(), sides_beyond(above, below)) == pytest.approx(expected, abs=1e-6)


def test_what_is_mixed_next_to_an_end_does_not_count():
    sides = sides_beyond(1.0, 1.0)
    sides.both[1, :, BEYOND - 3 : -BEYOND + 3] *= -1.0
    assert likeness_beyond(plane(), sides) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("unknown", [np.s_[:, :, :BEYOND], np.s_[0, :, -BEYOND:], np.s_[:, : 3 * ROWS // 4]])
def test_an_end_that_is_not_known_tells_nothing(unknown):
    sides = sides_beyond(1.0, 1.0)
    sides.known[unknown] = 0.0
    assert likeness_beyond(plane(), sides) == 0.0


def test_an_empty_sheet_tells_nothing():
    empty = sheet_of(np.full((ROWS, COLUMNS), np.nan))
    assert np.isnan(continue_sheet(empty, 1000).w).all()
    assert likeness_beyond(empty, sides_beyond(1.0, 1.0)) == 0.0
    assert share_out_of_view(empty, empty.w) == 0.0


@pytest.mark.parametrize(
    ("throw", "expected"),
    [(0.0, 0.0), (4.0, 0.0), (10.0, 3 / 15), (-10.0, 3 / 15), (60.0, 1.0)],
    ids=["none", "within what may be unseen", "normal", "reverse", "large"],
)
def test_a_throw_leads_out_of_view_near_the_end_that_it_comes_from(throw, expected):
    throws = np.full((ROWS, COLUMNS), throw, np.float32)
    assert share_out_of_view(plane(), throws) == pytest.approx(expected)


def test_a_throw_that_dies_at_both_ends_leads_nowhere_out():
    down = STEP * np.arange(COLUMNS)
    bell = 12.0 * np.sin(np.pi * down / down[-1]) ** 2
    assert share_out_of_view(plane(), np.tile(bell, (ROWS, 1)).astype(np.float32)) == 0.0


@pytest.mark.parametrize(
    ("shape", "throw", "share"),
    [
        ((100, 100, 100), 10.0, 1.0),
        ((100, 100, FIRST + STEP * COLUMNS - 1), 10.0, 1.0),
        ((100, 100, FIRST + STEP * COLUMNS - 1), -10.0, 10 / COLUMNS),
        ((100, 100, 100), 80.0, 0.0),
    ],
    ids=["in the midst of the cube", "from above", "from below its bottom", "from above its top"],
)
def test_what_a_throw_leads_to_is_in_view_within_the_cube(shape, throw, share):
    sheet = replace(plane(0.0), origin=np.array([20.0, 20.0]))
    assert share_in_view(sheet, np.full(sheet.w.shape, throw, np.float32), shape) == pytest.approx(share)


def test_a_sheet_that_leaves_the_cube_at_a_side_is_out_of_view_there():
    """Half a trace a sample away, 10 samples farther up it lies 5 traces nearer to the side."""
    sheet = sheet_of(np.full((ROWS, 1), 2.0) + 0.5 * STEP * np.arange(COLUMNS))
    throw = np.full(sheet.w.shape, 10.0, np.float32)
    assert share_in_view(sheet, throw, (100, 100, 100)) == pytest.approx((COLUMNS - 3) / COLUMNS)
    throw[:, 5:] = np.nan
    assert share_in_view(sheet, throw, (100, 100, 100)) == pytest.approx(2 / 5)
