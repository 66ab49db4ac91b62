"""Compiled loops of the refinement. Arrays in, arrays out, no checks."""

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
def cholesky_solve(H: Float64Array, b: Float64Array) -> None:
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
def _normal_matrix(slopes: Float32Array, weight: Float32Array, normal: Float64Array) -> None:
    n = normal.shape[0]
    for a in range(n):
        for b in range(a + 1):
            total = np.float32(0.0)
            for i in range(weight.size):
                total += weight[i] * slopes[a, i] * slopes[b, i]
            normal[a, b] = normal[b, a] = total
    for a in range(n):
        normal[a, a] *= 1.001


@numba.njit(cache=True, nogil=True)
def _compare(
    values: Float32Array,
    layout: Int64Array,
    pose: Float64Array,
    grid: Float32Array,
    weight: Float32Array,
    patch: Float32Array,
    residual: Float32Array,
) -> float:
    """Sample the moved patch, write its difference from the template; their correlation, -1 where it is flat."""
    start, rows, columns = layout[0], layout[1], layout[2]
    total, square, dot = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for i in range(weight.size):
        u, v = grid[i, 0], grid[i, 1]
        x, y = pose[0] + pose[2] * u + pose[3] * v, pose[1] + pose[4] * u + pose[5] * v
        residual[i] = _sample(values, start, rows, columns, x, y)
        total += weight[i] * residual[i]
    for i in range(weight.size):
        residual[i] -= total
        square += weight[i] * residual[i] * residual[i]
    if square < 1e-6:
        return -1.0
    inverse = np.float32(1.0) / np.sqrt(square)
    for i in range(weight.size):
        residual[i] *= inverse
        dot += weight[i] * residual[i] * patch[i]
        residual[i] -= patch[i]
    return float(dot)


@numba.njit(cache=True, nogil=True)
def _compose(pose: Float64Array, step: Float64Array) -> bool:
    """Undo the step (d, I + D) before a pose (c, M): M <- M (I + D)^-1, c <- c - M d; False where that folds."""
    d00, d01, d10, d11 = 1.0 + step[2], step[3], step[4], 1.0 + step[5]
    det = d00 * d11 - d01 * d10
    if det < 0.25 or det > 4.0:
        return False
    m00, m01, m10, m11 = pose[2], pose[3], pose[4], pose[5]
    pose[2], pose[3] = (m00 * d11 - m01 * d10) / det, (m01 * d00 - m00 * d01) / det
    pose[4], pose[5] = (m10 * d11 - m11 * d10) / det, (m11 * d00 - m10 * d01) / det
    pose[0] -= pose[2] * step[0] + pose[3] * step[1]
    pose[1] -= pose[4] * step[0] + pose[5] * step[1]
    return True


@numba.njit(cache=True, nogil=True)
def _track(
    values: Float32Array,
    layout: Int64Array,
    pose: Float64Array,
    grid: Float32Array,
    weight: Float32Array,
    patch: Float32Array,
    slopes: Float32Array,
    n_free: int,
    n_iterations: int,
    reach: float,
) -> float:
    """Move a pose until the patch there looks like the template; correlation, -1 where lost."""
    normal, factor, step = np.empty((n_free, n_free)), np.empty((n_free, n_free)), np.zeros(6)
    residual = np.empty(weight.size, np.float32)
    _normal_matrix(slopes, weight, normal)
    half = 0.5 * grid.max()
    x, y = pose[0], pose[1]
    for k in range(n_iterations + 1):
        wide, high = half * (abs(pose[2]) + abs(pose[3])), half * (abs(pose[4]) + abs(pose[5]))
        if not _inside(layout[2], layout[1], pose[0], pose[1], wide, high):
            return -1.0
        if (pose[0] - x) ** 2 + (pose[1] - y) ** 2 > reach * reach:
            return -1.0
        correlation = _compare(values, layout, pose, grid, weight, patch, residual)
        if correlation < 0.0 or k == n_iterations:
            return correlation
        for a in range(n_free):
            total = np.float32(0.0)
            for i in range(weight.size):
                total += weight[i] * slopes[a, i] * residual[i]
            step[a] = total
        factor[:] = normal
        cholesky_solve(factor, step[:n_free])
        if not _compose(pose, step):
            return -1.0
        moved = step[0] ** 2 + step[1] ** 2
        sheared = step[2] ** 2 + step[3] ** 2 + step[4] ** 2 + step[5] ** 2
        if k > 0 and moved < 1e-5 and sheared < 1e-5:
            return correlation
    return -1.0


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
    n_free: int,
    n_iterations: int,
    reach: float,
) -> Float64Array:
    """Move each source patch until it looks like the target's; correlation (n,), -1 where lost.

    ``centre_s`` and ``linear`` (from target to source pixels, at the levels) are changed in place: the place alone
    where two parameters are free, the shape too where all six are.
    """
    n, m = centre_t.shape[0], grid.shape[0]
    correlation = np.full(n, -1.0)
    patch, slopes = np.empty(m, np.float32), np.empty((6, m), np.float32)
    half = 0.5 * grid.max()
    pose = np.empty(6)
    for p in range(n):
        start, rows, columns = layout_t[level_t[p], 0], layout_t[level_t[p], 1], layout_t[level_t[p], 2]
        x, y = centre_t[p, 0], centre_t[p, 1]
        if not _inside(columns, rows, x, y, half, half):
            continue
        if _template(values_t, start, rows, columns, x, y, grid, weight, patch, slopes) == 0.0:
            continue
        pose[:2] = centre_s[p]
        pose[2:4], pose[4:] = linear[p, 0], linear[p, 1]
        layout = layout_s[level_s[p]]
        correlation[p] = _track(values_s, layout, pose, grid, weight, patch, slopes, n_free, n_iterations, reach)
        centre_s[p] = pose[:2]
        linear[p, 0], linear[p, 1] = pose[2:4], pose[4:]
    return correlation
