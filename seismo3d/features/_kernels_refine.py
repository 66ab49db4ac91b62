"""Compiled loops of the refinement and of the check by neighbours. Arrays in, arrays out, no checks."""

from __future__ import annotations

import numba
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int64Array


@numba.njit(cache=True, nogil=True)
def _sample(values: Float32Array, start: int, rows: int, columns: int, x: float, y: float) -> float:
    column, row = int(x), int(y)
    column = min(max(column, 0), columns - 2)
    row = min(max(row, 0), rows - 2)
    fx, fy = np.float32(x - column), np.float32(y - row)
    at = start + row * columns + column
    top = values[at] + fx * (values[at + 1] - values[at])
    bottom = values[at + columns] + fx * (values[at + columns + 1] - values[at + columns])
    return top + fy * (bottom - top)


@numba.njit(cache=True, nogil=True)
def _inside(columns: int, rows: int, cx: float, cy: float, wide: float, high: float) -> bool:
    return cx - wide >= 0.0 and cy - high >= 0.0 and cx + wide <= columns - 1.0 and cy + high <= rows - 1.0


@numba.njit(cache=True, nogil=True)
def _template(
    values: Float32Array,
    start: int,
    rows: int,
    columns: int,
    cx: float,
    cy: float,
    grid: Float32Array,
    weight: Float32Array,
    patch: Float32Array,
    slopes: Float32Array,
) -> float:
    """Sample a patch to zero mean and unit deviation, and its slopes by the affine parameters; its deviation."""
    n = grid.shape[0]
    total, square = 0.0, 0.0
    for i in range(n):
        value = _sample(values, start, rows, columns, cx + grid[i, 0], cy + grid[i, 1])
        patch[i] = value
        total += weight[i] * value
        square += weight[i] * value * value
    deviation = np.sqrt(max(square - total * total, 0.0))
    if deviation < 1e-3:
        return 0.0
    for i in range(n):
        u, v = grid[i, 0], grid[i, 1]
        gx = 0.5 * (
            _sample(values, start, rows, columns, cx + u + 1.0, cy + v)
            - _sample(values, start, rows, columns, cx + u - 1.0, cy + v)
        )
        gy = 0.5 * (
            _sample(values, start, rows, columns, cx + u, cy + v + 1.0)
            - _sample(values, start, rows, columns, cx + u, cy + v - 1.0)
        )
        patch[i] = (patch[i] - total) / deviation
        gx, gy = gx / deviation, gy / deviation
        slopes[0, i], slopes[1, i] = gx, gy
        slopes[2, i], slopes[3, i], slopes[4, i], slopes[5, i] = gx * u, gx * v, gy * u, gy * v
    return deviation


