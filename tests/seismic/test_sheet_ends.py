from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plain_sheets import candidate
from scipy.ndimage import gaussian_filter, gaussian_filter1d

import seismo3d as s3
from seismo3d.seismic.choosing import ChoiceSettings, choose_faults
from seismo3d.seismic.sheet_ends import end_along_layers, end_at_bends, end_in_mutes, end_where_still
from seismo3d.seismic.sheet_measures import median_throw
from seismo3d.seismic.throw import SheetSides

SETTINGS = ChoiceSettings()


def test_a_sheet_ends_in_mutes_but_passes_gaps_and_dead_traces():
    sheet, _ = candidate(rows=20, columns=30)
    known = np.ones((2, 20, 59), np.float32)
    known[0, :, :10] = known[1, :, :14] = 0.0  # muted, on one side farther down
    known[:, :, 30:36] = 0.0
    known[:, 5:7] = 0.0
    known[:, :, 51:] = 0.0
    ended = end_in_mutes(sheet, SheetSides(np.zeros_like(known), known, np.zeros_like(known)), (20, 20, 59))
    expected = np.zeros((20, 30), bool)
    expected[:, 5:26] = expected[5:7] = True
    np.testing.assert_array_equal(ended.inside, expected)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize(("begins", "is_left"), [(36, False), (28, False), (24, True)])
def test_a_sheet_along_a_mute_is_none(begins, is_left, turn):
    sheet = candidate(rows=20, columns=30)[0].only(np.tile((np.arange(30) > 12) & (np.arange(30) < 17), (20, 1)))
    known = np.ones((2, 20, 59), np.float32)
    known[0, :, :begins] = 0.0  # the sheet is at samples 26 to 32
    known = known[..., ::turn]
    sides = SheetSides(np.zeros_like(known), known, np.zeros_like(known))
    assert end_in_mutes(sheet, sides, (20, 20, 59)).inside.any() == is_left


def test_a_sheet_with_data_on_one_side_alone_is_none_but_at_the_border():
    sheet = candidate(rows=20, columns=30)[0]
    known = np.ones((2, 20, 59), np.float32)
    known[1, :12] = 0.0
    sides = SheetSides(np.zeros_like(known), known, np.zeros_like(known))
    assert not end_in_mutes(sheet, sides, (20, 20, 59)).inside.any()
    # what is read lies beyond a cube whose first line the sheet is at
    np.testing.assert_array_equal(end_in_mutes(sheet, sides, (60, 20, 59)).inside, sheet.inside)
    known[1, 8:12] = 1.0
    np.testing.assert_array_equal(end_in_mutes(sheet, sides, (20, 20, 59)).inside, sheet.inside)


def told_nothing(sheet):
    """Sides of a sheet on which nothing is known."""
    nothing = np.zeros((2, sheet.w.shape[0], 2 * sheet.w.shape[1] - 1), np.float32)
    return SheetSides(nothing, nothing, nothing)


def test_a_sheet_ends_where_its_sides_fit_unmoved():
    sheet, throw = candidate(score=0.3)
    values = throw.throw.copy()
    values[30:] = 0.2
    ended, moved = end_where_still(sheet, replace(throw, throw=values), told_nothing(sheet), SETTINGS, noise=0.0)
    assert ended.inside[:29].all()
    assert not ended.inside[31:].any()
    assert np.array_equal(np.isfinite(moved.throw), ended.inside)
    assert median_throw(moved) == pytest.approx(6.0)


def test_strong_support_goes_on_without_a_throw():
    sheet, throw = candidate(score=0.72, throw=0.2)
    assert end_where_still(sheet, throw, told_nothing(sheet), SETTINGS, noise=0.0) == (sheet, throw)


def test_a_sheet_goes_on_where_its_unmoved_sides_do_not_fit():
    sheet, throw = candidate(score=0.3, throw=0.2, fit=0.3)
    assert end_where_still(sheet, throw, told_nothing(sheet), SETTINGS, noise=0.0) == (sheet, throw)


@pytest.mark.parametrize(("noise", "goes_on"), [(0.0, True), (0.04, False), (0.08, False), (0.3, False)])
def test_a_small_throw_is_one_where_there_is_no_noise(noise, goes_on):
    sheet, throw = candidate(score=0.3, throw=0.7)
    ended, _ = end_where_still(sheet, throw, told_nothing(sheet), SETTINGS, noise=noise)
    assert ended.inside.all() == goes_on
    assert ended.inside.any() == goes_on


