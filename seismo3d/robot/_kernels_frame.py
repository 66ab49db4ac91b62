"""Kernels that turn a depth image into filtered vertices and normals; see :mod:`seismo3d.robot.frames`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array

DEPTH_BIT, SLOPE_BIT, ROOT_BIT = 44, 34, 24
"""Where a packed pixel's parts begin: 20 bits of depth, 10 of slope, 10 of the weight's root, 24 for a colour."""
DEPTH_UNIT, SLOPE_UNIT, ROOT_UNIT = 2.0**-14, 2.0**-9, 2.0**-9
TEN_BITS = np.uint32(1023)
FARTHEST = 60.0
"""Depths up to this can be packed, metres."""


@nb.njit(cache=True, nogil=True, inline="always")
def depth_sigma(z: float) -> float:
    """Return the standard deviation of a structured-light sensor's depth, metres (Nguyen, Izadi, Lovell 2012)."""
    return 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def halve(
    first: int, last: int, depth: Float32Array, rays: Float32Array, near: float, far: float, out: Float32Array
) -> None:
    """Fill some rows of vertices (rows / 2, columns / 2, 3): means of 2 x 2 pixels, and neighbours, on one surface.

    Pixels farther than four standard deviations from the median of the four are left out.
    """
    f4 = np.float32
    columns = depth.shape[1] // 2
    middle, reach, n = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    x, y, z = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    for r in range(first, last):
        _middle_depths(depth[2 * r], depth[2 * r + 1], near, far, middle)
        for c in range(columns):
            off = middle[c] - f4(0.4)
            reach[c] = f4(4.0) * (f4(0.0012) + f4(0.0019) * off * off) if middle[c] > f4(0.0) else f4(-1.0)
            x[c] = y[c] = z[c] = n[c] = f4(0.0)
        for rr in range(max(2 * r - 1, 0), min(2 * r + 3, depth.shape[0])):
            row, ray = depth[rr], rays[rr].reshape(-1)
            for dc in range(-1, 3):
                start = 1 if dc < 0 else 0
                stop = columns if 2 * (columns - 1) + dc < depth.shape[1] else columns - 1
                for c in range(start, stop):
                    value = row[2 * c + dc]
                    kept = value if abs(value - middle[c]) < reach[c] else f4(0.0)
                    x[c] += kept * ray[4 * c + 2 * dc]
                    y[c] += kept * ray[4 * c + 2 * dc + 1]
                    z[c] += kept
                    n[c] += f4(1.0) if kept > f4(0.0) else f4(0.0)
        for c in range(columns):
            share = f4(1.0) / max(n[c], f4(1.0)) if n[c] >= f4(3.0) else f4(0.0)
            out[r, c, 0], out[r, c, 1], out[r, c, 2] = x[c] * share, y[c] * share, z[c] * share


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _middle_depths(upper: Float32Array, lower: Float32Array, near: float, far: float, out: Float32Array) -> None:
    """Median (of two the lower) of the depths from ``near`` to ``far`` of each 2 x 2 pixels; 0 for fewer than two."""
    f4 = np.float32
    none = f4(np.inf)
    for c in range(out.shape[0]):
        a, b, d, e = upper[2 * c], upper[2 * c + 1], lower[2 * c], lower[2 * c + 1]
        a = a if (a > near) & (a < far) else none
        b = b if (b > near) & (b < far) else none
        d = d if (d > near) & (d < far) else none
        e = e if (e > near) & (e < far) else none
        a, b = min(a, b), max(a, b)
        d, e = min(d, e), max(d, e)
        lowest, high, low = min(a, d), max(a, d), min(b, e)
        second, third = min(high, low), max(high, low)
        # two values: the lower; three and four: the second
        found = lowest if third == none else second
        out[c] = found if second < none else f4(0.0)


@nb.njit(cache=True, nogil=True)
def grid_normals(first: int, last: int, vertices: Float32Array, reach: int, out: Float32Array) -> None:
    """Fill some rows of unit normals (rows, columns, 3) towards the camera over +-reach pixels; zero at jumps of depth.

    They are zero as near to the rim, too.
    """
    rows, columns, _ = vertices.shape
    for r in range(first, last):
        out[r] = 0.0
        if r < reach or r >= rows - reach:
            continue
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


@nb.njit(cache=True, nogil=True)
def pack_pixels(
    first: int,
    last: int,
    depth: Float32Array,
    vertices: Float32Array,
    normals: Float32Array,
    far: float,
    out: AnyArray,
) -> None:
    """Pack pixels of the full image (n_pixels), those under some rows of the half image; 0 for those without.

    What no vertex lies over, at the end of an odd row, is left as it is. Packed are depth, how far along the surface's
    normal a metre before it in depth is, root of the weight for fusion.
    """
    columns = depth.shape[1]
    at_metre = depth_sigma(1.0) ** 2
    for hr in range(first, last):
        for hc in range(vertices.shape[1]):
            upper, lower = 2 * hr * columns + 2 * hc, (2 * hr + 1) * columns + 2 * hc
            out[upper] = out[upper + 1] = out[lower] = out[lower + 1] = 0
            nx, ny, nz = normals[hr, hc, 0], normals[hr, hc, 1], normals[hr, hc, 2]
            if nx == 0.0 and ny == 0.0 and nz == 0.0:
                continue
            x, y, w = vertices[hr, hc, 0], vertices[hr, hc, 1], vertices[hr, hc, 2]
            along = -(x * nx + y * ny + w * nz)
            cosine = along / math.sqrt(x * x + y * y + w * w)
            if cosine < 0.15:
                continue
            sigma = depth_sigma(w)
            root = min(max(math.sqrt(cosine * at_metre) / (sigma * ROOT_UNIT) + 0.5, 1.0), 1023.0)
            slope = min(along / (w * SLOPE_UNIT) + 0.5, 1023.0)
            code = (np.uint64(slope) << np.uint64(SLOPE_BIT)) | (np.uint64(root) << np.uint64(ROOT_BIT))
            for k in range(4):
                r, c = 2 * hr + (k >> 1), 2 * hc + (k & 1)
                z = depth[r, c]
                if 0.0 < z < far and abs(w - z) < 6.0 * sigma + 0.02 * z:
                    out[r * columns + c] = code | (np.uint64(z / DEPTH_UNIT + 0.5) << np.uint64(DEPTH_BIT))


def unpack_pixels(pixels: AnyArray) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Return depth, slope and weight of packed pixels, each of their shape."""
    depth = (pixels >> np.uint64(DEPTH_BIT)).astype(np.float32) * np.float32(DEPTH_UNIT)
    slope, root = ((pixels >> np.uint64(bit) & np.uint64(1023)).astype(np.float32) for bit in (SLOPE_BIT, ROOT_BIT))
    return depth, slope * np.float32(SLOPE_UNIT), (root * np.float32(ROOT_UNIT)) ** 2
