from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic._kernels_placing import split_profiles
from seismo3d.seismic.placing import PlaceSettings, place_sheet, read_profile
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import ThrowSettings

REACH = PlaceSettings().reach


def sheet_at(w, rows=40, columns=30):
    place = np.broadcast_to(np.asarray(w, np.float32), (rows, columns)).astype(np.float32)
    return Sheet(np.zeros(2), np.array([1.0, 0.0]), 0, 2, 0.0, place, np.ones((rows, columns), np.float32))


def profile_with_break(rows, samples, at, rng, noise=0.0):
    """Traces at -reach .. reach of two layered sides that meet at `at`, an array over rows, and may share a trace."""
    left, right = rng.normal(size=(2, samples)).astype(np.float32)
    off = np.arange(-REACH, REACH + 1)[:, None, None]
    share = np.clip(off - np.asarray(at)[None, :, None] + 0.5, 0.0, 1.0)
    values = (1.0 - share) * left + share * right + noise * rng.normal(size=(len(off), rows, samples))
    return values.astype(np.float32), np.ones(values.shape, bool)


@pytest.mark.parametrize("moved", [0.0, 1.0, -0.25])
def test_splits_equal_their_definition(rng, moved):
    values = rng.normal(size=(7, 3, 5)).astype(np.float32)
    known = rng.random(values.shape) < 0.7
    known[:, 0, 0] = False
    known[:3, 1, 1] = False
    known[4:, 2, 2] = False
    within, contrast = np.empty((2, 5, 3, 5), np.float32)
    split_profiles(values, known, np.full((3, 5), moved, np.float32), within, contrast)
    for r, k in np.ndindex(3, 5):
        at = np.arange(7) + moved
        there = np.where(known[:, r, k], values[:, r, k], np.nan)
        read = np.interp(at, np.arange(7), there, left=np.nan, right=np.nan)
        assert (known[:, r, k] == np.isfinite(read)).all() or moved != 0.0
        told = np.isfinite(read[:3]).any() and np.isfinite(read[4:]).any()
        for b in range(5):
            sides = [part[np.isfinite(part)].astype(float) for part in (read[: b + 1], read[b + 2 :])]
            left, n = sum(((s - s.mean()) ** 2).sum() for s in sides if s.size), sum(s.size for s in sides)
            assert within[b, r, k] == pytest.approx(left / n if told and n else 0.0, abs=1e-5)
            apart = sides[0].mean() - sides[1].mean() if told and all(s.size for s in sides) else 0.0
            assert contrast[b, r, k] == pytest.approx(apart**2, abs=1e-5)


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("at", [-2.0, -0.5, 0.0, 0.3, 1.0, 2.5])
def test_a_sheet_is_moved_to_the_break(rng, at, noise):
    sheet = sheet_at(7.0)
    moved = place_sheet(sheet, *profile_with_break(40, 59, np.full(40, at), rng, noise))
    error = np.abs(moved.w - (7.0 + at))
    assert np.median(error) < 0.2 if noise else error.max() < 0.1


def test_a_side_without_data_leaves_a_sheet_where_it_is(rng):
    # what is known on the one side alone varies, too: that is no fault
    values = rng.normal(size=(2 * REACH + 1, 40, 59)).astype(np.float32)
    known = np.ones(values.shape, bool)
    known[:REACH] = False
    sheet = sheet_at(3.0)
    assert (place_sheet(sheet, values, known).w == sheet.w).all()


def test_a_bend_of_the_sheet_is_taken_out_where_it_is(rng):
    at = np.where(np.arange(40) < 20, 2.0, 0.0)
    moved = place_sheet(sheet_at(0.0), *profile_with_break(40, 59, at, rng))
    assert np.abs(moved.w[:8] - 2.0).max() < 0.1
    assert np.abs(moved.w[32:]).max() < 0.1


def test_sides_that_are_alike_or_unknown_leave_a_sheet_where_it_is(rng):
    sheet = sheet_at(3.0)
    values, known = profile_with_break(40, 59, np.full(40, 2.0), rng)
    assert (place_sheet(sheet, values, np.zeros_like(known)).w == sheet.w).all()
    assert (place_sheet(sheet, np.ones_like(values), known).w == sheet.w).all()


def test_what_is_outside_stays_outside(rng):
    sheet = sheet_at(0.0)
    sheet.w[5:9, 3:7] = np.nan
    moved = place_sheet(sheet, *profile_with_break(40, 59, np.full(40, 1.0), rng))
    assert (np.isnan(moved.w) == np.isnan(sheet.w)).all()
    assert np.nanmax(np.abs(moved.w - 1.0)) < 0.35


def test_a_profile_reads_the_traces_off_the_sheet_along_their_layers():
    # layers that climb half a sample a trace across: carried to the sheet, all traces of a side are the same
    i, _, k = np.mgrid[0:24, 0:20, 0:59].astype(np.float32)
    volume = np.where(i < 12, np.sin(0.3 * (k - 0.5 * i)), np.cos(0.2 * (k - 0.5 * i))).astype(np.float32)
    slopes = np.full(volume.shape, 0.5, np.float32), np.zeros(volume.shape, np.float32)
    sheet = sheet_at(11.5, rows=20)
    sheet = Sheet(sheet.origin, np.array([1.0, 0.0]), 0, 2, 0.0, sheet.w, sheet.score)
    values, known = read_profile(
        volume, np.ones(volume.shape, bool), slopes, sheet, throw=ThrowSettings(), settings=PlaceSettings()
    )
    inner = np.s_[2:18, 8:50]
    assert values.shape == (2 * REACH + 1, 20, 59)
    assert known[(slice(None), *inner)].all()
    for side in (values[:REACH], values[REACH + 1 :]):
        assert np.abs(side - side[0])[(slice(None), *inner)].max() < 0.02
    assert place_sheet(sheet, values, known).w == pytest.approx(sheet.w, abs=0.05)
