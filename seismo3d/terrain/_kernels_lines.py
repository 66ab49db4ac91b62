"""The line scan: signed evidence averaged along straight lines of every strike through every cell."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True, fastmath=True)
def keep_best_line(step, trough, known, shear, taps, stride, n_free, floor, code, best, step_mean, trough_mean, arg):  # type: ignore[no-untyped-def]
    """Test lines of one strike through every cell; keep the most significant, its two means and its strike's number.

    The line runs along the second axis and moves by `shear` along the first. Its means are weighed by `taps`, `stride`
    cells apart, times `known`. The statistic is the sum over both kinds of evidence of the squared mean over its
    squared standard error: the variance of the values along the line over `n_free`, plus the square of `floor`. A
    trough counts where it is hollow. Lines of which less than half is known are left out.
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
                one = w0 * step[a, j + t] + w1 * step[a + 1, j + t]
                two = w0 * trough[a, j + t] + w1 * trough[a + 1, j + t]
                total[j] += weight
                sums[0, j] += weight * one
                sums[1, j] += weight * one * one
                sums[2, j] += weight * two
                sums[3, j] += weight * two * two
        for j in range(columns):
            if total[j] < np.float32(0.5) * full or known[i, j] <= np.float32(0.0):
                continue
            # a line that is partly off the map has fewer free values
            free = n_free * total[j] / full
            least = floor[i, j] * floor[i, j]
            m = sums[0, j] / total[j]
            t2 = m * m / (max(sums[1, j] / total[j] - m * m, np.float32(0.0)) / free + least)
            h = sums[2, j] / total[j]
            if h > np.float32(0.0):
                t2 += h * h / (max(sums[3, j] / total[j] - h * h, np.float32(0.0)) / free + least)
            if t2 > best[i, j]:
                best[i, j] = t2
                step_mean[i, j] = m
                trough_mean[i, j] = h
                arg[i, j] = code
