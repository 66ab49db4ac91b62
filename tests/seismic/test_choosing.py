from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plain_sheets import candidate

import seismo3d as s3
from seismo3d.seismic.choosing import ChoiceSettings, choose_faults, may_be_faults
from seismo3d.seismic.sheet_measures import strength
from seismo3d.synthetic import fault_cube
from seismo3d.synthetic.bodies import Channel

SETTINGS = ChoiceSettings()
HOST = candidate()


def chosen(*candidates):
    return choose_faults(list(candidates), SETTINGS)


def test_a_large_strong_sheet_stands_by_itself():
    assert chosen(HOST) == [0]


@pytest.mark.parametrize(
    "change",
    [{"rows": 8, "columns": 20}, {"score": 0.18}, {"rows": 200, "columns": 8}, {"throw": 0.4}],
    ids=["small", "weak", "flat", "unmoved"],
)
def test_a_sheet_that_lacks_one_thing_does_not_stand(change):
    assert chosen(candidate(**change)) == []


@pytest.mark.parametrize(
    ("change", "stands"),
    [({"fit": 0.2}, False), ({"fit": 0.3}, True), ({"fit": 0.2, "score": 0.7}, True), ({"fit": 0.0}, False)],
)
def test_what_matches_next_to_nowhere_stands_by_strong_support_alone(change, stands):
    """Edges of chaotic beds break off layers, too; nothing tells that their sides were ever one."""
    assert chosen(candidate(**change)) == [0] * stands


@pytest.mark.parametrize(
    ("matched", "in_view", "stands"),
    [(0.2, 1.0, False), (0.2, 0.3, True), (0.2, 0.6, False), (0.06, 0.03, False)],
    ids=["all in view", "the rest out of the cube", "much of the rest within", "too little to tell"],
)
def test_what_leads_out_of_the_cube_need_not_match(matched, in_view, stands):
    sheet, throw = candidate()
    fit = np.where(np.arange(throw.fit.size).reshape(throw.fit.shape) < matched * throw.fit.size, 0.78, 0.0)
    moved = replace(throw, fit=fit.astype(np.float32), in_view=in_view)
    assert chosen((sheet, moved)) == [0] * stands


@pytest.mark.parametrize(("in_view", "stays"), [(1.0, False), (0.5, True)])
def test_company_must_match_where_its_throw_leads_within_the_cube(in_view, stays):
    sheet, throw = candidate(20, 30, origin=(5.0, 10.0), dip=60.0, score=0.46, fit=0.7)
    fit = np.where(np.arange(20)[:, None] < 5, throw.fit, np.float32(0.0))
    assert chosen(HOST, (sheet, replace(throw, fit=fit, in_view=in_view))) == [0] + [1] * stays


def test_a_tall_sheet_needs_less_strength_than_a_low_one():
    tall, low = candidate(16, 40, score=0.51), candidate(40, 16, score=0.51)
    assert strength(tall[0]) == pytest.approx(strength(low[0]))
    assert chosen(tall) == [0]
    assert chosen(low) == []


def test_a_weaker_sheet_is_kept_beside_a_strong_one_only():
    near, far = candidate(20, 20, origin=(5.0, 10.0)), candidate(20, 20, origin=(40.0, 10.0))
    assert chosen(near) == []
    assert chosen(HOST, near, far) == [0, 1]


@pytest.mark.parametrize("change", [{"throw": 1.2}, {"fit": 0.3}, {"score": 0.36}], ids=["unmoved", "unlike", "weak"])
def test_company_must_move_and_fit(change):
    assert chosen(HOST, candidate(20, 20, origin=(5.0, 10.0), **change)) == [0]


def leftover(rows=30, columns=20, **change):
    sheet, throw = candidate(rows, columns, **{"origin": (5.0, 10.0), "dip": 60.0, "score": 0.4} | change)
    return replace(sheet, leftover=True), throw


def test_a_leftover_is_kept_beside_a_strong_fault_only():
    assert chosen(leftover()) == []
    assert chosen(leftover(80, 40, score=2.0)) == []
    assert chosen(HOST, leftover()) == [0, 1]


