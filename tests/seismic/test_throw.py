from __future__ import annotations

import numba
import numpy as np
import pytest

from seismo3d.seismic import _kernels_throw as kernels
from seismo3d.seismic.linking import Sheet
from seismo3d.seismic.throw import ThrowSettings, measure_throw

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
    return measure_throw(volume, valid, slopes, sheet, settings=ThrowSettings(**settings))


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
    assert np.abs(measure(faulted(20.0), sheet_on(), longest=8).throw).max() <= 8.5


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


@pytest.mark.parametrize(("lateral", "thin"), [(0.0, 1), (0.0, 2), (0.3, 1), (-0.4, 2)])
def test_costs_of_throws_equal_their_definition(rng, lateral, thin):
    hanging, foot = rng.normal(size=(2, 6, 9)).astype(np.float32)
    in_hanging, in_foot = (rng.random((2, 6, 9)) > 0.2).astype(np.float32)
    shape = (7, (6 - 1) // thin + 1, (9 - 1) // thin + 1)
    cost, energy, weight = (np.empty(shape, np.float32) for _ in range(3))
    kernels.match_costs(hanging, foot, in_hanging, in_foot, lateral, thin, np.float32(2.5), cost, energy, weight)
    for c, a, b in np.ndindex(shape):
        r, k, throw = a * thin, b * thin, c - 3
        row, above = r - lateral * throw, k - throw
        expected = (0.0, 0.0, 0.0)
        if 0 <= row <= 5 and 0 <= above < 9 and in_hanging[r, k]:
            low, high = int(row), min(int(row) + 1, 5)
            if in_foot[low, above] and in_foot[high, above]:
                value = np.interp(row, np.arange(6), foot[:, above])
                expected = (min((hanging[r, k] - value) ** 2, 2.5), hanging[r, k] ** 2 + value**2, 1.0)
        np.testing.assert_allclose((cost[c, a, b], energy[c, a, b], weight[c, a, b]), expected, atol=1e-5)


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
    kernels.pick_shifts(total, cost, shift, fit)
    np.testing.assert_allclose(shift, 2.0, atol=0.1)
    assert fit[3, 3] == 0.5
    assert fit[0, 0] == 1.0


@pytest.mark.parametrize("place", [4.0, 3.7, 4.4, 1.2])
def test_parabola_gives_the_shift_between_samples(place):
    total = np.broadcast_to((np.arange(9.0) - place) ** 2, (2, 3, 9)).astype(np.float32)
    shift, fit = np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
    kernels.pick_shifts(total, total, shift, fit)
    np.testing.assert_allclose(shift, place - 4, atol=1e-4)
    np.testing.assert_allclose(fit, 1 - (round(place) - place) ** 2, atol=1e-5)


def test_finished_costs_are_ratios(rng):
    cost, weight = (rng.random((3, 4, 5)).astype(np.float32) for _ in range(2))
    energy = (0.1 + rng.random((3, 4, 5))).astype(np.float32)
    out = np.empty((4, 5, 3), np.float32)
    kernels.finish_costs(cost, energy, weight, np.float32(0.5), np.float32(0.7), out)
    expected = np.where(weight > 0.3, cost / (energy + 0.5 * weight), 0.7)
    np.testing.assert_allclose(out, expected.transpose(1, 2, 0), rtol=1e-5)


def test_far_throws_cost_more(rng):
    cost = rng.random((3, 4, 9)).astype(np.float32)
    usual = rng.uniform(-4, 4, (3, 4)).astype(np.float32)
    out = np.empty_like(cost)
    kernels.bar_far_shifts(cost, usual, np.float32(2.0), out)
    far = np.abs(np.arange(9) - 4 - usual[..., None]) - 2.0
    np.testing.assert_allclose(out, cost + 0.1 * np.maximum(far, 0.0), rtol=1e-5)
