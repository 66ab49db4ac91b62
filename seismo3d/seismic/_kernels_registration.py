"""Registration of neighbouring traces: whole-sample search, one-sided means, and the misfit that they leave."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d.seismic._kernels_misfit import _sample


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
    for line in prange(n0):
        i = np.int64(line)
        difference = np.zeros(n2 + 2 * half, np.float32)
        energy = np.zeros(n2 + 2 * half, np.float32)
        for j in range(n1):
            if i + di >= n0 or j + dj >= n1:
                costs[:, i, j] = 0.0
                continue
            a, b = volume[i, j], volume[i + di, j + dj]
            in_a, in_b = valid[i, j], valid[i + di, j + dj]
            for s in range(-farthest, farthest + 1):
                difference[:] = 0.0
                energy[:] = 0.0
                for k in range(max(0, -s), min(n2, n2 - s)):
                    if in_a[k] and in_b[k + s]:
                        d = a[k] - b[k + s]
                        difference[k + half] = d * d
                        energy[k + half] = a[k] * a[k] + b[k + s] * b[k + s]
                for n in range(costs.shape[3]):
                    left, whole = floor, floor
                    for t in range(2 * half + 1):
                        left += taps[t] * difference[n * step + t]
                        whole += taps[t] * energy[n * step + t]
                    costs[s + farthest, i, j, n] = left / whole


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
def one_sided_means(product, weight, keep, behind, ahead):  # type: ignore[no-untyped-def]
    """Write running means of product / weight down the first axis, from what lies behind and from what lies ahead.

    A value's share falls by `keep` with each step away. Entry i is taken to lie between i and i + 1: it counts ahead of
    i and behind i + 1. Where one side has none the other serves, and 0 where neither has.
    """
    n0, n1, m = product.shape
    tiny = np.float32(1e-9)
    for j in prange(n1):
        for sweep in range(2):
            total = np.zeros(m, np.float32)
            weights = np.zeros(m, np.float32)
            for step in range(n0):
                i = step if sweep == 0 else n0 - 1 - step
                for k in range(m):
                    if sweep == 0:
                        behind[i, j, k] = total[k] / weights[k] if weights[k] > tiny else np.float32(np.nan)
                    total[k] = keep * total[k] + product[i, j, k]
                    weights[k] = keep * weights[k] + weight[i, j, k]
                    if sweep == 1:
                        ahead[i, j, k] = total[k] / weights[k] if weights[k] > tiny else np.float32(np.nan)
        for i in range(n0):
            for k in range(m):
                if np.isnan(behind[i, j, k]):
                    behind[i, j, k] = np.float32(0.0) if np.isnan(ahead[i, j, k]) else ahead[i, j, k]
                if np.isnan(ahead[i, j, k]):
                    ahead[i, j, k] = behind[i, j, k]


@njit(cache=True, nogil=True)
def _refine(coarse, step, fine):  # type: ignore[no-untyped-def]
    """Interpolate values kept at every step-th sample; the last one goes on."""
    last = coarse.shape[0] - 1
    for k in range(fine.shape[0]):
        n = k // step
        if n >= last:
            fine[k] = coarse[last]
        else:
            share = np.float32(k - n * step) / np.float32(step)
            fine[k] = coarse[n] + share * (coarse[n + 1] - coarse[n])


@njit(cache=True, nogil=True, parallel=True)
def registered_misfit(volume, valid, behind, ahead, axis, reach, step, difference, energy):  # type: ignore[no-untyped-def]
    """Write (L - R)^2 and L^2 + R^2, each side carried by the shifts that were found on that side alone.

    L and R are means of up to `reach` traces. `behind` and `ahead` are shifts a trace at every step-th sample: those of
    the traces before a trace carry it when it lies on the left, those after it when it lies on the right. The energy is
    -1 where a side is empty.
    """
    n0, n1, n2 = volume.shape
    di, dj = (1, 0) if axis == 0 else (0, 1)
    for line in prange(n0):
        i = np.int64(line)
        slope = np.empty(n2, np.float32)
        side = np.empty((2, n2), np.float32)
        count = np.empty((2, n2), np.float32)
        for j in range(n1):
            side[:] = 0.0
            count[:] = 0.0
            for t in range(1, reach + 1):
                for which in range(2):
                    signed = t if which == 1 else -t
                    x, y = i + signed * di, j + signed * dj
                    if x < 0 or y < 0 or x >= n0 or y >= n1:
                        continue
                    _refine(ahead[x, y] if which == 1 else behind[x, y], step, slope)
                    for k in range(n2):
                        value, weight = _sample(volume[x, y], valid[x, y], k + signed * slope[k], n2)
                        side[which, k] += value
                        count[which, k] += weight
            for k in range(n2):
                if count[0, k] > 0 and count[1, k] > 0:
                    left, right = side[0, k] / count[0, k], side[1, k] / count[1, k]
                    difference[i, j, k] = (left - right) * (left - right)
                    energy[i, j, k] = left * left + right * right
                else:
                    difference[i, j, k] = 0.0
                    energy[i, j, k] = -1.0
