"""Kernels that clear what a frame sees through; see :mod:`seismo3d.robot.tsdf`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.robot._kernels_blocks import SIDE
from seismo3d.robot._kernels_frame import depth_sigma

TILE = 8
_CARVED = 0.4
"""How far a voxel that is seen through goes towards being free, whatever its weight."""


@nb.njit(cache=True, nogil=True)
def farthest_tiles(depth: Float32Array, rows: int, columns: int) -> Float32Array:
    """Largest depth in each tile of TILE x TILE pixels of an image (n_pixels)."""
    out = np.zeros((rows // TILE + 1, columns // TILE + 1), dtype=np.float32)
    for r in range(rows):
        for c in range(columns):
            out[r // TILE, c // TILE] = max(out[r // TILE, c // TILE], depth[r * columns + c])
    return out


@nb.njit(cache=True, nogil=True)
def blocks_before(
    coordinates: Int32Array,
    block: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    farthest: Float32Array,
    margin: float,
) -> Int64Array:
    """Numbers of the blocks that a camera (pose R, t; lens fx, fy, cx, cy) may see through.

    ``farthest`` is what :func:`farthest_tiles` gives; a block is left out where it lies behind all tiles around it, or
    less than ``margin`` before them.
    """
    seen = np.empty(coordinates.shape[0], dtype=np.int64)
    count = 0
    radius = 0.8661 * block
    last_row, last_column = farthest.shape[0] - 1, farthest.shape[1] - 1
    for n in range(coordinates.shape[0]):
        dx = (coordinates[n, 0] + 0.4375) * block - t[0]
        dy = (coordinates[n, 1] + 0.4375) * block - t[1]
        dz = (coordinates[n, 2] + 0.4375) * block - t[2]
        z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
        if z < 0.1:
            continue
        u = lens[0] * (R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz) / z + lens[2]
        v = lens[1] * (R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz) / z + lens[3]
        reach = 1.3 * max(lens[0], lens[1]) * radius / max(z - radius, 0.05) + 40.0 * (lens[4] != 0.0) + 2.0
        c0, c1 = math.floor((u - reach) / TILE), math.floor((u + reach) / TILE)
        r0, r1 = math.floor((v - reach) / TILE), math.floor((v + reach) / TILE)
        if c1 < 0 or r1 < 0 or c0 > last_column or r0 > last_row:
            continue
        found = False
        for r in range(max(r0, 0), min(r1, last_row) + 1):
            for c in range(max(c0, 0), min(c1, last_column) + 1):
                if farthest[r, c] > z - radius + margin:
                    found = True
        if found:
            seen[count] = n
            count += 1
    return seen[:count]


@nb.njit(cache=True, nogil=True)
def carve_blocks(
    numbers: Int64Array,
    coordinates: Int32Array,
    distance: Float32Array,
    weight: Float32Array,
    voxel: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    table: Int32Array,
    margin: int,
    free: Float32Array,
    band: float,
) -> None:
    """Make free what a frame sees through: two or three frames do away with what is no longer there.

    ``free`` (n_pixels) is the depth up to which all of a pixel's surroundings see nothing, 0 where that isn't known;
    the rest is as in :func:`fuse_blocks`. Nearer to it than two bands and three standard deviations nothing changes.
    """
    f4 = np.float32
    rows, columns = table.shape
    fx, fy = f4(lens[0]), f4(lens[1])
    cx, cy = f4(lens[2] + margin + 0.5), f4(lens[3] + margin + 0.5)
    band4, one, zero = f4(band), f4(1.0), f4(0.0)
    width, height = f4(columns), f4(rows)
    for number in numbers:
        ox = coordinates[number, 0] * SIDE * voxel - t[0]
        oy = coordinates[number, 1] * SIDE * voxel - t[1]
        oz = coordinates[number, 2] * SIDE * voxel - t[2]
        for index in range(SIDE * SIDE * SIDE):
            if not (weight[number, index] > zero and distance[number, index] < f4(0.5) * band4):
                continue  # unknown, or free already
            wx = ox + (index >> 6) * voxel
            wy = oy + ((index >> 3) & 7) * voxel
            wz = oz + (index & 7) * voxel
            z = f4(R[0, 2] * wx + R[1, 2] * wy + R[2, 2] * wz)
            if z < f4(0.05):
                continue
            u = fx * f4(R[0, 0] * wx + R[1, 0] * wy + R[2, 0] * wz) / z + cx
            v = fy * f4(R[0, 1] * wx + R[1, 1] * wy + R[2, 1] * wz) / z + cy
            if not (zero <= u < width and zero <= v < height):
                continue
            pixel = table[int(v), int(u)]
            if pixel < 0:
                continue
            beyond = free[pixel]
            if beyond - z > f4(2.0) * band4 + f4(3.0 * depth_sigma(np.float64(beyond))):
                old = weight[number, index]
                share = max(f4(_CARVED), one / (one + old))
                distance[number, index] += share * (band4 - distance[number, index])
                if distance[number, index] > f4(0.5) * band4:
                    distance[number, index] = band4
                weight[number, index] = max((one - share) * old, f4(0.05))


@nb.njit(cache=True, nogil=True)
def nearest_around(depth: Float32Array, reach: int) -> Float32Array:
    """Least depth (n_pixels) within some pixels of each; 0 where one of them has none."""
    rows, columns = depth.shape
    across = np.zeros((rows, columns), dtype=np.float32)
    for r in range(rows):
        for c in range(reach, columns - reach):
            least = depth[r, c]
            for k in range(c - reach, c + reach + 1):
                least = min(least, depth[r, k])
            across[r, c] = least
    out = np.zeros(rows * columns, dtype=np.float32)
    for r in range(reach, rows - reach):
        for c in range(columns):
            least = across[r, c]
            for k in range(r - reach, r + reach + 1):
                least = min(least, across[k, c])
            out[r * columns + c] = least
    return out
