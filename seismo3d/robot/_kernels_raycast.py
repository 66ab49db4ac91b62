"""Kernels that cast rays into the signed-distance blocks; see :mod:`seismo3d.robot.tsdf`."""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import find
from seismo3d.robot._kernels_blocks import SIDE, pack
from seismo3d.robot.voxels import STEPS, SURFACE


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _voxel(i: Any, j: Any, k: Any, distance: AnyArray, table_keys: Int64Array, table: Int32Array, shift: int) -> Any:
    """Return the distance at a voxel as it is held, 0 where it is not known."""
    number = find(pack(i >> 3, j >> 3, k >> 3), table_keys, table, shift)
    if number < 0:
        return np.int64(0)
    return np.int64(distance[number, ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sample_cell(
    x: float,
    y: float,
    z: float,
    distance: AnyArray,
    step: float,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    out: Float64Array,
) -> bool:
    """Interpolate the distance at voxel coordinates; write it and its gradient to ``out``; False where unknown.

    ``step`` is how much one step of what is held is.
    """
    i0, j0, k0 = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = x - i0, y - j0, z - k0
    i, j, k = np.int64(i0), np.int64(j0), np.int64(k0)
    number = find(pack(i >> 3, j >> 3, k >> 3), table_keys, table, shift)
    if number < 0:
        return False
    at = ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)
    if (i & 7) < 7 and (j & 7) < 7 and (k & 7) < 7:
        d = distance[number]
        v0, v1, v2, v3 = d[at], d[at + 1], d[at + 8], d[at + 9]
        v4, v5, v6, v7 = d[at + 64], d[at + 65], d[at + 72], d[at + 73]
    else:
        b4 = number if (i & 7) < 7 else find(pack((i >> 3) + 1, j >> 3, k >> 3), table_keys, table, shift)
        b1, b5 = _beyond(i, j, k + 1, (k & 7) < 7, (i & 7) < 7, number, b4, table_keys, table, shift)
        b2, b6 = _beyond(i, j + 1, k, (j & 7) < 7, (i & 7) < 7, number, b4, table_keys, table, shift)
        if (j & 7) < 7:
            b3, b7 = b1, b5
        else:
            b3, b7 = _beyond(i, j + 1, k + 1, (k & 7) < 7, (i & 7) < 7, b2, b6, table_keys, table, shift)
        if min(b1, b2, b3, b4, b5, b6, b7) < 0:
            return False
        # within a block the next voxel is one step on; in the block after it, seven back
        di = np.int64(64) if (i & 7) < 7 else np.int64(-448)
        dj = np.int64(8) if (j & 7) < 7 else np.int64(-56)
        dk = np.int64(1) if (k & 7) < 7 else np.int64(-7)
        v0, v1 = distance[number, at], distance[b1, at + dk]
        v2, v3 = distance[b2, at + dj], distance[b3, at + dj + dk]
        v4, v5 = distance[b4, at + di], distance[b5, at + di + dk]
        v6, v7 = distance[b6, at + di + dj], distance[b7, at + di + dj + dk]
    if min(v0, v1, v2, v3, v4, v5, v6, v7) == 0:
        return False
    # as numbers with a sign, which differences have
    v0, v1, v2, v3 = np.float32(v0), np.float32(v1), np.float32(v2), np.float32(v3)
    v4, v5, v6, v7 = np.float32(v4), np.float32(v5), np.float32(v6), np.float32(v7)
    gx, gy, gz = 1.0 - fx, 1.0 - fy, 1.0 - fz
    c00, c01 = v0 * gz + v1 * fz, v2 * gz + v3 * fz
    c10, c11 = v4 * gz + v5 * fz, v6 * gz + v7 * fz
    low, high = c00 * gy + c01 * fy, c10 * gy + c11 * fy
    out[0] = (low * gx + high * fx - SURFACE) * step
    out[1] = (high - low) * step
    out[2] = ((c01 - c00) * gx + (c11 - c10) * fx) * step
    out[3] = (((v1 - v0) * gy + (v3 - v2) * fy) * gx + ((v5 - v4) * gy + (v7 - v6) * fy) * fx) * step
    return True


@nb.njit(cache=True, nogil=True, inline="always")
def _beyond(
    i: Any, j: Any, k: Any, inside: Any, level: Any, near: Any, far: Any, table_keys: Any, table: Any, shift: Any
) -> Any:
    """Blocks of a voxel and of the one after it along the first axis.

    They are ``near`` and ``far`` where the voxel lies ``inside`` of the block that these belong to, and one block where
    the two are ``level``.
    """
    if inside:
        return near, far
    found = find(pack(i >> 3, j >> 3, k >> 3), table_keys, table, shift)
    return found, (found if level else find(pack((i >> 3) + 1, j >> 3, k >> 3), table_keys, table, shift))


@nb.njit(cache=True, nogil=True, error_model="numpy")
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
    distance: AnyArray,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    points: Float32Array,
    normals: Float32Array,
) -> None:
    """Find where the rays of some rows of an image meet the surface: points and normals in the world, NaN elsewhere.

    Looked for within ``reach`` of the depth ``expected`` of each pixel.
    """
    columns = points.shape[1]
    inverse, step = 1.0 / voxel, band / STEPS
    out = np.empty(4)
    ray = np.empty(6)  # origin and direction, in voxels and voxels a metre
    for a in range(3):
        ray[a] = t[a] * inverse
    for r in range(first, last_row):
        for c in range(columns):
            points[r, c, :] = np.nan
            normals[r, c, :] = np.nan
            if not expected[r, c] > 0.0:
                continue
            dx, dy = (c - lens[2]) / lens[0], (r - lens[3]) / lens[1]
            length = math.sqrt(dx * dx + dy * dy + 1.0)
            for a in range(3):
                ray[3 + a] = (R[a, 0] * dx + R[a, 1] * dy + R[a, 2]) / length * inverse
            middle = expected[r, c] * length
            hit = _descend(
                middle, middle - band, middle + band, ray, voxel, distance, step, table_keys, table, shift, out
            )
            if hit < 0.0:
                s, end = max(0.1, expected[r, c] - reach) * length, (expected[r, c] + reach) * length
                # where the space some bands before the expected surface is known to be free, the ray starts there
                for bands in (1.0, 3.0):
                    close = (expected[r, c] - bands * band) * length
                    if close > s and _nearest(close, ray, distance, table_keys, table, shift) > SURFACE:
                        s = close
                        break
                hit = _march(s, end, ray, voxel, band, distance, table_keys, table, shift, out)
            size = math.sqrt(out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
            if hit > 0.0 and size > 1e-9:
                for a in range(3):
                    points[r, c, a] = (ray[a] + hit * ray[3 + a]) * voxel
                    normals[r, c, a] = out[1 + a] / size


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _nearest(
    s: float, ray: Float64Array, distance: AnyArray, table_keys: Int64Array, table: Int32Array, shift: int
) -> Any:
    """Distance, as it is held, at the voxel nearest to a place on a ray, 0 where it is not known."""
    i = np.int64(math.floor(ray[0] + s * ray[3] + 0.5))
    j = np.int64(math.floor(ray[1] + s * ray[4] + 0.5))
    k = np.int64(math.floor(ray[2] + s * ray[5] + 0.5))
    return _voxel(i, j, k, distance, table_keys, table, shift)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _march(
    s: float,
    end: float,
    ray: Float64Array,
    voxel: float,
    band: float,
    distance: AnyArray,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    out: Float64Array,
) -> Any:
    """Go along a ray to where it enters the surface; ``out`` is what :func:`sample_cell` says there; -1 for nowhere."""
    before, s_before, step = np.nan, s, band / STEPS
    last = np.int64(-1)
    number = -1
    while s < end:
        x, y, z = ray[0] + s * ray[3] + 0.5, ray[1] + s * ray[4] + 0.5, ray[2] + s * ray[5] + 0.5
        i, j, k = np.int64(math.floor(x)), np.int64(math.floor(y)), np.int64(math.floor(z))
        key = pack(i >> 3, j >> 3, k >> 3)
        if key != last:
            number = find(key, table_keys, table, shift)
            last = key
        if number < 0:
            before = np.nan
            leave = min(_exit(x, i >> 3, ray[3]), _exit(y, j >> 3, ray[4]), _exit(z, k >> 3, ray[5]))
            s += leave + 0.05 * voxel
            continue
        held = distance[number, ((i & 7) * SIDE + (j & 7)) * SIDE + (k & 7)]
        if held == 0:
            before = np.nan
            s += voxel
            continue
        value = (held - SURFACE) * step
        if value < 0.0:
            if before > 0.0:
                return _refine(s_before, s, before, value, ray, voxel, distance, step, table_keys, table, shift, out)
            return -1.0
        before, s_before = value, s
        s += max(0.9 * value, voxel) if value < 0.99 * band else max(0.7 * band, voxel)
    return -1.0


@nb.njit(cache=True, nogil=True, inline="always")
def _exit(x: Any, block: Any, direction: Any) -> Any:
    """How far along a ray it leaves a block, by one coordinate and how much of it a metre is."""
    if direction > 1e-6:
        return ((block + 1) * SIDE - x) / direction
    if direction < -1e-6:
        return (block * SIDE - x) / direction
    return 1e9


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _refine(
    low: float,
    high: float,
    f_low: float,
    f_high: float,
    ray: Float64Array,
    voxel: float,
    distance: AnyArray,
    step: float,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    out: Float64Array,
) -> Any:
    """Find the zero of the interpolated distance between two places on a ray; -1 where none is."""
    half = 0.5 * voxel
    s = low + (high - low) * f_low / (f_low - f_high)
    return _descend(s, low - half, high + half, ray, voxel, distance, step, table_keys, table, shift, out)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _descend(
    s: float,
    low: float,
    high: float,
    ray: Float64Array,
    voxel: float,
    distance: AnyArray,
    step: float,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    out: Float64Array,
) -> Any:
    """Find the zero of the interpolated distance near a place on a ray by Newton's steps, the last one taken on trust.

    Returns -1 where none is between two places.
    """
    half, near = 0.5 * voxel, 0.25 * voxel
    for _ in range(4):
        x, y, z = ray[0] + s * ray[3], ray[1] + s * ray[4], ray[2] + s * ray[5]
        if not sample_cell(x, y, z, distance, step, table_keys, table, shift, out):
            return -1.0
        slope = out[1] * ray[3] + out[2] * ray[4] + out[3] * ray[5]
        if not slope < 0.0:  # not what a ray that enters sees
            return -1.0
        move = -out[0] / slope
        s += move
        if abs(move) < near:
            return s
        if not low <= s <= high:
            s = min(max(s, low), high)
    return s if abs(out[0]) < half else -1.0
