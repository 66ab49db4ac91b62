from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from seismo3d.seismic import _kernels_costs as kernels
from seismo3d.seismic._kernels_filters import gaussian_taps

LOUD = np.float32(2.5)
QUIET = np.float32(0.5)
UNMATCHED = np.float32(0.7)


def two_sides(rng, shape, missing=0.2):
    """Amplitudes of both sides and where they are known; 0 where they are not, as sides are read."""
    known = (rng.random((2, *shape)) >= missing).astype(np.float32)
    sides = rng.normal(size=(2, *shape)).astype(np.float32) * known
    return sides[0], sides[1], known[0], known[1]


def spans_of(known, thin=1, reach=(0, 0)):
    return kernels.find_spans(np.ascontiguousarray(known[::thin, ::thin]), *reach)


def thinned(shape, thin):
    return (shape[0] - 1) // thin + 1, (shape[1] - 1) // thin + 1


def test_spans_hold_all_that_a_window_sees():
    known = np.zeros((5, 9), np.float32)
    known[2, 3:5] = 1.0
    known[3, 8] = 1.0
    own, along, around = kernels.find_spans(known, 1, 2)
    np.testing.assert_array_equal(own, [[0, 0], [0, 0], [3, 5], [8, 9], [0, 0]])
    np.testing.assert_array_equal(along, [[0, 0], [0, 0], [1, 7], [6, 9], [0, 0]])
    np.testing.assert_array_equal(around, [[0, 0], [1, 7], [1, 9], [1, 9], [6, 9]])


@pytest.mark.parametrize("thin", [1, 2])
@pytest.mark.parametrize("throw", [-20, -3, 0, 2, 5, 20])
def test_squares_and_energies_of_a_throw_equal_their_definition(rng, thin, throw):
    sides = two_sides(rng, (6, 9))
    hanging, foot, in_hanging, in_foot = sides
    sums = np.full((3, *thinned((6, 9), thin)), np.nan, np.float32)
    kernels.match_throw(*sides, throw, thin, LOUD, spans_of(in_hanging, thin)[0], sums)
    for a, b in np.ndindex(sums.shape[1:]):
        r, k, above = a * thin, b * thin, b * thin - throw
        expected = (0.0, 0.0, 0.0)
        if 0 <= above < 9 and in_hanging[r, k] and in_foot[r, above] and in_foot[min(r + 1, 5), above]:
            one, other = hanging[r, k], foot[r, above]
            expected = (min((one - other) ** 2, 2.5), one**2 + other**2, 1.0)
        np.testing.assert_allclose(sums[:, a, b], expected, atol=1e-5)


@pytest.mark.parametrize(("share", "thin"), [(0.0, 1), (0.3, 1), (-0.4, 2)])
def test_squares_about_a_throw_equal_their_definition(rng, share, thin):
    hanging, foot, in_hanging, _ = two_sides(rng, (7, 12))
    usual = rng.uniform(-3, 3, thinned((7, 12), thin)).astype(np.float32)
    sums = np.full((3, *usual.shape), np.nan, np.float32)
    kernels.match_throw_about(
        hanging, foot, in_hanging, np.ones_like(foot), usual, np.float32(1.0), np.float32(share), thin, LOUD,
        spans_of(in_hanging, thin)[0], sums,
    )  # fmt: skip
    for a, b in np.ndindex(usual.shape):
        r, k, throw = a * thin, b * thin, float(usual[a, b]) + 1.0
        row, above = r - share * throw, k - throw
        expected = (0.0, 0.0, 0.0)
        if in_hanging[r, k] and 0 <= row <= 6 and 0 <= above <= 11:
            other = ndimage.map_coordinates(foot.astype(np.float64), [[row], [above]], order=1)[0]
            expected = (min((hanging[r, k] - other) ** 2, 2.5), hanging[r, k] ** 2 + other**2, 1.0)
        np.testing.assert_allclose(sums[:, a, b], expected, atol=1e-4)


def test_comparison_about_a_throw_is_shifted_by_it(rng):
    sides = two_sides(rng, (5, 30), missing=0.0)
    own = spans_of(sides[2])[0]
    plain, about = np.empty((3, 5, 30), np.float32), np.empty((3, 5, 30), np.float32)
    kernels.match_throw(*sides, 4, 1, LOUD, own, plain)
    usual = np.full((5, 30), 3.0, np.float32)
    kernels.match_throw_about(*sides, usual, np.float32(1.0), np.float32(0.0), 1, LOUD, own, about)
    np.testing.assert_allclose(about, plain, atol=1e-6)


