from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy import ndimage

from seismo3d.seismic import _kernels_throw as kernels
from seismo3d.seismic.dip import DipSettings, estimate_slopes
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import (
    SheetThrow,
    ThrowSettings,
    at_every,
    farther_off,
    gather_closer,
    gather_sides,
    mask_sheets,
    match_sides,
    refine_throw,
    slopes_beside,
)

SHAPE = (30, 40, 80)


def layer_values(depth, *, seed=3):
    values = np.convolve(np.random.default_rng(seed).normal(size=500), np.hanning(9), "same")
    return np.interp(depth, np.arange(-200, 300), values / values.std())


def faulted(throw, cotangent=0.4, *, shape=SHAPE, slope=0.0):
    """Layers cut by a plane that strikes along inlines; the side that lies on it has slid down it by `throw`."""
    _, x, k = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")
    beyond = x - shape[1] / 2 - cotangent * (k - shape[2] / 2) > 0
    hanging = beyond if cotangent >= 0 else ~beyond
    moved = np.where(hanging, throw, 0.0)
    return layer_values(k - moved - slope * (x - cotangent * moved)).astype(np.float32)


def sheet_on(cotangent=0.4, *, shape=SHAPE, step=2, turn=1.0, outside=None):
    """The plane of `faulted` as a sheet, its normal along growing crosslines or, with turn -1, against them."""
    columns = shape[2] // step
    w = turn * cotangent * (step * np.arange(columns) - shape[2] / 2)
    w = np.broadcast_to(w, (shape[0], columns)).astype(np.float32).copy()
    if outside is not None:
        w[outside] = np.nan
    # along = (-turn, 0): rows count inlines down from the far end, or up from 0
    first_s = -(shape[0] - 1.0) if turn > 0 else 0.0
    origin = np.array([0.0, shape[1] / 2])
    score = np.where(np.isfinite(w), 1.0, np.nan).astype(np.float32)
    return Sheet(origin, np.array([0.0, turn]), 0, step, first_s, w, score)


def measure(volume, sheet, *, valid=None, slope=0.0, **settings):
    valid = np.ones(volume.shape, bool) if valid is None else valid
    slopes = np.zeros_like(volume), np.full_like(volume, slope)
    chosen = ThrowSettings(**settings)
    sides = gather_sides(volume, valid, slopes, sheet, settings=chosen)
    return match_sides(sheet, sides.both, sides.known, settings=chosen)


def test_a_sheet_of_one_column_has_no_throw():
    sheet = sheet_on(0.0)
    middle = sheet.w.shape[1] // 2
    one = replace(sheet, first_sample=sheet.step * middle, w=sheet.w[:, [middle]], score=sheet.score[:, [middle]])
    found = measure(faulted(4.0, 0.0), one)
    assert found.throw.shape == found.fit.shape == (SHAPE[0], 1)
    assert np.isnan(found.throw).all()
    assert found.hanging_side == 1


def inner(values):
    """Away from the top and bottom, where one of the sides has left the cube."""
    return values[:, 12:-12]


@pytest.mark.parametrize("throw", [6.0, -6.0, 0.0, 15.0, 3.0, 4.5, -7.5])
@pytest.mark.parametrize("cotangent", [0.4, -0.4])
def test_throw_is_positive_where_the_hanging_wall_is_down(throw, cotangent):
    found = measure(faulted(throw, cotangent), sheet_on(cotangent))
    assert found.throw.dtype == np.float32
    assert found.hanging_side == (1 if cotangent > 0 else -1)
    # half a sample where the throw lies between two of the tried shifts
    assert np.median(inner(found.throw)) == pytest.approx(throw, abs=0.3)
    assert (np.abs(inner(found.throw) - throw) < 1.0).mean() > 0.9
    assert np.median(inner(found.fit)) > 0.8


@pytest.mark.parametrize("cotangent", [0.4, -0.4])
def test_sheet_may_face_either_way(cotangent):
    volume = faulted(5.0, cotangent)
    one, other = (measure(volume, sheet_on(cotangent, turn=turn)) for turn in (1.0, -1.0))
    assert one.hanging_side == -other.hanging_side
    # odd shifts are split unevenly between the sides
    np.testing.assert_allclose(inner(other.throw)[::-1], inner(one.throw), atol=0.3)


