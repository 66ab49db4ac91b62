"""Kernels of layer time: where faults break traces, and its value at every sample from the solution of the graph."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def find_breaks(cuts, step, breaks):  # type: ignore[no-untyped-def]
    """Write, between a coarse sample and the next, how many samples below it the first fault is met, from 1; else 0."""
    n0, n1, n2 = cuts.shape
    m = breaks.shape[2]
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for k in range(m):
                breaks[i, j, k] = 0
                for t in range(step):
                    if k * step + t < n2 and cuts[i, j, k * step + t] & np.uint8(4):
                        breaks[i, j, k] = t + 1
                        break


@njit(cache=True, nogil=True, parallel=True)
def fill_samples(coarse, breaks, step, out):  # type: ignore[no-untyped-def]
    """Write layer time at every sample from values (layer time less sample) at every step-th.

    Between two coarse samples values change linearly; where a fault lies between, either side is carried to it
    along its own trend.
    """
    n0, n1, n2 = out.shape
    m = coarse.shape[2]
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            row, gaps = coarse[i, j], breaks[i, j]
            for k in range(n2):
                low = min(k // step, m - 1)
                t = k - low * step
                value = row[low]
                if t > 0:
                    part = np.float32(t) / np.float32(step)
                    if low == m - 1 or gaps[low] >= t + 1:
                        if low > 0 and gaps[low - 1] == 0:
                            value += part * (row[low] - row[low - 1])
                    elif gaps[low] > 0:
                        value = row[low + 1]
                        if low + 2 < m and gaps[low + 1] == 0:
                            value -= (np.float32(1.0) - part) * (row[low + 2] - row[low + 1])
                    else:
                        value += part * (row[low + 1] - row[low])
                out[i, j, k] = value + k


@njit(cache=True, nogil=True)
def _make_run_increasing(row, first, last, least, mean, size):  # type: ignore[no-untyped-def]
    """Do what `make_increasing` does for the samples of one trace from `first` to before `last`."""
    falls = False
    for k in range(first + 1, last):
        if not row[k] - row[k - 1] >= least:
            falls = True
            break
    if not falls:
        return
    n = 0
    for k in range(first, last):
        mean[n], size[n] = row[k] - least * k, 1
        while n > 0 and mean[n - 1] > mean[n]:
            total = size[n - 1] + size[n]
            mean[n - 1] = (mean[n - 1] * size[n - 1] + mean[n] * size[n]) / total
            size[n - 1] = total
            n -= 1
        n += 1
    k = first
    for b in range(n):
        for _ in range(size[b]):
            row[k] = mean[b] + least * k
            k += 1


@njit(cache=True, nogil=True, parallel=True)
def make_increasing(times, least):  # type: ignore[no-untyped-def]
    """Replace every trace, in place, by the nearest one (least squares) that grows by `least` or more a sample."""
    n0, n1, n2 = times.shape
    for line in prange(n0):
        i = np.int64(line)
        mean, size = np.empty(n2), np.empty(n2, np.int64)
        for j in range(n1):
            _make_run_increasing(times[i, j], 0, n2, least, mean, size)


@njit(cache=True, nogil=True, parallel=True)
def make_runs_increasing(times, cuts, least):  # type: ignore[no-untyped-def]
    """Do what `make_increasing` does for the samples between one fault and the next alone."""
    n0, n1, n2 = times.shape
    for line in prange(n0):
        i = np.int64(line)
        mean, size = np.empty(n2), np.empty(n2, np.int64)
        for j in range(n1):
            first = 0
            for k in range(n2):
                if k == n2 - 1 or cuts[i, j, k] & np.uint8(4):
                    _make_run_increasing(times[i, j], first, k + 1, least, mean, size)
                    first = k + 1
