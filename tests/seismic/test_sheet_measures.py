from __future__ import annotations

import numpy as np
import pytest
from plain_sheets import candidate

from seismo3d.seismic.sheet_measures import (
    dip_deg,
    length_down_dip,
    mean_support,
    median_fit,
    median_throw,
    share_matched,
    strength,
    vertical_extent,
)


def test_strength_is_mean_support_times_the_root_of_the_area():
    assert strength(candidate(10, 20, score=0.5)[0]) == pytest.approx(0.5 * 20.0)


@pytest.mark.parametrize("dip", [27.0, 45.0, 63.4, 90.0])
def test_dip_and_length_down_it_are_those_of_the_plane(dip):
    sheet, _ = candidate(20, 31, dip=dip)
    assert dip_deg(sheet) == pytest.approx(dip, abs=0.1)
    assert length_down_dip(sheet) == pytest.approx(60.0 / np.sin(np.radians(dip)), rel=1e-3)


def test_a_sheet_of_no_nodes_has_no_size():
    sheet, throw = candidate(10, 20)
    none = sheet.only(np.zeros(sheet.w.shape, bool))
    assert vertical_extent(sheet) == 38.0
    assert (strength(none), vertical_extent(none), share_matched(none, throw), median_fit(none, throw)) == (0, 0, 0, 0)


def test_only_places_whose_sides_match_have_a_fit():
    sheet, throw = candidate(10, 20)
    throw.fit[:4] = 0.0
    throw.fit[4:7] = 0.5
    throw.throw[5:] = np.nan
    throw.throw[:2] = -9.0
    assert share_matched(sheet, throw) == pytest.approx(0.6)
    assert median_fit(sheet, throw) == pytest.approx(0.65)
    assert median_throw(throw) == pytest.approx(6.0)
    assert mean_support(sheet) == pytest.approx(0.6)
