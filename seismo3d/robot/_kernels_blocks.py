"""Kernels of the hashed signed-distance blocks: find, allocate, fuse; see :mod:`seismo3d.robot.tsdf`.

A block holds 8 x 8 x 8 voxels. Its key packs three block coordinates, each offset by 2^20, into 21 bits. The hash table
is open with linear probing and holds block numbers, -1 where free. Signed distances are in metres, positive in front
of the surface; a voxel's centre lies at its integer coordinates times the voxel size.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxels import AXIS_BITS, AXIS_MASK, find, slot

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


@nb.njit(cache=True, nogil=True)
def touched_blocks(
    vertices: Float32Array, step: int, R: Float64Array, t: Float64Array, block: float, band: float
) -> Int64Array:
    """Keys (distinct, sorted) of the blocks within ``band`` metres along the ray of every ``step``-th vertex."""
    rows, columns, _ = vertices.shape
    bits = 15
    shift = 64 - bits
    table = np.full(1 << bits, -1, dtype=np.int32)
    table_keys = np.empty(1 << bits, dtype=np.int64)
    found = np.empty(1 << bits, dtype=np.int64)
    count = 0
    n_samples = math.ceil(2.0 * band / (0.6 * block)) + 1
    for r in range(0, rows, step):
        for c in range(0, columns, step):
            z = vertices[r, c, 2]
            if not z > 0.0:
                continue
            x, y = vertices[r, c, 0], vertices[r, c, 1]
            length = math.sqrt(x * x + y * y + z * z)
            last = np.int64(-1)
            for k in range(n_samples):
                f = 1.0 + (2.0 * band * k / (n_samples - 1) - band) / length
                px, py, pz = f * x, f * y, f * z
                bx = np.int64(math.floor((R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]) / block))
                by = np.int64(math.floor((R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]) / block))
                bz = np.int64(math.floor((R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]) / block))
                key = pack(bx, by, bz)
                if key == last:
                    continue
                last = key
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
    return np.sort(found[:count])


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


@nb.njit(cache=True, nogil=True)
def fuse_blocks(
    numbers: Int64Array,
    coordinates: Int32Array,
    distance: Float32Array,
    weight: Float32Array,
    colour: AnyArray,
    voxel: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    table: Int32Array,
    margin: int,
    pixels: Float32Array,
    rgb: AnyArray,
    band: float,
    heaviest: float,
) -> None:
    """Average a frame into the voxels of blocks near its surface.

    Parameters are the blocks' rows, all blocks' coordinates (n, 3), distances and weights (n, 512), colours (n, 512,
    3), the voxel's size, the pose's rotation and translation (camera to world), the lens (fx, fy, cx, cy first), the
    table of pixels with its margin, (depth, cosine between ray and normal, weight) of each pixel (n_pixels, 3), the
    colours (n_pixels, 3; or without rows), the band in metres and the largest weight.
    """
    f4 = np.float32
    rows, columns = table.shape
    fx, fy = f4(lens[0]), f4(lens[1])
    cx, cy = f4(lens[2] + margin + 0.5), f4(lens[3] + margin + 0.5)
    band4, near4, one, zero = f4(band), f4(0.05), f4(1.0), f4(0.0)
    heaviest4, close = f4(heaviest), f4(2.0 * voxel)
    width, height = f4(columns), f4(rows)
    has_colour = rgb.shape[0] > 0
    sx, sy, sz = f4(R[2, 0] * voxel), f4(R[2, 1] * voxel), f4(R[2, 2] * voxel)
    for number in numbers:
        ox = coordinates[number, 0] * SIDE * voxel - t[0]
        oy = coordinates[number, 1] * SIDE * voxel - t[1]
        oz = coordinates[number, 2] * SIDE * voxel - t[2]
        for i in range(SIDE):
            wx = ox + i * voxel
            for j in range(SIDE):
                wy = oy + j * voxel
                x = f4(R[0, 0] * wx + R[1, 0] * wy + R[2, 0] * oz)
                y = f4(R[0, 1] * wx + R[1, 1] * wy + R[2, 1] * oz)
                z = f4(R[0, 2] * wx + R[1, 2] * wy + R[2, 2] * oz)
                index = (i * SIDE + j) * SIDE - 1
                for _ in range(SIDE):
                    index += 1
                    vx, vy, vz = x, y, z
                    x += sx
                    y += sy
                    z += sz
                    if vz < near4:
                        continue
                    inverse = one / vz
                    u = fx * vx * inverse + cx
                    v = fy * vy * inverse + cy
                    if not (zero <= u < width and zero <= v < height):
                        continue
                    pixel = table[int(v), int(u)]
                    if pixel < 0:
                        continue
                    w = pixels[pixel, 2]
                    if not w > zero:
                        continue
                    ahead = pixels[pixel, 0] - vz
                    if ahead < -band4 - band4:
                        continue
                    ahead *= f4(math.sqrt(one + (vx * vx + vy * vy) * inverse * inverse)) * pixels[pixel, 1]
                    if ahead < -band4:
                        continue
                    ahead = min(ahead, band4)
                    old = weight[number, index]
                    total = old + w
                    share = w / total
                    distance[number, index] += share * (ahead - distance[number, index])
                    weight[number, index] = min(total, heaviest4)
                    if has_colour and abs(ahead) < close and rgb[pixel, 0] > 0:
                        fresh = colour[number, index, 0] == 0
                        for k in range(3):
                            held = f4(colour[number, index, k])
                            value = f4(rgb[pixel, k])
                            if not fresh:
                                value = held + share * (value - held)
                            colour[number, index, k] = np.uint8(max(one, value + f4(0.5)))
