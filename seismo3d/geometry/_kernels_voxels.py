"""Voxel maps by hashing: points to voxels with their moments, coarser maps, normals from neighbours, nearest voxels.

A voxel's key packs its three integer coordinates into 21 bits each; points of the plane have the third coordinate zero.
Moments of a voxel are (count, sums of x, y, z, sums of xx, xy, xz, yy, yz, zz). Hash tables are open, with linear
probing; a table holds the voxel's number, or -1.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array

AXIS_BITS = 21
AXIS_MASK = (1 << AXIS_BITS) - 1
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


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


@nb.njit(cache=True, nogil=True, inline="always")
def slot(key: Any, shift: int) -> Any:
    """First place of a key in a table of 2^(64 - shift) places; four voxels along the last axis lie side by side."""
    return (np.int64((np.uint64(key >> 2) * _GOLDEN) >> np.uint64(shift)) & ~3) | (key & 3)


@nb.njit(cache=True, nogil=True, inline="always")
def find(key: Any, table_keys: Int64Array, table: Int32Array, shift: int) -> int:
    """Return the number of the voxel with a key, or -1."""
    mask = table.shape[0] - 1
    place = slot(key, shift)
    while True:
        number = table[place]
        if number < 0:
            return -1
        if table_keys[place] == key:
            return number
        place = (place + 1) & mask


@nb.njit(cache=True, nogil=True)
def make_table(keys: Int64Array) -> tuple[Int64Array, Int32Array, int]:
    """Return a hash table of distinct keys: keys by place, numbers by place, shift."""
    return _table_with_room(keys, keys.shape[0])


@nb.njit(cache=True, nogil=True)
def _table_with_room(keys: Int64Array, room: int) -> tuple[Int64Array, Int32Array, int]:
    """Return a table of keys that has places for three times as many as ``room``."""
    bits = 4
    while (1 << bits) < 3 * room:
        bits += 1
    table = np.full(1 << bits, -1, dtype=np.int32)
    table_keys = np.empty(1 << bits, dtype=np.int64)
    mask = (1 << bits) - 1
    shift = 64 - bits
    for i in range(keys.shape[0]):
        place = slot(keys[i], shift)
        while table[place] >= 0:
            place = (place + 1) & mask
        table[place] = i
        table_keys[place] = keys[i]
    return table_keys, table, shift


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
        table_keys, table, shift = _table_with_room(keys[:count], room)
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


@nb.njit(cache=True, nogil=True, inline="always")
def cell_around(
    x: float, y: float, z: float, turn: Float64Array, origin: Float64Array, inverse_size: float, d: int
) -> Any:
    """Return the key of the cell that a point lies in, -2 outside of all."""
    fx = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z - origin[0]) * inverse_size
    fy = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z - origin[1]) * inverse_size
    fz = (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z - origin[2]) * inverse_size
    if d == 2:
        fz = 0.5
    if not (fx > 0.0 and fy > 0.0 and fz > 0.0 and fx < AXIS_MASK and fy < AXIS_MASK and fz < AXIS_MASK):
        return -2
    return (np.int64(fx) << (2 * AXIS_BITS)) | (np.int64(fy) << AXIS_BITS) | np.int64(fz)


@nb.njit(cache=True, nogil=True, inline="always")
def _sides(fraction: float, size2: float) -> tuple[float, float]:
    """Squared distances to the nearer and to the farther wall of the cell, from the fraction of the way through it."""
    other = 1.0 - fraction
    low, high = min(fraction, other), max(fraction, other)
    return low * low * size2, high * high * size2


@nb.njit(cache=True, nogil=True, inline="always")
def _beyond(distance2: float, margin: float) -> float:
    """Squared distance that is greater by a margin than a squared distance."""
    if margin == 0.0:
        return distance2
    distance = math.sqrt(distance2) + margin
    return distance * distance


@nb.njit(cache=True, nogil=True, inline="always")
def nearest_voxel(
    x: float,
    y: float,
    z: float,
    turn: Float64Array,
    origin: Float64Array,
    inverse_size: float,
    d: int,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    surface: Float32Array,
    radius2: float,
    margin: float,
) -> tuple[int, float]:
    """Return the voxel whose centroid is nearest among the 3^d cells around a point, within a radius, and what is next.

    The voxel is -1 where there is none. The second number bounds the squared distance of all other centroids in those
    cells from below; it is exact up to ``margin`` beyond the nearest one (beyond the radius where there is none). Cells
    come in order of their distance along each axis; those farther than the best so far by more than the margin are not
    looked up. An element that joined layers moved out of its cell may be missed for the neighbour's that it was joined
    with.
    """
    fx = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z - origin[0]) * inverse_size
    fy = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z - origin[1]) * inverse_size
    fz = (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z - origin[2]) * inverse_size
    if d == 2:
        fz = 0.5
    if not (fx > 0.0 and fy > 0.0 and fz > 0.0 and fx < AXIS_MASK and fy < AXIS_MASK and fz < AXIS_MASK):
        return -1, 0.0
    ix, iy, iz = np.int64(fx), np.int64(fy), np.int64(fz)
    sx = 1 if fx - ix >= 0.5 else -1
    sy = 1 if fy - iy >= 0.5 else -1
    sz = 1 if fz - iz >= 0.5 else -1
    size2 = 1.0 / (inverse_size * inverse_size)
    near_x, far_x = _sides(fx - ix, size2)
    near_y, far_y = _sides(fy - iy, size2)
    near_z, far_z = _sides(fz - iz, size2)
    best = radius2
    far = _beyond(best, margin)
    other = far
    found = -1
    for a in range(3):
        dx = 0 if a == 0 else (sx if a == 1 else -sx)
        bound_x = 0.0 if a == 0 else (near_x if a == 1 else far_x)
        if bound_x >= far or ix + dx < 0:
            continue
        for b in range(3):
            dy = 0 if b == 0 else (sy if b == 1 else -sy)
            bound_y = bound_x + (0.0 if b == 0 else (near_y if b == 1 else far_y))
            if bound_y >= far or iy + dy < 0:
                continue
            column = ((ix + dx) << (2 * AXIS_BITS)) | ((iy + dy) << AXIS_BITS)
            for c in range(3 if d == 3 else 1):
                dz = 0 if c == 0 else (sz if c == 1 else -sz)
                bound = bound_y + (0.0 if c == 0 else (near_z if c == 1 else far_z))
                if bound >= far or iz + dz < 0:
                    continue
                j = find(column | (iz + dz) if d == 3 else column, table_keys, table, shift)
                if j >= 0:
                    ex, ey, ez = surface[j, 0] - x, surface[j, 1] - y, surface[j, 2] - z
                    distance = ex * ex + ey * ey + ez * ez
                    if distance < best:
                        if found >= 0:
                            other = min(other, best)
                        best = distance
                        far = _beyond(best, margin)
                        found = j
                    else:
                        other = min(other, distance)
    return found, min(other, far)
