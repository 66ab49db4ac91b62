"""Kernels that cast rays into the signed-distance blocks; see :mod:`seismo3d.robot.tsdf`."""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.robot._kernels_blocks import SIDE, find_block, pack


@nb.njit(cache=True, nogil=True)
def tile_bounds(
    coordinates: Int32Array,
    block: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    rows: int,
    columns: int,
    tile: int,
) -> tuple[Float32Array, Int64Array]:
    """Nearest and farthest depth (tile rows, tile columns, 2) of the blocks that each tile sees; the blocks in view."""
    tile_rows, tile_columns = (rows + tile - 1) // tile, (columns + tile - 1) // tile
    bounds = np.zeros((tile_rows, tile_columns, 2), dtype=np.float32)
    bounds[:, :, 0] = np.inf
    seen = np.empty(coordinates.shape[0], dtype=np.int64)
    count = 0
    radius = 0.8661 * block
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    for n in range(coordinates.shape[0]):
        dx = (coordinates[n, 0] + 0.4375) * block - t[0]
        dy = (coordinates[n, 1] + 0.4375) * block - t[1]
        dz = (coordinates[n, 2] + 0.4375) * block - t[2]
        z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
        if z < 0.1:
            continue
        x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
        y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
        u, v = fx * x / z + cx, fy * y / z + cy
        reach_u, reach_v = 1.1 * fx * radius / z + 1.0, 1.1 * fy * radius / z + 1.0
        c0, c1 = max(0, math.floor((u - reach_u) / tile)), min(tile_columns - 1, int((u + reach_u) / tile))
        r0, r1 = max(0, math.floor((v - reach_v) / tile)), min(tile_rows - 1, int((v + reach_v) / tile))
        if u + reach_u < 0.0 or v + reach_v < 0.0 or c0 > c1 or r0 > r1:
            continue
        seen[count] = n
        count += 1
        low, high = max(0.1, z - radius), z + radius
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                bounds[r, c, 0] = min(bounds[r, c, 0], low)
                bounds[r, c, 1] = max(bounds[r, c, 1], high)
    return bounds, seen[:count]


@nb.njit(cache=True, nogil=True)
def sample_cell(
    x: float,
    y: float,
    z: float,
    distance: Float32Array,
    weight: Float32Array,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    out: Float64Array,
) -> bool:
    """Interpolate the distance at voxel coordinates; write it and its gradient to ``out``; False where unknown."""
    i0, j0, k0 = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = x - i0, y - j0, z - k0
    i, j, k = np.int64(i0), np.int64(j0), np.int64(k0)
    v = np.empty(8)
    last = np.int64(-1)
    number = -1
    for n in range(8):
        a, b, c = i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1)
        key = pack(a >> 3, b >> 3, c >> 3)
        if key != last:
            number = find_block(key, table_keys, table, shift)
            last = key
        if number < 0:
            return False
        index = ((a & 7) * SIDE + (b & 7)) * SIDE + (c & 7)
        if not weight[number, index] > 0.0:
            return False
        v[n] = distance[number, index]
    gx, gy, gz = 1.0 - fx, 1.0 - fy, 1.0 - fz
    c00, c01 = v[0] * gz + v[1] * fz, v[2] * gz + v[3] * fz
    c10, c11 = v[4] * gz + v[5] * fz, v[6] * gz + v[7] * fz
    low, high = c00 * gy + c01 * fy, c10 * gy + c11 * fy
    out[0] = low * gx + high * fx
    out[1] = high - low
    out[2] = (c01 - c00) * gx + (c11 - c10) * fx
    out[3] = ((v[1] - v[0]) * gy + (v[3] - v[2]) * fy) * gx + ((v[5] - v[4]) * gy + (v[7] - v[6]) * fy) * fx
    return True


