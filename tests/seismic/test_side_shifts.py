from __future__ import annotations

import numba
import numpy as np
import pytest

from seismo3d.seismic import _kernels_registration as kernels
from seismo3d.seismic._kernels_filters import gaussian_taps, grow_traces, shift_traces
from seismo3d.seismic._kernels_shifts import add_windows, refine
from seismo3d.seismic.shifts import ShiftField
from seismo3d.seismic.side_shifts import (
    RegistrationSettings,
    carry_reach,
    carry_sides,
    match_reach,
    match_slices,
    register_slices,
)

SHAPE = (20, 22, 64)


def layered(depth, *, seed=3):
    """Random reflectivity at each voxel's depth of deposition."""
    values = np.convolve(np.random.default_rng(seed).normal(size=800), np.hanning(9), "same")
    volume = np.interp(depth, np.arange(-400, 400), values)
    return (volume / volume.std()).astype(np.float32)


def grid(shape=SHAPE):
    return np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")


def everywhere(volume):
    return np.ones(volume.shape, bool)


# ----- kernels


@pytest.mark.parametrize("axis", [0, 1])
def test_costs_equal_their_definition(rng, axis):
    shape, farthest, step, floor = (4, 5, 13), 2, 3, np.float32(1e-3)
    volume = rng.normal(size=shape).astype(np.float32)
    valid = rng.random(shape) > 0.2
    taps = gaussian_taps(1.0)
    costs = np.empty((2 * farthest + 1, *shape[:2], 5), np.float32)
    kernels.search_costs(volume, valid, axis, farthest, step, taps, floor, costs)
    half = len(taps) // 2
    for s, i, j, n in np.ndindex(*costs.shape):
        x, y = (i + 1, j) if axis == 0 else (i, j + 1)
        if x >= shape[0] or y >= shape[1]:
            assert costs[s, i, j, n] == 0.0
            continue
        left = whole = float(floor)
        for t in range(-half, half + 1):
            k, m = n * step + t, n * step + t + s - farthest
            if 0 <= k < shape[2] and 0 <= m < shape[2] and valid[i, j, k] and valid[x, y, m]:
                a, b = float(volume[i, j, k]), float(volume[x, y, m])
                left += float(taps[t + half]) * (a - b) ** 2
                whole += float(taps[t + half]) * (a * a + b * b)
        assert costs[s, i, j, n] == pytest.approx(left / whole, rel=1e-4)