def test_transposed_cube_gives_the_same_throw():
    volume = faulted(6.0)
    plain = measure(volume, sheet_on())
    # with axes exchanged the plane's normal is the inline axis and its strike runs along crosslines
    sheet = sheet_on()
    turned = Sheet(np.array([SHAPE[1] / 2, 0.0]), np.array([1.0, 0.0]), 0, 2, 0.0, sheet.w, sheet.score)
    across = measure(np.ascontiguousarray(volume.transpose(1, 0, 2)), turned)
    np.testing.assert_allclose(across.throw, plain.throw[::-1], atol=0.05)


@pytest.mark.parametrize("factor", [-1.0, 1000.0, 1e-3])
def test_sign_and_scale_of_amplitudes_do_not_matter(factor):
    volume = faulted(6.0)
    np.testing.assert_allclose(
        measure(volume * np.float32(factor), sheet_on()).throw, measure(volume, sheet_on()).throw, atol=0.01
    )


def test_sides_are_carried_along_their_dips():
    """Dipping layers: read a few traces off, they would seem to be thrown by the dip between the sides."""
    volume = faulted(5.0, slope=0.6)
    assert np.median(inner(measure(volume, sheet_on(), slope=0.6).throw)) == pytest.approx(5.0, abs=0.4)
    assert abs(np.median(inner(measure(volume, sheet_on(), slope=0.0).throw)) - 5.0) > 1.5


@pytest.mark.parametrize("throw", [6.0, -6.0])
def test_sides_of_a_gentle_fault_are_read_where_the_wavelet_does_not_mix_them(throw):
    shape = (20, 90, 90)
    volume = ndimage.gaussian_filter1d(faulted(throw, 1.0, shape=shape), 3.0, axis=2)
    sheet = sheet_on(1.0, shape=shape)
    assert farther_off(sheet, ThrowSettings()) == 5
    assert farther_off(sheet, ThrowSettings(), close=True) == 2
    errors = [np.abs(inner(measure(volume, sheet, **kw).throw) - throw) for kw in ({}, {"clearance": 0.0})]
    assert (errors[0] < 1.0).mean() > 0.9
    assert errors[0].mean() < 0.8 * errors[1].mean()


@pytest.mark.parametrize(("cotangent", "off"), [(0.0, 0), (0.2, 0), (-0.75, 3), (9.0, 11)])
def test_gentle_faults_are_read_farther_off_but_not_too_far(cotangent, off):
    assert farther_off(sheet_on(cotangent), ThrowSettings()) == off


def dragged(throw, cotangent, reach, *, shape):
    """Layers as in `faulted`, whose hanging wall moved the less the farther off, in traces, under a wavelet."""
    _, x, k = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")
    beyond = x - shape[1] / 2 - cotangent * (k - shape[2] / 2)
    volume = layer_values(k - np.where(beyond > 0, throw * np.exp(-np.maximum(beyond, 0.0) / reach), 0.0))
    return ndimage.gaussian_filter1d(volume, 1.5, axis=2).astype(np.float32)


@pytest.mark.parametrize("throw", [-14.0, 9.0])
def test_closer_sides_tell_more_of_what_drag_has_bent_beside_a_gentle_fault(throw):
    shape, settings = (24, 120, 110), ThrowSettings()
    volume, sheet, valid = dragged(throw, 1.5, 25.0, shape=shape), sheet_on(1.5, shape=shape), np.ones(shape, bool)
    slopes = slopes_beside(volume, valid, [sheet], dip=DipSettings(), settings=settings)
    sides = gather_sides(volume, valid, slopes, sheet, settings=settings)
    found = match_sides(sheet, sides.both, sides.known, settings=settings)
    closer = gather_closer(volume, valid, slopes, sheet, settings=settings)
    refined = refine_throw(sheet, found, closer, settings=settings)
    before, after = (float(np.median(inner(one.throw)[inner(one.fit) > 0.5])) / throw for one in (found, refined))
    assert before < 0.9
    assert abs(after - 1.0) < 0.85 * abs(before - 1.0)
    assert refined.hanging_side == found.hanging_side
    np.testing.assert_array_equal(np.isnan(refined.throw), np.isnan(found.throw))


