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
    f4, i4 = np.float32, np.int32
    rows, columns = depth_before.shape
    n = vertices.shape[1] // 2
    place, needed = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.float32)
    # from the one camera to the other, in the half image's pixels
    A, b = np.empty((3, 3), dtype=np.float32), np.empty(3, dtype=np.float32)
    for i in range(3):
        scale = lens[i] if i < 2 else 1.0
        b[i] = scale * (R_before[:, i] * (t - t_before)).sum()
        for j in range(3):
            A[i, j] = scale * (R_before[:, i] * R[:, j]).sum()
    a00, a01, a02, a10, a11, a12 = A[0, 0], A[0, 1], A[0, 2], A[1, 0], A[1, 1], A[1, 2]
    a20, a21, a22, b0, b1, b2 = A[2, 0], A[2, 1], A[2, 2], b[0], b[1], b[2]
    cx, cy, width, height = f4(lens[2] + 0.5), f4(lens[3] + 0.5), f4(columns - 1), f4(rows - 1)
    near, zero, one, stride = f4(0.1), f4(0.0), f4(1.0), i4(columns)
    for r in range(0, vertices.shape[0] - 1, 2):
        row = vertices[r].reshape(-1)
        # all of a row side by side, so that the processor's vectors take many in a step
        for k in range(n):
            x, y, z = row[6 * k], row[6 * k + 1], row[6 * k + 2]
            depth = a20 * x + a21 * y + a22 * z + b2
            inverse = one / max(depth, near)
            u = (a00 * x + a01 * y + a02 * z + b0) * inverse + cx
            v = (a10 * x + a11 * y + a12 * z + b1) * inverse + cy
            inside = (z > zero) & (depth >= near) & (u >= one) & (v >= one) & (u < width) & (v < height)
            at = i4(i4(i4(v) * stride) + i4(u))
            place[k] = at if inside else i4(-1)
            off = depth - f4(0.4)
            needed[k] = depth + f4(0.06) + f4(5.0) * (f4(0.0012) + f4(0.0019) * off * off)
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
