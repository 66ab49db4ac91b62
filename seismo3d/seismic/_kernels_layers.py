"""Kernels of the layer graph: edges from shifts, and layer time at every sample from the solution."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d.seismic._kernels_shifts import follow


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


@njit(cache=True, nogil=True)
def count_links(shift, axis, length, stride, step):  # type: ignore[no-untyped-def]
    """Count the edges that `link_traces` writes."""
    n0, n1, m = shift.shape
    di, dj = (length, 0) if axis == 0 else (0, length)
    count = 0
    for i in range(0, n0 - di, stride):
        for j in range(0, n1 - dj, stride):
            for k in range(m):
                ahead = k * step + shift[i, j, k]
                if 0.0 <= ahead <= (m - 1) * step:
                    count += 1
    return count


@njit(cache=True, nogil=True)
def link_traces(  # type: ignore[no-untyped-def]
    nearest, shift, variance, cuts, breaks, axis, length, stride, step, first, second, measured, spread, share
):
    """Write edges from every coarse sample of every stride-th trace to its place on the trace `length` further.

    Vertices are numbered on the grid of every stride-th trace. Values are layer time less sample, so that an edge
    measures minus the shift. Gives the number of edges; those that cross a fault are left out.
    """
    n0, n1, m = shift.shape
    di, dj = (length, 0) if axis == 0 else (0, length)
    across = (n1 - 1) // stride + 1
    count = 0
    for i in range(0, n0 - di, stride):
        for j in range(0, n1 - dj, stride):
            tail = ((i // stride) * across + j // stride) * m
            head = (((i + di) // stride) * across + (j + dj) // stride) * m
            for k in range(m):
                ahead = k * step + shift[i, j, k]
                if ahead < 0.0 or ahead > (m - 1) * step:
                    continue
                _, free = follow(nearest, cuts, i, j, np.float64(k * step), axis, length, step)
                if not free:
                    continue
                low = min(int(ahead / step), m - 2)
                part = np.float32(ahead / step - low)
                gap = breaks[i + di, j + dj, low]
                if gap > 0:
                    part = np.float32(0.0) if ahead < low * step + gap - 0.5 else np.float32(1.0)
                first[count] = tail + k
                second[count] = head + low
                measured[count] = -shift[i, j, k]
                spread[count] = variance[i, j, k]
                share[count] = part
                count += 1
    return count


@njit(cache=True, nogil=True)
def link_samples(thickness, breaks, variance, first, second, measured, spread, share):  # type: ignore[no-untyped-def]
    """Write edges down every trace, with the change of value that is expected; none across a fault."""
    n0, n1, m = breaks.shape
    count = 0
    vertex = 0
    for i in range(n0):
        for j in range(n1):
            for k in range(m - 1):
                if breaks[i, j, k] == 0:
                    first[count] = vertex + k
                    second[count] = vertex + k + 1
                    measured[count] = thickness[vertex + k]
                    spread[count] = variance
                    share[count] = 0.0
                    count += 1
            vertex += m
    return count


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
