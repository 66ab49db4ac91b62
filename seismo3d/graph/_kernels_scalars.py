"""Kernels of the scalar graph: one pass over the edges each; arrays in, arrays out, no checks."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, inline="always")
def _difference(values, a, b, f, g):  # type: ignore[no-untyped-def]
    """Value at an edge's head minus that at its tail; shares above 0 lie between a vertex and the next."""
    one = np.float32(1.0)
    tail, head = values[a], values[b]
    if f > 0:
        tail = (one - f) * tail + f * values[a + 1]
    if g > 0:
        head = (one - g) * head + g * values[b + 1]
    return head - tail


@njit(cache=True, nogil=True, inline="always")
def _pull(out, a, b, f, g, r):  # type: ignore[no-untyped-def]
    """Add a pull to an edge's head and take it from its tail."""
    one = np.float32(1.0)
    out[a] -= (one - f) * r
    if f > 0:
        out[a + 1] -= f * r
    out[b] += (one - g) * r
    if g > 0:
        out[b + 1] += g * r


@njit(cache=True, nogil=True, parallel=True)
def edge_residuals(values, first, second, first_share, second_share, measured, out):  # type: ignore[no-untyped-def]
    """Write, for every edge, what is measured minus the difference of the values at its ends."""
    for e in prange(len(first)):
        out[e] = measured[e] - _difference(values, first[e], second[e], first_share[e], second_share[e])


@njit(cache=True, nogil=True)
def gather_gradient(first, second, first_share, second_share, pull, out):  # type: ignore[no-untyped-def]
    """Add every edge's pull to its head and take it from its tail."""
    out[:] = 0.0
    for e in range(len(first)):
        _pull(out, first[e], second[e], first_share[e], second_share[e], pull[e])


@njit(cache=True, nogil=True)
def apply_normal(values, first, second, first_share, second_share, weight, out):  # type: ignore[no-untyped-def]
    """Write the normal matrix times values, edge by edge."""
    out[:] = 0.0
    for e in range(len(first)):
        a, b, f, g = first[e], second[e], first_share[e], second_share[e]
        _pull(out, a, b, f, g, weight[e] * _difference(values, a, b, f, g))


@njit(cache=True, nogil=True)
def normal_diagonal(first, second, first_share, second_share, weight, out):  # type: ignore[no-untyped-def]
    """Write the diagonal of the normal matrix."""
    one = np.float32(1.0)
    out[:] = 0.0
    for e in range(len(first)):
        a, b, f, g, w = first[e], second[e], first_share[e], second_share[e], weight[e]
        out[a] += w * (one - f) * (one - f)
        if f > 0:
            out[a + 1] += w * f * f
        out[b] += w * (one - g) * (one - g)
        if g > 0:
            out[b + 1] += w * g * g


@njit(cache=True, nogil=True, parallel=True)
def robust_weights(residuals, variance, cutoff, out):  # type: ignore[no-untyped-def]
    """Write 1 / variance times the weight of Geman and McClure; an infinite cutoff leaves 1 / variance."""
    for e in prange(len(residuals)):
        square = residuals[e] * residuals[e] / variance[e]
        shrink = np.float32(1.0) / (np.float32(1.0) + square / (cutoff * cutoff))
        out[e] = shrink * shrink / variance[e]
