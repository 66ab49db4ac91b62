from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.seismic.fault_ages import (
    _SHARES,
    HistorySettings,
    _best_share,
    are_one,
    find_families,
    order_faults,
    tell_strike_slips,
)
from seismo3d.seismic.fault_motion import FaultMotion, Frame, find_motion, undo_parts

ALONG_INLINES = Frame(np.array([0.0, 32.0]), np.array([0.0, 1.0]))
ALONG_CROSSLINES = Frame(np.array([32.0, 0.0]), np.array([1.0, 0.0]))
SETTINGS = HistorySettings()


def plane_motion(frame, *, throw=10.0, cotangent=0.4, share=0.0, rows=64, samples=80, offset=None):
    """The motion of a plane that dips along `across`, its middle at sample 40; w is raised by an offset of its grid."""
    first_s = -63.0 if frame is ALONG_INLINES else 0.0
    w = np.broadcast_to(cotangent * (np.arange(samples) - 40.0), (rows, samples)).copy()
    if offset is not None:
        w += offset
    thin = np.full(w[::2, ::2].shape, throw, np.float32)
    return find_motion(
        frame, (first_s, 0.0), w, thin, np.ones_like(thin), hanging_side=1 if cotangent > 0 else -1, share=share,
        stiffness=300.0,
    )  # fmt: skip


def places(motion: FaultMotion, every: int = 2):
    rows, samples = (at.ravel() for at in np.meshgrid(*(np.arange(0, n, every) for n in motion.height.shape)))
    s = motion.first[0] + rows.astype(float)
    return motion.frame.place(s, motion.first[1] + samples, motion.height[rows, samples])


@pytest.mark.parametrize(("cotangent", "throw"), [(0.4, 10.0), (0.4, -6.0), (-0.3, 5.0)])
def test_the_hanging_wall_goes_back_up_the_surface(cotangent, throw):
    motion = plane_motion(ALONG_INLINES, cotangent=cotangent, throw=throw)
    hanging = 32.0 + motion.hanging_side * 9.0
    points = np.array([[20.0, hanging, 40.0], [20.0, 64.0 - hanging, 40.0]])
    np.testing.assert_array_equal(np.sign(motion.side(points)), [1.0, -1.0])
    moved = motion.undo(points)
    np.testing.assert_allclose(moved[0], [20.0, hanging - cotangent * throw, 40.0 - throw], atol=1e-3)
    np.testing.assert_array_equal(moved[1], points[1])


def test_slip_along_strike_goes_back_too():
    motion = plane_motion(ALONG_INLINES, share=0.5)
    moved = motion.undo(np.array([[20.0, 40.0, 40.0]]))
    # the frame's `along` is against growing inlines
    np.testing.assert_allclose(moved[0], [25.0, 36.0, 30.0], atol=1e-3)


def test_a_plane_goes_on_beyond_its_grid():
    motion = plane_motion(ALONG_INLINES)
    np.testing.assert_allclose(motion.height_at(np.array([-90.0]), np.array([110.0])), [28.0], atol=1e-6)
    assert motion.apart_at(np.array([[90.0, 32.0, 40.0]]))[0] == pytest.approx(27.0)


@pytest.mark.parametrize("cotangent", [0.4, -0.3])
def test_points_near_a_motion_are_those_that_its_distances_tell(cotangent):
    rng = np.random.default_rng(0)
    motion = plane_motion(ALONG_INLINES, cotangent=cotangent, offset=2.0 * np.sin(0.2 * np.arange(80.0)))
    points = rng.uniform([-20.0, -20.0, -20.0], [90.0, 90.0, 110.0], (3000, 3))
    found, side = motion.find_near(points, clear=2.0, reach=20.0, edge=6.0)
    away = np.abs(motion.side(points))
    expected = (away > 2.0) & (away < 20.0) & (motion.apart_at(points) <= 6.0)
    np.testing.assert_array_equal(found, np.flatnonzero(expected))
    np.testing.assert_allclose(side, motion.side(points[found]), atol=1e-9)
    assert 100 < len(found) < 1500


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


def in_parts(*, heave=6.0, cotangent=0.4):
    """One plane in two parts, along the strike one after the other, taken apart across it by a heave."""
    first = plane_motion(ALONG_INLINES, rows=30, cotangent=cotangent)
    moved = Frame(ALONG_INLINES.origin + np.array([0.0, heave]), ALONG_INLINES.across)
    second = plane_motion(moved, rows=30, cotangent=cotangent)
    return first, replace(second, first=(first.first[0] + 34.0, 0.0))


def beside(motion, traces):
    """The same fault, so many traces across."""
    return replace(motion, frame=Frame(motion.frame.origin + traces * motion.frame.across, motion.frame.across))


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


def test_one_part_carries_on_but_one_of_two_side_by_side():
    first, second = in_parts(heave=0.0)
    # the nearer of the two goes with the part that carries both on
    assert families_of([first, second, beside(first, 4.0)]) == [0, 0, 1]
    assert families_of([beside(first, 4.0), second, first]) == [0, 1, 1]


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


def gain_of(young, old, nodes):
    """The least that is asked for at which the order of two faults is still told."""
    asked = np.linspace(0.05, 20.0, 400)
    nodes, areas, families = [places(young), nodes], [5000.0] * 2, np.arange(2)
    limits = [replace(SETTINGS, least_gain=least) for least in asked]
    told = [order_faults([young, old], nodes, areas, families, limit).any() for limit in limits]
    return float(asked[np.flatnonzero(told)[-1]])


def test_a_fault_found_in_parts_moves_nothing_twice():
    whole = plane_motion(ALONG_INLINES, throw=8.0)
    first, second = in_parts(heave=0.0)
    points = np.random.default_rng(1).uniform([0.0, 0.0, 10.0], [63.0, 63.0, 70.0], (400, 3))
    parts = [replace(part, throw=np.full(part.throw.shape, 8.0)) for part in (first, second)]
    np.testing.assert_allclose(undo_parts(parts, points), whole.undo(points), atol=1e-6)
    np.testing.assert_array_equal(undo_parts(parts[:1], points), parts[0].undo(points))
    # each by its own throw
    parts[1] = replace(parts[1], throw=np.full(second.throw.shape, 3.0))
    moved = points[:, 2] - undo_parts(parts, points)[:, 2]
    hanging = whole.side(points) > 0
    s = ALONG_INLINES.lay(points)[0]
    np.testing.assert_allclose(moved[hanging & (s < -34.0)], 8.0, atol=1e-6)
    np.testing.assert_allclose(moved[hanging & (s > -29.0)], 3.0, atol=1e-6)
    np.testing.assert_array_equal(moved[~hanging], 0.0)


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
