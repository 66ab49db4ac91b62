"""The strength of every trace, and how like its neighbours it is."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def mean_sizes(volume, valid, most, kept, out):  # type: ignore[no-untyped-def]
    """Write the mean size of the smaller samples of every trace, a share of them; 0 where none is valid.

    At most about so many samples of a trace are looked at.
    """
    n0, n1, n2 = volume.shape
    step = max(1, n2 // most)
    for line in prange(n0):
        i = np.int64(line)
        row = np.empty(n2, np.float32)
        for j in range(n1):
            n = 0
            for k in range(0, n2, step):
                if valid[i, j, k]:
                    row[n] = abs(volume[i, j, k])
                    n += 1
            counted = int(np.ceil(kept * n))
            total = 0.0
            for size in np.sort(row[:n])[:counted]:
                total += size
            out[i, j] = total / max(counted, 1)


@njit(cache=True, nogil=True, inline="always")
def _best_match(first, second, most):  # type: ignore[no-untyped-def]
    """Return the largest sum of products of two traces, one moved by up to so many samples."""
    n = len(first)
    best = np.float32(-np.inf)
    for lag in range(-most, most + 1):
        one, other = first[max(0, -lag) : n - max(0, lag)], second[max(0, lag) : n - max(0, -lag)]
        total = np.float32(0.0)
        for k in range(len(one)):
            total += one[k] * other[k]
        best = max(best, total)
    return best


@njit(cache=True, nogil=True, parallel=True, fastmath={"reassoc", "contract"})
def liken_traces(volume, valid, strengths, slope, clip, out):  # type: ignore[no-untyped-def]
    """Write the mean correlation of every trace with the two that it is most like, of two on either side along a line.

    Neighbours may lie up to `slope` samples a trace higher or lower. Samples count up to `clip` times the trace's
    strength. NaN where a trace has no neighbours, or no data.
    """
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        rows = np.zeros((n1, n2), np.float32)
        found = np.full((n1, 4), -np.inf, np.float32)
        for j in range(n1):
            most = np.float32(clip * strengths[i, j])
            power = 0.0
            for k in range(n2):
                if valid[i, j, k]:
                    rows[j, k] = min(max(volume[i, j, k], -most), most)
                    power += np.float64(rows[j, k]) ** 2
            if power > 0.0:
                rows[j] /= np.float32(np.sqrt(power))
        for j in range(n1):
            for apart in range(1, 3):
                if j + apart < n1 and strengths[i, j] > 0.0 and strengths[i, j + apart] > 0.0:
                    best = _best_match(rows[j], rows[j + apart], min(slope * apart, n2 - 1))
                    found[j, apart - 1] = best
                    found[j + apart, apart + 1] = best
        for j in range(n1):
            in_order = np.sort(found[j])
            best, second = in_order[3], in_order[2]
            if best == -np.inf:
                out[i, j] = np.nan
            else:
                out[i, j] = best if second == -np.inf else np.float32(0.5) * (best + second)
