"""Kernels of the hashed signed-distance blocks: find, allocate, touch; see :mod:`seismo3d.robot.tsdf`.

A block holds 8 x 8 x 8 voxels. Its key packs three block coordinates, each offset by 2^20, into 21 bits. The hash table
is open with linear probing and holds block numbers, -1 where free. Signed distances are in metres, positive in front
of the surface; a voxel's centre lies at its integer coordinates times the voxel size.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import AXIS_BITS, AXIS_MASK, find, slot

SIDE = 8
HALF_RANGE = 1 << 20


@nb.njit(cache=True, nogil=True, inline="always")
def pack(x: Any, y: Any, z: Any) -> Any:
    """Key of a block by its coordinates."""
    return ((x + HALF_RANGE) << (2 * AXIS_BITS)) | ((y + HALF_RANGE) << AXIS_BITS) | (z + HALF_RANGE)


@nb.njit(cache=True, nogil=True)
def insert_block(key: Any, number: int, table_keys: Int64Array, table: Int32Array, shift: int) -> bool:
    """Enter a block under a number; return whether it was not there."""
    mask = table.shape[0] - 1
    place = slot(key, shift)
    while table[place] >= 0:
        if table_keys[place] == key:
            return False
        place = (place + 1) & mask
    table[place] = number
    table_keys[place] = key
    return True


@nb.njit(cache=True, nogil=True)
def enter_keys(
    keys: Int64Array,
    count: int,
    held: Int64Array,
    numbers: Int64Array,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
) -> int:
    """Give numbers to the blocks of some keys, new ones from ``count`` on, in order; return the count afterwards."""
    for i in range(keys.shape[0]):
        if insert_block(keys[i], count, table_keys, table, shift):
            held[count] = keys[i]
            count += 1
        numbers[i] = find(keys[i], table_keys, table, shift)
    return count


@nb.njit(cache=True, nogil=True)
def fill_table(keys: Int64Array, table_keys: Int64Array, table: Int32Array, shift: int) -> None:
    """Enter all blocks into a table of another size."""
    for i in range(keys.shape[0]):
        insert_block(keys[i], i, table_keys, table, shift)


@nb.njit(cache=True, nogil=True)
def unpack(keys: Int64Array) -> Int32Array:
    """Block coordinates (n, 3) of keys."""
    out = np.empty((keys.shape[0], 3), dtype=np.int32)
    for i in range(keys.shape[0]):
        out[i, 0] = (keys[i] >> (2 * AXIS_BITS)) - HALF_RANGE
        out[i, 1] = ((keys[i] >> AXIS_BITS) & AXIS_MASK) - HALF_RANGE
        out[i, 2] = (keys[i] & AXIS_MASK) - HALF_RANGE
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def touched_blocks(
    vertices: Float32Array, step: int, R: Float64Array, t: Float64Array, block: float, band: float
) -> Int64Array:
    """Keys (distinct) of the blocks within ``band`` metres along the ray of every ``step``-th vertex, as they come."""
    rows, columns, _ = vertices.shape
    bits = 14
    shift = 64 - bits
    table = np.full(1 << bits, -1, dtype=np.int32)
    table_keys = np.empty(1 << bits, dtype=np.int64)
    found = np.empty(1 << bits, dtype=np.int64)
    count = 0
    tx, ty, tz = t[0] / block, t[1] / block, t[2] / block
    n_samples = math.ceil(2.0 * band / (0.6 * block)) + 1
    # keys of the vertex before and of the one above: mostly those of the next one, too
    before, upper = np.full(n_samples, -1, dtype=np.int64), np.full((columns, n_samples), -1, dtype=np.int64)
    inverse, spacing = 1.0 / block, 2.0 * band / (n_samples - 1)
    for r in range(0, rows, step):
        for c in range(0, columns, step):
            z = vertices[r, c, 2]
            if not z > 0.0:
                continue
            x, y = vertices[r, c, 0], vertices[r, c, 1]
            if (r // step) & 1 or (c // step) & 1:
                # every second one is enough where they lie close on a surface
                left, above = vertices[r, max(c - step, 0)], vertices[max(r - step, 0), c]
                level = abs(left[2] - z) < 0.25 * block and abs(above[2] - z) < 0.25 * block
                if level and abs(left[0] - x) < 0.3 * block:
                    continue
            length = math.sqrt(x * x + y * y + z * z)
            px = (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z) * inverse
            py = (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z) * inverse
            pz = (R[2, 0] * x + R[2, 1] * y + R[2, 2] * z) * inverse
            f, step_f = 1.0 - band / length, spacing / length
            for k in range(n_samples):
                bx = np.int64(math.floor(f * px + tx))
                by = np.int64(math.floor(f * py + ty))
                bz = np.int64(math.floor(f * pz + tz))
                f += step_f
                key = pack(bx, by, bz)
                known = key == before[k] or key == upper[c, k]
                before[k] = upper[c, k] = key
                if known:
                    continue
                if insert_block(key, count, table_keys, table, shift):
                    found[count] = key
                    count += 1
                    if 2 * count > table.shape[0]:
                        bits += 1
                        shift = 64 - bits
                        table = np.full(1 << bits, -1, dtype=np.int32)
                        table_keys = np.empty(1 << bits, dtype=np.int64)
                        larger = np.empty(1 << bits, dtype=np.int64)
                        larger[:count] = found[:count]
                        found = larger
                        for i in range(count):
                            insert_block(found[i], i, table_keys, table, shift)
    return found[:count].copy()


@nb.njit(cache=True, nogil=True)
def pixel_table(rows: int, columns: int, margin: int, lens: Float64Array) -> Int32Array:
    """Distorted pixel (its number, or -1) of each pixel of an image without distortion and with a margin."""
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    out = np.full((rows + 2 * margin, columns + 2 * margin), -1, dtype=np.int32)
    for r in range(out.shape[0]):
        y = (r - margin - cy) / fy
        for c in range(out.shape[1]):
            x = (c - margin - cx) / fx
            r2 = x * x + y * y
            f = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
            u = x * f + 2.0 * lens[6] * x * y + lens[7] * (r2 + 2.0 * x * x)
            v = y * f + lens[6] * (r2 + 2.0 * y * y) + 2.0 * lens[7] * x * y
            cc, rr = math.floor(fx * u + cx + 0.5), math.floor(fy * v + cy + 0.5)
            if 0 <= cc < columns and 0 <= rr < rows and r2 < 1.5:
                out[r, c] = rr * columns + cc
    return out
