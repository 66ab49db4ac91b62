"""Surface elements of voxels: centroid, quality and normal from a voxel's moments and its neighbours'."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import AXIS_BITS, find


@nb.njit(cache=True, nogil=True)
def smallest_eigenvector(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float, out: Float64Array) -> None:
    """Write the eigenvector of the smallest eigenvalue of a 3 x 3 matrix, then the eigenvalues, ascending."""
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    p2 = (a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0
    if p2 <= 1e-300:
        out[0], out[1], out[2] = 0.0, 0.0, 1.0
        out[3] = out[4] = out[5] = mean
        return
    p = math.sqrt(p2)
    det = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    half = min(1.0, max(-1.0, det / (2.0 * p * p2)))
    angle = math.acos(half) / 3.0
    large = mean + 2.0 * p * math.cos(angle)
    small = mean + 2.0 * p * math.cos(angle + 2.0943951023931953)
    out[3], out[4], out[5] = small, 3.0 * mean - large - small, large
    a, b, c = xx - small, yy - small, zz - small
    best = -1.0
    for k in range(3):
        if k == 0:
            x, y, z = xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy
        elif k == 1:
            x, y, z = xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz
        else:
            x, y, z = b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz
        length = x * x + y * y + z * z
        if length > best:
            best = length
            out[0], out[1], out[2] = x, y, z
    if best <= 1e-300:
        out[0], out[1], out[2] = 0.0, 0.0, 1.0
        return
    root = math.sqrt(best)
    out[0] /= root
    out[1] /= root
    out[2] /= root


@nb.njit(cache=True, nogil=True)
def voxel_normals(
    keys: Int64Array,
    moments: Float64Array,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    d: int,
    rows: Int64Array,
    out: Float32Array,
) -> None:
    """Write, for the voxels of some rows, (centroid, quality, normal) from the moments of them and their neighbours.

    Quality is 0 where the neighbours do not span a surface (a line, a blob or too few points), else up to 1.
    """
    m = np.empty(10)
    eigen = np.empty(6)
    reach = 1 if d == 3 else 0
    for i in rows:
        for k in range(10):
            m[k] = moments[i, k]
        for k in range(3):
            out[i, k] = m[1 + k] / m[0]
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-reach, reach + 1):
                    if dx == 0 and dy == 0 and dz == 0:
                        continue
                    key = keys[i] + (np.int64(dx) << (2 * AXIS_BITS)) + (np.int64(dy) << AXIS_BITS) + dz
                    j = find(key, table_keys, table, shift)
                    if j >= 0:
                        for k in range(10):
                            m[k] += moments[j, k]
        w = 1.0 / m[0]
        x, y, z = m[1] * w, m[2] * w, m[3] * w
        xx, xy, yy = m[4] * w - x * x, m[5] * w - x * y, m[7] * w - y * y
        xz, yz, zz = m[6] * w - x * z, m[8] * w - y * z, m[9] * w - z * z
        if d == 2:
            zz = 4.0 * (xx + yy) + 1e-30
            smallest_eigenvector(xx, xy, 0.0, yy, 0.0, zz, eigen)
            flat = eigen[3] / max(eigen[4], 1e-300)
            quality = 1.0 - 2.0 * math.sqrt(max(flat, 0.0)) if m[0] >= 3.0 else 0.0
        else:
            smallest_eigenvector(xx, xy, xz, yy, yz, zz, eigen)
            thin = math.sqrt(max(eigen[3], 0.0) / max(eigen[4], 1e-300))
            wide = math.sqrt(max(eigen[4], 0.0) / max(eigen[5], 1e-300))
            quality = (1.0 - 1.4 * thin) * min(1.0, 4.0 * wide) if m[0] >= 5.0 and wide > 0.08 else 0.0
        out[i, 3] = max(0.0, quality)
        for k in range(3):
            out[i, 4 + k] = eigen[k]


@nb.njit(cache=True, nogil=True)
def join_layers(
    keys: Int64Array,
    moments: Float64Array,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    turn: Float64Array,
    most: float,
    rows: Int64Array,
    out: Float32Array,
) -> None:
    """Move elements along their normal to the middle of all layers of voxels that one noisy surface fills.

    Noise puts part of the points of a surface near a voxel's wall across it, and each part's own centroid is drawn to
    its side: errors that all elements along the wall share. Together with the neighbours along the axis that is nearest
    to the normal the level is right. Neighbours whose level differs by ``most`` or more belong to another surface.
    """
    for i in rows:
        p, q, r = out[i, 4], out[i, 5], out[i, 6]
        a = abs(turn[0, 0] * p + turn[0, 1] * q + turn[0, 2] * r)
        b = abs(turn[1, 0] * p + turn[1, 1] * q + turn[1, 2] * r)
        c = abs(turn[2, 0] * p + turn[2, 1] * q + turn[2, 2] * r)
        if a + b + c == 0.0:
            continue
        step = np.int64(1)
        if a >= b and a >= c:
            step = np.int64(1) << (2 * AXIS_BITS)
        elif b >= c:
            step = np.int64(1) << AXIS_BITS
        n = moments[i, 0]
        x, y, z = moments[i, 1] / n, moments[i, 2] / n, moments[i, 3] / n
        level = 0.0
        for side in (-1, 1):
            j = find(keys[i] + side * step, table_keys, table, shift)
            if j >= 0:
                m = moments[j, 0]
                gap = p * (moments[j, 1] / m - x) + q * (moments[j, 2] / m - y) + r * (moments[j, 3] / m - z)
                if abs(gap) < most:
                    n += m
                    level += m * gap
        level /= n
        out[i, 0], out[i, 1], out[i, 2] = x + level * p, y + level * q, z + level * r


@nb.njit(cache=True, nogil=True)
def centroids_only(moments: Float64Array, quality: float, out: Float32Array) -> None:
    """Write (centroid, a given quality, no normal) of each voxel."""
    for i in range(moments.shape[0]):
        w = 1.0 / moments[i, 0]
        for k in range(3):
            out[i, k] = moments[i, 1 + k] * w
            out[i, 4 + k] = 0.0
        out[i, 3] = quality


@nb.njit(cache=True, nogil=True)
def tensor_normals(moments: Float64Array, tensors: Float64Array, d: int, out: Float32Array) -> None:
    """Write (centroid, quality, normal) of each voxel from the sums of its points' normals n n'.

    The normal is the direction that the normals have most in common; quality is low where they disagree.
    """
    eigen = np.empty(6)
    for i in range(moments.shape[0]):
        w = 1.0 / moments[i, 0]
        for k in range(3):
            out[i, k] = moments[i, 1 + k] * w
        xx, xy, xz = -tensors[i, 0] * w, -tensors[i, 1] * w, -tensors[i, 2] * w
        yy, yz, zz = -tensors[i, 3] * w, -tensors[i, 4] * w, -tensors[i, 5] * w
        smallest_eigenvector(xx, xy, xz, yy, yz, zz, eigen)
        out[i, 3] = max(0.0, 2.0 * (-eigen[3]) - 1.0)
        for k in range(3):
            out[i, 4 + k] = eigen[k] if k < d else 0.0


@nb.njit(cache=True, nogil=True)
def inherit_normals(
    fine: Float32Array, coarse: Float32Array, parent: Int32Array, rows: Int64Array, least: float
) -> None:
    """Give voxels whose own neighbours do not span a surface their parent's normal, at half its quality."""
    for i in rows:
        j = parent[i]
        if fine[i, 3] < least and 0.5 * coarse[j, 3] > fine[i, 3]:
            fine[i, 3] = 0.5 * coarse[j, 3]
            for k in range(4, 7):
                fine[i, k] = coarse[j, k]