@pytest.mark.parametrize(
    ("change", "stays"),
    [
        ({"score": 0.33}, False),
        ({"throw": 1.3}, False),
        ({"fit": 0.7}, False),
        ({"dip": 82.0}, False),
        ({"dip": 45.0}, False),
        ({"dip": 45.0, "score": 0.5}, True),
        ({"rows": 60, "score": 0.3}, True),
        ({"columns": 12, "rows": 60}, False),
    ],
    ids=["weak", "hardly moved", "unlike", "upright", "gentle and weak", "gentle", "weak but large", "short"],
)
def test_a_leftover_must_move_match_and_slope(change, stays):
    assert chosen(HOST, leftover(**change)) == [0] + [1] * stays


@pytest.mark.parametrize(("share", "stays"), [(0.2, True), (0.08, False)])
def test_a_leftover_may_match_on_a_little_of_it(share, stays):
    sheet, throw = leftover()
    fit = np.where(np.arange(throw.fit.size).reshape(throw.fit.shape) < share * throw.fit.size, 0.8, 0.0)
    assert chosen(HOST, (sheet, replace(throw, fit=fit.astype(np.float32)))) == [0] + [1] * stays


@pytest.mark.parametrize("is_leftover", [True, False])
def test_what_slopes_and_matches_well_is_kept_for_what_of_it_is_new(is_leftover):
    """It may go on over a fault that was chosen before: what lies on it there is parted off later."""

    def beside(crossline, **change):
        sheet, throw = candidate(30, 20, **{"origin": (0.0, crossline), "score": 0.5, "dip": 60.0} | change)
        return replace(sheet, leftover=is_leftover), throw

    sloping = candidate(dip=60.0)
    assert chosen(sloping, beside(45.0)) == [0, 1]
    assert chosen(sloping, beside(20.0)) == [0]
    assert chosen(sloping, beside(45.0, fit=0.7)) == [0]


def test_leftovers_are_judged_last():
    """Of two doubles the one linked from strong ridges is kept, though it is the weaker one."""
    weak, strong = candidate(20, 20, origin=(5.0, 10.0), dip=60.0), leftover(20, 20, score=0.8)
    assert chosen(HOST, strong, weak) == [0, 2]


def test_the_same_fault_is_not_kept_twice():
    assert chosen(HOST, candidate(20, 20, origin=(1.0, 10.0))) == [0]


def test_of_two_weak_doubles_the_stronger_is_kept():
    weaker, stronger = candidate(20, 20, origin=(6.0, 10.0), score=0.54), candidate(20, 20, origin=(5.0, 10.0))
    assert chosen(HOST, weaker, stronger) == [0, 2]


def test_no_candidates_give_no_faults():
    assert choose_faults([], SETTINGS) == []


def test_sheets_too_small_for_any_throw_are_left_out_first():
    large, small, line = HOST[0], candidate(5, 10)[0], candidate(1, 400)[0]
    assert may_be_faults([large, small, line], False, SETTINGS) == [large]
    assert may_be_faults([line], True, ChoiceSettings.for_section()) == [line]


def test_a_low_fragment_beside_a_fault_counts_by_its_length_down_the_dip():
    host = candidate(dip=45.0)
    low = candidate(40, 13, origin=(5.0, 0.0), score=0.42, dip=45.0)
    upright = candidate(40, 13, origin=(5.0, 0.0), score=0.42)
    assert chosen(host, low) == [0, 1]
    assert chosen(candidate(), upright) == [0]


def test_a_bend_over_a_low_fault_is_no_company():
    bend = candidate(30, 20, origin=(-5.0, 0.0), score=0.42)
    across = candidate(30, 20, origin=(8.0, 0.0), across=(0.0, 1.0), score=0.42)
    assert chosen(candidate(dip=45.0), bend) == [0]
    assert chosen(candidate(dip=45.0), across) == [0, 1]
    assert chosen(candidate(dip=75.0), bend) == [0, 1]


@pytest.mark.parametrize(
    ("dip", "score", "joins"), [(40.0, 0.28, False), (40.0, 0.32, True), (50.0, 0.24, False), (50.0, 0.28, True)]
)
def test_low_company_needs_more_support(dip, score, joins):
    """Along unconformities and gentle bends weak ridges line up."""
    sheet = candidate(60, 20, origin=(5.0, 0.0), dip=dip, score=score)
    assert chosen(HOST, sheet) == [0, *[1] * joins]


def test_what_slopes_may_fit_less_well_than_what_may_be_a_channels_edge():
    assert chosen(HOST, candidate(40, 20, origin=(5.0, 0.0), score=0.42, fit=0.7)) == [0]
    sloping = candidate(40, 20, origin=(5.0, 0.0), score=0.42, fit=0.7, dip=50.0)
    assert chosen(HOST, sloping) == [0, 1]


