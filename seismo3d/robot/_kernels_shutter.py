"""Kernels for cameras that read row by row, and colour and depth apart; see :mod:`seismo3d.robot.frames`.

A motion is (rotation, translation) a second, in the camera's frame; over a time t it carries a point p, to second order
in the angle, to p + t (w x p + v) + t^2 / 2 w x (w x p).
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array


@nb.njit(cache=True, nogil=True, inline="always")
def _carried(w: Any, v: Any, x: Any, y: Any, z: Any, t: Any) -> Any:
    """Where a point is after a time."""
    ax, ay, az = w[1] * z - w[2] * y, w[2] * x - w[0] * z, w[0] * y - w[1] * x
    bx, by, bz = w[1] * az - w[2] * ay, w[2] * ax - w[0] * az, w[0] * ay - w[1] * ax
    h = np.float32(0.5) * t * t
    return x + t * (ax + v[0]) + h * bx, y + t * (ay + v[1]) + h * by, z + t * (az + v[2]) + h * bz


@nb.njit(cache=True, nogil=True, inline="always")
def _halves(twist: Float64Array) -> Any:
    f4 = np.float32
    return (f4(twist[0]), f4(twist[1]), f4(twist[2])), (f4(twist[3]), f4(twist[4]), f4(twist[5]))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def move_rows(
    first: int,
    last: int,
    depth: Float32Array,
    rays: Float32Array,
    twist: Float64Array,
    start: float,
    spacing: float,
    focal: Float32Array,
    place: Int32Array,
    moved: Float32Array,
) -> None:
    """Write where pixels of some rows of a depth image come to lie (-1 for outside), and their depth there.

    ``twist`` is what carries points of a row's camera frame into the frame of the image's own time, over ``start``
    seconds for the first row and ``spacing`` more for each one after it.
    """
    f4, i4 = np.float32, np.int32
    rows, columns = depth.shape
    w, v = _halves(twist)
    fx, fy, zero, half = focal[0], focal[1], f4(0.0), f4(0.5)
    width, height, stride = f4(columns), f4(rows), i4(columns)
    for r in range(first, last):
        # rays in one row: a step of two numbers, known beforehand, lets vectors take many
        row, ray, to, at_depth, t = depth[r], rays[r].reshape(-1), place[r], moved[r], f4(start + r * spacing)
        for c in range(columns):
            z, a, b = row[c], ray[2 * c], ray[2 * c + 1]
            nx, ny, nz = _carried(w, v, z * a, z * b, z, t)
            inverse = f4(1.0) / nz
            u = f4(i4(c)) + fx * (nx * inverse - a) + half
            q = f4(i4(r)) + fy * (ny * inverse - b) + half
            inside = (z > zero) & (nz >= f4(0.05)) & (u >= zero) & (u < width) & (q >= zero) & (q < height)
            at = i4(q) * stride + i4(u)
            to[c] = at if inside else i4(-1)
            at_depth[c] = nz


@nb.njit(cache=True, nogil=True)
def splat_rows(place: Int32Array, moved: Float32Array, out: Float32Array) -> None:
    """Fill the depth image of what :func:`move_rows` gave: the nearest surface wins where two pixels land on one."""
    out[:] = 0.0
    to, far, flat = place.reshape(-1), moved.reshape(-1), out.reshape(-1)
    for i in range(to.shape[0]):
        if to[i] >= 0:
            at = np.uint64(to[i])
            if flat[at] == np.float32(0.0) or far[i] < flat[at]:
                flat[at] = far[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def colour_pixels(
    first: int,
    last: int,
    colours: AnyArray,
    vertices: Float32Array,
    twist: Float64Array,
    start: float,
    spacing: float,
    focal: Float32Array,
    pixels: AnyArray,
) -> None:
    """Put colours into packed pixels (n_pixels) taken at another time, into those under some rows of the half image.

    Pixels that are 0 stay so; in the others the three lowest bytes become those of ``colours`` (rows, columns; whole
    numbers), each at least 1. ``vertices`` are those of the half image; the four pixels under one are shifted alike.
    ``twist`` is what carries points of the
    depth's camera frame into the frame of a row of the colour image, over ``start`` seconds for its first row and
    ``spacing`` more for each one after it; the row is found from the pixel's own first.
    """
    f4, i4, u4, u8 = np.float32, np.int32, np.uint32, np.uint64
    rows, columns, width = i4(colours.shape[0]), i4(colours.shape[1]), vertices.shape[1]
    place = np.empty(2 * width, dtype=np.int32)
    across, down = np.empty(vertices.shape[1], dtype=np.int32), np.empty(vertices.shape[1], dtype=np.int32)
    w, v = _halves(twist)
    fx, fy, zero, half, near, none = focal[0], focal[1], f4(0.0), f4(0.5), f4(0.05), i4(-(1 << 20))
    t0, dt, most = f4(start), f4(spacing), f4(1 << 15)
    flat = colours.reshape(-1)
    for hr in range(first, last):
        points, own = vertices[hr].reshape(-1), f4(i4(2 * hr)) + half
        for c in range(vertices.shape[1]):
            x, y, z = points[3 * c], points[3 * c + 1], points[3 * c + 2]
            inverse = f4(1.0) / max(z, near)
            a, b = x * inverse, y * inverse
            nx, ny, nz = _carried(w, v, x, y, z, t0 + own * dt)
            other = own + fy * (ny / nz - b)
            nx, ny, nz = _carried(w, v, x, y, z, t0 + other * dt)
            inverse = f4(1.0) / nz
            u, q = fx * (nx * inverse - a) + half, fy * (ny * inverse - b) + half
            seen = (z > zero) & (nz >= near) & (abs(u) < most) & (abs(q) < most)
            across[c] = i4(np.floor(u)) if seen else none
            down[c] = i4(np.floor(q)) if seen else none
        for r in range(2 * hr, 2 * hr + 2):
            for c in range(width):
                rr, cc = i4(i4(r) + down[c]), i4(i4(2 * c) + across[c])
                at, inside = i4(i4(rr * columns) + cc), (rr >= i4(0)) & (rr < rows)
                place[2 * c] = at if inside & (cc >= i4(0)) & (cc < columns) else i4(-1)
                place[2 * c + 1] = i4(at + i4(1)) if inside & (cc >= i4(-1)) & (cc < i4(columns - 1)) else i4(-1)
            to = pixels[r * columns : r * columns + 2 * width]
            for c in range(2 * width):
                if place[c] >= 0 and to[c] > u8(0):
                    code = u4(flat[u8(place[c])])
                    # the highest bit of each byte that is not 0, and so a 1 in each that is
                    some = u4(u4(u4(code & u4(0x7F7F7F)) + u4(0x7F7F7F)) | code) & u4(0x808080)
                    to[c] |= u8(u4(u4(code & u4(0xFFFFFF)) | u4(u4(some >> u4(7)) ^ u4(0x010101))))
