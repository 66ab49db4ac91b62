"""Separable filters and the structure tensor, one axis at a time, with the sample axis innermost for vector units."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d._typing import Float32Array


def gaussian_taps(sigma: float) -> Float32Array:
    """Return the weights of a Gaussian cut at 2.5 sigma, of sum 1; a single 1 for sigma 0."""
    if sigma <= 0.0:
        return np.ones(1, np.float32)
    half = max(1, int(np.ceil(2.5 * sigma)))
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
    """Correlate with the taps along the sample axis; the ends repeat."""
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


@njit(cache=True, nogil=True, parallel=True)
def filter_crosslines(volume, taps, out):  # type: ignore[no-untyped-def]
    """Correlate with the taps along the crossline axis; the ends repeat."""
    n0, n1, n2 = volume.shape
    half = len(taps) // 2
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                out[i, j, k] = 0.0
            for t in range(-half, half + 1):
                jj = min(max(j + t, 0), n1 - 1)
                weight = taps[t + half]
                for k in range(n2):
                    out[i, j, k] += weight * volume[i, jj, k]


@njit(cache=True, nogil=True, parallel=True)
def filter_inlines(volume, taps, out):  # type: ignore[no-untyped-def]
    """Correlate with the taps along the inline axis; the ends repeat.

    Inlines are the inner loop, so that the traces a window shares with the next one are still in the cache.
    """
    n0, n1, n2 = volume.shape
    half = len(taps) // 2
    for j in prange(n1):
        for i in range(n0):
            for k in range(n2):
                out[i, j, k] = 0.0
            for t in range(-half, half + 1):
                ii = min(max(i + t, 0), n0 - 1)
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


def smooth(
    volume: Float32Array, sigma: tuple[float, float, float], *, scratch: Float32Array | None = None
) -> Float32Array:
    """Return the volume smoothed by a Gaussian of the given widths along its three axes; the ends repeat.

    `scratch`, an array of the same shape, is written over: a caller that smooths many volumes saves as many.
    """
    out = np.empty_like(volume)
    scratch = np.empty_like(volume) if scratch is None else scratch
    filter_samples(volume, gaussian_taps(sigma[2]), out)
    filter_crosslines(out, gaussian_taps(sigma[1]), scratch)
    filter_inlines(scratch, gaussian_taps(sigma[0]), out)
    return out