def fits_on(share, fit, **change):
    """A candidate whose sides match on a share of its rows alone."""
    sheet, throw = candidate(**change)
    matched = np.zeros_like(throw.fit)
    matched[: int(len(matched) * share)] = fit
    return sheet, replace(throw, fit=matched)


@pytest.mark.parametrize(
    ("fit", "share", "joins"),
    [
        (0.65, 0.35, False),
        (0.65, 0.5, True),
        (0.8, 0.35, True),
        (0.9, 0.25, True),
        (0.75, 0.25, False),
        (0.9, 0.1, False),
    ],
)
def test_company_that_matches_on_little_of_it_must_match_well_there(fit, share, joins):
    beside = fits_on(share, fit, rows=40, columns=20, origin=(5.0, 0.0), score=0.42, dip=50.0)
    assert chosen(HOST, beside) == [0, 1][: 1 + joins]


@pytest.mark.parametrize(("share", "score", "joins"), [(0.45, 0.3, False), (0.45, 0.37, True), (0.6, 0.3, True)])
def test_weak_company_matches_on_half_of_it(share, score, joins):
    beside = fits_on(share, 0.85, rows=60, columns=22, origin=(5.0, 0.0), score=score, dip=50.0)
    assert chosen(HOST, beside) == [0, 1][: 1 + joins]


@pytest.mark.parametrize(("change", "stands"), [({}, True), ({"fit": 0.7}, False), ({"dip": 80.0}, False)])
def test_a_large_throw_may_lead_out_of_view_from_most_of_what_slopes(change, stands):
    """Chaotic beds match by chance where they are seen, but not so well; edges of channels are steep."""
    assert chosen(fits_on(0.2, **{"fit": 0.85, "dip": 50.0} | change)) == [0] * stands


def test_company_whose_sides_match_well_may_have_moved_less():
    place = {"rows": 40, "columns": 20, "origin": (5.0, 0.0), "score": 0.42}
    assert chosen(HOST, candidate(**place, throw=1.2, fit=0.8)) == [0]
    assert chosen(HOST, candidate(**place, throw=1.2, fit=0.95)) == [0, 1]
    assert chosen(HOST, candidate(**place, throw=0.9, fit=1.0)) == [0]


@pytest.mark.parametrize(
    ("change", "stands"),
    [
        ({}, False),
        ({"dip": 60.0}, True),
        ({"columns": 24}, True),
        ({"score": 0.96}, True),
        ({"columns": 24, "fit": 0.55}, False),
        ({"columns": 32, "fit": 0.55}, True),
        ({"columns": 24, "fit": 0.55, "score": 0.96}, True),
    ],
    ids=["low and steep", "slopes", "higher", "strong", "matches badly", "tall", "strong, matches badly"],
)
def test_a_low_edge_is_no_fault_by_itself(change, stands):
    shape = {"rows": 60, "columns": 18, "score": 0.6} | change
    assert chosen(candidate(**shape)) == ([0] if stands else [])


@pytest.mark.parametrize(
    ("change", "stands"),
    [
        ({}, True),
        ({"fit": 0.75}, False),
        ({"throw": 1.1}, False),
        ({"dip": 85.0}, False),
        ({"score": 0.45, "throw": 6.0}, False),
        ({"columns": 18, "dip": 75.0, "score": 0.6}, False),
    ],
    ids=["well told", "matches badly", "hardly moves", "upright", "weak", "low and steep"],
)
def test_a_small_sheet_that_matches_well_needs_less_strength(change, stands):
    shape = {"rows": 28, "columns": 22, "score": 0.55, "fit": 0.88, "dip": 68.0} | change
    assert chosen(candidate(**shape)) == ([0] if stands else [])


def small(**change):
    """A fault of 30 traces by 38 samples: its throw is a tenth of its height."""
    return candidate(**{"rows": 30, "columns": 20, "dip": 60.0, "score": 0.4, "throw": 4.0, "fit": 0.7} | change)


SWARM = [small(origin=(20.0 * n, 0.0), score=0.45) for n in (1, 2, 3)]


