"""Kernels that cast rays into the signed-distance blocks; see :mod:`seismo3d.robot.tsdf`."""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxels import find
from seismo3d.robot._kernels_blocks import SIDE, pack


@nb.njit(cache=True, nogil=True)
def _voxel(
    i: Any,
    j: Any,
    k: Any,
    distance: Float32Array,
    weight: Float32Array,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
) -> float:
    """Return the distance at a voxel, NaN where it is not known."""
    number = find(pack(i >> 3, j >> 3, k >> 3), table_keys, table, shift)
    if number < 0:
        return np.nan
    index = ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)
    return distance[number, index] if weight[number, index] > 0.0 else np.nan


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
    if (i & 7) < 7 and (j & 7) < 7 and (k & 7) < 7:
        number = find(pack(i >> 3, j >> 3, k >> 3), table_keys, table, shift)
        if number < 0:
            return False
        at = ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)
        d, w = distance[number], weight[number]
        if not (w[at] > 0.0 and w[at + 1] > 0.0 and w[at + 8] > 0.0 and w[at + 9] > 0.0):
            return False
        if not (w[at + 64] > 0.0 and w[at + 65] > 0.0 and w[at + 72] > 0.0 and w[at + 73] > 0.0):
            return False
        v0, v1, v2, v3 = d[at], d[at + 1], d[at + 8], d[at + 9]
        v4, v5, v6, v7 = d[at + 64], d[at + 65], d[at + 72], d[at + 73]
    else:
        v0 = _voxel(i, j, k, distance, weight, table_keys, table, shift)
        v1 = _voxel(i, j, k + 1, distance, weight, table_keys, table, shift)
        v2 = _voxel(i, j + 1, k, distance, weight, table_keys, table, shift)
        v3 = _voxel(i, j + 1, k + 1, distance, weight, table_keys, table, shift)
        v4 = _voxel(i + 1, j, k, distance, weight, table_keys, table, shift)
        v5 = _voxel(i + 1, j, k + 1, distance, weight, table_keys, table, shift)
        v6 = _voxel(i + 1, j + 1, k, distance, weight, table_keys, table, shift)
        v7 = _voxel(i + 1, j + 1, k + 1, distance, weight, table_keys, table, shift)
        if not math.isfinite(v0 + v1 + v2 + v3 + v4 + v5 + v6 + v7):
            return False
    gx, gy, gz = 1.0 - fx, 1.0 - fy, 1.0 - fz
    c00, c01 = v0 * gz + v1 * fz, v2 * gz + v3 * fz
    c10, c11 = v4 * gz + v5 * fz, v6 * gz + v7 * fz
    low, high = c00 * gy + c01 * fy, c10 * gy + c11 * fy
    out[0] = low * gx + high * fx
    out[1] = high - low
    out[2] = (c01 - c00) * gx + (c11 - c10) * fx
    out[3] = ((v1 - v0) * gy + (v3 - v2) * fy) * gx + ((v5 - v4) * gy + (v7 - v6) * fy) * fx
    return True


@nb.njit(cache=True, nogil=True)
def cast_rows(
    first: int,
    last_row: int,
    expected: Float32Array,
    reach: float,
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

    Looked for within ``reach`` of the depth ``expected`` of each pixel. ``shade`` receives (grey value, weight) of the
    surface there.
    """
    columns = points.shape[1]
    inverse = 1.0 / voxel
    out = np.empty(4)
    for r in range(first, last_row):
        for c in range(columns):
            points[r, c, :] = np.nan
            normals[r, c, :] = np.nan
            shade[r, c, :] = 0.0
            if not expected[r, c] > 0.0:
                continue
            near, far = max(0.1, expected[r, c] - reach), expected[r, c] + reach
            dx, dy = (c - lens[2]) / lens[0], (r - lens[3]) / lens[1]
            length = math.sqrt(dx * dx + dy * dy + 1.0)
            ux = (R[0, 0] * dx + R[0, 1] * dy + R[0, 2]) / length
            uy = (R[1, 0] * dx + R[1, 1] * dy + R[1, 2]) / length
            uz = (R[2, 0] * dx + R[2, 1] * dy + R[2, 2]) / length
            s, end = near * length, far * length
            # where the space three bands before the expected surface is known to be free, the ray starts there
            close = (expected[r, c] - 3.0 * band) * length
            if close > s:
                i = np.int64(math.floor((t[0] + close * ux) * inverse + 0.5))
                j = np.int64(math.floor((t[1] + close * uy) * inverse + 0.5))
                k = np.int64(math.floor((t[2] + close * uz) * inverse + 0.5))
                if _voxel(i, j, k, distance, weight, table_keys, table, shift) > 0.0:
                    s = close
            before, s_before = np.nan, s
            last = np.int64(-1)
            number = -1
            while s < end:
                x, y, z = (t[0] + s * ux) * inverse, (t[1] + s * uy) * inverse, (t[2] + s * uz) * inverse
                i, j, k = np.int64(math.floor(x + 0.5)), np.int64(math.floor(y + 0.5)), np.int64(math.floor(z + 0.5))
                key = pack(i >> 3, j >> 3, k >> 3)
                if key != last:
                    number = find(key, table_keys, table, shift)
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
                            s_before,
                            s,
                            before,
                            value,
                            ux,
                            uy,
                            uz,
                            t,
                            inverse,
                            distance,
                            weight,
                            table_keys,
                            table,
                            shift,
                            out,
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
                s += max(0.9 * value, voxel) if value < 0.99 * band else max(0.7 * band, voxel)


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
    f_low: float,
    f_high: float,
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
    """Find the zero of the interpolated distance between two places on a ray by false position; -1 where none is."""
    half = 0.5 / inverse
    low, high = low - half, high + half
    s = low
    for _ in range(5):
        s = low + (high - low) * f_low / (f_low - f_high)
        if not sample_cell((t[0] + s * ux) * inverse, (t[1] + s * uy) * inverse, (t[2] + s * uz) * inverse,
                           distance, weight, table_keys, table, shift, out):  # fmt: skip
            return -1.0
        if abs(out[0]) < 0.05 * half:
            break
        if out[0] > 0.0:
            low, f_low = s, out[0]
        else:
            high, f_high = s, out[0]
    return s if abs(out[0]) < half else -1.0
