from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.faults import trace_faults
from seismo3d.seismic.flanks import FlankSettings, join_flanks
from seismo3d.seismic.scores import fault_score
from seismo3d.seismic.sheets import Sheet
from seismo3d.synthetic import SyntheticFault, fault_cube

CHOICE = ChoiceSettings()
COT = 1.0 / np.tan(np.radians(35.0))


def plane(*, raised=0.0, first=0, rows=60, columns=30, cot=COT, turn_deg=0.0, score=1.0):
    """A plane through inline 20 at sample 0, of 2 * columns samples, raised by so many samples."""
    angle = np.radians(turn_deg)
    across = np.array([np.cos(angle), np.sin(angle)])
    depth = 2.0 * np.arange(columns)
    w = np.broadcast_to((depth + raised) * cot, (rows, columns)).astype(np.float32)
    return Sheet(np.array([20.0, 30.0]), across, 0, 2, float(first), w, np.full((rows, columns), score, np.float32))


def test_two_flanks_become_the_fault_in_their_middle():
    above, below = plane(raised=3.0), plane(raised=-3.0)
    (found,) = join_flanks([above, below], CHOICE)
    np.testing.assert_allclose(found.w, plane().w, atol=1e-4)
    np.testing.assert_array_equal(found.score, above.score)


def test_the_better_supported_flank_weighs_more():
    above, below = plane(raised=3.0, score=0.5), plane(raised=-3.0, score=1.5)
    (found,) = join_flanks([above, below], CHOICE)
    # three quarters of the way from above to below
    np.testing.assert_allclose(found.w, plane(raised=-1.5).w, atol=1e-4)


def test_leftovers_are_flanks_of_nothing():
    sheets = [plane(raised=3.0), replace(plane(raised=-3.0), leftover=True)]
    for found, given in zip(join_flanks(sheets, CHOICE), sheets, strict=True):
        assert found is given


def test_the_order_of_the_sheets_does_not_matter():
    above, below = plane(raised=2.0, score=0.7), plane(raised=-2.0)
    one, other = join_flanks([above, below], CHOICE), join_flanks([below, above], CHOICE)
    np.testing.assert_array_equal(one[0].w, other[0].w)


def test_what_lies_beyond_the_stronger_one_stays():
    whole, longer = plane(rows=60), plane(raised=3.0, first=30, rows=60, score=0.6)
    first, second = join_flanks([whole, longer], CHOICE)
    assert first.inside.all()
    np.testing.assert_array_equal(np.flatnonzero(second.inside.any(axis=1)), np.arange(30, 60))
    # where there is no flank nothing moves; where there is, by its share of the weight
    np.testing.assert_allclose(first.w[:14], whole.w[:14], atol=1e-4)
    assert np.allclose((first.w - whole.w)[45:], 3.0 * COT * 0.6 / 1.6, atol=0.02)


@pytest.mark.parametrize(
    "other",
    [
        plane(raised=9.0, score=0.8),
        plane(raised=3.0, cot=-COT, score=0.8),
        plane(raised=3.0, turn_deg=35.0, score=0.8),
        plane(raised=3.0, cot=2.2 * COT, score=0.8),
        plane(raised=3.0, first=45, score=0.8),
    ],
    ids=["too far", "dips the other way", "other strike", "other dip", "hardly beside it"],
)
def test_what_is_no_flank_is_left_as_it_is(other):
    sheets = [plane(), other]
    found = join_flanks(sheets, CHOICE)
    assert len(found) == 2
    for before, after in zip(sheets, found, strict=True):
        np.testing.assert_array_equal(before.w, after.w)


def test_upright_faults_are_flanks_only_where_they_nearly_touch():
    upright = plane(cot=0.1)
    beside = replace(upright, w=upright.w + np.float32(2.0), score=upright.score * np.float32(0.8))
    assert len(join_flanks([upright, beside], CHOICE)) == 2
    touching = replace(beside, w=upright.w + np.float32(1.0))
    assert len(join_flanks([upright, touching], CHOICE)) == 1


def test_no_sheet_is_no_sheet():
    assert join_flanks([], CHOICE) == []


def test_settings_say_what_flanks_are():
    sheets = [plane(raised=3.0), plane(raised=-3.0, score=0.8)]
    assert len(join_flanks(sheets, CHOICE, settings=FlankSettings(apart=4.0))) == 2


def test_a_gentle_fault_under_a_long_wavelet_is_found_once_and_in_its_place():
    """Its throw is a third of the wavelet: layers only bend down over it."""
    fault = SyntheticFault((48.0, 48.0, 48.0), 20.0, 36.0, 7.0)
    cube = fault_cube(
        "clean", seed=4, shape=(96, 96, 96), wavelength=(22.0, 22.0), layer_spacing=(2.0, 9.0), population=None,
        faults=(fault,),
    )  # fmt: skip
    faults = trace_faults(cube.seismic)
    score = fault_score(faults.labels, cube.faults)
    assert len(faults.surfaces) == 1
    assert score.precision > 0.9
    assert score.recall > 0.8