@numba.njit(cache=True, nogil=True)
def _cholesky_solve(H: Float64Array, b: Float64Array) -> None:
    """Solve H x = b in place, for a small symmetric positive definite H."""
    n = b.size
    for j in range(n):
        for k in range(j):
            H[j, j] -= H[j, k] * H[j, k]
        H[j, j] = np.sqrt(max(H[j, j], 1e-12))
        for i in range(j + 1, n):
            for k in range(j):
                H[i, j] -= H[i, k] * H[j, k]
            H[i, j] /= H[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= H[i, k] * b[k]
        b[i] /= H[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= H[k, i] * b[k]
        b[i] /= H[i, i]


@numba.njit(cache=True, nogil=True)
def refine_affine(
    values_t: Float32Array,
    layout_t: Int64Array,
    level_t: AnyArray,
    centre_t: Float64Array,
    values_s: Float32Array,
    layout_s: Int64Array,
    level_s: AnyArray,
    centre_s: Float64Array,
    linear: Float64Array,
    grid: Float32Array,
    weight: Float32Array,
    n_iterations: int,
    reach: float,
) -> Float64Array:
    """Move each source patch until it looks like the target's; correlation (n,), -1 where lost.

    ``centre_s`` and ``linear`` (from target to source pixels, at the levels) are changed in place.
    """
    n, m = centre_t.shape[0], grid.shape[0]
    correlation = np.full(n, -1.0)
    patch, moved = np.empty(m, np.float32), np.empty(m, np.float32)
    slopes = np.empty((6, m), np.float32)
    normal, factor, step = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    radius = grid.max()
    for p in range(n):
        st, rt, ct = layout_t[level_t[p], 0], layout_t[level_t[p], 1], layout_t[level_t[p], 2]
        ss, rs, cs = layout_s[level_s[p], 0], layout_s[level_s[p], 1], layout_s[level_s[p], 2]
        tx, ty = centre_t[p, 0], centre_t[p, 1]
        if not _inside(ct, rt, tx, ty, 0.5 * radius, 0.5 * radius):
            continue
        if _template(values_t, st, rt, ct, tx, ty, grid, weight, patch, slopes) == 0.0:
            continue
        for a in range(6):
            for b in range(a + 1):
                total = np.float32(0.0)
                for i in range(m):
                    total += weight[i] * slopes[a, i] * slopes[b, i]
                normal[a, b] = normal[b, a] = total
        for a in range(6):
            normal[a, a] *= 1.001
        x, y = centre_s[p, 0], centre_s[p, 1]
        m00, m01, m10, m11 = linear[p, 0, 0], linear[p, 0, 1], linear[p, 1, 0], linear[p, 1, 1]
        start_x, start_y, value = x, y, -1.0
        for k in range(n_iterations + 1):
            wide, high = 0.5 * radius * (abs(m00) + abs(m01)), 0.5 * radius * (abs(m10) + abs(m11))
            if not _inside(cs, rs, x, y, wide, high) or (x - start_x) ** 2 + (y - start_y) ** 2 > reach * reach:
                value = -1.0
                break
            total, square = np.float32(0.0), np.float32(0.0)
            for i in range(m):
                u, v = grid[i, 0], grid[i, 1]
                moved[i] = _sample(values_s, ss, rs, cs, x + m00 * u + m01 * v, y + m10 * u + m11 * v)
                total += weight[i] * moved[i]
            for i in range(m):
                moved[i] -= total
                square += weight[i] * moved[i] * moved[i]
            if square < 1e-6:
                value = -1.0
                break
            inverse = np.float32(1.0) / np.sqrt(square)
            dot = np.float32(0.0)
            for i in range(m):
                moved[i] = moved[i] * inverse
                dot += weight[i] * moved[i] * patch[i]
                moved[i] -= patch[i]
            value = float(dot)
            if k == n_iterations:
                break
            for a in range(6):
                total = np.float32(0.0)
                for i in range(m):
                    total += weight[i] * slopes[a, i] * moved[i]
                step[a] = total
            factor[:] = normal
            _cholesky_solve(factor, step)
            # Compose with the inverse of the step I + D, d: M <- M (I + D)^-1, c <- c - M (I + D)^-1 d.
            d00, d01, d10, d11 = 1.0 + step[2], step[3], step[4], 1.0 + step[5]
            det = d00 * d11 - d01 * d10
            if det < 0.25 or det > 4.0:
                value = -1.0
                break
            n00, n01 = (m00 * d11 - m01 * d10) / det, (m01 * d00 - m00 * d01) / det
            n10, n11 = (m10 * d11 - m11 * d10) / det, (m11 * d00 - m10 * d01) / det
            m00, m01, m10, m11 = n00, n01, n10, n11
            x -= m00 * step[0] + m01 * step[1]
            y -= m10 * step[0] + m11 * step[1]
            if (
                step[0] ** 2 + step[1] ** 2 < 1e-5
                and (step[2] ** 2 + step[3] ** 2 + step[4] ** 2 + step[5] ** 2) < 1e-5
                and k > 0
            ):
                break
        correlation[p] = value
        centre_s[p, 0], centre_s[p, 1] = x, y
        linear[p, 0, 0], linear[p, 0, 1], linear[p, 1, 0], linear[p, 1, 1] = m00, m01, m10, m11
    return correlation


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
                _cholesky_solve(factor, solved[s])
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
