"""Kernels that turn a depth image into filtered vertices and normals; see :mod:`seismo3d.robot.frames`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array


@nb.njit(cache=True, nogil=True, inline="always")
def depth_sigma(z: float) -> float:
    """Return the standard deviation of a structured-light sensor's depth, metres (Nguyen, Izadi, Lovell 2012)."""
    return 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4)


@nb.njit(cache=True, nogil=True)
def halve(depth: Float32Array, rays: Float32Array, near: float, far: float) -> Float32Array:
    """Vertices (rows / 2, columns / 2, 3) of the mean of each 2 x 2 pixels, and their neighbours, on one surface.

    Pixels farther than four standard deviations from the median of the four are left out.
    """
    rows, columns = depth.shape[0] // 2, depth.shape[1] // 2
    out = np.zeros((rows, columns, 3), dtype=np.float32)
    v = np.empty(4)
    for r in range(rows):
        for c in range(columns):
            n = 0
            for k in range(4):
                z = np.float64(depth[2 * r + (k >> 1), 2 * c + (k & 1)])
                if near < z < far:
                    m = n
                    while m > 0 and v[m - 1] > z:
                        v[m] = v[m - 1]
                        m -= 1
                    v[m] = z
                    n += 1
            if n < 2:
                continue
            middle = v[(n - 1) // 2]
            reach = 4.0 * depth_sigma(middle)
            total, x, y, count = 0.0, 0.0, 0.0, 0.0
            for dr in range(-1, 3):
                for dc in range(-1, 3):
                    rr, cc = 2 * r + dr, 2 * c + dc
                    if rr < 0 or cc < 0 or rr >= depth.shape[0] or cc >= depth.shape[1]:
                        continue
                    z = np.float64(depth[rr, cc])
                    if abs(z - middle) < reach:
                        total += z
                        x += z * rays[rr, cc, 0]
                        y += z * rays[rr, cc, 1]
                        count += 1.0
            if count >= 3.0:
                out[r, c, 0] = x / count
                out[r, c, 1] = y / count
                out[r, c, 2] = total / count
    return out


@nb.njit(cache=True, nogil=True)
def grid_normals(vertices: Float32Array, reach: int) -> Float32Array:
    """Return unit normals (rows, columns, 3) towards the camera over +-reach pixels; zero at jumps of depth."""
    rows, columns, _ = vertices.shape
    out = np.zeros((rows, columns, 3), dtype=np.float32)
    for r in range(reach, rows - reach):
        for c in range(reach, columns - reach):
            z = np.float64(vertices[r, c, 2])
            if not z > 0.0:
                continue
            limit = 8.0 * depth_sigma(z) + 0.05 * z * reach / 2
            zl, zr = vertices[r, c - reach, 2], vertices[r, c + reach, 2]
            zu, zd = vertices[r - reach, c, 2], vertices[r + reach, c, 2]
            if not (abs(zl - z) < limit and abs(zr - z) < limit and abs(zu - z) < limit and abs(zd - z) < limit):
                continue
            ax = vertices[r, c + reach, 0] - vertices[r, c - reach, 0]
            ay = vertices[r, c + reach, 1] - vertices[r, c - reach, 1]
            az = zr - zl
            bx = vertices[r + reach, c, 0] - vertices[r - reach, c, 0]
            by = vertices[r + reach, c, 1] - vertices[r - reach, c, 1]
            bz = zd - zu
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            if not size > 0.0:
                continue
            if nx * vertices[r, c, 0] + ny * vertices[r, c, 1] + nz * z > 0.0:
                size = -size
            out[r, c, 0] = nx / size
            out[r, c, 1] = ny / size
            out[r, c, 2] = nz / size
    return out


@nb.njit(cache=True, nogil=True)
def weigh_pixels(depth: Float32Array, vertices: Float32Array, normals: Float32Array, far: float) -> Float32Array:
    """Depth, cosine between ray and normal, and weight for fusion of each pixel of the full image, (n_pixels, 3)."""
    rows, columns = depth.shape
    out = np.zeros((rows * columns, 3), dtype=np.float32)
    at_metre = depth_sigma(1.0) ** 2
    for hr in range(vertices.shape[0]):
        for hc in range(vertices.shape[1]):
            nx, ny, nz = normals[hr, hc, 0], normals[hr, hc, 1], normals[hr, hc, 2]
            if nx == 0.0 and ny == 0.0 and nz == 0.0:
                continue
            x, y, w = vertices[hr, hc, 0], vertices[hr, hc, 1], vertices[hr, hc, 2]
            cosine = -(x * nx + y * ny + w * nz) / math.sqrt(x * x + y * y + w * w)
            if cosine < 0.15:
                continue
            sigma = depth_sigma(w)
            trust = cosine * at_metre / (sigma * sigma)
            for k in range(4):
                r, c = 2 * hr + (k >> 1), 2 * hc + (k & 1)
                z = depth[r, c]
                if 0.0 < z < far and abs(w - z) < 6.0 * sigma + 0.02 * z:
                    i = r * columns + c
                    out[i, 0], out[i, 1], out[i, 2] = z, cosine, trust
    return out


@nb.njit(cache=True, nogil=True)
def freeze_shutter(depth: Float32Array, rays: Float32Array, motion: Float32Array, focal: Float32Array) -> Float32Array:
    """Depth image as if all rows had been exposed at once.

    ``motion`` (rows, 3, 4) carries points of a row's camera frame into the frame of the image's own time. The nearest
    surface wins where two pixels land on one.
    """
    rows, columns = depth.shape
    out = np.zeros_like(depth)
    for r in range(rows):
        m = motion[r]
        for c in range(columns):
            z = depth[r, c]
            if not z > 0.0:
                continue
            x, y = z * rays[r, c, 0], z * rays[r, c, 1]
            nx = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
            ny = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
            nz = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            if nz < 0.05:
                continue
            cc = math.floor(c + focal[0] * (nx / nz - rays[r, c, 0]) + 0.5)
            rr = math.floor(r + focal[1] * (ny / nz - rays[r, c, 1]) + 0.5)
            if 0 <= cc < columns and 0 <= rr < rows and (out[rr, cc] == 0.0 or nz < out[rr, cc]):
                out[rr, cc] = nz
    return out


@nb.njit(cache=True, nogil=True)
def colour_at_depth(
    first: int,
    last: int,
    rgb: AnyArray,
    depth: Float32Array,
    rays: Float32Array,
    motion: Float32Array,
    focal: Float32Array,
    out: AnyArray,
) -> None:
    """Colour of each pixel of some rows of a depth image taken at another time; zero where there is none.

    ``motion`` (rows, 3, 4) carries points of the depth's camera frame into the frame of each row of the colour image;
    the row is found from the pixel's own first.
    """
    rows, columns = depth.shape
    for r in range(first, last):
        for c in range(columns):
            z = depth[r, c]
            if not z > 0.0:
                continue
            x, y = z * rays[r, c, 0], z * rays[r, c, 1]
            rr, cc = r, c
            for _ in range(2):
                m = motion[rr]
                nx = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
                ny = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
                nz = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                if nz < 0.05:
                    rr = -1
                    break
                cc = math.floor(c + focal[0] * (nx / nz - rays[r, c, 0]) + 0.5)
                rr = math.floor(r + focal[1] * (ny / nz - rays[r, c, 1]) + 0.5)
                if not (0 <= cc < columns and 0 <= rr < rows):
                    rr = -1
                    break
            if rr >= 0:
                for k in range(3):
                    out[r, c, k] = max(rgb[rr, cc, k], np.uint8(1))
