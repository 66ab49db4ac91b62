"""Slopes of a map with holes, and the sums of one step of alignment."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

N_PARAMETERS = 8
"""Shift along columns and rows, turn, growth, vertical offset, tilt along columns and rows, vertical scale."""
N_SUMS = N_PARAMETERS * N_PARAMETERS + N_PARAMETERS + 2


@njit(cache=True, nogil=True, parallel=True)
def slopes_with_holes(z, gu, gv):  # type: ignore[no-untyped-def]
    """Write the slope of the plane through the neighbours of each cell, the cell itself left out.

    So the noise of a cell is not in its own slope. NaN where fewer than four neighbours are known or they lie in line.
    """
    rows, columns = z.shape
    for line in prange(rows):
        i = np.int64(line)
        for j in range(columns):
            gu[i, j] = np.nan
            gv[i, j] = np.nan
            n = 0
            s = su = sv = suu = svv = suv = sz = suz = svz = 0.0
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    a, b = i + di, j + dj
                    if (di == 0 and dj == 0) or a < 0 or b < 0 or a >= rows or b >= columns:
                        continue
                    value = np.float64(z[a, b])
                    if math.isnan(value):
                        continue
                    w = 1.0 if di == 0 or dj == 0 else 0.5
                    n += 1
                    s += w
                    su += w * dj
                    sv += w * di
                    suu += w * dj * dj
                    svv += w * di * di
                    suv += w * di * dj
                    sz += w * value
                    suz += w * dj * value
                    svz += w * di * value
            if n < 4:
                continue
            cuu = suu - su * su / s
            cvv = svv - sv * sv / s
            cuv = suv - su * sv / s
            det = cuu * cvv - cuv * cuv
            if det < 0.3:
                continue
            bu = suz - su * sz / s
            bv = svz - sv * sz / s
            gu[i, j] = (cvv * bu - cuv * bv) / det
            gv[i, j] = (cuu * bv - cuv * bu) / det


@njit(cache=True, nogil=True)
def bilinear(z, u, v):  # type: ignore[no-untyped-def]
    """Value at (column, row), NaN outside or beside a hole; corners of no weight need not be known."""
    rows, columns = z.shape
    if not (u >= 0.0 and v >= 0.0 and u <= columns - 1 and v <= rows - 1):
        return np.nan
    j = min(int(u), columns - 2)
    i = min(int(v), rows - 2)
    fu = u - j
    fv = v - i
    total = 0.0
    for di in range(2):
        wi = fv if di == 1 else 1.0 - fv
        for dj in range(2):
            w = wi * (fu if dj == 1 else 1.0 - fu)
            if w > 1e-9:
                total += w * z[i + di, j + dj]
    return total


@njit(cache=True, nogil=True, parallel=True)
def resample(z, M, out):  # type: ignore[no-untyped-def]
    """Write values at M (2 x 3) applied to each place (column, row) of `out`."""
    rows, columns = out.shape
    for line in prange(rows):
        i = np.int64(line)
        for j in range(columns):
            u = M[0, 0] * j + M[0, 1] * i + M[0, 2]
            v = M[1, 0] * j + M[1, 1] * i + M[1, 2]
            out[i, j] = bilinear(z, u, v)


@njit(cache=True, nogil=True)
def _derivatives(slope_x, slope_y, U, V, other, half, x):  # type: ignore[no-untyped-def]
    """Write what the moved source gains at a place with a step of each parameter."""
    x[0] = -slope_x
    x[1] = -slope_y
    x[2] = half * (slope_x * V - slope_y * U)
    x[3] = -half * (slope_x * U + slope_y * V)
    x[4] = 1.0
    x[5] = U
    x[6] = V
    x[7] = other


@njit(cache=True, nogil=True, parallel=True)
def alignment_sums(target, gx, gy, source, M, vertical, centre, E, half, cutoff, residuals, sums):  # type: ignore[no-untyped-def]
    """Write residuals, and for every row of the target the sums of one Gauss-Newton step.

    The residual is ``target - (k source(M place) + c0 + c1 U + c2 V)`` with U, V = E (place - centre); `half` is the
    length for which U and V stand for 1, gx and gy are slopes along them. `vertical` holds (c0, c1, c2, k). Tukey's
    weights reach zero at `cutoff`. A row of `sums`: the matrix, the vector, the sum of weights and the number of cells.
    """
    rows, columns = target.shape
    for line in prange(rows):
        i = np.int64(line)
        x = np.empty(N_PARAMETERS)
        for m in range(N_SUMS):
            sums[i, m] = 0.0
        for j in range(columns):
            residuals[i, j] = np.nan
            slope_x = np.float64(gx[i, j])
            slope_y = np.float64(gy[i, j])
            height = np.float64(target[i, j])
            if math.isnan(slope_x) or math.isnan(height):
                continue
            u = M[0, 0] * j + M[0, 1] * i + M[0, 2]
            v = M[1, 0] * j + M[1, 1] * i + M[1, 2]
            other = bilinear(source, u, v)
            if math.isnan(other):
                continue
            U = E[0, 0] * (j - centre[0]) + E[0, 1] * (i - centre[1])
            V = E[1, 0] * (j - centre[0]) + E[1, 1] * (i - centre[1])
            r = height - (vertical[3] * other + vertical[0] + vertical[1] * U + vertical[2] * V)
            residuals[i, j] = r
            ratio = r / cutoff
            if abs(ratio) >= 1.0:
                continue
            w = (1.0 - ratio * ratio) ** 2
            _derivatives(slope_x, slope_y, U, V, other, half, x)
            for a in range(N_PARAMETERS):
                wa = w * x[a]
                for b in range(a, N_PARAMETERS):
                    sums[i, a * N_PARAMETERS + b] += wa * x[b]
                sums[i, N_PARAMETERS * N_PARAMETERS + a] += wa * r
            sums[i, N_SUMS - 2] += w
            sums[i, N_SUMS - 1] += 1.0


@njit(cache=True, nogil=True)
def patch_scores(slopes, source_slopes, source_values, residuals, centre, E, half, cutoff, patch, scores, change):  # type: ignore[no-untyped-def]
    """Add up scores over square patches of `patch` cells, and what they all change by with a step.

    A score is a weighted residual times derivatives by `slopes` (x, y) of the target; `scores` is (patches,
    parameters). Row a of `change` tells how the sum of score a falls with a step of each parameter, by
    `source_slopes`, for the source is what moves; noise is in the slopes of both maps, but not the same.
    """
    rows, columns = residuals.shape
    across = (columns + patch - 1) // patch
    x, y = np.empty(N_PARAMETERS), np.empty(N_PARAMETERS)
    for i in range(rows):
        for j in range(columns):
            r = np.float64(residuals[i, j])
            if math.isnan(r) or abs(r) >= cutoff or math.isnan(source_slopes[0, i, j]):
                continue
            square = (r / cutoff) ** 2
            U = E[0, 0] * (j - centre[0]) + E[0, 1] * (i - centre[1])
            V = E[1, 0] * (j - centre[0]) + E[1, 1] * (i - centre[1])
            other = source_values[i, j]
            _derivatives(slopes[0, i, j], slopes[1, i, j], U, V, other, half, x)
            _derivatives(source_slopes[0, i, j], source_slopes[1, i, j], U, V, other, half, y)
            score, by_residual = (1.0 - square) ** 2 * r, (1.0 - square) * (1.0 - 5.0 * square)
            row = scores[(i // patch) * across + j // patch]
            for a in range(N_PARAMETERS):
                row[a] += score * x[a]
                for b in range(N_PARAMETERS):
                    change[a, b] += by_residual * x[a] * y[b]


@njit(cache=True, nogil=True, parallel=True)
def block_means(z, factor, least, out):  # type: ignore[no-untyped-def]
    """Write means of the known cells of blocks; NaN where fewer than `least` are known."""
    rows, columns = out.shape
    for line in prange(rows):
        i = np.int64(line)
        for j in range(columns):
            total = 0.0
            n = 0
            for a in range(i * factor, (i + 1) * factor):
                for b in range(j * factor, (j + 1) * factor):
                    value = np.float64(z[a, b])
                    if not math.isnan(value):
                        total += value
                        n += 1
            out[i, j] = total / n if n >= least else np.nan
