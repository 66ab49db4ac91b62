"""Kernels of lens distortion; see :mod:`seismo3d.geometry.camera`."""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array

_STEPS = 12
_STILL = 1e-13


@nb.njit(cache=True, nogil=True, error_model="numpy")
def straighten_points(distorted: Float64Array, bend: Float64Array) -> Float64Array:
    """Points (n, 2) at depth 1 without distortion, by as many steps as change them; ``bend`` is k1, k2, p1, p2, k3."""
    out = np.empty_like(distorted)
    k1, k2, p1, p2, k3 = bend[0], bend[1], bend[2], bend[3], bend[4]
    for n in range(distorted.shape[0]):
        x0, y0 = distorted[n, 0], distorted[n, 1]
        x, y = x0, y0
        for _ in range(_STEPS):
            r2 = x * x + y * y
            inverse = 1.0 / (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)))
            u = (x0 - 2.0 * p1 * x * y - p2 * (r2 + 2.0 * x * x)) * inverse
            v = (y0 - p1 * (r2 + 2.0 * y * y) - 2.0 * p2 * x * y) * inverse
            still = abs(u - x) + abs(v - y) < _STILL
            x, y = u, v
            if still:
                break
        out[n, 0], out[n, 1] = x, y
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def straighten_rows(first: int, last: int, lens: Float64Array, bend: Float64Array, out: Float32Array) -> None:
    """Fill some rows of the points (rows, columns, 2) at depth 1 that an image's pixels look at.

    ``lens`` is fx, fy, cx, cy, ``bend`` k1, k2, p1, p2, k3. All pixels of a row take the same number of steps side by
    side, so that the processor's vectors take many in one.
    """
    columns = out.shape[1]
    k1, k2, p1, p2, k3 = bend[0], bend[1], bend[2], bend[3], bend[4]
    x0, x, y = np.empty(columns), np.empty(columns), np.empty(columns)
    for c in range(columns):
        x0[c] = (c - lens[2]) / lens[0]
    for r in range(first, last):
        y0 = (r - lens[3]) / lens[1]
        for c in range(columns):
            x[c], y[c] = x0[c], y0
        for _ in range(_STEPS):
            for c in range(columns):
                a, b = x[c], y[c]
                r2 = a * a + b * b
                inverse = 1.0 / (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)))
                x[c] = (x0[c] - 2.0 * p1 * a * b - p2 * (r2 + 2.0 * a * a)) * inverse
                y[c] = (y0 - p1 * (r2 + 2.0 * b * b) - 2.0 * p2 * a * b) * inverse
        for c in range(columns):
            out[r, c, 0], out[r, c, 1] = x[c], y[c]
