"""What a pass leaves behind: elements whose normals it asks for, sums over its blocks, the scale of its residuals."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array

DIGITS = 2048
"""Values of eleven bits."""


@nb.njit(cache=True, nogil=True)
def rows_asked_for(residuals: Float32Array, partners: Int32Array, n_target: int) -> Int64Array:
    """Return the target's rows, ascending, that are partners without a residual: their normals are not known yet."""
    n_asked = 0
    for i in range(residuals.shape[0]):
        if partners[i] >= 0 and math.isnan(residuals[i]):
            n_asked += 1
    if n_asked == 0:
        return np.empty(0, dtype=np.int64)
    marked = np.zeros(n_target, dtype=np.bool_)
    for i in range(residuals.shape[0]):
        if partners[i] >= 0 and math.isnan(residuals[i]):
            marked[partners[i]] = True
    return np.flatnonzero(marked)


@nb.njit(cache=True, nogil=True)
def sum_blocks(sums: Float64Array, residuals: Float32Array) -> tuple[Float64Array, float, float]:
    """Return the sum of the blocks' rows, the mean square residual, and the residuals' median magnitude."""
    total = np.zeros(sums.shape[1])
    for block in range(sums.shape[0]):
        for k in range(sums.shape[1]):
            total[k] += sums[block, k]
    magnitudes = np.empty(residuals.shape[0], dtype=np.float32)
    n = 0
    squares = 0.0
    for i in range(residuals.shape[0]):
        r = residuals[i]
        if not math.isnan(r):
            magnitudes[n] = abs(r)
            n += 1
            squares += np.float64(r) * np.float64(r)
    if n == 0:
        return total, 0.0, 0.0
    return total, squares / n, median_of_magnitudes(magnitudes[:n])


@nb.njit(cache=True, nogil=True)
def median_of_magnitudes(values: Float32Array) -> float:
    """Return the median of numbers that are not negative, whose bits therefore are in their order.

    The middle one is found by its bits, eleven at a time from the highest on, among those that share what is above.
    """
    n = values.shape[0]
    bits = values.view(np.int32).copy()
    counts = np.empty(DIGITS, dtype=np.int32)
    rank = (n - 1) // 2
    left = n
    for shift in (20, 9, 0):
        counts[:] = 0
        for i in range(left):
            counts[(bits[i] >> shift) & (DIGITS - 1)] += 1
        digit = 0
        while counts[digit] <= rank:
            rank -= counts[digit]
            digit += 1
        kept = 0
        for i in range(left):
            if (bits[i] >> shift) & (DIGITS - 1) == digit:
                bits[kept] = bits[i]
                kept += 1
        left = kept
    low = bits[:1].view(np.float32)[0]
    if n % 2 or rank + 1 < left:
        return np.float64(low)
    high = np.float32(np.inf)
    for i in range(n):
        if values[i] > low:
            high = min(high, values[i])
    return np.float64((low + high) * np.float32(0.5))
