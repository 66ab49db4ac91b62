from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_motions import ALONG_CROSSLINES, ALONG_INLINES, places, plane_motion, taken_apart

from seismo3d.seismic.fault_ages import (
    _SHARES,
    HistorySettings,
    _best_share,
    order_faults,
    tell_strike_slips,
)
from seismo3d.seismic.fault_motion import Frame

SETTINGS = HistorySettings()


def crossing(slid=0.0):
    """A fault, and an older one whose surface it has offset; it slid along its strike by a share of its throw."""
    young = plane_motion(ALONG_CROSSLINES)
    whole = plane_motion(ALONG_INLINES, throw=12.0)
    inlines = -(whole.first[0] + np.arange(64.0))[:, None] * np.ones(80)
    samples = np.ones(64)[:, None] * np.arange(80.0)
    # in its hanging wall the older plane lies lower by its throw
    offset = np.where(inlines > 32.0 + 0.4 * (samples - 40.0), (slid - 0.4) * 10.0, 0.0)
    return young, plane_motion(ALONG_INLINES, throw=12.0, offset=offset)


@pytest.mark.parametrize("turned", [False, True])
def test_the_younger_fault_has_offset_the_older(turned):
    motions = list(crossing())[:: -1 if turned else 1]
    younger = order_faults(motions, [places(m) for m in motions], [5000.0, 5000.0], np.arange(2), SETTINGS)
    young = 1 if turned else 0
    assert younger[young, 1 - young]
    assert younger.sum() == 1


def strike_slips(motions, families=None):
    n = len(motions)
    families = np.arange(n) if families is None else np.array(families)
    return tell_strike_slips(motions, [places(m) for m in motions], [5000.0] * n, families, SETTINGS)


@pytest.mark.parametrize("slid", [-0.4, -0.6, -1.0])
def test_an_older_fault_tells_how_far_the_younger_slid_along_its_strike(slid):
    young, old = strike_slips(crossing(slid))
    assert young.share == pytest.approx(slid, abs=0.06)
    assert young.certainty > 0.5
    assert old.share is None


def test_a_fault_that_slid_down_its_dip_is_told_nothing():
    assert [slip.share for slip in strike_slips(crossing())] == [None, None]


def test_a_fault_that_slid_past_an_older_one_without_a_trace_tells_nothing():
    # its slip lies in the older plane, which is whole: either may be the younger
    motions = list(crossing(0.4))
    nodes, areas = [places(m) for m in motions], [5000.0, 5000.0]
    assert not order_faults(motions, nodes, areas, np.arange(2), SETTINGS, sliding=True).any()
    assert [slip.share for slip in strike_slips(motions)] == [None, None]


def test_all_parts_of_a_fault_slid_alike():
    young, old = crossing(-0.4)
    behind = replace(young, first=(young.first[0] + 90.0, 0.0))
    turned = replace(behind, frame=Frame(young.frame.origin, -young.frame.across), hanging_side=-1)
    slips = strike_slips([young, old, turned], [0, 1, 0])
    assert slips[0].share == pytest.approx(-0.4, abs=0.06)
    assert slips[2].share == -slips[0].share


@pytest.mark.parametrize(("witnesses", "told"), [((1.8, 0.0), False), ((2.2, 0.0), True), ((0.8, 0.6), True)])
def test_two_older_faults_together_tell_what_one_must_tell_clearly(witnesses, told):
    mended = np.array([clear * np.exp(-0.5 * ((_SHARES - 0.4) / 0.1) ** 2) for clear in witnesses])
    share, certainty = _best_share(mended, SETTINGS)
    assert (share is not None) == told
    if told:
        assert share == pytest.approx(0.4)
        assert 0.5 < certainty < 1.0


def test_slip_hardly_off_the_dip_line_is_not_told():
    """Older faults tell 11 degrees no better than none."""
    for true, told in ((0.2, False), (0.4, True)):
        share, _ = _best_share(4.0 * np.exp(-0.5 * ((_SHARES - true) / 0.1) ** 2)[None], SETTINGS)
        assert (share is not None) == told


def test_a_strike_slip_that_mends_the_more_the_larger_it_is_is_not_believed():
    mended = np.linspace(-5.0, 5.0, len(_SHARES))[None]
    assert _best_share(mended, SETTINGS) == (None, 0.0)


def test_faults_that_do_not_meet_have_no_order():
    one, other = plane_motion(ALONG_INLINES), plane_motion(Frame(np.array([0.0, 90.0]), np.array([0.0, 1.0])))
    assert not order_faults([one, other], [places(one), places(other)], [5000.0, 5000.0], np.arange(2), SETTINGS).any()


def test_small_faults_are_not_taken_back():
    motions = list(crossing())
    assert not order_faults(motions, [places(m) for m in motions], [500.0, 5000.0], np.arange(2), SETTINGS).any()


def test_what_parts_tell_of_ages_is_added_up():
    young, old = crossing()
    nodes = places(old)
    # over few places the older fault is rough by too little to tell
    weak = replace(SETTINGS, least_gain=1.2 * abs(gain_of(young, old, nodes)))
    halves = [nodes[nodes[:, 2] < 40.0], nodes[nodes[:, 2] >= 40.0]]
    motions = [young, old, old]
    apart = order_faults(motions, [places(young), *halves], [5000.0] * 3, np.arange(3), weak)
    together = order_faults(motions, [places(young), *halves], [5000.0] * 3, np.array([0, 1, 1]), weak)
    assert not apart.any()
    np.testing.assert_array_equal(together, [[False, True, True], [False] * 3, [False] * 3])


@pytest.mark.parametrize("turned", [False, True])
def test_two_parts_on_either_side_of_a_fault_tell_that_it_is_younger(turned):
    young = plane_motion(ALONG_CROSSLINES, throw=30.0, cotangent=0.3)
    parts, nodes = taken_apart(young, plane_motion(ALONG_INLINES, cotangent=0.6))
    motions, at = [young, *parts], [places(young), *nodes]
    order = [2, 0, 1] if turned else [0, 1, 2]
    motions, at = [motions[n] for n in order], [at[n] for n in order]
    families = np.array([[0, 1, 1][n] for n in order])
    younger = order_faults(motions, at, [5000.0] * 3, families, SETTINGS)
    first = order.index(0)
    expected = np.zeros((3, 3), bool)
    expected[first] = families != 0
    np.testing.assert_array_equal(younger, expected)
    # nor does a strike slip explain it
    np.testing.assert_array_equal(order_faults(motions, at, [5000.0] * 3, families, SETTINGS, sliding=True), expected)
    # it is told more clearly than by what each part tells alone
    clear = replace(SETTINGS, least_gain=7.0)
    np.testing.assert_array_equal(order_faults(motions, at, [5000.0] * 3, families, clear), expected)
    assert not order_faults(motions, at, [5000.0] * 3, np.arange(3), clear).any()


def gain_of(young, old, nodes):
    """The least that is asked for at which the order of two faults is still told."""
    asked = np.linspace(0.05, 20.0, 400)
    nodes, areas, families = [places(young), nodes], [5000.0] * 2, np.arange(2)
    limits = [replace(SETTINGS, least_gain=least) for least in asked]
    told = [order_faults([young, old], nodes, areas, families, limit).any() for limit in limits]
    return float(asked[np.flatnonzero(told)[-1]])
