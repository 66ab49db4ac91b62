"""The voxel whose centroid is nearest to a point."""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import AXIS_BITS, AXIS_MASK, find


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
