"""A layer carried on from trace to trace, on one side of faults."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def part_moved(cuts, before, after):  # type: ignore[no-untyped-def]
    """Set to NaN what moved past a fault that the trace crosses."""
    n0, n1, n2 = cuts.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            if not (np.isfinite(before[i, j]) and np.isfinite(after[i, j])):
                continue
            low, high = min(before[i, j], after[i, j]), max(before[i, j], after[i, j])
            for k in range(max(int(np.rint(low)), 0), min(int(np.rint(high)), n2 - 1)):
                if cuts[i, j, k] & np.uint8(4):
                    after[i, j] = np.nan


@njit(cache=True, nogil=True, inline="always")
def _ahead(cut, z):  # type: ignore[no-untyped-def]
    """Bits 0 and 1: a fault passes before the next inline or crossline at a depth."""
    last = len(cut) - 1
    low, high = min(max(int(np.floor(z)), 0), last), min(max(int(np.ceil(z)), 0), last)
    return (cut[low] | cut[high]) & np.uint8(3)


@njit(cache=True, nogil=True, parallel=True)
def read_levels(times, cuts, depth, level, ahead):  # type: ignore[no-untyped-def]
    """Write the layer time at every depth, read on its side of faults, and in which directions a fault bounds it."""
    n0, n1, n2 = times.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            z = depth[i, j]
            if not np.isfinite(z):
                continue
            row, cut = times[i, j], cuts[i, j]
            middle = min(max(int(np.rint(z)), 0), n2 - 1)
            low = middle if z >= middle else middle - 1
            if low < 0 or low + 1 >= n2 or cut[low] & np.uint8(4):
                # the other way, or on at a sample a unit where there is but one
                low = middle - 1 if low == middle else middle
            if low < 0 or low + 1 >= n2 or cut[low] & np.uint8(4):
                level[i, j] = row[middle] + z - middle
            else:
                level[i, j] = row[low] + (z - low) * (row[low + 1] - row[low])
            ahead[i, j] = _ahead(cut, z)


@njit(cache=True, nogil=True, inline="always")
def _level_near(row, cut, z, wanted, reach):  # type: ignore[no-untyped-def]
    """Sample at which a trace reaches a time near a depth, on its side of faults; NaN where it does not."""
    n2 = len(row)
    middle = min(max(int(np.rint(z)), 0), n2 - 1)
    first, last = middle, middle
    while first > max(0, middle - reach) and not cut[first - 1] & np.uint8(4):
        first -= 1
    while last < min(n2 - 1, middle + reach) and not cut[last] & np.uint8(4):
        last += 1
    if wanted < row[first]:
        return first - (row[first] - wanted) if wanted >= row[first] - np.float32(0.5) and first > 0 else np.nan
    for k in range(first, last):
        if row[k] <= wanted < row[k + 1]:
            return k + (wanted - row[k]) / (row[k + 1] - row[k])
    return last + (wanted - row[last]) if wanted <= row[last] + np.float32(0.5) and last < n2 - 1 else np.nan


@njit(cache=True, nogil=True)
def grow_layer(times, cuts, corner, wanted, reach, old, new):  # type: ignore[no-untyped-def]
    """Carry a layer on to wanted traces next to those that have it, no fault between; return to how many.

    `old` and `new` are its (depth, level, ahead, parts), of shape (inline, crossline), before and after; of what is not
    in the volumes, the first trace of which is the corner, nothing is written.
    """
    depth, level, ahead, parts = old
    n0, n1 = depth.shape
    count = 0
    for row in range(len(times)):
        for column in range(times.shape[1]):
            i, j = row + corner[0], column + corner[1]
            if not wanted[i, j]:
                continue
            least, best, source = np.float64(reach), np.nan, (-1, -1)
            for axis in range(2):
                bit = np.uint8(1 << axis)
                for side in (-1, 1):
                    x, y = (i + side, j) if axis == 0 else (i, j + side)
                    if x < 0 or y < 0 or x >= n0 or y >= n1 or not np.isfinite(depth[x, y]):
                        continue
                    z = depth[x, y]
                    if (ahead[x, y] if side < 0 else _ahead(cuts[row, column], z)) & bit:
                        continue
                    found = _level_near(times[row, column], cuts[row, column], z, level[x, y], reach)
                    if np.isfinite(found) and abs(found - z) < least:
                        least, best, source = abs(found - z), found, (x, y)
            if np.isfinite(best):
                new[0][i, j], new[1][i, j], new[3][i, j] = best, level[source], parts[source]
                new[2][i, j] = _ahead(cuts[row, column], best)
                count += 1
    return count
