"""Kernels that tell what moves: places that are occupied now and were free a moment ago."""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array
from seismo3d.robot._kernels_frame import depth_sigma


@nb.njit(cache=True, nogil=True, error_model="numpy")
def mark_intruders(
    vertices: Float32Array,
    R: Float64Array,
    t: Float64Array,
    depth_before: Float32Array,
    R_before: Float64Array,
    t_before: Float64Array,
    lens: Float64Array,
    marked: BoolArray,
) -> None:
    """Mark vertices, two by two, that lie well before what an earlier depth image (half size) saw along their rays.

    (R, t) and (R_before, t_before) carry each camera's points to the world; ``lens`` is fx, fy, cx, cy of the half
    image. All of the 3 x 3 earlier pixels around must have seen farther.
    """
    rows, columns = depth_before.shape
    n = vertices.shape[1] // 2
    place, needed = np.empty(n, dtype=np.int64), np.empty(n)
    sx, sy, sz = t[0] - t_before[0], t[1] - t_before[1], t[2] - t_before[2]
    for r in range(0, vertices.shape[0] - 1, 2):
        row = vertices[r].reshape(-1)
        # all of a row side by side, so that the processor's vectors take many in a step
        for k in range(n):
            vx, vy, z = np.float64(row[6 * k]), np.float64(row[6 * k + 1]), np.float64(row[6 * k + 2])
            dx = R[0, 0] * vx + R[0, 1] * vy + R[0, 2] * z + sx
            dy = R[1, 0] * vx + R[1, 1] * vy + R[1, 2] * z + sy
            dz = R[2, 0] * vx + R[2, 1] * vy + R[2, 2] * z + sz
            depth = R_before[0, 2] * dx + R_before[1, 2] * dy + R_before[2, 2] * dz
            inverse = 1.0 / max(depth, 0.1)
            u = lens[0] * (R_before[0, 0] * dx + R_before[1, 0] * dy + R_before[2, 0] * dz) * inverse + lens[2] + 0.5
            v = lens[1] * (R_before[0, 1] * dx + R_before[1, 1] * dy + R_before[2, 1] * dz) * inverse + lens[3] + 0.5
            inside = (z > 0.0) & (depth >= 0.1) & (u >= 1.0) & (v >= 1.0) & (u < columns - 1.0) & (v < rows - 1.0)
            at = np.int64(v) * columns + np.int64(u)
            place[k] = at if inside else np.int64(-1)
            needed[k] = depth + 0.06 + 5.0 * depth_sigma(depth)
        for k in range(n):
            if place[k] < 0:
                continue
            rr, cc = place[k] // columns, place[k] % columns
            if not depth_before[rr, cc] > needed[k]:
                continue
            free = True
            for i in range(-1, 2):
                for j in range(-1, 2):
                    if not depth_before[rr + i, cc + j] > needed[k]:
                        free = False
            if free:
                marked[r : r + 2, 2 * k : 2 * k + 2] = True


@nb.njit(cache=True, nogil=True)
def erode_marked(marked: BoolArray, reach: int) -> BoolArray:
    """Return what is marked with all around it, two by two, within some steps of two; outside counts as marked."""
    rows, columns = marked.shape[0] // 2, marked.shape[1] // 2
    out = np.zeros_like(marked)
    for r in range(rows):
        for c in range(columns):
            if not marked[2 * r, 2 * c]:
                continue
            whole = True
            for i in range(max(0, r - reach), min(rows, r + reach + 1)):
                for j in range(max(0, c - reach), min(columns, c + reach + 1)):
                    if not marked[2 * i, 2 * j]:
                        whole = False
            if whole:
                out[2 * r : 2 * r + 2, 2 * c : 2 * c + 2] = True
    return out


@nb.njit(cache=True, nogil=True)
def grow_marked(vertices: Float32Array, hints: BoolArray, share: float, largest: float, marked: BoolArray) -> None:
    """Mark whole surfaces, that hang together without a jump of depth, of which at least some share is hinted at.

    Surfaces that take more than a share ``largest`` of the image are left out.
    """
    rows, columns = marked.shape[0] // 2, marked.shape[1] // 2
    seen = np.zeros((rows, columns), dtype=np.bool_)
    members = np.empty((rows * columns, 2), dtype=np.int32)
    for r in range(rows):
        for c in range(columns):
            if seen[r, c] or not hints[2 * r, 2 * c] or not vertices[2 * r, 2 * c, 2] > 0.0:
                continue
            seen[r, c] = True
            members[0, 0], members[0, 1] = r, c
            count, done, hits = 1, 0, 0
            while done < count:
                i, j = members[done]
                done += 1
                hits += hints[2 * i, 2 * j]
                z = vertices[2 * i, 2 * j, 2]
                for k in range(4):
                    a, b = i + (k == 0) - (k == 1), j + (k == 2) - (k == 3)
                    if a < 0 or b < 0 or a >= rows or b >= columns or seen[a, b]:
                        continue
                    other = vertices[2 * a, 2 * b, 2]
                    if other > 0.0 and abs(other - z) < 0.02 + 4.0 * depth_sigma(np.float64(z)):
                        seen[a, b] = True
                        members[count, 0], members[count, 1] = a, b
                        count += 1
            if hits >= share * count and count <= largest * rows * columns:
                for k in range(count):
                    i, j = members[k]
                    marked[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = True


@nb.njit(cache=True, nogil=True)
def veto_pixels(marked: BoolArray, reach: int, columns: int, pixels: AnyArray) -> None:
    """Clear the packed pixels of the full image around marked ones of the half image."""
    rows, half_columns = marked.shape
    near = np.zeros(half_columns, dtype=np.bool_)
    for r in range(rows):
        near[:] = False
        for i in range(max(0, r - reach), min(rows, r + reach + 1)):
            near |= marked[i]
        last = -reach - 1  # the last column that is marked
        for c in range(min(reach, half_columns)):
            last = c if near[c] else last
        for c in range(half_columns):
            if c + reach < half_columns and near[c + reach]:
                last = c + reach
            if c - last <= reach:
                for k in range(4):
                    pixels[(2 * r + (k >> 1)) * columns + 2 * c + (k & 1)] = 0