def test_a_throw_that_nothing_tells_is_not_refined():
    sheet, settings = sheet_on(), ThrowSettings()
    unknown = SheetThrow(np.full_like(sheet.w, np.nan), np.zeros_like(sheet.w), 1)
    volume = faulted(5.0)
    flat = (np.zeros_like(volume),) * 2
    sides = gather_closer(volume, np.ones(SHAPE, bool), flat, sheet, settings=settings)
    assert refine_throw(sheet, unknown, sides, settings=settings) is unknown


def test_what_nodes_tell_is_read_between_them_and_off_them():
    sheet = sheet_on(shape=(5, 8, 8))
    values = np.tile(np.arange(4, dtype=np.float32), (5, 1))
    values[3:] = np.nan
    np.testing.assert_allclose(at_every(values, sheet, 1), np.tile(np.arange(7) / 2.0, (5, 1)))
    np.testing.assert_allclose(at_every(values, sheet, 2), np.tile(np.arange(4.0), (3, 1)))


def test_slopes_beside_a_fault_are_those_of_the_layers_alone():
    shape, settings = (30, 60, 80), ThrowSettings()
    volume, sheet = faulted(8.0, 0.6, shape=shape), sheet_on(0.6, shape=shape)
    valid = np.ones(shape, bool)
    _, bent = estimate_slopes(volume, valid)
    p, q = slopes_beside(volume, valid, [sheet], dip=DipSettings(), settings=settings)
    x = (30 + 0.6 * (np.arange(20, 60) - 40)).round().astype(int)
    beside = np.s_[15, x + 5, np.arange(20, 60)]
    assert np.abs(q[beside]).mean() < 0.5 * np.abs(bent[beside]).mean()
    assert np.abs(p[beside]).max() < 0.02


def test_masked_block_is_part_of_the_masked_cube():
    valid = np.ones(SHAPE, bool)
    valid[3, 4] = False
    sheets = [sheet_on(0.4), sheet_on(-0.3, outside=np.s_[:9])]
    whole = mask_sheets(sheets, valid, beside=1)
    assert not whole[3, 4].any()
    assert 0.85 < whole.mean() < 0.95
    assert not whole[np.s_[:, 19:22, 40]].any()
    np.testing.assert_array_equal(mask_sheets(sheets, valid[7:21, 10:35], beside=1, corner=(7, 10)), whole[7:21, 10:35])
    # leftovers, of which many are no faults, cost no data
    sheets.append(replace(sheet_on(0.1), leftover=True))
    np.testing.assert_array_equal(mask_sheets(sheets, valid, beside=1), whole)


def test_throw_may_change_along_strike():
    volume = np.concatenate([faulted(float(t), shape=(1, *SHAPE[1:])) for t in np.linspace(4, 10, 60)])
    found = measure(volume, sheet_on(shape=volume.shape))
    middle = np.median(inner(found.throw), axis=1)[::-1]
    assert np.abs(middle - np.linspace(4, 10, 60)).max() < 1.2
    assert np.median(np.abs(middle - np.linspace(4, 10, 60))) < 0.4


@pytest.mark.parametrize("steepness", [0.15, -0.15])
def test_throw_that_changes_down_the_surface_is_that_of_the_hanging_wall_there(steepness):
    """Growth: the hanging wall at sample k has come down by 10 + steepness (k - 40)."""
    _, x, k = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in SHAPE), indexing="ij")
    hanging = x - SHAPE[1] / 2 - 0.4 * (k - SHAPE[2] / 2) > 0
    truth = 10.0 + steepness * (np.arange(SHAPE[2], step=2) - 40.0)
    volume = layer_values(k - np.where(hanging, 10.0 + steepness * (k - 40.0), 0.0)).astype(np.float32)
    found = measure(volume, sheet_on())
    error = np.median(found.throw, axis=0) - truth
    matched = np.median(found.fit, axis=0) > 0.4
    assert matched.mean() > 0.6
    assert np.abs(error[matched]).max() < 1.7
    assert np.median(np.abs(error[matched])) < 0.4
    # carried on to where the counterpart lies above the top
    assert not matched[:3].any()
    assert np.abs(error[:3]).max() < 2.0