@pytest.mark.parametrize(
    ("change", "is_kept"),
    [
        ({}, True),
        ({"throw": -4.0}, True),
        ({"throw": 5.0}, False),
        ({"throw": 5.0, "columns": 22}, True),
        ({"throw": 0.9}, False),
        ({"fit": 0.58}, False),
        ({"score": 0.3}, False),
        ({"rows": 9, "score": 0.65}, False),
        ({"dip": 70.0, "fit": 0.8}, False),
        ({"dip": 70.0, "fit": 0.8, "columns": 22}, True),
        ({"dip": 82.0, "fit": 0.8, "columns": 22}, False),
    ],
    ids=[
        "small",
        "reverse",
        "far",
        "far and high",
        "unmoved",
        "unlike",
        "weak",
        "tiny",
        "low edge",
        "steep",
        "upright",
    ],
)
def test_a_small_fault_of_a_swarm_moves_as_its_size_has_it(change, is_kept):
    """What is cut out or laid down is alike across at some throw or other; faults grow by slip and in size together."""
    assert chosen(small(**change), *SWARM) == [*[0] * is_kept, 1, 2, 3]


def test_a_small_fault_of_a_swarm_matches_on_most_of_it_and_is_kept_once():
    sheet, throw = small()
    halved = throw.fit.copy()
    halved[:12] = 0.0
    assert chosen((sheet, replace(throw, fit=halved)), *SWARM) == [1, 2, 3]
    assert chosen((replace(sheet, leftover=True), throw), *SWARM) == [1, 2, 3]
    assert chosen((sheet, throw), small(score=0.38, origin=(1.0, 0.0)), *SWARM) == [0, 2, 3, 4]


def test_a_small_fault_is_found_among_others_only():
    """What lines up by chance does so once; faults as small as that come in swarms."""
    assert chosen(small()) == []
    assert chosen(small(), SWARM[0]) == []
    assert chosen(small(), *SWARM[:2]) == [0, 1, 2]
    assert chosen(small(origin=(120.0, 0.0)), *SWARM) == [1, 2, 3]
    standing = [candidate(30, 30, dip=60.0, score=0.7, origin=(15.0 * n, 0.0)) for n in (1, 2)]
    assert chosen(small(), *standing) == [0, 1, 2]


def test_a_small_sheet_that_matches_on_half_of_it_is_not_well_told():
    sheet, throw = candidate(28, 22, score=0.55, fit=0.88, dip=68.0)
    halved = throw.fit.copy()
    halved[:14] = 0.0
    assert chosen((sheet, replace(throw, fit=halved))) == []


@pytest.mark.parametrize("score", [0.45, 1.0], ids=["plain", "overwhelming"])
def test_overwhelming_support_stands_wherever_its_throw_leads(score):
    sheet, moved = candidate(rows=80, columns=24, score=score, throw=16.0)
    assert chosen((sheet, replace(moved, runs_on=0.95))) == ([0] if score == 1.0 else [])


def course_of(rows, columns, offsets):
    """A strong sheet whose course along its strike is offset so; rows traces by 2 * columns samples, dipping."""
    sheet, throw = candidate(rows, columns, score=1.0, dip=70.0)
    return replace(sheet, w=sheet.w + np.asarray(offsets, np.float32)[:, None]), throw


ALONG = np.arange(130.0)


@pytest.mark.parametrize(
    ("offsets", "columns", "stands"),
    [
        (12.0 * np.sin(ALONG * 2.0 * np.pi / 64.0), 16, False),
        (12.0 * np.sin(ALONG * 2.0 * np.pi / 64.0), 30, True),
        (3.0 * np.sin(ALONG * 2.0 * np.pi / 128.0), 16, True),
        (60.0 * (ALONG / 130.0) ** 2, 16, True),
    ],
    ids=["winds", "winds, high", "is wavy", "is an arc"],
)
def test_what_is_low_and_winds_is_a_channels_edge(offsets, columns, stands):
    winding = course_of(len(ALONG), columns, offsets)
    assert chosen(winding) == ([0] if stands else [])


def test_a_fault_that_cuts_a_corner_of_the_cube_is_no_channels_edge():
    """Its rows are short, for the cube ends; but it goes down through all of it."""
    sheet, throw = course_of(len(ALONG), 70, 12.0 * np.sin(ALONG * 2.0 * np.pi / 64.0))
    row, column = np.indices(sheet.w.shape)
    corner = np.abs(column - 0.45 * row - 6) <= 7
    assert chosen((sheet.only(corner), throw)) == [0]
    assert chosen((sheet.only(corner & (row < 60)), throw)) == []