@nb.njit(cache=True, nogil=True)
def cast_rows(
    first: int,
    last_row: int,
    bounds: Float32Array,
    tile: int,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    voxel: float,
    band: float,
    distance: Float32Array,
    weight: Float32Array,
    colour: AnyArray,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    points: Float32Array,
    normals: Float32Array,
    shade: Float32Array,
) -> None:
    """Find where the rays of some rows of an image meet the surface: points and normals in the world, NaN elsewhere.

    ``shade`` receives (grey value, weight) of the surface there.
    """
    columns = points.shape[1]
    inverse = 1.0 / voxel
    out = np.empty(4)
    for r in range(first, last_row):
        for c in range(columns):
            points[r, c, :] = np.nan
            normals[r, c, :] = np.nan
            shade[r, c, :] = 0.0
            near, far = bounds[r // tile, c // tile, 0], bounds[r // tile, c // tile, 1]
            if not far > near:
                continue
            dx, dy = (c - lens[2]) / lens[0], (r - lens[3]) / lens[1]
            length = math.sqrt(dx * dx + dy * dy + 1.0)
            ux = (R[0, 0] * dx + R[0, 1] * dy + R[0, 2]) / length
            uy = (R[1, 0] * dx + R[1, 1] * dy + R[1, 2]) / length
            uz = (R[2, 0] * dx + R[2, 1] * dy + R[2, 2]) / length
            s, end = near * length, far * length
            before, s_before = np.nan, s
            last = np.int64(-1)
            number = -1
            while s < end:
                x, y, z = (t[0] + s * ux) * inverse, (t[1] + s * uy) * inverse, (t[2] + s * uz) * inverse
                i, j, k = np.int64(math.floor(x + 0.5)), np.int64(math.floor(y + 0.5)), np.int64(math.floor(z + 0.5))
                key = pack(i >> 3, j >> 3, k >> 3)
                if key != last:
                    number = find_block(key, table_keys, table, shift)
                    last = key
                if number < 0:
                    before = np.nan
                    leave = _exit(x + 0.5, i >> 3, ux)
                    leave = min(leave, _exit(y + 0.5, j >> 3, uy), _exit(z + 0.5, k >> 3, uz))
                    s += (leave + 0.05) * voxel
                    continue
                index = ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)
                if not weight[number, index] > 0.0:
                    before = np.nan
                    s += voxel
                    continue
                value = distance[number, index]
                if value < 0.0:
                    if before > 0.0:
                        hit = _refine(
                            s_before, s, ux, uy, uz, t, inverse, distance, weight, table_keys, table, shift, out
                        )
                        if hit > 0.0:
                            size = math.sqrt(out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
                            if size > 1e-9:
                                points[r, c, 0] = t[0] + hit * ux
                                points[r, c, 1] = t[1] + hit * uy
                                points[r, c, 2] = t[2] + hit * uz
                                for a in range(3):
                                    normals[r, c, a] = out[1 + a] / size
                                grey = 0.0
                                for a in range(3):
                                    grey += np.float64(colour[number, index, a]) / 3.0
                                shade[r, c, 0] = grey
                                shade[r, c, 1] = weight[number, index]
                    break
                before, s_before = value, s
                s += max(0.8 * value, 0.5 * voxel) if value < 0.99 * band else max(0.7 * band, voxel)


@nb.njit(cache=True, nogil=True, inline="always")
def _exit(x: Any, block: Any, direction: Any) -> Any:
    """Voxels along a ray to where it leaves a block, by one coordinate."""
    if direction > 1e-9:
        return ((block + 1) * SIDE - x) / direction
    if direction < -1e-9:
        return (block * SIDE - x) / direction
    return 1e9


@nb.njit(cache=True, nogil=True)
def _refine(
    low: float,
    high: float,
    ux: float,
    uy: float,
    uz: float,
    t: Float64Array,
    inverse: float,
    distance: Float32Array,
    weight: Float32Array,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    out: Float64Array,
) -> Any:
    """Place of the zero of the interpolated distance between two places on a ray; -1 where there is none."""
    span = 1.0 / inverse
    low, high = low - 0.5 * span, high + 0.5 * span
    f_low, f_high = np.nan, np.nan
    s = low
    n_steps = math.ceil((high - low) / (0.5 * span))
    step = (high - low) / n_steps
    found = False
    for _ in range(n_steps + 1):
        if sample_cell((t[0] + s * ux) * inverse, (t[1] + s * uy) * inverse, (t[2] + s * uz) * inverse,
                       distance, weight, table_keys, table, shift, out):  # fmt: skip
            if out[0] <= 0.0 and f_low > 0.0:
                f_high, high = out[0], s
                found = True
                break
            f_low, low = out[0], s
        else:
            f_low = np.nan
        s += step
    if not found:
        return -1.0
    s = low + (high - low) * f_low / (f_low - f_high)
    if not sample_cell((t[0] + s * ux) * inverse, (t[1] + s * uy) * inverse, (t[2] + s * uz) * inverse,
                       distance, weight, table_keys, table, shift, out):  # fmt: skip
        return -1.0
    along = (out[1] * ux + out[2] * uy + out[3] * uz) * inverse
    if along < -1e-3:
        move = -out[0] / along
        if abs(move) < 0.5 * span:
            s += move
    return s