def test_repeated_reflectors_are_told_apart_by_the_whole_surface():
    """Layers that repeat after 12 samples over most of the depth, but not everywhere."""
    _, x, k = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in SHAPE), indexing="ij")
    hanging = x - SHAPE[1] / 2 - 0.4 * (k - SHAPE[2] / 2) > 0
    depth = k - np.where(hanging, 14.0, 0.0)
    volume = np.sin(2 * np.pi * depth / 12.0) + np.where(depth > 45, layer_values(depth), 0.0)
    found = measure(volume.astype(np.float32), sheet_on())
    assert (np.abs(found.throw - 14.0) < 1.5).mean() > 0.9


def test_noise_of_half_the_signal_is_no_hindrance():
    volume = faulted(8.0) + 0.5 * np.random.default_rng(1).normal(size=SHAPE).astype(np.float32)
    assert np.median(inner(measure(volume, sheet_on()).throw)) == pytest.approx(8.0, abs=0.5)


def test_unrelated_sides_do_not_fit():
    volume = faulted(6.0)
    other = layer_values(np.arange(SHAPE[2], dtype=float), seed=11).astype(np.float32)
    _, x, k = np.meshgrid(*(np.arange(n) for n in SHAPE), indexing="ij")
    broken = np.where(x - SHAPE[1] / 2 - 0.4 * (k - SHAPE[2] / 2) > 0, other[k], volume)
    good, bad = measure(volume, sheet_on()), measure(broken.astype(np.float32), sheet_on())
    assert np.median(inner(bad.fit)) < np.median(inner(good.fit)) - 0.15


def test_nothing_is_said_outside_the_sheet():
    outside = (slice(0, 10), slice(None))
    sheet = sheet_on(outside=outside)
    found = measure(faulted(6.0), sheet)
    assert np.isnan(found.throw[outside]).all()
    assert np.isfinite(found.throw[~np.isnan(sheet.w)]).all()
    assert np.median(inner(found.throw[10:])) == pytest.approx(6.0, abs=0.3)


def test_no_data_at_all_is_no_throw():
    volume = faulted(6.0)
    found = measure(volume, sheet_on(), valid=np.zeros(volume.shape, bool))
    assert np.isnan(found.throw).all()


def test_missing_side_takes_the_nearest_known_throw():
    volume = faulted(6.0)
    valid = np.ones(SHAPE, bool)
    valid[:8, :16] = False
    found = measure(np.where(valid, volume, 0), sheet_on(), valid=valid)
    assert np.isfinite(found.throw).all()
    assert np.median(inner(found.throw)) == pytest.approx(6.0, abs=0.3)


def test_longest_throw_is_a_bound():
    found = measure(faulted(20.0), sheet_on(), longest=8)
    assert np.abs(found.throw)[found.fit > 0].max() <= 8.5


@pytest.mark.parametrize("throw", [70.0, -60.0])
def test_a_throw_larger_than_usual_is_found(throw):
    shape = (30, 90, 200)
    sheet = sheet_on(0.3, shape=shape)
    found = measure(faulted(throw, 0.3, shape=shape), sheet)
    assert np.median(found.throw) == pytest.approx(throw, abs=0.3)
    assert np.abs(measure(faulted(throw, 0.3, shape=shape), sheet, longest=48).throw).max() <= 48.0


def test_section_one_row_thick():
    volume = faulted(6.0, shape=(1, *SHAPE[1:]))
    found = measure(volume, sheet_on(shape=(1, *SHAPE[1:])))
    assert found.throw.shape == (1, SHAPE[2] // 2)
    assert np.median(inner(found.throw)) == pytest.approx(6.0, abs=0.3)


def test_one_thread_and_two_give_the_same_bits():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread is all there is")
    before = numba.get_num_threads()
    try:
        results = []
        for n_threads in (1, 2):
            numba.set_num_threads(n_threads)
            results.append(measure(faulted(4.5), sheet_on()))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0].throw, results[1].throw)
    np.testing.assert_array_equal(results[0].fit, results[1].fit)