def test_a_channels_edge_beside_a_fault_is_no_company():
    edge = course_of(len(ALONG), 16, 12.0 * np.sin(ALONG * 2.0 * np.pi / 64.0))
    host = candidate(rows=130, columns=60, origin=(30.0, 0.0), score=0.9, dip=70.0)
    straight = course_of(len(ALONG), 16, 0.0 * ALONG)
    assert chosen(host, edge) == [0]
    assert chosen(host, straight) == [0, 1]


@pytest.mark.parametrize(
    ("runs_on", "throw", "beside", "stands"),
    [(0.95, 16.0, False, False), (0.6, 16.0, False, True), (0.95, 2.0, False, True), (0.95, 16.0, True, True)],
    ids=["walls", "layers broken beyond it", "leads within", "cut off by a fault"],
)
def test_walls_that_end_within_layers_that_run_on_are_no_fault(runs_on, throw, beside, stands):
    sheet, moved = candidate(rows=80, columns=24, score=0.45, throw=throw, origin=(6.0, 0.0))
    walls = sheet, replace(moved, runs_on=runs_on)
    others = [candidate(rows=80, columns=60, score=0.9)] if beside else []
    assert (len(others) in chosen(*others, walls)) == stands


@pytest.mark.parametrize(
    ("thickness", "meander", "half_width"),
    [(28.0, (14.0, 90.0, 2.0), 8.0), (24.0, (10.0, 70.0, 1.0), 6.0)],
    ids=["found whole", "found in pieces"],
)
def test_a_cube_with_a_deep_channel_has_no_fault(thickness, meander, half_width):
    channel = Channel(40.0, thickness, (64.0, 48.0), 10.0, meander, half_width, 1.6, 0.3)
    cube = fault_cube("fault_free", seed=5, shape=(128, 96, 96), channels=(channel,), noise=0.0)
    assert not (s3.trace_faults(cube.seismic).labels > 0).any()


@pytest.mark.parametrize(
    ("change", "is_kept"),
    [({}, False), ({"throw": 9.0}, True), ({"dip": 70.0}, True), ({"across": (0.6, 0.8)}, True)],
    ids=["upright", "moves otherwise", "slopes alike", "strikes otherwise"],
)
def test_a_faults_own_break_seen_upright_is_no_fault(change, is_kept):
    host = candidate(dip=60.0)
    upright = candidate(columns=22, origin=(21.0 / np.tan(np.radians(60.0)), 0.0), **change)
    assert chosen(upright) == [0]
    assert chosen(host, upright) == ([0, 1] if is_kept else [0])


def test_small_cubes_ask_for_less_of_what_is_tall_alone():
    settings = ChoiceSettings()
    assert settings.for_size((128, 128, 128)) is settings
    assert settings.for_size((70, 400, 128)) is settings
    assert settings.for_size((1, 400, 64)) is settings
    narrow, tiny = settings.for_size((400, 12, 128)), settings.for_size((48, 48, 64))
    assert narrow.tall_strength == settings.company_strength
    assert narrow.host_strength == pytest.approx(33.0 * np.sqrt(12 * 128) / 90.0)
    assert tiny.tall_strength == pytest.approx(max(11.0, 17.0 * np.sqrt(48 * 64) / 90.0))
    assert narrow.least_strength == tiny.least_strength == settings.least_strength


def test_lines_of_a_section_are_more_than_chance_would_have():
    settings = ChoiceSettings.for_section()
    assert settings.for_size((1, 200, 600)).chance == pytest.approx(12.0 * settings.chance)

    def kept(supports, size):
        lines = [candidate(score=score) for score in supports]
        return choose_faults(lines, settings.for_size((1, *size)))

    weak = 3.0 / strength(candidate(score=1.0)[0])
    # in a section so large some two dozen such lines are expected of noise alone
    assert kept([weak] * 20, (500, 2000)) == []
    assert kept([weak] * 20, (64, 64)) == list(range(20))
    # strong ones stand, and so do weak ones of which noise would have few beside so many
    assert kept([2.5 * weak, weak], (500, 2000)) == [0]
    assert kept([2.5 * weak] * 40 + [1.4 * weak] * 10, (500, 2000)) == list(range(50))


def test_a_fault_across_a_small_cube_is_found():
    found = s3.trace_faults(fault_cube("noise", seed=11, shape=(48, 48, 64)).seismic)
    assert len(found.surfaces) > 0
    assert not s3.trace_faults(fault_cube("fault_free", seed=11, shape=(48, 48, 64)).seismic).surfaces