@pytest.mark.parametrize("n_taps", [1, 5, 7, 9, 11])
@pytest.mark.parametrize("axis", [0, 1])
def test_windows_equal_a_correlation_with_repeated_ends(rng, n_taps, axis):
    values, taps = rng.normal(size=(6, 17)).astype(np.float32), rng.random(n_taps).astype(np.float32)
    out, spans = np.full_like(values, np.nan), np.tile([0, 17], (6, 1))
    if axis == 0:
        kernels.smooth_columns(values, taps, spans, out)
    else:
        kernels.smooth_rows(values, taps, spans, np.empty(17 + n_taps, np.float32), out)
    expected = ndimage.correlate1d(values.astype(np.float64), taps.astype(np.float64), axis=axis, mode="nearest")
    np.testing.assert_allclose(out, expected, atol=1e-5)


def test_windows_outside_the_spans_are_left_alone():
    values, spans = np.ones((3, 8), np.float32), np.array([[0, 0], [2, 5], [0, 0]])
    out = np.full_like(values, 9.0)
    kernels.smooth_columns(values, np.ones(1, np.float32), spans, out)
    np.testing.assert_array_equal(out, [[9] * 8, [9, 9, 1, 1, 1, 9, 9, 9], [9] * 8])
    kernels.smooth_rows(values, np.ones(1, np.float32), spans, np.empty(8, np.float32), out)
    np.testing.assert_array_equal(out, [[0] * 8, [0, 0, 1, 1, 1, 0, 0, 0], [0] * 8])


def plain_ratios(sums, row_taps, sample_taps):
    """Ratios by plain filters of all that there is."""
    smooth = sums.astype(np.float64)
    for axis, taps in ((2, sample_taps), (1, row_taps)):
        smooth = ndimage.correlate1d(smooth, taps.astype(np.float64), axis=axis, mode="nearest")
    cost, energy, weight = smooth
    return np.where(weight > 0.3, cost / np.maximum(energy + QUIET * weight, 1e-9), UNMATCHED)


@pytest.mark.parametrize("thin", [1, 2])
def test_ratios_of_all_throws_are_those_of_plain_filters(rng, thin):
    shape, taps = (31, 44), (gaussian_taps(1.5), gaussian_taps(2.0))
    sides = [side.copy() for side in two_sides(rng, shape)]
    slanted = np.abs(np.indices(shape)[1] - np.indices(shape)[0] - 6) < 7
    for side in sides:
        side[~slanted] = 0.0
    ratio = np.empty((9, *thinned(shape, thin)), np.float32)
    out = np.empty((*ratio.shape[1:], 9), np.float32)
    kernels.compare_throws(*sides, -4, thin, 1, LOUD, *taps, QUIET, UNMATCHED, ratio, out)
    few = np.empty((9, *out[::2, ::2, 0].shape), np.float32)
    thinner = np.empty((*few.shape[1:], 9), np.float32)
    kernels.compare_throws(*sides, -4, thin, 2, LOUD, *taps, QUIET, UNMATCHED, few, thinner)
    np.testing.assert_array_equal(thinner, out[::2, ::2])
    some = np.empty((*out.shape[:2], 4), np.float32)
    kernels.compare_throws(
        *sides, -2, thin, 1, LOUD, *taps, QUIET, UNMATCHED, np.empty((4, *out.shape[:2]), np.float32), some
    )
    np.testing.assert_array_equal(some, out[..., 2:6])
    assert 0.2 < (out == UNMATCHED).mean() < 0.9
    about = np.empty_like(out)
    usual = np.zeros(ratio.shape[1:], np.float32)
    kernels.compare_about(*sides, usual, np.float32(0.2), thin, LOUD, *taps, QUIET, UNMATCHED, ratio, about)
    for number in range(9):
        sums = np.empty((3, *ratio.shape[1:]), np.float32)
        own = spans_of(sides[2], thin)[0]
        kernels.match_throw(*sides, number - 4, thin, LOUD, own, sums)
        np.testing.assert_allclose(out[..., number], plain_ratios(sums, *taps), atol=1e-4)
        kernels.match_throw_about(*sides, usual, np.float32(number - 4), np.float32(0.2), thin, LOUD, own, sums)
        np.testing.assert_allclose(about[..., number], plain_ratios(sums, *taps), atol=1e-4)
