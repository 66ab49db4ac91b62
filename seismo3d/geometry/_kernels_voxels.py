"""Points to voxels with their moments by hashing, and voxels to coarser ones.

Moments of a voxel are (count, sums of x, y, z, sums of xx, xy, xz, yy, yz, zz).
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import AXIS_BITS, AXIS_MASK, slot, table_with_room


@nb.njit(cache=True, nogil=True)
def survey(points: Float64Array, out: Float64Array) -> bool:
    """Write minimum, maximum and sum of each axis and the sum of squares to ``out``; return whether all are finite."""
    n, d = points.shape
    x0, y0, z0 = points[0, 0], points[0, 1], points[0, d - 1]
    low_x, low_y, low_z = x0, y0, z0
    high_x, high_y, high_z = x0, y0, z0
    sum_x = sum_y = sum_z = squares_x = squares_y = squares_z = 0.0
    for i in range(n):  # the axes side by side: three chains of sums keep the processor busy, one does not
        x, y, z = points[i, 0], points[i, 1], points[i, d - 1]
        low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
        high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
        x, y, z = x - x0, y - y0, z - z0
        sum_x, sum_y, sum_z = sum_x + x, sum_y + y, sum_z + z
        squares_x, squares_y, squares_z = squares_x + x * x, squares_y + y * y, squares_z + z * z
    out[d - 1], out[2 * d - 1], out[3 * d - 1], out[4 * d - 1] = low_z, high_z, sum_z, squares_z
    out[0], out[d], out[2 * d], out[3 * d] = low_x, high_x, sum_x, squares_x
    out[1], out[d + 1], out[2 * d + 1], out[3 * d + 1] = low_y, high_y, sum_y, squares_y
    for k in range(d):
        offset = out[2 * d + k] / n
        out[3 * d + k] = max(0.0, out[3 * d + k] - n * offset * offset)
        out[2 * d + k] = n * (points[0, k] + offset)
    finite = True
    for i in range(4 * d):
        finite = finite and math.isfinite(out[i])
    return finite


@nb.njit(cache=True, nogil=True)
def _enter_points(
    first: int,
    points: Float64Array,
    center: Float64Array,
    factor: float,
    turn: Float64Array,
    origin: Float64Array,
    inverse_size: float,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    count: int,
    keys: Int64Array,
    moments: Float64Array,
    owner: Int32Array,
) -> tuple[int, int]:
    """Enter points from ``first`` on until there is no room for a new voxel; return how far that was, and the voxels.

    Arrays that a loop never replaces stay where the processor has them: growing is left to the caller.
    """
    n, d = points.shape
    room = keys.shape[0]
    mask = table.shape[0] - 1
    z = 0.0
    for i in range(first, n):
        x = (points[i, 0] - center[0]) * factor
        y = (points[i, 1] - center[1]) * factor
        if d == 3:
            z = (points[i, 2] - center[2]) * factor
        along_x = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
        along_y = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
        key = (np.int64((along_x - origin[0]) * inverse_size) << (2 * AXIS_BITS)) | (
            np.int64((along_y - origin[1]) * inverse_size) << AXIS_BITS
        )
        if d == 3:
            along_z = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
            key |= np.int64((along_z - origin[2]) * inverse_size)
        place = slot(key, shift)
        number = table[place]
        while number >= 0 and table_keys[place] != key:
            place = (place + 1) & mask
            number = table[place]
        if number < 0:
            if count == room:
                return i, count
            number = count
            table[place] = number
            table_keys[place] = key
            keys[number] = key
            for k in range(10):
                moments[number, k] = 0.0
            count += 1
        owner[i] = number
        moments[number, 0] += 1.0
        moments[number, 1] += x
        moments[number, 2] += y
        moments[number, 3] += z
        moments[number, 4] += x * x
        moments[number, 5] += x * y
        moments[number, 6] += x * z
        moments[number, 7] += y * y
        moments[number, 8] += y * z
        moments[number, 9] += z * z
    return n, count


@nb.njit(cache=True, nogil=True)
def voxelise(
    points: Float64Array,
    center: Float64Array,
    factor: float,
    turn: Float64Array,
    origin: Float64Array,
    inverse_size: float,
) -> tuple[Int64Array, Float64Array, Int32Array]:
    """Return keys and moments of the voxels that hold points, in order of first sight, and each point's voxel.

    Points become ``(p - center) * factor`` first, which is what moments are of; ``turn`` carries them to the axes of
    the voxels, along which ``origin`` and ``inverse_size`` are.
    """
    n = points.shape[0]
    room = 2048
    keys = np.empty(room, dtype=np.int64)
    moments = np.empty((room, 10))
    owner = np.empty(n, dtype=np.int32)
    done = count = 0
    while True:
        table_keys, table, shift = table_with_room(keys[:count], room)
        done, count = _enter_points(
            done,
            points,
            center,
            factor,
            turn,
            origin,
            inverse_size,
            table_keys,
            table,
            shift,
            count,
            keys,
            moments,
            owner,
        )
        if done == n:
            return keys[:count].copy(), moments[:count].copy(), owner
        room *= 4
        more_keys = np.empty(room, dtype=np.int64)
        more_keys[:count] = keys
        keys = more_keys
        more_moments = np.empty((room, 10))
        more_moments[:count] = moments
        moments = more_moments


@nb.njit(cache=True, nogil=True)
def coarsen(keys: Int64Array, moments: Float64Array) -> tuple[Int64Array, Float64Array, Int32Array]:
    """Join voxels two by two along each axis: return coarser keys, moments, and each fine voxel's parent."""
    n = keys.shape[0]
    bits = 4
    while (1 << bits) < 2 * n:
        bits += 1
    table = np.full(1 << bits, -1, dtype=np.int32)
    mask = (1 << bits) - 1
    shift = 64 - bits
    new_keys = np.empty(n, dtype=np.int64)
    new_moments = np.zeros((n, 10))
    parent = np.empty(n, dtype=np.int32)
    count = 0
    for i in range(n):
        key = keys[i]
        x, y, z = key >> (2 * AXIS_BITS), (key >> AXIS_BITS) & AXIS_MASK, key & AXIS_MASK
        key = ((x >> 1) << (2 * AXIS_BITS)) | ((y >> 1) << AXIS_BITS) | (z >> 1)
        place = slot(key, shift)
        while True:
            number = table[place]
            if number < 0:
                number = count
                table[place] = number
                new_keys[number] = key
                count += 1
                break
            if new_keys[number] == key:
                break
            place = (place + 1) & mask
        parent[i] = number
        for k in range(10):
            new_moments[number, k] += moments[i, k]
    return new_keys[:count].copy(), new_moments[:count].copy(), parent
