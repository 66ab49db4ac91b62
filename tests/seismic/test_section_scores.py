"""Scores of a section's crests: what a move explains, and what a long line adds."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy import ndimage

from seismo3d.seismic import _kernels_moves as kernels
from seismo3d.seismic._kernels_filters import gaussian_taps
from seismo3d.seismic.linking import link_sheets
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.section_scores import (
    SectionScoreSettings,
    explain_breaks,
    spread_likelihood,
    weigh_by_lines,
    weigh_crests,
    weigh_line,
)
from seismo3d.seismic.sheets import SheetSettings

N_TRACES, N_SAMPLES, STEP = 60, 80, 2
FAULT, NOISY, BRIGHT = 29.5, 14, 44.5
SETTINGS = SectionScoreSettings()


def make_section(throw=3, *, slope=0.0):
    """Layers cut by an upright fault, with one trace of noise and a change of gain."""
    rng = np.random.default_rng(5)
    trace = ndimage.gaussian_filter1d(rng.normal(size=N_SAMPLES + 200), 1.5)
    trace /= trace.std()
    depth = np.arange(N_SAMPLES)[None] + 100.0 - slope * np.arange(N_TRACES)[:, None]
    depth[np.arange(N_TRACES) > FAULT] -= throw
    section = np.interp(depth, np.arange(trace.size), trace)
    section[NOISY] += rng.normal(size=N_SAMPLES)
    section[np.arange(N_TRACES) > BRIGHT] *= 1.6
    return section.astype(np.float32)


def crests(*traces, samples=range(20, 61, STEP), score=1.0, axis=1, cotangent=0.0):
    """Upright lines of crests at the given traces."""
    places = np.array([(t, s) for t in traces for s in samples], np.float32)
    positions = np.zeros((len(places), 3), np.float32)
    positions[:, axis], positions[:, 2] = places.T
    voxels = np.rint(positions / [1, 1, STEP]).astype(np.int32)
    planes = np.zeros_like(positions)
    planes[:, axis], planes[:, 2] = 1.0, cotangent
    return RidgePoints(voxels, positions, planes, np.full(len(places), score, np.float32))


def explain(section, ridges, *, slope=0.0, axis=1):
    volume = section[None] if axis == 1 else section[:, None]
    slopes = [np.zeros_like(volume), np.zeros_like(volume)]
    slopes[axis][:] = slope
    return explain_breaks(volume, np.ones(volume.shape, bool), tuple(slopes), ridges, settings=SETTINGS)


# ----- kernels against their definition


def test_sides_are_means_of_traces_carried_along_the_slope():
    section, slope = make_section(slope=0.25), np.full((N_TRACES, N_SAMPLES), 0.25, np.float32)
    sides, known = np.empty((2, 2, 11), np.float32)
    x, z, cotangent = 20.3, 40, 0.4
    kernels.read_beside(section, np.ones(section.shape, bool), slope, x, z, cotangent, 1, 3, 3, sides, known)
    assert known.all()
    for m in range(11):
        at = x + cotangent * (m - 5)
        for side, sign in enumerate((-1, 1)):
            places = [(at + sign * d, z + m - 5 + sign * d * 0.25) for d in (1, 2, 3)]
            wanted = ndimage.map_coordinates(section.astype(float), np.array(places).T, order=1).mean()
            assert sides[side, m] == pytest.approx(wanted, abs=1e-5)


def test_nothing_is_read_beyond_the_section_or_where_there_are_no_data():
    section, slope = make_section(), np.zeros((N_TRACES, N_SAMPLES), np.float32)
    valid = np.ones(section.shape, bool)
    valid[21:] = False
    sides, known = np.empty((2, 2, 21), np.float32)
    kernels.read_beside(section, valid, slope, 20.0, 4, 0.0, 1, 3, 3, sides, known)
    assert not known[1].any()
    np.testing.assert_array_equal(known[0], np.arange(21) >= 6)


@pytest.mark.parametrize("move", [-5, -2, -1, 0, 1, 4, 7])
def test_moved_misfit_is_the_ratio_of_the_shifted_sides(rng, move):
    taps = gaussian_taps(2.0)
    half = len(taps) // 2
    sides = rng.normal(size=(2, 2 * half + 21)).astype(np.float32)
    middle = sides.shape[1] // 2
    first = middle - half - move // 2
    left, right = sides[0, first : first + len(taps)], sides[1, first + move : first + move + len(taps)]
    wanted = (taps * (left - right) ** 2).sum() / ((taps * (left**2 + right**2)).sum() + 0.1)
    assert kernels.moved_misfit(sides, np.ones_like(sides), move, taps) == pytest.approx(wanted, rel=1e-5)


def test_misfit_is_one_where_less_than_half_of_the_window_is_known():
    taps = gaussian_taps(2.0)
    sides, known = np.ones((2, 41), np.float32), np.ones((2, 41), np.float32)
    known[1, 21:] = 0.0
    assert kernels.moved_misfit(sides, known, 0, taps) == 0.0
    known[1, 19:] = 0.0
    assert kernels.moved_misfit(sides, known, 0, taps) == 1.0


# ----- what a move explains


@pytest.mark.parametrize("throw", [2, 3, -5, 9])
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_a_move_explains_a_fault_and_neither_noise_nor_gain(throw, slope):
    section = make_section(throw, slope=slope)
    assert explain(section, crests(FAULT), slope=slope).min() > 0.8
    # the two crests that a bad trace makes: beside it, where it is the nearest trace of one side
    for trace in (NOISY - 1.0, NOISY + 1.0):
        assert np.median(explain(section, crests(trace), slope=slope)) < 0.2
    assert np.median(explain(section, crests(BRIGHT), slope=slope)) < 0.05


def test_unbroken_layers_are_explained_by_no_move():
    assert explain(make_section(), crests(22.0)).max() < 0.05


def test_a_leaning_fault_is_read_along_its_dip():
    cotangent = 0.5
    rng = np.random.default_rng(3)
    trace = ndimage.gaussian_filter1d(rng.normal(size=300), 1.5)
    x, z = np.mgrid[:N_TRACES, :N_SAMPLES]
    hanging = x > 20.0 + cotangent * (z - 20)
    section = trace[100 + z - 4 * hanging].astype(np.float32) / np.float32(trace.std())
    ridges = crests(20.0, cotangent=cotangent)
    ridges.positions[:, 1] += cotangent * (ridges.positions[:, 2] - 20.0)
    along = explain(section, ridges)
    upright = explain(section, replace(ridges, planes=crests(20.0).planes))
    assert np.median(along) > 0.9
    assert np.median(along) > np.median(upright) + 0.1


def test_either_axis_gives_the_same_bits():
    section = make_section()
    across = explain(section, crests(FAULT, 20.0, NOISY + 1.0))
    along = explain(section, crests(FAULT, 20.0, NOISY + 1.0, axis=0), axis=0)
    np.testing.assert_array_equal(across, along)


def test_mirrored_and_turned_over_sections_give_the_same_shares():
    section, traces = make_section(throw=5), (FAULT, 20.0, NOISY + 1.0)
    plain = explain(section, crests(*traces))
    mirrored = explain(np.ascontiguousarray(section[::-1]), crests(*(N_TRACES - 1 - t for t in traces)))
    np.testing.assert_allclose(mirrored, plain, atol=1e-5)
    np.testing.assert_allclose(explain(-section, crests(*traces)), plain, atol=1e-6)


def test_one_thread_and_two_give_the_same_bits():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread is all there is")
    before = numba.get_num_threads()
    try:
        results = []
        for threads in (1, 2):
            numba.set_num_threads(threads)
            results.append(explain(make_section(), crests(FAULT, 20.0, NOISY + 1.0)))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(*results)


def test_crests_lose_what_no_move_explains():
    section, ridges = make_section()[None], crests(FAULT, BRIGHT, score=0.8)
    flat = (np.zeros_like(section), np.zeros_like(section))
    valid = np.ones(section.shape, bool)
    share = explain_breaks(section, valid, flat, ridges, settings=SETTINGS)
    weighed = weigh_crests(section, valid, flat, ridges, settings=replace(SETTINGS, doubt=0.5))
    np.testing.assert_allclose(weighed.score, 0.8 * (0.5 + 0.5 * share), rtol=1e-6)
    np.testing.assert_array_equal(weighed.positions, ridges.positions)
    kept = weigh_crests(section, valid, flat, ridges, settings=replace(SETTINGS, doubt=0.0))
    np.testing.assert_array_equal(kept.score, ridges.score)


def test_no_crests_are_no_crests():
    empty = crests(FAULT).select(np.zeros(21, bool))
    assert len(explain(make_section(), empty)) == 0
    assert len(by_lines(empty).score) == 0


# ----- what a long line adds


def by_lines(ridges):
    shape = (1, N_TRACES, N_SAMPLES // STEP)
    return weigh_by_lines(ridges, shape, step=STEP, link=SheetSettings(fragment=6, contacts=5), settings=SETTINGS)


def joined(*parts):
    return RidgePoints(*(np.concatenate([getattr(part, name) for part in parts]) for name in RidgePoints.__slots__))


def test_of_two_crests_of_one_score_that_on_the_longer_line_counts_more():
    long, short, lone = crests(10.0, samples=range(4, 76, STEP)), crests(30.0, samples=range(30, 50, STEP)), [40]
    ridges = joined(long, short, crests(50.0, samples=lone))
    score = by_lines(ridges).score
    parts = np.split(score, [len(long.score), len(long.score) + len(short.score)])
    assert parts[0].min() > parts[1].max() > parts[2].max()
    # the square root of the strength, which is that of the length: 72 samples against 20
    assert np.median(parts[0]) / np.median(parts[1]) == pytest.approx((72 / 20) ** 0.25, rel=0.1)
    np.testing.assert_allclose(parts[2], np.sqrt(np.sqrt(STEP) / SETTINGS.usual_strength), rtol=1e-6)


def test_a_line_of_usual_strength_leaves_a_score_of_one():
    score = by_lines(crests(20.0, samples=range(10, 59, STEP))).score
    assert np.median(score) == pytest.approx(1.0, rel=0.1)


def test_weak_crests_are_linked_into_no_line():
    weak = by_lines(crests(20.0, score=0.1)).score
    np.testing.assert_allclose(weak, 0.1 * np.sqrt(np.sqrt(STEP) / SETTINGS.usual_strength), rtol=1e-5)


def test_a_weak_place_of_a_long_line_gains_and_stays_the_weakest():
    ridges = crests(20.0, samples=range(4, 76, STEP))
    ridges.score[15:18] = 0.3
    alone = crests(20.0, score=0.3, samples=range(34, 40, STEP))
    score = by_lines(ridges).score
    assert score[15:18].min() > 1.5 * by_lines(alone).score.max()
    assert score[15:18].max() < np.delete(score, np.s_[15:18]).min()


def test_a_sheet_gets_the_scores_of_the_crests_on_it():
    ridges = crests(20.0, samples=range(4, 76, STEP), score=0.7)
    shape, link = (1, N_TRACES, N_SAMPLES // STEP), SheetSettings(fragment=6, contacts=5)
    sheet = link_sheets(ridges, shape, step=STEP, least_points=6, settings=link)[0]
    weighed = weigh_line(sheet, SETTINGS)
    assert np.nanmedian(weighed.score) == pytest.approx(np.median(by_lines(ridges).score), rel=0.02)
    np.testing.assert_array_equal(weighed.inside, sheet.inside)


@pytest.mark.parametrize("axis", [0, 1])
def test_likelihood_spreads_over_the_traces_beside_a_line(axis):
    settings = SectionScoreSettings(spread=1.5)
    lines = np.zeros((20, 1, 3), np.float32)
    lines[8, 0, 1], lines[10, 0, 1], lines[0, 0, 2] = 0.8, 0.2, 0.5
    spread = spread_likelihood(lines.swapaxes(0, axis), settings=settings).swapaxes(0, axis)[:, 0]
    gaussian = np.exp(-0.5 * (np.arange(-19, 20) / 1.5) ** 2) * (np.abs(np.arange(-19, 20)) <= 4)
    at = np.arange(20)
    assert spread[:, 0] == pytest.approx(np.zeros(20))
    assert spread[:, 1] == pytest.approx(
        np.maximum(0.8 * gaussian[at - 8 + 19], 0.2 * gaussian[at - 10 + 19]), abs=1e-6
    )
    assert spread[:, 2] == pytest.approx(0.5 * gaussian[at + 19], abs=1e-6)


def test_likelihood_of_few_traces_spreads_too():
    lines = np.ones((2, 1, 4), np.float32)
    assert (spread_likelihood(lines, settings=SectionScoreSettings()) == 1.0).all()
