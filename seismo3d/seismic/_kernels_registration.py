"""Registration of neighbouring traces: whole-sample search, one-sided means, and the misfit that they leave."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d._multiply_add import multiply_add
from seismo3d.seismic._kernels_misfit import add_carried, compare_sides
from seismo3d.seismic._kernels_shifts import add_windows, refine


@njit(cache=True, nogil=True)
def compare_samples(a, b, in_a, in_b, difference, energy):  # type: ignore[no-untyped-def]
    """Write (a - b)^2 and a^2 + b^2, 0 where either is not there."""
    zero = np.float32(0.0)
    for k in range(len(a)):
        there = in_a[k] & in_b[k]
        apart = a[k] - b[k]
        difference[k] = apart * apart if there else zero
        energy[k] = a[k] * a[k] + b[k] * b[k] if there else zero


@njit(cache=True, nogil=True, parallel=True)
def search_costs(volume, valid, axis, farthest, step, taps, floor, costs):  # type: ignore[no-untyped-def]
    """Write the windowed (a - b)^2 over a^2 + b^2 of every trace a and the next one, b, moved by whole samples.

    `costs` has the shape (2 farthest + 1, inline, crossline, coarse sample): a reflector at a sample lies from
    `farthest` samples higher to `farthest` deeper on the next trace. The cost is 1 where no data meet, and 0 on the
    last trace, which has none next to it.
    """
    n0, n1, n2 = volume.shape
    di, dj = (1, 0) if axis == 0 else (0, 1)
    half = len(taps) // 2
    m = costs.shape[3]
    for line in prange(n0):
        i = np.int64(line)
        phases = np.empty((step, m + 2 * half // step + 2), np.float32)
        difference, energy = np.zeros(phases.size, np.float32), np.zeros(phases.size, np.float32)
        left, whole = np.empty(m, np.float32), np.empty(m, np.float32)
        for j in range(n1):
            if i + di >= n0 or j + dj >= n1:
                costs[:, i, j] = 0.0
                continue
            a, b = volume[i, j], volume[i + di, j + dj]
            in_a, in_b = valid[i, j], valid[i + di, j + dj]
            for s in range(-farthest, farthest + 1):
                difference[:] = 0.0
                energy[:] = 0.0
                low, high = max(0, -s), min(n2, n2 - s)
                compare_samples(
                    a[low:high], b[low + s : high + s], in_a[low:high], in_b[low + s : high + s],
                    difference[half + low : half + high], energy[half + low : half + high],
                )  # fmt: skip
                left[:] = floor
                whole[:] = floor
                add_windows(difference, taps, step, phases, left)
                add_windows(energy, taps, step, phases, whole)
                for n in range(m):
                    costs[s + farthest, i, j, n] = left[n] / whole[n]


@njit(cache=True, nogil=True, parallel=True)
def pick_cheapest(costs, shift):  # type: ignore[no-untyped-def]
    """Write the shift of least cost, the smallest of several, refined between samples by a parabola."""
    n_shifts, n0, n1, m = costs.shape
    middle = n_shifts // 2
    for i in prange(n0):
        for j in range(n1):
            for k in range(m):
                best = middle
                for away in range(1, middle + 1):
                    for s in (middle - away, middle + away):
                        if costs[s, i, j, k] < costs[best, i, j, k]:
                            best = s
                value = np.float32(best - middle)
                if 0 < best < n_shifts - 1:
                    low, high = costs[best - 1, i, j, k], costs[best + 1, i, j, k]
                    bend = low - np.float32(2.0) * costs[best, i, j, k] + high
                    if bend > np.float32(1e-6):
                        value += np.float32(0.5) * (low - high) / bend
                shift[i, j, k] = value


@njit(cache=True, nogil=True, parallel=True)
def one_sided_means(product, weight, shares, behind, ahead):  # type: ignore[no-untyped-def]
    """Write means of product / weight down the first axis, from what lies behind and from what lies ahead.

    `shares` says how much the nearest value counts, the one beyond it, and so on to the farthest. Entry i is taken to
    lie between i and i + 1: it counts ahead of i and behind i + 1. Where one side has none the other serves, and 0
    where neither has.
    """
    n0, n1, m = product.shape
    tiny = np.float32(1e-9)
    for j in prange(n1):
        total = np.empty(m, np.float32)
        weights = np.empty(m, np.float32)
        for i in range(n0):
            for side in range(2):
                total[:] = 0.0
                weights[:] = 0.0
                for away in range(len(shares)):
                    at = i + away if side == 1 else i - 1 - away
                    if at < 0 or at >= n0:
                        break
                    share = shares[away]
                    for k in range(m):
                        total[k] = multiply_add(share, product[at, j, k], total[k])
                        weights[k] = multiply_add(share, weight[at, j, k], weights[k])
                out = behind[i, j] if side == 0 else ahead[i, j]
                for k in range(m):
                    out[k] = total[k] / weights[k] if weights[k] > tiny else np.float32(np.nan)
            for k in range(m):
                if np.isnan(behind[i, j, k]):
                    behind[i, j, k] = np.float32(0.0) if np.isnan(ahead[i, j, k]) else ahead[i, j, k]
                if np.isnan(ahead[i, j, k]):
                    ahead[i, j, k] = behind[i, j, k]


@njit(cache=True, nogil=True, parallel=True)
def registered_misfit(volume, valid, behind, ahead, axis, reach, step, corner, difference, energy):  # type: ignore[no-untyped-def]
    """Write (L - R)^2 and L^2 + R^2, each side carried by the shifts that were found on that side alone.

    L and R are means of up to `reach` traces. `behind` and `ahead` are shifts a trace at every step-th sample: those of
    the traces before a trace carry it when it lies on the left, those after it when it lies on the right. The energy is
    -1 where a side is empty. The first trace of what is written is the volume's at the corner.
    """
    n0, n1, n2 = volume.shape
    di, dj = (1, 0) if axis == 0 else (0, 1)
    for line in prange(len(difference)):
        row = np.int64(line)
        i = row + corner[0]
        slope = np.empty(n2, np.float32)
        padded = np.empty(n2 + 3, np.float32)
        side = np.empty((2, n2), np.float32)
        count = np.empty((2, n2), np.float32)
        for column in range(difference.shape[1]):
            j = column + corner[1]
            side[:] = 0.0
            count[:] = 0.0
            for t in range(1, reach + 1):
                for which in range(2):
                    signed = t if which == 1 else -t
                    x, y = i + signed * di, j + signed * dj
                    if 0 <= x < n0 and 0 <= y < n1:
                        refine(ahead[x, y] if which == 1 else behind[x, y], step, slope)
                        add_carried(volume[x, y], valid[x, y], slope, signed, padded, side[which], count[which])
            compare_sides(side, count, difference[row, column], energy[row, column])
