"""Both sides of a fault read along its surface, and the shift that matches them, smooth over the surface."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, inline="always")
def _read(volume, valid, x, y, z):  # type: ignore[no-untyped-def]
    """Trilinear amplitude at a fractional position; weight 0 where any of its samples is missing."""
    n0, n1, n2 = volume.shape
    if x < 0.0 or y < 0.0 or z < 0.0 or x > n0 - 1 or y > n1 - 1 or z > n2 - 1:
        return np.float32(0.0), np.float32(0.0)
    i, j, k = min(int(x), max(n0 - 2, 0)), min(int(y), max(n1 - 2, 0)), min(int(z), max(n2 - 2, 0))
    fx, fy, fz = np.float32(x - i), np.float32(y - j), np.float32(z - k)
    value = np.float32(0.0)
    for a in range(2):
        for b in range(2):
            weight = (fx if a == 1 else np.float32(1.0) - fx) * (fy if b == 1 else np.float32(1.0) - fy)
            if weight <= np.float32(1e-4):
                continue
            for c in range(2):
                w = weight * (fz if c == 1 else np.float32(1.0) - fz)
                if w <= np.float32(1e-4):
                    continue
                if not valid[i + a, j + b, k + c]:
                    return np.float32(0.0), np.float32(0.0)
                value += w * volume[i + a, j + b, k + c]
    return value, np.float32(1.0)


@njit(cache=True, nogil=True, parallel=True)
def read_sides(  # type: ignore[no-untyped-def]
    volume, valid, p, q, w, origin, along, across, first_s, first_sample, near, far, clear, corner, sides, known, tilts
):
    """Write both sides of a sheet, one value a sample: the mean of traces `near` to `far` off, along their dips.

    `w` holds the sheet's position at every (row, sample); sides[0] lies against `across`, sides[1] along it.
    The volumes' first inline and crossline are the corner's. `tilts` are the mean dips across that were followed.
    """
    n_rows, n_samples = w.shape
    n0, n1, n2 = volume.shape
    for line in prange(n_rows):
        r = np.int64(line)
        s = first_s + r
        for k in range(n_samples):
            for side in range(2):
                sides[side, r, k] = 0.0
                known[side, r, k] = 0.0
                tilts[side, r, k] = 0.0
            if not np.isfinite(w[r, k]):
                continue
            for side in range(2):
                total, tilt, count = np.float32(0.0), np.float32(0.0), np.float32(0.0)
                for distance in range(near, far + 1):
                    d = float(distance) if side == 1 else -float(distance)
                    x = origin[0] + s * along[0] + (w[r, k] + d) * across[0] - corner[0]
                    y = origin[1] + s * along[1] + (w[r, k] + d) * across[1] - corner[1]
                    z = float(first_sample + k)
                    if x < 0.0 or y < 0.0 or x > n0 - 1 or y > n1 - 1:
                        continue
                    # slopes right beside the fault are the least sure: they are read farther off
                    away = float(clear) if side == 1 else -float(clear)
                    i = min(max(int(np.rint(x + away * across[0])), 0), n0 - 1)
                    j = min(max(int(np.rint(y + away * across[1])), 0), n1 - 1)
                    kk = min(first_sample + k, n2 - 1)
                    slope = p[i, j, kk] * across[0] + q[i, j, kk] * across[1]
                    value, weight = _read(volume, valid, x, y, z + d * slope)
                    total += value
                    tilt += weight * np.float32(slope)
                    count += weight
                if count > 0:
                    sides[side, r, k] = total / count
                    known[side, r, k] = 1.0
                    tilts[side, r, k] = tilt / count


@njit(cache=True, nogil=True)
def mark_beside(w, origin, along, across, first_s, first_sample, beside, corner, clear):  # type: ignore[no-untyped-def]
    """Clear what lies within `beside` traces of a sheet at `w`, in a block whose first trace is the corner."""
    n0, n1, n2 = clear.shape
    for r in range(w.shape[0]):
        for k in range(w.shape[1]):
            if not np.isfinite(w[r, k]) or first_sample + k >= n2:
                continue
            for d in range(-beside, beside + 1):
                x = origin[0] + (first_s + r) * along[0] + (w[r, k] + d) * across[0]
                y = origin[1] + (first_s + r) * along[1] + (w[r, k] + d) * across[1]
                i, j = int(np.rint(x)) - corner[0], int(np.rint(y)) - corner[1]
                if 0 <= i < n0 and 0 <= j < n1:
                    clear[i, j, first_sample + k] = False


@njit(cache=True, nogil=True)
def _pass(cost, previous, current, r, k, step, jump):  # type: ignore[no-untyped-def]
    """One step of the path cost: the node's own, and the cheapest way from the previous node's shifts."""
    n = cost.shape[2]
    least = previous[0]
    for c in range(1, n):
        least = min(least, previous[c])
    for c in range(n):
        way = min(previous[c], least + jump)
        if c > 0:
            way = min(way, previous[c - 1] + step)
        if c < n - 1:
            way = min(way, previous[c + 1] + step)
        current[c] = cost[r, k, c] + way - least


@njit(cache=True, nogil=True, parallel=True)
def sum_paths(cost, step, jump, total):  # type: ignore[no-untyped-def]
    """Add up, at every node, the cheapest paths that reach it from the four directions of the grid."""
    n_rows, n_samples, n = cost.shape
    for r in prange(n_rows):
        previous, current = np.zeros(n, np.float32), np.zeros(n, np.float32)
        for k in range(n_samples):
            _pass(cost, previous, current, r, k, step, jump)
            previous[:] = current
            total[r, k] += current
        previous[:] = 0.0
        for k in range(n_samples - 1, -1, -1):
            _pass(cost, previous, current, r, k, step, jump)
            previous[:] = current
            total[r, k] += current
    for k in prange(n_samples):
        previous, current = np.zeros(n, np.float32), np.zeros(n, np.float32)
        for r in range(n_rows):
            _pass(cost, previous, current, r, k, step, jump)
            previous[:] = current
            total[r, k] += current
        previous[:] = 0.0
        for r in range(n_rows - 1, -1, -1):
            _pass(cost, previous, current, r, k, step, jump)
            previous[:] = current
            total[r, k] += current


@njit(cache=True, nogil=True, parallel=True)
def pick_shifts(total, cost, first, shift, fit):  # type: ignore[no-untyped-def]
    """Write the shift, from `first` on, of the cheapest path, refined by a parabola, and 1 - its own misfit ratio."""
    n_rows, n_samples, n = total.shape
    for r in prange(n_rows):
        for k in range(n_samples):
            best = 0
            for c in range(1, n):
                if total[r, k, c] < total[r, k, best]:
                    best = c
            refined = np.float32(best)
            if 0 < best < n - 1:
                before, here, after = total[r, k, best - 1], total[r, k, best], total[r, k, best + 1]
                bend = before - 2 * here + after
                if bend > 0:
                    refined += np.float32(0.5) * (before - after) / bend
            shift[r, k] = refined + first
            fit[r, k] = np.float32(1.0) - cost[r, k, best]


@njit(cache=True, nogil=True, parallel=True)
def bar_far_shifts(cost, first, usual, band, out):  # type: ignore[no-untyped-def]
    """Write the cost of shifts from `first` on, raised where one lies farther than `band` from the usual one."""
    n_rows, n_samples, n = cost.shape
    for r in prange(n_rows):
        for k in range(n_samples):
            for c in range(n):
                far = abs(c + first - usual[r, k]) - band
                out[r, k, c] = cost[r, k, c] + np.float32(0.1) * max(far, np.float32(0.0))
