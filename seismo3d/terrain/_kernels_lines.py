"""The line scan: signed evidence averaged along straight lines of every strike through every cell."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def keep_best_line(step, trough, known, shear, taps, stride, n_free, floor, code, best, mean, arg):  # type: ignore[no-untyped-def]
    """Test lines of one strike through every cell; keep the most significant, its mean and its strike's number.

    The line runs along the second axis and moves by `shear` along the first. Its means are weighed by `taps`, `stride`
    cells apart, times `known`. The statistic is the squared mean over its squared standard error: the variance of the
    values along the line over `n_free`, plus the square of `floor`; for steps, for troughs where they are hollow, and
    the mean of both. So `best`, `mean` and `arg` are of shape (3, rows, columns); the third mean is the larger one.
    Lines of which less than half is known are left out.
    """
    rows, columns = step.shape
    half = len(taps) // 2
    full = taps.sum()
    for line in prange(rows):
        i = np.int64(line)
        total = np.zeros(columns, np.float32)
        sums = np.zeros((4, columns), np.float32)
        for n in range(-half, half + 1):
            t = n * stride
            moved = shear * t
            base = math.floor(moved)
            a = i + base
            w1 = np.float32(moved - base)
            w0 = np.float32(1.0) - w1
            if a < 0 or a + 1 >= rows:
                continue
            tap = taps[n + half]
            for j in range(max(0, -t), min(columns, columns - t)):
                weight = tap * (w0 * known[a, j + t] + w1 * known[a + 1, j + t])
                slope = w0 * step[a, j + t] + w1 * step[a + 1, j + t]
                bend = w0 * trough[a, j + t] + w1 * trough[a + 1, j + t]
                total[j] += weight
                sums[0, j] += weight * slope
                sums[1, j] += weight * slope * slope
                sums[2, j] += weight * bend
                sums[3, j] += weight * bend * bend
        for j in range(columns):
            if total[j] < np.float32(0.5) * full or known[i, j] <= np.float32(0.0):
                continue
            # a line that is partly off the map has fewer free values
            free = n_free * total[j] / full
            least = floor[i, j] * floor[i, j]
            m = sums[0, j] / total[j]
            one = m * m / (max(sums[1, j] / total[j] - m * m, np.float32(0.0)) / free + least)
            h = sums[2, j] / total[j]
            two = h * h / (max(sums[3, j] / total[j] - h * h, np.float32(0.0)) / free + least)
            if h < np.float32(0.0):
                two = np.float32(0.0)
            if one > best[0, i, j]:
                best[0, i, j] = one
                mean[0, i, j] = m
                arg[0, i, j] = code
            if two > best[1, i, j]:
                best[1, i, j] = two
                mean[1, i, j] = h
                arg[1, i, j] = code
            both = np.float32(0.5) * (one + two)
            if both > best[2, i, j]:
                best[2, i, j] = both
                mean[2, i, j] = m if abs(m) > h else h
                arg[2, i, j] = code
