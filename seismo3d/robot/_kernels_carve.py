"""Kernels that clear what a frame sees through; see :mod:`seismo3d.robot.tsdf`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.robot._kernels_blocks import SIDE
from seismo3d.robot._kernels_frame import depth_sigma
from seismo3d.robot._kernels_fuse import VOXELS, project_block, voxel_offsets
from seismo3d.robot.voxels import STEPS, SURFACE, WHOLE

TILE = 8
_CARVED = 0.64
"""How far a voxel that is seen through goes towards being free, whatever its weight."""


@nb.njit(cache=True, nogil=True)
def farthest_tiles(depth: Float32Array, rows: int, columns: int) -> Float32Array:
    """Largest depth that a tile of TILE x TILE pixels of an image (n_pixels or more) surely sees through to.

    That is the depth less three standard deviations.
    """
    out = np.zeros((rows // TILE + 1, columns // TILE + 1), dtype=np.float32)
    for r in range(rows):
        for c in range(columns):
            out[r // TILE, c // TILE] = max(out[r // TILE, c // TILE], depth[r * columns + c])
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[r, c] -= np.float32(3.0 * depth_sigma(np.float64(out[r, c])))
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def blocks_before(
    first: int,
    last: int,
    coordinates: Int32Array,
    block: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    margin: int,
    farthest: Float32Array,
    gap: float,
) -> Int64Array:
    """Numbers of those of some blocks that a camera (pose R, t; lens fx, fy, cx, cy) may see through.

    ``farthest`` is what :func:`farthest_tiles` gives of an image without distortion and with a margin; a block is left
    out where it lies behind all tiles that it covers, or less than ``gap`` before them.
    """
    seen = np.empty(last - first, dtype=np.int64)
    count = 0
    radius = math.sqrt(3.0) * (SIDE - 1) / (2 * SIDE) * block
    middle = (SIDE - 1) / (2 * SIDE)
    last_row, last_column = farthest.shape[0] - 1, farthest.shape[1] - 1
    for n in range(first, last):
        dx = (coordinates[n, 0] + middle) * block - t[0]
        dy = (coordinates[n, 1] + middle) * block - t[1]
        dz = (coordinates[n, 2] + middle) * block - t[2]
        z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
        nearest = max(z - radius, 0.05)
        if z + radius < 0.05:
            continue
        x = (R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz) / max(z, 0.05)
        y = (R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz) / max(z, 0.05)
        u, v = lens[0] * x + lens[2] + margin, lens[1] * y + lens[3] + margin
        reach_u = 1.0 + lens[0] * radius * math.sqrt(1.0 + x * x) / nearest
        reach_v = 1.0 + lens[1] * radius * math.sqrt(1.0 + y * y) / nearest
        c0, c1 = max((u - reach_u) / TILE, 0.0), min((u + reach_u) / TILE, last_column + 0.5)
        r0, r1 = max((v - reach_v) / TILE, 0.0), min((v + reach_v) / TILE, last_row + 0.5)
        if not (c0 <= c1 and r0 <= r1):
            continue
        if _any_beyond(farthest, int(r0), int(r1), int(c0), int(c1), z - radius + gap):
            seen[count] = n
            count += 1
    return seen[:count]


@nb.njit(cache=True, nogil=True)
def _any_beyond(farthest: Float32Array, r0: int, r1: int, c0: int, c1: int, depth: float) -> bool:
    for r in range(r0, r1 + 1):
        for c in range(c0, c1 + 1):
            if farthest[r, c] > depth:
                return True
    return False


@nb.njit(cache=True, nogil=True, error_model="numpy")
def carve_blocks(
    numbers: Int64Array,
    coordinates: Int32Array,
    distance: AnyArray,
    root: AnyArray,
    voxel: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    shape: tuple[int, int],
    margin: int,
    free: Float32Array,
    band: float,
    heaviest: float,
) -> None:
    """Make free what a frame sees through: two frames do away with what is no longer there.

    ``free`` (n + 1) is, in the image without distortion, the depth up to which all of a pixel's surroundings see
    nothing, 0 where that isn't known; the rest is as in :func:`seismo3d.robot._kernels_fuse.fuse_blocks`. Nearer to it
    than two bands and three standard deviations nothing changes.
    """
    f4, i4, u2 = np.float32, np.int32, np.uint16
    two_bands, one, zero, least, half = f4(2.0 * band), f4(1.0), f4(0.0), f4(0.05), f4(0.5)
    free_side, solid_side, unit = f4(SURFACE + STEPS), i4(SURFACE + 0.5 * STEPS), f4(heaviest / (WHOLE * WHOLE))
    lightest = f4(math.sqrt(0.05 / heaviest) * WHOLE)
    offsets = voxel_offsets(R, voxel)
    place, depth = np.empty(VOXELS, dtype=np.int32), np.empty(VOXELS, dtype=np.float32)
    beyond, cut = np.empty(VOXELS, dtype=np.float32), np.empty(VOXELS, dtype=np.float32)
    for number in numbers:
        d, held = distance[number], root[number]
        n_solid = i4(0)
        for q in range(VOXELS):
            n_solid = i4(n_solid + i4((i4(d[q]) > i4(0)) & (i4(d[q]) < solid_side)))
        if n_solid == 0:
            continue  # unknown, or free already
        project_block(coordinates[number], voxel, R, t, offsets, lens, shape, margin, place, depth)
        for q in range(VOXELS):
            beyond[q] = free[np.uint64(place[q])]
        n_cut = i4(0)
        for q in range(VOXELS):
            far = beyond[q] - f4(0.4)
            needed = two_bands + f4(0.0036) + f4(0.0057) * far * far  # three times depth_sigma
            solid = (i4(d[q]) > i4(0)) & (i4(d[q]) < solid_side)
            seen_through = (beyond[q] - depth[q] > needed) & (depth[q] >= least) & solid
            weight = f4(i4(held[q])) * f4(i4(held[q])) * unit
            cut[q] = max(f4(_CARVED), one / (one + weight)) if seen_through else zero
            n_cut = i4(n_cut + i4(seen_through))
        if n_cut == 0:
            continue
        for q in range(VOXELS):
            was, had, share = f4(i4(d[q])), f4(i4(held[q])), cut[q]
            moved = was + share * (free_side - was)
            moved = free_side if moved > f4(solid_side) else moved
            left = max(np.sqrt(one - share) * had, lightest)
            d[q] = u2(i4(moved + half)) if share > zero else d[q]
            held[q] = u2(i4(left + half)) if share > zero else held[q]


@nb.njit(cache=True, nogil=True)
def straighten_depth(table: Int32Array, depth: Float32Array) -> Float32Array:
    """Depth (n + 1) of each pixel of an image without distortion, by a table of pixels; 0 last and where it is none."""
    rows, columns = table.shape
    out, flat = np.zeros(rows * columns + 1, dtype=np.float32), depth.reshape(-1)
    for r in range(rows):
        for c in range(columns):
            if table[r, c] >= 0:
                out[r * columns + c] = flat[np.uint64(table[r, c])]
    return out


@nb.njit(cache=True, nogil=True)
def nearest_around(depth: Float32Array) -> Float32Array:
    """Least depth (rows / 2, columns / 2) of 6 x 6 pixels, the two by two of each and those around; 0 for none in one.

    Also 0 at the image's rim.
    """
    rows, columns = depth.shape[0] // 2, depth.shape[1] // 2
    least, across = np.empty((rows, columns), dtype=np.float32), np.zeros((rows, columns), dtype=np.float32)
    for r in range(rows):
        upper, lower = depth[2 * r], depth[2 * r + 1]
        for c in range(columns):
            least[r, c] = min(upper[2 * c], upper[2 * c + 1], lower[2 * c], lower[2 * c + 1])
        for c in range(1, columns - 1):
            across[r, c] = min(least[r, c - 1], least[r, c + 1], least[r, c])
    out = np.zeros((rows, columns), dtype=np.float32)
    for r in range(1, rows - 1):
        for c in range(columns):
            out[r, c] = min(across[r - 1, c], across[r + 1, c], across[r, c])
    return out
