from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from seismo3d.seismic import _kernels_filters as filters
from seismo3d.seismic._kernels_valid import mark_valid, same_as_next


@pytest.fixture
def volume(rng):
    return rng.normal(size=(6, 7, 11)).astype(np.float32)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("n_taps", [1, 3, 9, 25])
def test_filters_equal_a_correlation_with_repeated_ends(volume, rng, axis, n_taps):
    run = (filters.filter_inlines, filters.filter_crosslines, filters.filter_samples)[axis]
    taps = rng.normal(size=n_taps).astype(np.float32)
    out = np.full_like(volume, np.nan)
    run(volume, taps, out, *([] if axis == 2 else [0]))
    expected = ndimage.correlate1d(volume.astype(np.float64), taps.astype(np.float64), axis=axis, mode="nearest")
    np.testing.assert_allclose(out, expected, atol=1e-4)


def test_filtered_along_samples_in_place(volume, rng):
    taps, out = rng.normal(size=5).astype(np.float32), np.empty_like(volume)
    filters.filter_samples(volume, taps, out)
    filters.filter_samples(volume, taps, volume)
    np.testing.assert_array_equal(volume, out)


@pytest.mark.parametrize("within", [(slice(0, 6), slice(0, 7)), (slice(2, 5), slice(0, 3)), (slice(0, 1), slice(4, 7))])
def test_traces_smoothed_within_a_volume_are_those_of_all_of_it(volume, within):
    sigma = (1.0, 2.0, 0.7)
    np.testing.assert_array_equal(filters.smooth(volume, sigma, within=within), filters.smooth(volume, sigma)[within])
    around = filters.grow_traces(within, (3, 5), volume.shape)
    inner = filters.shift_traces(within, around)
    part = np.ascontiguousarray(volume[around])
    np.testing.assert_array_equal(filters.smooth(part, sigma, within=inner), filters.smooth(volume, sigma)[within])


@pytest.mark.parametrize("sigma", [0.3, 1.0, 2.7])
def test_gaussian_taps(sigma):
    taps = filters.gaussian_taps(sigma)
    assert taps.sum() == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(taps, taps[::-1])
    assert (np.diff(taps[: len(taps) // 2 + 1]) > 0).all()
    t = np.arange(len(taps)) - len(taps) // 2
    # cut at 2.5 sigma the second moment falls a little short
    assert (taps * t**2).sum() <= sigma**2
    if sigma >= 1:
        assert (taps * t**2).sum() == pytest.approx(sigma**2, rel=0.15)


def test_no_width_is_no_filter(volume):
    np.testing.assert_array_equal(filters.gaussian_taps(0.0), [1.0])
    np.testing.assert_array_equal(filters.smooth(volume, (0.0, 0.0, 0.0)), volume)


@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.0])
def test_derivative_of_a_straight_line_is_exact(sigma):
    taps = filters.derivative_taps(sigma)
    line = (3.0 - 0.7 * np.arange(40.0)).astype(np.float32)
    out = np.correlate(line, taps, "valid")
    np.testing.assert_allclose(out, -0.7, atol=1e-5)
    assert taps.sum() == pytest.approx(0.0, abs=1e-6)


def test_smoothing_is_separable(volume):
    expected = volume.astype(np.float64)
    for axis, sigma in enumerate((1.0, 0.6, 2.0)):
        expected = ndimage.correlate1d(expected, filters.gaussian_taps(sigma).astype(float), axis=axis, mode="nearest")
    np.testing.assert_allclose(filters.smooth(volume, (1.0, 0.6, 2.0)), expected, atol=1e-5)


def test_products_are_weighted(volume, rng):
    other, weight = (rng.normal(size=volume.shape).astype(np.float32) for _ in range(2))
    out = np.empty_like(volume)
    filters.multiply_weighted(volume, other, weight, out)
    np.testing.assert_allclose(out, weight * volume * other, rtol=1e-5)


def test_slopes_are_those_of_the_leading_eigenvector(rng):
    shape = (4, 5, 6)
    normal = np.stack([rng.uniform(-2, 2, shape), rng.uniform(-2, 2, shape), np.ones(shape)], -1)
    tensor = normal[..., :, None] * normal[..., None, :] + 0.02 * np.eye(3)
    spread = rng.normal(size=(*shape, 3, 3)) * 0.05
    tensor += spread @ spread.swapaxes(-1, -2)
    parts = [
        np.ascontiguousarray(tensor[..., a, b], np.float32) for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    ]
    p, q = np.empty(shape, np.float32), np.empty(shape, np.float32)
    filters.tensor_slopes(*parts, np.float32(4.0), p, q)
    leading = np.linalg.eigh(tensor)[1][..., -1]
    np.testing.assert_allclose(p, -leading[..., 0] / leading[..., 2], atol=2e-3)
    np.testing.assert_allclose(q, -leading[..., 1] / leading[..., 2], atol=2e-3)


@pytest.mark.parametrize("factor", [1e-8, 1.0, 1e8])
def test_slopes_of_tensors_of_any_size(factor):
    parts = [np.full((1, 1, 3), factor * v, np.float32) for v in (0.25, 0.0, -0.5, 0.0, 0.0, 1.0)]
    p, q = np.empty((1, 1, 3), np.float32), np.empty((1, 1, 3), np.float32)
    filters.tensor_slopes(*parts, np.float32(4.0), p, q)
    np.testing.assert_allclose(p, 0.5, atol=1e-3)
    np.testing.assert_allclose(q, 0.0, atol=1e-6)


# ----- which samples hold data


def plain_valid(trace, longest_run):
    valid = np.zeros(len(trace), bool)
    for k in range(len(trace)):
        low = high = k
        while low > 0 and trace[low - 1] == trace[k]:
            low -= 1
        while high < len(trace) - 1 and trace[high + 1] == trace[k]:
            high += 1
        is_muted = trace[k] == 0.0 and (low == 0 or high == len(trace) - 1)
        valid[k] = np.isfinite(trace[k]) and high - low + 1 < longest_run and not is_muted
    return valid


def test_runs_and_missing_samples_are_no_data(rng):
    volume = rng.integers(0, 2, (5, 6, 40)).astype(np.float32)
    volume[rng.random(volume.shape) < 0.05] = np.nan
    volume[0, 0, 3] = np.inf
    volume[1, 1] = 4.0
    volume[2, 2, :12] = 7.0
    volume[2, 3, -11:] = 7.0
    volume[3, 3] = np.nan
    valid = np.empty(volume.shape, bool)
    mark_valid(volume, 4, valid)
    for i, x in np.ndindex(5, 6):
        np.testing.assert_array_equal(valid[i, x], plain_valid(volume[i, x], 4))


def test_equal_neighbours_are_marked(rng):
    volume = rng.normal(size=(3, 5, 8)).astype(np.float32)
    volume[1, 3] = volume[1, 2]
    volume[2, 1] = volume[2, 0]
    volume[2, 1, 7] += 1.0
    valid = np.ones(volume.shape, bool)
    volume[0, :] = 0.0
    valid[0] = False
    same = np.zeros((3, 5), bool)
    same_as_next(volume, valid, same)
    expected = np.zeros((3, 5), bool)
    expected[1, 2] = True
    np.testing.assert_array_equal(same, expected)
