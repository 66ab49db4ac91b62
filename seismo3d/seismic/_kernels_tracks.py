"""Depths of one layer, and the waveforms along it."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def level_depths(times, cuts, target, depth):  # type: ignore[no-untyped-def]
    """Write the fractional sample at which every trace reaches its target; NaN where it does not, or in a fault."""
    n0, n1, n2 = times.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            depth[i, j] = np.nan
            row, wanted = times[i, j], target[i, j]
            if not (wanted >= row[0] and wanted <= row[n2 - 1]):
                continue
            low, high = 0, n2 - 1
            while high - low > 1:
                middle = (low + high) // 2
                if row[middle] <= wanted:
                    low = middle
                else:
                    high = middle
            if cuts[i, j, low] & np.uint8(4) and row[high] - row[low] > 2.0:
                continue
            depth[i, j] = low + (wanted - row[low]) / (row[high] - row[low])


@njit(cache=True, nogil=True, parallel=True)
def read_waveforms(volume, valid, depth, half, out):  # type: ignore[no-untyped-def]
    """Write amplitudes from `half` samples above every depth to `half` below; 0 where there are none."""
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for t in range(2 * half + 1):
                out[i, j, t] = 0.0
                if not np.isfinite(depth[i, j]):
                    continue
                z = depth[i, j] + t - half
                b = int(np.floor(z))
                if b < 1 or b + 2 >= n2 or not (valid[i, j, b] and valid[i, j, b + 1]):
                    continue
                f = np.float32(z - b)
                y0, y1 = volume[i, j, b - 1], volume[i, j, b]
                y2, y3 = volume[i, j, b + 1], volume[i, j, b + 2]
                c1 = np.float32(0.5) * (y2 - y0)
                c2 = y0 - np.float32(2.5) * y1 + np.float32(2.0) * y2 - np.float32(0.5) * y3
                c3 = np.float32(0.5) * (y3 - y0) + np.float32(1.5) * (y1 - y2)
                out[i, j, t] = y1 + f * (c1 + f * (c2 + f * c3))
