from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_motions import ALONG_CROSSLINES, ALONG_INLINES, beside, in_parts, places, plane_motion, taken_apart

from seismo3d.seismic.fault_ages import HistorySettings
from seismo3d.seismic.fault_families import are_one, find_families

SETTINGS = HistorySettings()


def families_of(motions, areas=None):
    return find_families(motions, [places(m) for m in motions], areas or [5000.0] * len(motions), SETTINGS).tolist()


@pytest.mark.parametrize("turned", [False, True])
def test_parts_that_a_heave_took_apart_are_of_one_family(turned):
    parts = in_parts()[:: -1 if turned else 1]
    others = beside(plane_motion(ALONG_INLINES), 25.0), plane_motion(ALONG_CROSSLINES)
    assert families_of([*parts, *others]) == [0, 0, 1, 2]


def test_what_covers_dips_otherwise_or_lies_far_off_is_of_another_family():
    first, second = in_parts(heave=15.0)
    assert families_of([first, second]) == [0, 1]
    assert families_of([in_parts()[0], in_parts(cotangent=-0.4)[1]]) == [0, 1]
    # side by side, however near
    assert families_of([first, beside(first, 5.0)]) == [0, 1]
    # found twice
    assert families_of([first, replace(first, throw=first.throw + 1.0)]) == [0, 0]
    assert find_families([], [], [], SETTINGS).tolist() == []


def test_what_is_thrown_up_is_of_another_family_than_what_is_thrown_down():
    first, second = in_parts()
    for throw, together in ((10.0, True), (3.0, True), (-1.5, True), (-3.0, False), (-10.0, False)):
        both = [first, replace(second, throw=np.full_like(second.throw, throw))]
        assert families_of(both) == [0, 0 if together else 1]
        # so small a part may have been matched a cycle off
        assert families_of(both, [5000.0, 500.0]) == [0, 0]


@pytest.mark.parametrize("overrun", [0.0, 2.0])
def test_parts_that_another_fault_took_far_apart_are_of_one_family(overrun):
    young = plane_motion(ALONG_CROSSLINES, throw=30.0, cotangent=0.3)
    (one, other), nodes = taken_apart(young, plane_motion(ALONG_INLINES, cotangent=0.6), overrun=overrun)

    def families(cut=young, second=other, at=nodes[1], areas=(5000.0, 5000.0, 5000.0)):
        found = find_families([cut, one, second], [places(cut), nodes[0], at], list(areas), SETTINGS)
        return found.tolist()

    # 18 traces of the one by the other, where a throw of 30 went down a dip of 59 degrees
    assert families() == [0, 1, 1]
    # what is too small to be taken back takes nothing apart
    assert families(areas=(1000.0, 5000.0, 5000.0)) == [0, 1, 2]
    # a throw that takes it elsewhere
    assert families(cut=replace(young, throw=young.throw - 12.0)) == [0, 1, 2]
    assert families(second=beside(other, 6.0), at=nodes[1] + [0.0, 6.0, 0.0]) == [0, 1, 2]
    # thrown up here, and down there
    assert families(second=replace(other, throw=-other.throw)) == [0, 1, 2]
    # both on one side
    assert families(at=nodes[0] + [0.0, 18.0, 0.0], second=beside(one, 18.0)) == [0, 1, 2]


def test_one_part_carries_on_but_one_of_two_side_by_side():
    first, second = in_parts(heave=0.0)
    # the nearer of the two goes with the part that carries both on
    assert families_of([first, second, beside(first, 4.0)]) == [0, 0, 1]
    assert families_of([beside(first, 4.0), second, first]) == [0, 1, 1]


def test_parts_of_one_plane_are_one():
    points = places(plane_motion(ALONG_INLINES))
    one, other = points[points[:, 0] < 28.0], points[points[:, 0] > 36.0]
    across = ALONG_INLINES.across
    assert are_one(ALONG_INLINES, one, across, other, SETTINGS)
    assert are_one(ALONG_INLINES, one, -across, other, SETTINGS)
    assert not are_one(ALONG_INLINES, one, across, other + np.array([0.0, 5.0, 0.0]), SETTINGS)
    assert not are_one(ALONG_INLINES, one, ALONG_CROSSLINES.across, other, SETTINGS)
    assert not are_one(ALONG_INLINES, one, across, other + np.array([60.0, 0.0, 0.0]), SETTINGS)
    assert not are_one(ALONG_INLINES, points, across, points, SETTINGS)