@pytest.mark.parametrize("step", [1, 3, 4])
def test_windows_equal_a_correlation_at_every_step(rng, step):
    taps = gaussian_taps(1.5)
    m, half = 6, len(taps) // 2
    phases = np.empty((step, m + 2 * half // step + 2), np.float32)
    values = rng.normal(size=phases.size).astype(np.float32)
    sums = np.full(m, 2.0, np.float32)
    add_windows(values, taps, step, phases, sums)
    expected = 2.0 + np.correlate(values.astype(np.float64), taps.astype(np.float64), "valid")[: m * step : step]
    np.testing.assert_allclose(sums, expected, atol=1e-5)


def test_coarse_shifts_are_refined_on_straight_lines():
    fine = np.empty(11, np.float32)
    refine(np.array([0.0, 3.0, -3.0], np.float32), 4, fine)
    np.testing.assert_allclose(fine, [0.0, 0.75, 1.5, 2.25, 3.0, 1.5, 0.0, -1.5, -3.0, -3.0, -3.0])


def test_cheapest_shift_is_refined_and_the_smallest_wins_a_tie():
    shifts = np.arange(-3, 4)
    costs = np.empty((7, 1, 1, 3), np.float32)
    costs[:, 0, 0, 0] = (shifts - 1.3) ** 2
    costs[:, 0, 0, 1] = 1.0
    costs[:, 0, 0, 2] = -shifts
    shift = np.empty((1, 1, 3), np.float32)
    kernels.pick_cheapest(costs, shift)
    np.testing.assert_allclose(shift[0, 0], [1.3, 0.0, 3.0], atol=1e-5)


def test_one_sided_means_equal_their_definition(rng):
    product, weight = rng.normal(size=(2, 7, 3, 4)).astype(np.float32)
    weight = np.abs(weight)
    weight[:, 1, 1] = 0.0
    weight[:3, 2] = 0.0
    product[weight == 0.0] = 0.0
    behind, ahead = np.empty_like(product), np.empty_like(product)
    kernels.one_sided_means(product, weight, np.float32([1.0, 0.5, 0.25]), behind, ahead)
    for i, j, k in np.ndindex(*product.shape):
        sums = []
        for steps in (range(i - 1, max(i - 4, -1), -1), range(i, min(i + 3, 7))):
            shares = [0.5**n for n in range(len(steps))]
            total = sum(w * weight[m, j, k] for w, m in zip(shares, steps, strict=True))
            value = sum(w * product[m, j, k] for w, m in zip(shares, steps, strict=True))
            sums.append(value / total if total > 1e-9 else None)
        before = next((s for s in sums if s is not None), 0.0)
        after = sums[1] if sums[1] is not None else before
        assert behind[i, j, k] == pytest.approx(before, rel=1e-4, abs=1e-5)
        assert ahead[i, j, k] == pytest.approx(after, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
def test_registered_misfit_equals_its_definition(rng, axis):
    shape, step, reach = (6, 7, 16), 4, 2
    volume = rng.normal(size=shape).astype(np.float32)
    # interpolation needs the sample below too: whole traces are missing, so that this makes no difference
    valid = np.repeat(rng.random((*shape[:2], 1)) > 0.2, shape[2], axis=2)
    behind, ahead = (np.repeat(rng.integers(-1, 2, (*shape[:2], 1)), 4, axis=2).astype(np.float32) for _ in range(2))
    difference, energy = np.empty_like(volume), np.empty_like(volume)
    kernels.registered_misfit(volume, valid, behind, ahead, axis, reach, step, (0, 0), difference, energy)
    part = [np.empty((3, 4, 16), np.float32) for _ in range(2)]
    kernels.registered_misfit(volume, valid, behind, ahead, axis, reach, step, (2, 1), *part)
    np.testing.assert_array_equal(part, [difference[2:5, 1:5], energy[2:5, 1:5]])
    for i, j, k in np.ndindex(*shape):
        means = []
        for sign, side in ((-1, behind), (1, ahead)):
            values = []
            for t in range(1, reach + 1):
                at = [i, j, k]
                at[axis] += sign * t
                if not 0 <= at[axis] < shape[axis]:
                    continue
                at[2] += int(sign * t * side[at[0], at[1], 0])
                if 0 <= at[2] < shape[2] and valid[tuple(at)]:
                    values.append(volume[tuple(at)])
            means.append(np.mean(values) if values else None)
        if None in means:
            assert (difference[i, j, k], energy[i, j, k]) == (0.0, -1.0)
        else:
            assert difference[i, j, k] == pytest.approx((means[0] - means[1]) ** 2, abs=1e-5)
            assert energy[i, j, k] == pytest.approx(means[0] ** 2 + means[1] ** 2, abs=1e-5)


# ----- registration


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (2.6, -1.3), (-3.2, 0.4)])
def test_slices_of_sloping_layers_are_registered_without_a_start(p, q):
    i, x, k = grid()
    volume = layered(k - p * i - q * x)
    first, second = register_slices(volume, everywhere(volume))
    for found, slope, inner in ((first, p, np.s_[2:-3, 2:-2, 3:-3]), (second, q, np.s_[2:-2, 2:-3, 3:-3])):
        assert np.abs(found.shift[inner] - slope).max() < 0.05
        assert found.misfit[inner].max() < 1.0


def test_each_side_of_a_fault_keeps_its_own_slope():
    i, _, k = grid()
    volume = layered(np.where(i < 10, k - 1.0 * i, k + 0.5 * i + 90.0))
    sides = carry_sides(register_slices(volume, everywhere(volume))[0])
    # samples whose partners all lie inside the cube
    inner = np.s_[4:-4, 4:-4]
    assert np.abs(sides.behind[8:10][:, *inner] - 1.0).max() < 0.1
    assert np.abs(sides.ahead[10:12][:, *inner] + 0.5).max() < 0.1


@pytest.mark.parametrize("axis", [0, 1])
def test_shift_that_jumps_is_rejected(axis):
    shape = (16, 16, 12)
    shift = np.full(shape, 0.5, np.float32)
    at = [slice(None)] * 3
    at[axis] = slice(8, 9)
    shift[tuple(at)] = 3.0
    calm = ShiftField(axis, 1, shift, np.full(shape, 1e-3, np.float32), np.full(shape, 0.1, np.float32))
    sides = carry_sides(calm)
    for side in (sides.behind, sides.ahead):
        assert np.abs(side - 0.5).max() < 0.05
    lenient = carry_sides(calm, settings=RegistrationSettings(jump=100.0))
    assert np.abs(lenient.behind - 0.5).max() > 0.5


def test_dead_traces_are_bridged(rng):
    i, x, k = grid()
    volume = layered(k - 1.5 * i + 0.7 * x)
    valid = everywhere(volume)
    valid[rng.random(SHAPE[:2]) < 0.15] = False
    volume[~valid] = 0.0
    first, second = (carry_sides(field) for field in register_slices(volume, valid))
    for sides, slope in ((first, 1.5), (second, -0.7)):
        for side in (sides.behind, sides.ahead):
            assert np.abs(side[3:-3, 3:-3, 4:-4] - slope).max() < 0.1


def test_mirrored_cube_has_the_mirrored_sides(rng):
    i, x, k = grid()
    volume = layered(k - 1.5 * i + 0.7 * x) + 0.2 * rng.normal(size=SHAPE).astype(np.float32)
    sides = carry_sides(register_slices(volume, everywhere(volume))[0])
    mirror = np.ascontiguousarray(volume[::-1])
    turned = carry_sides(register_slices(mirror, everywhere(volume))[0])
    # the fit is of first order in the shift: its two directions agree to a hundredth of a sample
    np.testing.assert_allclose(turned.behind[2:-2, :, 3:-3], -sides.ahead[::-1][2:-2, :, 3:-3], atol=0.05)


def test_one_thread_and_two_give_the_same_bits(rng):
    i, x, k = grid()
    volume = layered(k - 0.8 * i + 0.3 * x) + 0.3 * rng.normal(size=SHAPE).astype(np.float32)
    found = []
    threads = numba.get_num_threads()
    try:
        for n in (1, min(2, threads)):
            numba.set_num_threads(n)
            found.append([carry_sides(field) for field in register_slices(volume, everywhere(volume))])
    finally:
        numba.set_num_threads(threads)
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one.behind, two.behind)
        np.testing.assert_array_equal(one.ahead, two.ahead)


