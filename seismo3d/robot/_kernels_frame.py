"""Kernels that turn a depth image into filtered vertices and normals; see :mod:`seismo3d.robot.frames`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array
from seismo3d.registration.robust import NORMAL

DEPTH_BIT, SLOPE_BIT, ROOT_BIT = 44, 34, 24
"""Where a packed pixel's parts begin: 20 bits of depth, 10 of slope, 10 of the weight's root, 24 for a colour."""
DEPTH_UNIT, SLOPE_UNIT, ROOT_UNIT = 2.0**-14, 2.0**-9, 2.0**-9
TEN_BITS = np.uint32(1023)
_STEEPEST = 6.5
"""Change of depth over the way across at that depth, from which on it is a jump: that of a plane seen at 81 degrees."""
_NOISIEST, _SAMPLE, _LEAST_SAMPLES = 8.0, 4, 50
"""Times the usual noise at most that a depth image is taken to have; of how manieth pixel it is found, and of how many
at least."""
FARTHEST = 60.0
"""Depths up to this can be packed, metres."""


@nb.njit(cache=True, nogil=True, inline="always")
def depth_sigma(z: float) -> float:
    """Return the standard deviation of a structured-light sensor's depth, metres (Nguyen, Izadi, Lovell 2012)."""
    return 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def read_depth(first: int, last: int, raw: AnyArray, scale: float, out: Float32Array) -> None:
    """Fill some rows of a depth image in metres, of values of which ``scale`` are a metre; 0 where there is none."""
    f4 = np.float32
    for r in range(first, last):
        for c in range(raw.shape[1]):
            z = f4(raw[r, c]) / f4(scale)
            out[r, c] = z if (z > f4(0.0)) & (z < f4(np.inf)) else f4(0.0)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def noise_of(depth: Float32Array, near: float, far: float) -> float:
    """Return how many times noisier than :func:`depth_sigma` a depth image is, from once to ``_NOISIEST``.

    By the median second difference along the rows, of every so manieth pixel: surfaces bend but little.
    """
    rows, columns = depth.shape
    ratios, count = np.empty((rows // _SAMPLE + 1) * (columns // _SAMPLE + 1)), 0
    for r in range(_SAMPLE // 2, rows, _SAMPLE):
        for c in range(_SAMPLE // 2, columns - 1, _SAMPLE):
            z, left, right = np.float64(depth[r, c]), np.float64(depth[r, c - 1]), np.float64(depth[r, c + 1])
            if near < z < far and left > 0.0 and right > 0.0:
                ratios[count] = abs(left - 2.0 * z + right) / depth_sigma(z)
                count += 1
    if count < _LEAST_SAMPLES:
        return 1.0
    # of three that are independent: root of 1 + 4 + 1, and what the median is of the standard deviation
    middle = np.partition(ratios[:count], count // 2)[count // 2] / (math.sqrt(6.0) / NORMAL)
    return min(max(middle, 1.0), _NOISIEST)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def halve(
    first: int,
    last: int,
    depth: Float32Array,
    rays: Float32Array,
    near: float,
    far: float,
    noise: float,
    out: Float32Array,
) -> None:
    """Fill some rows of vertices (rows / 2, columns / 2, 3): means of 2 x 2 pixels, and neighbours, on one surface.

    Pixels farther than four standard deviations, each ``noise`` times the usual one, from the median of the four are
    left out.
    """
    f4 = np.float32
    columns = depth.shape[1] // 2
    middle, reach, n = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    x, y, z = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    for r in range(first, last):
        _middle_depths(depth[2 * r], depth[2 * r + 1], near, far, middle)
        for c in range(columns):
            off = middle[c] - f4(0.4)
            reach[c] = f4(4.0 * noise) * (f4(0.0012) + f4(0.0019) * off * off) if middle[c] > f4(0.0) else f4(-1.0)
            x[c] = y[c] = z[c] = n[c] = f4(0.0)
        for rr in range(max(2 * r - 1, 0), min(2 * r + 3, depth.shape[0])):
            row, ray = depth[rr], rays[rr].reshape(-1)
            _add_four(row, ray, middle, reach, x, y, z, n)
            for c in (0, columns - 1):
                for k in range(max(2 * c - 1, 0), min(2 * c + 3, depth.shape[1])):
                    if abs(row[k] - middle[c]) < reach[c]:
                        x[c] += row[k] * ray[2 * k]
                        y[c] += row[k] * ray[2 * k + 1]
                        z[c] += row[k]
                        n[c] += f4(1.0) if row[k] > f4(0.0) else f4(0.0)
        for c in range(columns):
            share = f4(1.0) / max(n[c], f4(1.0)) if n[c] >= f4(3.0) else f4(0.0)
            x[c], y[c], z[c] = x[c] * share, y[c] * share, z[c] * share
        # by themselves: vectors do not write numbers that lie three by three
        to = out[r].reshape(-1)
        for c in range(columns):
            to[3 * c], to[3 * c + 1], to[3 * c + 2] = x[c], y[c], z[c]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _add_four(
    row: Float32Array,
    ray: Float32Array,
    middle: Float32Array,
    reach: Float32Array,
    x: Float32Array,
    y: Float32Array,
    z: Float32Array,
    n: Float32Array,
) -> None:
    """Add to each vertex but the first and the last those of its four pixels of a row that lie within its reach."""
    f4 = np.float32
    zero, one = f4(0.0), f4(1.0)
    for before in range(middle.shape[0] - 2):
        c, k, m = before + 1, 2 * before + 1, 4 * before + 2
        centre, far = middle[c], reach[c]
        p, q, s, t = row[k], row[k + 1], row[k + 2], row[k + 3]
        p, q = p if abs(p - centre) < far else zero, q if abs(q - centre) < far else zero
        s, t = s if abs(s - centre) < far else zero, t if abs(t - centre) < far else zero
        x[c] += p * ray[m] + q * ray[m + 2] + s * ray[m + 4] + t * ray[m + 6]
        y[c] += p * ray[m + 1] + q * ray[m + 3] + s * ray[m + 5] + t * ray[m + 7]
        z[c] += p + q + s + t
        many = (one if p > zero else zero) + (one if q > zero else zero)
        n[c] += many + (one if s > zero else zero) + (one if t > zero else zero)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _middle_depths(upper: Float32Array, lower: Float32Array, near: float, far: float, out: Float32Array) -> None:
    """Median (of two the lower) of the depths from ``near`` to ``far`` of each 2 x 2 pixels; 0 for fewer than two."""
    f4 = np.float32
    none, near4, far4 = f4(np.inf), f4(near), f4(far)
    for c in range(out.shape[0]):
        a, b, d, e = upper[2 * c], upper[2 * c + 1], lower[2 * c], lower[2 * c + 1]
        a = a if (a > near4) & (a < far4) else none
        b = b if (b > near4) & (b < far4) else none
        d = d if (d > near4) & (d < far4) else none
        e = e if (e > near4) & (e < far4) else none
        a, b = min(a, b), max(a, b)
        d, e = min(d, e), max(d, e)
        lowest, high, low = min(a, d), max(a, d), min(b, e)
        second, third = min(high, low), max(high, low)
        # two values: the lower; three and four: the second
        found = lowest if third == none else second
        out[c] = found if second < none else f4(0.0)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def grid_normals(
    first: int, last: int, vertices: Float32Array, reach: int, spacing: float, noise: float, out: Float32Array
) -> int:
    """Fill some rows of unit normals (rows, columns, 3) towards the camera over +-reach pixels; return how many.

    They are zero at jumps of depth, and as near to the rim. Vertices look ``spacing`` apart at depth 1, by which steep
    surfaces are told from jumps, and so is noise, of ``noise`` times the usual size.
    """
    f4, i4 = np.float32, np.int32
    rows, columns, _ = vertices.shape
    across, down, away = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    count, slant = 0, f4(_STEEPEST * spacing * reach)
    for r in range(first, last):
        out[r] = 0.0
        if r < reach or r >= rows - reach:
            continue
        # rows that begin where the neighbours of the first vertex lie, so that no place is counted from the end
        row, skip = vertices[r].reshape(-1), 3 * reach
        left, middle, right = row, row[skip:], row[2 * skip :]
        upper, lower = vertices[r - reach].reshape(-1)[skip:], vertices[r + reach].reshape(-1)[skip:]
        to, found = out[r].reshape(-1)[skip:], i4(0)
        for c in range(columns - 2 * reach):
            k = 3 * c
            x, y, z = middle[k], middle[k + 1], middle[k + 2]
            off = z - f4(0.4)
            limit = f4(8.0 * noise) * (f4(0.0012) + f4(0.0019) * off * off) + slant * z
            zl, zr, zu, zd = left[k + 2], right[k + 2], upper[k + 2], lower[k + 2]
            level = (abs(zl - z) < limit) & (abs(zr - z) < limit) & (abs(zu - z) < limit) & (abs(zd - z) < limit)
            ax, ay, az = right[k] - left[k], right[k + 1] - left[k + 1], zr - zl
            bx, by, bz = lower[k] - upper[k], lower[k + 1] - upper[k + 1], zd - zu
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            size = np.sqrt(nx * nx + ny * ny + nz * nz)
            inverse = f4(1.0) / max(size, f4(1e-30))
            inverse = -inverse if nx * x + ny * y + nz * z > f4(0.0) else inverse
            known = (z > f4(0.0)) & level & (size > f4(0.0))
            inverse = inverse if known else f4(0.0)
            across[c], down[c], away[c] = nx * inverse, ny * inverse, nz * inverse
            found = i4(found + i4(known))
        count += int(found)
        for c in range(columns - 2 * reach):
            to[3 * c], to[3 * c + 1], to[3 * c + 2] = across[c], down[c], away[c]
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def pack_pixels(
    first: int,
    last: int,
    depth: Float32Array,
    vertices: Float32Array,
    normals: Float32Array,
    far: float,
    noise: float,
    out: AnyArray,
) -> None:
    """Pack pixels of the full image (n_pixels), those under some rows of the half image; 0 for those without.

    What no vertex lies over, at the end of an odd row, is left as it is. Packed are depth, how far along the surface's
    normal a metre before it in depth is, root of the weight for fusion; the colour's bits are zero. Noise is
    ``noise`` times the usual one.
    """
    f4, i4, u4, u8 = np.float32, np.int32, np.uint32, np.uint64
    columns, half = depth.shape[1], vertices.shape[1]
    scale = f4(depth_sigma(1.0) / ROOT_UNIT)
    least, most, zero, far4 = f4(1.0), f4(1023.0), f4(0.0), f4(far)
    # of each pixel of a row: its surface's depth, how far from it the pixel may be, its slope and root
    middle, reach = np.empty(2 * half, dtype=np.float32), np.empty(2 * half, dtype=np.float32)
    code = np.empty(2 * half, dtype=np.uint32)
    for hr in range(first, last):
        point, normal = vertices[hr].reshape(-1), normals[hr].reshape(-1)
        for hc in range(half):
            x, y, w = point[3 * hc], point[3 * hc + 1], point[3 * hc + 2]
            along = -(x * normal[3 * hc] + y * normal[3 * hc + 1] + w * normal[3 * hc + 2])
            cosine = along / max(np.sqrt(x * x + y * y + w * w), f4(1e-6))
            off = w - f4(0.4)
            sigma = f4(0.0012) + f4(0.0019) * off * off
            root = min(max(np.sqrt(max(cosine, zero)) * scale / sigma + f4(0.5), least), most)
            slope = min(max(along / (max(w, f4(1e-6)) * f4(SLOPE_UNIT)) + f4(0.5), zero), most)
            packed = u4(u4(u4(i4(slope)) << u4(SLOPE_BIT - ROOT_BIT)) | u4(i4(root)))
            shown = cosine >= f4(0.15)
            middle[2 * hc] = middle[2 * hc + 1] = w
            reach[2 * hc] = reach[2 * hc + 1] = f4(6.0 * noise) * sigma if shown else f4(-1e6)
            code[2 * hc] = code[2 * hc + 1] = packed
        for r in range(2 * hr, 2 * hr + 2):
            row, to = depth[r], out[r * columns : r * columns + 2 * half]
            for c in range(2 * half):
                z = row[c]
                kept = (z > zero) & (z < far4) & (abs(middle[c] - z) < reach[c] + f4(0.02) * z)
                steps = u4(i4(z * f4(1.0 / DEPTH_UNIT) + f4(0.5)))
                whole = (u8(steps) << u8(DEPTH_BIT)) | (u8(code[c]) << u8(ROOT_BIT))
                to[c] = whole if kept else u8(0)


def unpack_pixels(pixels: AnyArray) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Return depth, slope and weight of packed pixels, each of their shape."""
    depth = (pixels >> np.uint64(DEPTH_BIT)).astype(np.float32) * np.float32(DEPTH_UNIT)
    slope, root = ((pixels >> np.uint64(bit) & np.uint64(1023)).astype(np.float32) for bit in (SLOPE_BIT, ROOT_BIT))
    return depth, slope * np.float32(SLOPE_UNIT), (root * np.float32(ROOT_UNIT)) ** 2
