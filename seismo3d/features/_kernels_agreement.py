"""Compiled loops of the check of matches by their neighbours. Arrays in, arrays out, no checks."""

from __future__ import annotations

import numba
import numpy as np

from seismo3d._typing import Float64Array, Int64Array
from seismo3d.features._kernels_refine import cholesky_solve


@numba.njit(cache=True, nogil=True)
def count_agreeing(
    target: Float64Array,
    source: Float64Array,
    linear: Float64Array,
    neighbours: Int64Array,
    slack: float,
    growth: float,
) -> Int64Array:
    """Count neighbours of each match that lie where its affine map says, and it where theirs says."""
    n = target.shape[0]
    count = np.zeros(n, np.int64)
    for i in range(n):
        for j in neighbours[i]:
            if j < 0:
                continue
            dx, dy = target[j, 0] - target[i, 0], target[j, 1] - target[i, 1]
            ex, ey = source[j, 0] - source[i, 0], source[j, 1] - source[i, 1]
            if dx * dx + dy * dy < 1.0:
                continue  # the same place on another level is no second witness
            limit = (slack + growth * np.sqrt(dx * dx + dy * dy)) ** 2
            ax = linear[i, 0, 0] * dx + linear[i, 0, 1] * dy - ex
            ay = linear[i, 1, 0] * dx + linear[i, 1, 1] * dy - ey
            bx = linear[j, 0, 0] * dx + linear[j, 0, 1] * dy - ex
            by = linear[j, 1, 0] * dx + linear[j, 1, 1] * dy - ey
            scale = abs(linear[i, 0, 0] * linear[i, 1, 1] - linear[i, 0, 1] * linear[i, 1, 0])
            if ax * ax + ay * ay <= limit * scale and bx * bx + by * by <= limit * scale:
                count[i] += 1
    return count


@numba.njit(cache=True, nogil=True)
def local_misfit(target: Float64Array, source: Float64Array, neighbours: Int64Array) -> Float64Array:
    """Distance from an affine fit to the neighbours, reweighted three times (Cauchy, scale from the mean distance)."""
    n, k = neighbours.shape
    misfit = np.zeros(n)
    weight, distance = np.empty(k), np.empty(k)
    for i in range(n):
        used = 0
        for c in range(k):
            weight[c] = 1.0 if neighbours[i, c] >= 0 else 0.0
            used += neighbours[i, c] >= 0
        if used < 6:
            continue
        for _ in range(4):
            normal = np.zeros((3, 3))
            right = np.zeros((2, 3))
            for c in range(k):
                j = neighbours[i, c]
                if j < 0:
                    continue
                u, v = target[j, 0] - target[i, 0], target[j, 1] - target[i, 1]
                row = (1.0, u, v)
                for a in range(3):
                    for b in range(3):
                        normal[a, b] += weight[c] * row[a] * row[b]
                    for s in range(2):
                        right[s, a] += weight[c] * row[a] * (source[j, s] - source[i, s])
            for a in range(3):
                normal[a, a] += 1e-6 * (1.0 if a == 0 else normal[0, 0])
            solved = np.empty((2, 3))
            for s in range(2):
                factor = normal.copy()
                solved[s] = right[s]
                cholesky_solve(factor, solved[s])
            for c in range(k):
                j = neighbours[i, c]
                if j < 0:
                    continue
                u, v = target[j, 0] - target[i, 0], target[j, 1] - target[i, 1]
                ex = solved[0, 0] + solved[0, 1] * u + solved[0, 2] * v - (source[j, 0] - source[i, 0])
                ey = solved[1, 0] + solved[1, 1] * u + solved[1, 2] * v - (source[j, 1] - source[i, 1])
                distance[c] = np.sqrt(ex * ex + ey * ey)
            scale = 0.0
            for c in range(k):
                if neighbours[i, c] >= 0:
                    scale += min(distance[c], 3.0) / used
            scale = max(scale, 0.1)
            for c in range(k):
                if neighbours[i, c] >= 0:
                    weight[c] = 1.0 / (1.0 + (distance[c] / scale) ** 2)
            misfit[i] = np.sqrt(solved[0, 0] ** 2 + solved[1, 0] ** 2)
    return misfit