def test_shifts_and_sides_of_some_traces_are_those_of_all(rng):
    settings = RegistrationSettings(wide=1.5, across=1.0, memory=2.0)
    i, x, k = grid((44, 46, 32))
    volume = layered(k - 0.8 * i + 0.3 * x + 2.0 * (i > 20)) + 0.3 * rng.normal(size=i.shape).astype(np.float32)
    valid = rng.random((*i.shape[:2], 1)).repeat(32, axis=2) > 0.02
    whole = match_slices(volume, valid, floor=np.float32(1e-3), settings=settings)
    asked = (slice(16, 27), slice(15, 30))
    wide = grow_traces(asked, (match_reach(settings),) * 2, volume.shape)
    assert wide[0] != slice(0, 44)
    assert wide[1] != slice(0, 46)
    cut = [np.ascontiguousarray(part[wide]) for part in (volume, valid)]
    part = match_slices(*cut, floor=np.float32(1e-3), settings=settings, within=shift_traces(asked, wide))
    for one, other in zip(part, whole, strict=True):
        for name in ("shift", "variance", "misfit"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name)[asked])
    wide = grow_traces(asked, (carry_reach(settings),) * 2, volume.shape)
    assert wide[0].start > 0
    for other in whole:
        around = [np.ascontiguousarray(values[wide]) for values in (other.shift, other.variance, other.misfit)]
        sides = carry_sides(ShiftField(other.axis, 1, *around), settings=settings, within=shift_traces(asked, wide))
        expected = carry_sides(other, settings=settings)
        np.testing.assert_array_equal(sides.behind, expected.behind[asked])
        np.testing.assert_array_equal(sides.ahead, expected.ahead[asked])
