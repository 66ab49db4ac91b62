"""Kernels of the attribute cubes: arrays in, arrays out, no checks."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array


@nb.njit(cache=True, nogil=True)
def find_slopes(
    xx: AnyArray,
    yy: AnyArray,
    zz: AnyArray,
    xy: AnyArray,
    xz: AnyArray,
    yz: AnyArray,
    steepest: float,
    out: Float32Array,
) -> None:
    """Slopes dz/dx, dz/dy of the planes normal to the tensors' strongest axes; 0 where a tensor is empty.

    Tensors come as six arrays of shape (n,), slopes go to ``out`` of shape (2, n), limited to +-``steepest``.
    """
    a = np.empty((3, 3))
    v = np.empty((3, 3))
    for i in range(xx.size):
        a[0, 0], a[1, 1], a[2, 2] = xx[i], yy[i], zz[i]
        a[0, 1] = a[1, 0] = xy[i]
        a[0, 2] = a[2, 0] = xz[i]
        a[1, 2] = a[2, 1] = yz[i]
        total = a[0, 0] + a[1, 1] + a[2, 2]
        if not total > 0.0:
            out[0, i] = out[1, i] = 0.0
            continue
        a /= total
        _diagonalise(a, v)
        k = 0
        for j in range(1, 3):
            if a[j, j] > a[k, k]:
                k = j
        nz = v[2, k]
        if abs(nz) < 1e-6:
            nz = math.copysign(1e-6, nz)
        out[0, i] = min(max(-v[0, k] / nz, -steepest), steepest)
        out[1, i] = min(max(-v[1, k] / nz, -steepest), steepest)


@nb.njit(cache=True, nogil=True)
def _diagonalise(a: AnyArray, v: AnyArray) -> None:
    """Jacobi's rotations: ``a`` becomes diagonal, the columns of ``v`` its axes."""
    for i in range(3):
        for j in range(3):
            v[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off = a[0, 1] ** 2 + a[0, 2] ** 2 + a[1, 2] ** 2
        if off < 1e-18:
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if abs(a[p, q]) < 1e-30:
                    continue
                theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    left, right = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * left - s * right, s * left + c * right
                for k in range(3):
                    left, right = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * left - s * right, s * left + c * right
                for k in range(3):
                    left, right = v[k, p], v[k, q]
                    v[k, p], v[k, q] = c * left - s * right, s * left + c * right


@nb.njit(cache=True, nogil=True)
def stack_along_dip(
    cube: AnyArray,
    live: BoolArray,
    slope_x: AnyArray,
    slope_y: AnyArray,
    i: int,
    out_stack: AnyArray,
    out_energy: AnyArray,
) -> None:
    """Sum and energy of up to 3 x 3 traces aligned along the dip, for every sample of inline ``i``.

    ``out_stack`` gets the squared sum over the number of traces, ``out_energy`` the sum of squares, both of shape
    (crosslines, samples); their ratio, each smoothed along the trace, is the semblance.
    """
    n_x, n_y, n_z = cube.shape
    for j in range(n_y):
        for k in range(n_z):
            total, energy, count = 0.0, 0.0, 0
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    x, y = i + di, j + dj
                    if x < 0 or x >= n_x or y < 0 or y >= n_y or not live[x, y]:
                        continue
                    z = k + di * slope_x[i, j, k] + dj * slope_y[i, j, k]
                    low = math.floor(z)
                    if low < 0 or low + 1 >= n_z:
                        if z != n_z - 1:
                            continue
                        low = n_z - 2
                    share = z - low
                    value = cube[x, y, low] * (1.0 - share) + cube[x, y, low + 1] * share
                    total += value
                    energy += value * value
                    count += 1
            out_stack[j, k] = total * total / count if count > 0 else 0.0
            out_energy[j, k] = energy