def test_a_sheet_without_any_throw_is_gone():
    sheet, throw = candidate(score=0.3, throw=0.2)
    ended, moved = end_where_still(sheet, throw, told_nothing(sheet), SETTINGS, noise=0.0)
    assert not ended.inside.any()
    assert median_throw(moved) == 0.0
    assert choose_faults([(ended, moved)], SETTINGS) == []


def run_on(rng, *, from_node, rows=slice(None), score=0.3, carried_fit=0.0, alike=1.0):
    """End a weak sheet whose throw matches above a node; from there on the layers of some rows go on unmoved.

    They are alike on both sides but for noise of which `alike` is what share of the energy is common.
    """
    sheet, throw = candidate(score=score)
    both = rng.normal(size=(2, 60, 79))
    common = np.sqrt(alike) * rng.normal(size=(60, 79)) + np.sqrt(1.0 - alike) * both
    both[:, rows, 2 * from_node :] = common[:, rows, 2 * from_node :]
    fit = throw.fit.copy()
    fit[:, from_node:] = carried_fit
    known = np.ones_like(both, np.float32)
    sides = SheetSides(both.astype(np.float32), known, known)
    return sheet, end_where_still(sheet, replace(throw, fit=fit), sides, SETTINGS, noise=0.1)[0]


@pytest.mark.parametrize("alike", [1.0, 0.6])
def test_a_sheet_ends_where_layers_go_on_unmoved_though_its_throw_was_carried_on(rng, alike):
    _, ended = run_on(rng, from_node=25, alike=alike)
    assert ended.inside[:, :23].all()
    assert not ended.inside[:, 28:].any()


@pytest.mark.parametrize(
    "told",
    [{"score": 0.5}, {"carried_fit": 0.9}, {"alike": 0.0}, {"rows": slice(20, 26)}],
    ids=["well supported", "the throw fits as well", "unlike", "a few traces"],
)
def test_a_sheet_goes_on_where_that_is_not_sure(rng, told):
    sheet, ended = run_on(rng, from_node=25, **told)
    np.testing.assert_array_equal(ended.inside, sheet.inside)


def test_what_goes_on_unmoved_within_a_sheet_does_not_end_it(rng):
    """Layers a cycle apart look unmoved; a fault does not end above a part of it that is surely one."""
    sheet, throw = candidate(score=0.3)
    both, fit = rng.normal(size=(2, 60, 79)), throw.fit.copy()
    both[1, 15:45, 20:60] = both[0, 15:45, 20:60]
    fit[15:45, 10:30] = 0.0
    known = np.ones_like(both, np.float32)
    sides = SheetSides(both.astype(np.float32), known, known)
    ended, _ = end_where_still(sheet, replace(throw, fit=fit), sides, SETTINGS, noise=0.1)
    np.testing.assert_array_equal(ended.inside, sheet.inside)


def between_layers(sheet, *tilts_deg, known=1.0):
    """Sides of a sheet whose layers dip along `across` by these angles, on either side."""
    shape = (2, len(sheet.w), 2 * sheet.w.shape[1] - 1)
    tilts = np.tan(np.radians(np.array(tilts_deg)))[:, None, None]
    return SheetSides(
        np.zeros(shape, np.float32),
        np.full(shape, known, np.float32),
        np.broadcast_to(tilts, shape).astype(np.float32),
    )


@pytest.mark.parametrize(
    ("dip", "tilts_deg"),
    [(50.0, (35.0, 35.0)), (50.0, (50.0, 48.0)), (50.0, (65.0, 66.0)), (100.0, (-75.0, -75.0)), (35.0, (20.0, 18.0))],
    ids=["gentler layers", "along them", "steeper layers", "upright layers", "low"],
)
def test_what_runs_along_the_layers_is_no_fault(dip, tilts_deg):
    sheet, throw = candidate(dip=dip, fit=0.7)
    ended = end_along_layers(sheet, throw, between_layers(sheet, *tilts_deg), SETTINGS)
    assert not ended.inside.any()
    assert np.isnan(ended.score).all()
    assert choose_faults([(ended, throw)], SETTINGS) == []