# ----- kernels


def test_reading_between_voxels_is_linear(rng):
    i, x, k = np.meshgrid(np.arange(5.0), np.arange(6.0), np.arange(7.0), indexing="ij")
    volume = (2 * i - x + 0.5 * k).astype(np.float32)
    valid = np.ones(volume.shape, bool)
    for point in rng.uniform(0, [4, 5, 6], (40, 3)):
        value, weight = kernels._read(volume, valid, *point)
        assert weight == 1.0
        assert value == pytest.approx(2 * point[0] - point[1] + 0.5 * point[2], abs=5e-3)  # tiny weights are skipped
    assert kernels._read(volume, valid, 4.0, 5.0, 6.0)[1] == 1.0


@pytest.mark.parametrize("point", [(-0.1, 2, 2), (4.1, 2, 2), (2, 5.1, 2), (2, 2, 6.1), (1.5, 2, 2)])
def test_nothing_is_read_outside_or_beside_missing_samples(point):
    valid = np.ones((5, 6, 7), bool)
    valid[1, 2, 2] = False
    assert kernels._read(np.ones((5, 6, 7), np.float32), valid, *point) == (0.0, 0.0)


def plain_path(costs, step, jump):
    """Cheapest way to every shift of every node of a row, each node's least taken off as the kernel does."""
    n = costs.shape[1]
    change = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    price = np.where(change == 0, 0.0, np.where(change == 1, step, jump))
    previous, out = np.zeros(n), []
    for row in costs:
        way = (previous[:, None] + price).min(axis=0)
        previous = row + way - previous.min()
        out.append(previous)
    return np.array(out)


def test_paths_equal_their_definition(rng):
    cost = rng.random((5, 6, 7)).astype(np.float32)
    total = np.zeros_like(cost)
    kernels.sum_paths(cost, np.float32(0.1), np.float32(0.4), total)
    expected = np.zeros(cost.shape)
    for r in range(5):
        expected[r] += plain_path(cost[r], 0.1, 0.4) + plain_path(cost[r, ::-1], 0.1, 0.4)[::-1]
    for k in range(6):
        expected[:, k] += plain_path(cost[:, k], 0.1, 0.4) + plain_path(cost[::-1, k], 0.1, 0.4)[::-1]
    np.testing.assert_allclose(total, expected, rtol=1e-5)


def test_neighbours_outvote_a_place_that_knows_nothing():
    cost = np.ones((7, 7, 9), np.float32)
    cost[:, :, 6] = 0.0
    cost[3, 3] = 0.5
    total = np.zeros_like(cost)
    kernels.sum_paths(cost, np.float32(0.1), np.float32(0.4), total)
    shift, fit = np.empty((7, 7), np.float32), np.empty((7, 7), np.float32)
    kernels.pick_shifts(total, cost, -4, shift, fit)
    np.testing.assert_allclose(shift, 2.0, atol=0.1)
    assert fit[3, 3] == 0.5
    assert fit[0, 0] == 1.0


@pytest.mark.parametrize("place", [4.0, 3.7, 4.4, 1.2])
def test_parabola_gives_the_shift_between_samples(place):
    total = np.broadcast_to((np.arange(9.0) - place) ** 2, (2, 3, 9)).astype(np.float32)
    shift, fit = np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
    kernels.pick_shifts(total, total, -4, shift, fit)
    np.testing.assert_allclose(shift, place - 4, atol=1e-4)
    np.testing.assert_allclose(fit, 1 - (round(place) - place) ** 2, atol=1e-5)


def test_far_throws_cost_more(rng):
    cost = rng.random((3, 4, 9)).astype(np.float32)
    usual = rng.uniform(-4, 4, (3, 4)).astype(np.float32)
    out = np.empty_like(cost)
    kernels.bar_far_shifts(cost, -4, usual, np.float32(2.0), out)
    far = np.abs(np.arange(9) - 4 - usual[..., None]) - 2.0
    np.testing.assert_allclose(out, cost + 0.1 * np.maximum(far, 0.0), rtol=1e-5)
