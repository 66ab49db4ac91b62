"""Kernels that average a frame into signed-distance blocks; see :mod:`seismo3d.robot.tsdf`.

All voxels of a block are treated at once: projected, looked up in the image, averaged, each in a loop of its own over
arrays that lie in a row, so that the processor's vectors take many voxels in a step. The image is one without
distortion and with a margin, and a last pixel without weight for what falls outside.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.robot._kernels_blocks import SIDE
from seismo3d.robot._kernels_frame import DEPTH_BIT, DEPTH_UNIT, ROOT_BIT, ROOT_UNIT, SLOPE_BIT, SLOPE_UNIT, TEN_BITS
from seismo3d.robot.voxels import STEPS, SURFACE, WHOLE

VOXELS = SIDE * SIDE * SIDE
_SIDES, _GREEN, _COLOUR = np.uint32(0xFF00FF), np.uint32(0x00FF00), np.uint32(0xFFFFFF)
_DEPTH_BIT, _SLOPE_BIT, _ROOT_BIT = np.uint32(DEPTH_BIT - 32), np.uint32(SLOPE_BIT - 32), np.uint32(ROOT_BIT)
_ROOT_LEFT = np.uint32(32 - ROOT_BIT)


@nb.njit(cache=True, nogil=True)
def straighten(first: int, last: int, table: Int32Array, pixels: AnyArray, image: AnyArray) -> None:
    """Fill some rows of a frame's image without distortion (n + 1) with its packed pixels, by a table of pixels."""
    columns = table.shape[1]
    for r in range(first, last):
        for c in range(columns):
            at = table[r, c]
            image[r * columns + c] = pixels[np.uint64(at)] if at >= 0 else np.uint64(0)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def voxel_offsets(R: Float64Array, voxel: float) -> Float32Array:
    """Offsets (3, 512) of a block's voxels from its first one in the camera's frame."""
    out = np.empty((3, VOXELS), dtype=np.float32)
    for q in range(VOXELS):
        i, j, k = q >> 6, (q >> 3) & 7, q & 7
        for a in range(3):
            out[a, q] = (R[0, a] * i + R[1, a] * j + R[2, a] * k) * voxel
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def project_block(
    coordinates: Int32Array,
    voxel: float,
    R: Float64Array,
    t: Float64Array,
    offsets: Float32Array,
    lens: Float64Array,
    shape: tuple[int, int],
    margin: int,
    place: Int32Array,
    depth: Float32Array,
) -> None:
    """Write where a block's voxels fall in the image without distortion, and their depth.

    Parameters are the block's coordinates, the voxel's size, the pose's rotation and translation (camera to world), the
    voxels' offsets, the lens (fx, fy, cx, cy first), the image's shape and margin.
    """
    f4, i4 = np.float32, np.int32
    rows, columns = shape
    fx, fy = f4(lens[0]), f4(lens[1])
    cx, cy = f4(lens[2] + margin + 0.5), f4(lens[3] + margin + 0.5)
    width, height, stride, outside = f4(columns), f4(rows), i4(columns), i4(rows * columns)
    near, zero, one = f4(0.05), f4(0.0), f4(1.0)
    ox = coordinates[0] * SIDE * voxel - t[0]
    oy = coordinates[1] * SIDE * voxel - t[1]
    oz = coordinates[2] * SIDE * voxel - t[2]
    x0 = f4(R[0, 0] * ox + R[1, 0] * oy + R[2, 0] * oz)
    y0 = f4(R[0, 1] * ox + R[1, 1] * oy + R[2, 1] * oz)
    z0 = f4(R[0, 2] * ox + R[1, 2] * oy + R[2, 2] * oz)
    for q in range(VOXELS):
        z = z0 + offsets[2, q]
        inverse = one / z
        u = fx * (x0 + offsets[0, q]) * inverse + cx
        v = fy * (y0 + offsets[1, q]) * inverse + cy
        inside = (z >= near) & (u >= zero) & (u < width) & (v >= zero) & (v < height)
        at = i4(v) * stride + i4(u)
        place[q] = at if inside else outside
        depth[q] = z


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fuse_blocks(
    numbers: Int64Array,
    coordinates: Int32Array,
    distance: AnyArray,
    root: AnyArray,
    colour: AnyArray,
    voxel: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    shape: tuple[int, int],
    margin: int,
    image: AnyArray,
    times: Float32Array,
    band: float,
    heaviest: float,
) -> None:
    """Average a frame into the voxels of blocks near its surface.

    Parameters are the blocks' rows, all blocks' coordinates (n, 3), distances and roots of weights (n, 512) as
    :mod:`seismo3d.robot.voxels` holds them, colours (as whole numbers) of the same shape, the voxel's size, the pose,
    the lens, the shape and the margin of the image without distortion, that image as :func:`straighten` fills it, how
    many times the frame's weight each of the blocks takes, the band in metres and the largest weight.
    """
    u4, u8 = np.uint32, np.uint64
    unit = heaviest / (WHOLE * WHOLE)
    offsets = voxel_offsets(R, voxel)
    place, depth = np.empty(VOXELS, dtype=np.int32), np.empty(VOXELS, dtype=np.float32)
    ahead, fresh = np.empty(VOXELS, dtype=np.float32), np.empty(VOXELS, dtype=np.float32)
    upper, lower = np.empty(VOXELS, dtype=np.uint32), np.empty(VOXELS, dtype=np.uint32)
    for n in range(numbers.shape[0]):
        number = numbers[n]
        project_block(coordinates[number], voxel, R, t, offsets, lens, shape, margin, place, depth)
        for q in range(VOXELS):
            seen = image[u8(place[q])]
            upper[q], lower[q] = u4(seen >> u8(32)), u4(seen)
        n_near, n_coloured = read_pixels(upper, lower, depth, times[n], band, 2.0 * voxel, ahead, fresh)
        if n_near > 0:
            average(ahead, fresh, unit, distance[number], root[number])
        if n_coloured > 0:
            blend_colours(fresh, lower, colour[number])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def read_pixels(
    upper: AnyArray,
    lower: AnyArray,
    depth: Float32Array,
    times: float,
    band: float,
    close: float,
    ahead: Float32Array,
    fresh: Float32Array,
) -> tuple[int, int]:
    """Write the distance and the weight that the pixels of a block's voxels say; return how many say one, and a colour.

    ``upper`` and ``lower`` are the halves of the pixels, ``depth`` that of the voxels. Distances are as
    :mod:`seismo3d.robot.voxels` holds them, not yet rounded. Of ``lower`` the colour is left, 0 where it is none or
    farther than ``close`` from the surface.
    """
    f4, i4, u4 = np.float32, np.int32, np.uint32
    zero, band4, close4 = f4(0.0), f4(band), f4(close)
    scale, often = f4(STEPS / band), f4(times * (ROOT_UNIT * ROOT_UNIT))
    n_near, n_coloured = i4(0), i4(0)
    for q in range(VOXELS):
        # each step in 32 bits, of which the processor's vectors take twice as many as of 64
        high, low = upper[q], lower[q]
        before = f4(i4(u4(high >> _DEPTH_BIT))) * f4(DEPTH_UNIT) - depth[q]
        along = before * (f4(i4(u4(u4(high >> _SLOPE_BIT) & TEN_BITS))) * f4(SLOPE_UNIT))
        root = f4(i4(u4(u4(u4(high << _ROOT_LEFT) & TEN_BITS) | u4(low >> _ROOT_BIT))))
        w = root * root * often
        w = w if (along >= -band4) & (before >= -(band4 + band4)) else zero
        shade = u4(low & _COLOUR)
        shade = shade if (w > zero) & (abs(along) < close4) else u4(0)
        fresh[q], ahead[q], lower[q] = w, min(along, band4) * scale + f4(SURFACE), shade
        n_near, n_coloured = i4(n_near + i4(w > zero)), i4(n_coloured + i4(shade > u4(0)))
    return int(n_near), int(n_coloured)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def average(ahead: Float32Array, fresh: Float32Array, unit: float, distance: AnyArray, root: AnyArray) -> None:
    """Average distances with some weight into those of a block; the weight becomes the share that the new ones have.

    ``unit`` is the weight of a root of 1; that of the largest root stays as it is.
    """
    f4, i4, u2 = np.float32, np.int32, np.uint16
    half, least, unit4 = f4(0.5), f4(1e-30), f4(unit)
    most, back = f4(unit * WHOLE * WHOLE), f4(1.0 / math.sqrt(unit))
    for q in range(VOXELS):
        was, held, w = f4(i4(distance[q])), f4(i4(root[q])), fresh[q]
        total = held * held * unit4 + w
        share = w / max(total, least)  # 1 where nothing was known
        fresh[q] = share
        distance[q] = u2(i4(was + share * (ahead[q] - was) + half))
        root[q] = u2(i4(np.sqrt(min(total, most)) * back + half))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def blend_colours(share: Float32Array, tint: AnyArray, colour: AnyArray) -> None:
    """Average colours, three bytes in a number, into those of a block by the share that the new ones have.

    A voxel without colour takes the new one as it is; 0 is no colour, and no channel of one is.
    """
    f4, i4, u4 = np.float32, np.int32, np.uint32
    for q in range(VOXELS):
        old, new = colour[q], tint[q]
        # red and blue side by side, two bytes each, so that both are mixed in one product
        part = u4(i4(share[q] * f4(256.0) + f4(0.5)))
        sides, green = u4(old & _SIDES), u4(old & _GREEN)
        sides = u4(u4(u4(sides << u4(8)) + u4(u4(u4(new & _SIDES) - sides) * part)) + u4(0x800080))
        green = u4(u4(u4(green << u4(8)) + u4(u4(u4(new & _GREEN) - green) * part)) + u4(0x8000))
        mixed = u4(u4(u4(sides >> u4(8)) & _SIDES) | u4(u4(green >> u4(8)) & _GREEN))
        mixed = new if old == u4(0) else mixed
        colour[q] = mixed if new > u4(0) else old