@pytest.mark.parametrize(
    ("dip", "tilts_deg"),
    [(50.0, (25.0, 25.0)), (50.0, (-35.0, -35.0)), (100.0, (75.0, 75.0)), (35.0, (0.0, 0.0)), (50.0, (10.0, 20.0))],
    ids=["layers less steep", "layers dip against it", "upright against it", "level layers", "sides that differ"],
)
def test_what_cuts_the_layers_stays_as_it_is(dip, tilts_deg):
    sheet, throw = candidate(dip=dip, fit=0.7)
    assert end_along_layers(sheet, throw, between_layers(sheet, *tilts_deg), SETTINGS) is sheet


@pytest.mark.parametrize(
    ("change", "tilt_deg", "is_kept"),
    [({}, 15.0, True), ({}, 25.0, False), ({"fit": 0.7}, 15.0, False), ({"throw": 1.2}, 15.0, False),
     ({"rows": 12}, 15.0, False), ({"dip": 55.0}, 40.0, False), ({"score": 0.42}, 15.0, True)],
    ids=["matches well", "along them", "matches badly", "hardly moves", "small", "steep", "less support"],
)  # fmt: skip
def test_a_thrust_climbs_through_its_layers_at_a_low_angle(change, tilt_deg, is_kept):
    sheet, throw = candidate(**{"dip": 30.0, "score": 0.7} | change)
    ended = end_along_layers(sheet, throw, between_layers(sheet, tilt_deg, tilt_deg), SETTINGS)
    assert ended.inside.any() == is_kept


@pytest.mark.parametrize(
    ("change", "tilts_deg", "is_kept"),
    [
        ({}, (20.0, 18.0), False),
        ({"dip": 125.0}, (-20.0, -18.0), False),
        ({}, (12.0, 12.0), True),
        ({}, (-20.0, -18.0), True),
        ({"dip": 85.0}, (35.0, 35.0), True),
        ({"score": 0.5}, (20.0, 18.0), True),
        ({"rows": 120, "columns": 60}, (20.0, 18.0), True),
    ],
    ids=["leans as they do", "to the other side", "gentler ones", "against them", "steep itself", "supported", "sure"],
)
def test_a_weak_sheet_that_leans_over_as_steep_layers_do_is_no_fault(change, tilts_deg, is_kept):
    sheet, throw = candidate(**{"dip": 55.0, "score": 0.4} | change)
    ended = end_along_layers(sheet, throw, between_layers(sheet, *tilts_deg), SETTINGS)
    assert ended.inside.any() == is_kept


def test_layers_that_are_not_known_end_no_sheet():
    sheet, throw = candidate(dip=50.0)
    assert end_along_layers(sheet, throw, between_layers(sheet, 45.0, 45.0, known=0.0), SETTINGS) is sheet
    line, throw = candidate(columns=1)
    assert end_along_layers(line, throw, between_layers(line, 45.0, 45.0), SETTINGS) is line


@pytest.mark.parametrize(
    ("throw", "dips", "is_kept"),
    [(3.0, (0.0, 0.5), False), (3.0, (0.5, 0.5), True), (3.0, (0.0, 0.2), True), (9.0, (0.0, 0.5), True),
     (-3.0, (0.5, 0.0), False)],
    ids=["a bend", "dips alike", "bends little", "a block that turned", "the other way"],
)  # fmt: skip
def test_where_layers_bend_by_more_than_they_are_offset_is_no_fault(throw, dips, is_kept):
    sheet, moved = candidate(throw=throw)
    sides = between_layers(sheet, *np.degrees(np.arctan(dips)))
    assert end_at_bends(sheet, moved, sides, SETTINGS).inside.any() == is_kept


def test_bends_are_not_told_where_one_side_is_not_known():
    sheet, moved = candidate(throw=1.2)
    assert end_at_bends(sheet, moved, between_layers(sheet, 0.0, 45.0, known=0.0), SETTINGS) is sheet


def test_the_hinges_of_sharp_folds_are_no_faults():
    """Layers dip by four fifths of a sample a trace, either way from their hinge, in mild noise."""
    rng = np.random.default_rng(3)
    inline, crossline, sample = np.indices((72, 72, 96), np.float32)
    folded = 0.8 * np.abs(crossline - 36.0) + 0.1 * inline
    reflectivity = gaussian_filter1d(rng.normal(size=400), 2.0)
    cube = np.interp(2.0 * (sample - folded) + 150.0, np.arange(400), reflectivity).astype(np.float32)
    cube += 0.1 * cube.std() * gaussian_filter(rng.normal(size=cube.shape), 1.0).astype(np.float32)
    assert not (s3.trace_faults(cube).labels > 0).any()
