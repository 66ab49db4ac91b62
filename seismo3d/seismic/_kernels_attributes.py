"""Kernels of the attribute cubes: arrays in, arrays out, no checks."""

from __future__ import annotations

import math

import numba as nb

from seismo3d._typing import AnyArray, BoolArray


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
    (crosslines, samples); their ratio, each smoothed along the trace, is the semblance. NaN is left out.
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
                    if math.isnan(value):
                        continue
                    total += value
                    energy += value * value
                    count += 1
            out_stack[j, k] = total * total / count if count > 0 else 0.0
            out_energy[j, k] = energy
