"""Separable filters and the structure tensor, one axis at a time, with the sample axis innermost for vector units."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d._typing import AnyArray, Float32Array

Traces = tuple[slice, slice]
"""Inlines and crosslines of a volume, each from a start to a stop."""


def all_traces(volume: AnyArray) -> Traces:
    """Return all traces of a volume."""
    return slice(0, volume.shape[0]), slice(0, volume.shape[1])


def grow_traces(traces: Traces, reach: tuple[int, int], shape: tuple[int, ...]) -> Traces:
    """Return traces with so many inlines and crosslines more on every side, as far as a volume has them."""
    return (
        slice(max(0, traces[0].start - reach[0]), min(shape[0], traces[0].stop + reach[0])),
        slice(max(0, traces[1].start - reach[1]), min(shape[1], traces[1].stop + reach[1])),
    )


def shift_traces(traces: Traces, other: Traces) -> Traces:
    """Return where traces lie among others."""
    return (
        slice(traces[0].start - other[0].start, traces[0].stop - other[0].start),
        slice(traces[1].start - other[1].start, traces[1].stop - other[1].start),
    )


def gaussian_taps(sigma: float, *, cut: float = 2.5) -> Float32Array:
    """Return the weights of a Gaussian cut at so many sigma, of sum 1; a single 1 for sigma 0."""
    if sigma <= 0.0:
        return np.ones(1, np.float32)
    half = max(1, int(np.ceil(cut * sigma)))
    t = np.arange(-half, half + 1)
    weights = np.exp(-(t**2) / (2.0 * sigma**2))
    return (weights / weights.sum()).astype(np.float32)


def derivative_taps(sigma: float) -> Float32Array:
    """Return weights that give the slope of a straight line exactly and taper like a Gaussian."""
    half = max(1, int(np.ceil(3.0 * sigma)))
    t = np.arange(-half, half + 1)
    weights = t * np.exp(-(t**2) / (2.0 * sigma**2))
    return (weights / (weights * t).sum()).astype(np.float32)


@njit(cache=True, nogil=True, parallel=True)
def filter_samples(volume, taps, out):  # type: ignore[no-untyped-def]
    """Correlate with the taps along the sample axis; the ends repeat. `out` may be the volume itself."""
    n0, n1, n2 = volume.shape
    half = len(taps) // 2
    for i in prange(n0):
        row = np.empty(n2 + 2 * half, np.float32)
        for j in range(n1):
            for k in range(n2):
                row[k + half] = volume[i, j, k]
            for k in range(half):
                row[k] = volume[i, j, 0]
                row[n2 + half + k] = volume[i, j, n2 - 1]
            for k in range(n2):
                out[i, j, k] = 0.0
            for t in range(2 * half + 1):
                weight = taps[t]
                for k in range(n2):
                    out[i, j, k] += weight * row[k + t]


@njit(cache=True, nogil=True)
def _bridge(own, there, row):  # type: ignore[no-untyped-def]
    """Write a trace, with straight lines over its gaps, from its first to its last valid sample; return these two.

    The first is behind the last where there is none. What is put in for a gap must not be a step: a filter rings at it.
    """
    n = len(own)
    first, last = 0, n - 1
    while first < n and not there[first]:
        first += 1
    while last > first and not there[last]:
        last -= 1
    before = first
    for k in range(first, last + 1):
        if there[k]:
            row[k] = own[k]
            for gap in range(before + 1, k):
                share = np.float32(gap - before) / np.float32(k - before)
                row[gap] = own[before] + share * (own[k] - own[before])
            before = k
    return first, last


@njit(cache=True, nogil=True)
def _correlate(row, taps, there, first, last, out):  # type: ignore[no-untyped-def]
    """Write a trace, given with half of the taps beyond either end, correlated with them where it is valid."""
    for t in range(len(taps)):
        weight = taps[t]
        for k in range(first, last + 1):
            out[k] += weight * row[k + t]
    for k in range(first, last + 1):
        if not there[k]:
            out[k] = np.float32(0.0)


@njit(cache=True, nogil=True, parallel=True)
def filter_known(volume, valid, taps, out):  # type: ignore[no-untyped-def]
    """Correlate traces with the taps; 0 where they are not valid. The first and the last valid sample repeat."""
    n0, n1, n2 = volume.shape
    half = len(taps) // 2
    for i in prange(n0):
        row = np.empty(n2 + 2 * half, np.float32)
        for j in range(n1):
            there = valid[i, j]
            out[i, j] = np.float32(0.0)
            first, last = _bridge(volume[i, j], there, row[half : half + n2])
            if first > last:
                continue
            row[: half + first] = row[half + first]
            row[half + last + 1 :] = row[half + last]
            _correlate(row, taps, there, first, last, out[i, j])


@njit(cache=True, nogil=True, parallel=True)
def filter_carried(volume, valid, taps, beyond, out):  # type: ignore[no-untyped-def]
    """Correlate traces with the taps from their first to their last valid sample; 0 where they are not valid.

    Row t of `beyond` tells the sample t + 1 beyond an end from the last ones, the end first.
    """
    n0, n1, n2 = volume.shape
    half, n = len(taps) // 2, beyond.shape[1]
    zero = np.float32(0.0)
    for i in prange(n0):
        row = np.empty(n2 + 2 * half, np.float32)
        for j in range(n1):
            there = valid[i, j]
            out[i, j] = zero
            row[:] = zero
            first, last = _bridge(volume[i, j], there, row[half : half + n2])
            if first > last:
                continue
            for t in range(half):
                above, below = zero, zero
                for k in range(min(n, last - first + 1)):
                    above += beyond[t, k] * row[first + half + k]
                    below += beyond[t, k] * row[last + half - k]
                row[first + half - 1 - t], row[last + half + 1 + t] = above, below
            _correlate(row, taps, there, first, last, out[i, j])


@njit(cache=True, nogil=True, parallel=True)
def filter_crosslines(volume, taps, out, first):  # type: ignore[no-untyped-def]
    """Correlate with the taps along the crossline axis; the ends repeat.

    `out` may have fewer crosslines, the first of which is the volume's at `first`.
    """
    n0, n1, n2 = volume.shape
    half = len(taps) // 2
    for i in prange(n0):
        for j in range(out.shape[1]):
            for k in range(n2):
                out[i, j, k] = 0.0
            for t in range(-half, half + 1):
                jj = min(max(first + j + t, 0), n1 - 1)
                weight = taps[t + half]
                for k in range(n2):
                    out[i, j, k] += weight * volume[i, jj, k]


@njit(cache=True, nogil=True, parallel=True)
def filter_inlines(volume, taps, out, first):  # type: ignore[no-untyped-def]
    """Correlate with the taps along the inline axis; the ends repeat.

    `out` may have fewer inlines, the first of which is the volume's at `first`. Inlines are the inner loop, so that the
    traces a window shares with the next one are still in the cache.
    """
    n0, n1, n2 = volume.shape
    half = len(taps) // 2
    for j in prange(n1):
        for i in range(out.shape[0]):
            for k in range(n2):
                out[i, j, k] = 0.0
            for t in range(-half, half + 1):
                ii = min(max(first + i + t, 0), n0 - 1)
                weight = taps[t + half]
                for k in range(n2):
                    out[i, j, k] += weight * volume[ii, j, k]


@njit(cache=True, nogil=True, parallel=True)
def multiply_weighted(a, b, weight, out):  # type: ignore[no-untyped-def]
    """Write weight * a * b."""
    n0, n1, n2 = a.shape
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                out[i, j, k] = weight[i, j, k] * a[i, j, k] * b[i, j, k]


@njit(cache=True, nogil=True, parallel=True)
def tensor_slopes(txx, txy, txz, tyy, tyz, tzz, steepest, p, q):  # type: ignore[no-untyped-def]
    """Turn smoothed structure tensors into reflector slopes, in samples a trace, along inlines (p) and crosslines (q).

    The eigenvector of the largest eigenvalue is the reflector's normal. Squaring the 3 x 3 matrix four times (its 16th
    power) leaves that vector alone, with no branch, so that the loop runs on vector units.
    """
    n0, n1, n2 = p.shape
    tiny = np.float32(1e-20)
    one = np.float32(1.0)
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                a, b, c = txx[i, j, k], txy[i, j, k], txz[i, j, k]
                d, e, f = tyy[i, j, k], tyz[i, j, k], tzz[i, j, k]
                s = one / (a + d + f + tiny)
                a, b, c, d, e, f = a * s, b * s, c * s, d * s, e * s, f * s
                for _ in range(4):
                    a2 = a * a + b * b + c * c
                    b2 = a * b + b * d + c * e
                    c2 = a * c + b * e + c * f
                    d2 = b * b + d * d + e * e
                    e2 = b * c + d * e + e * f
                    f2 = c * c + e * e + f * f
                    s = one / (a2 + d2 + f2 + tiny)
                    a, b, c, d, e, f = a2 * s, b2 * s, c2 * s, d2 * s, e2 * s, f2 * s
                # the 16th power is v v' up to scale: its last column is v
                f = max(f, np.float32(1e-3))
                p[i, j, k] = min(max(-c / f, -steepest), steepest)
                q[i, j, k] = min(max(-e / f, -steepest), steepest)


def smooth(volume: Float32Array, sigma: tuple[float, float, float], *, within: Traces | None = None) -> Float32Array:
    """Return the volume smoothed by a Gaussian of the given widths along its three axes; the ends repeat.

    Given traces within it, only those are returned; the filter along the samples, mostly the longest, then runs on no
    others.
    """
    return filter_traces(volume, *(gaussian_taps(width) for width in sigma), within=within)


def filter_traces(
    volume: Float32Array,
    inline_taps: Float32Array,
    crossline_taps: Float32Array,
    sample_taps: Float32Array,
    *,
    within: Traces | None = None,
) -> Float32Array:
    """Return the volume, or traces within it, correlated with taps along all three axes; the ends repeat."""
    found = spread_traces(volume, inline_taps, crossline_taps, within=within)
    filter_samples(found, sample_taps, found)
    return found


def spread_traces(
    volume: Float32Array, inline_taps: Float32Array, crossline_taps: Float32Array, *, within: Traces | None = None
) -> Float32Array:
    """Return the volume, or traces within it, correlated with taps along inlines and crosslines; the ends repeat."""
    inlines, crosslines = within or all_traces(volume)
    across = np.empty((inlines.stop - inlines.start, *volume.shape[1:]), np.float32)
    filter_inlines(volume, inline_taps, across, inlines.start)
    found = np.empty((len(across), crosslines.stop - crosslines.start, volume.shape[2]), np.float32)
    filter_crosslines(across, crossline_taps, found, crosslines.start)
    return found
