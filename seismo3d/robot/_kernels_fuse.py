"""Kernels that average a frame into signed-distance blocks; see :mod:`seismo3d.robot.tsdf`.

All voxels of a block are treated at once: projected, looked up in the image, averaged, each in a loop of its own over
arrays that lie in a row, so that the processor's vectors take many voxels in a step. The image is one without
distortion and with a margin, and a last pixel without weight for what falls outside.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.robot._kernels_blocks import SIDE

VOXELS = SIDE * SIDE * SIDE
_BYTE = np.uint32(255)
_EIGHT, _SIXTEEN = np.uint32(8), np.uint32(16)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def straighten(
    first: int,
    last: int,
    table: Int32Array,
    lens: Float64Array,
    margin: int,
    pixels: Float32Array,
    rgb: AnyArray,
    image: Float32Array,
    tints: AnyArray,
) -> None:
    """Fill some rows of a frame's image without distortion, by a table of pixels with its margin.

    ``image`` (n + 1, 4) receives depth, how far along the surface's normal a metre before it in depth is, and weight;
    ``tints`` is the same memory as whole numbers, and receives red, green and blue in its last column, from the low
    byte on; 0 without colour.
    """
    columns = table.shape[1]
    for r in range(first, last):
        y = (r - margin - lens[3]) / lens[1]
        for c in range(columns):
            place = r * columns + c
            pixel = table[r, c]
            image[place, 2] = 0.0
            tints[place, 3] = 0
            if pixel < 0 or not pixels[pixel, 2] > 0.0:
                continue
            x = (c - margin - lens[2]) / lens[0]
            image[place, 0] = pixels[pixel, 0]
            image[place, 1] = pixels[pixel, 1] * math.sqrt(1.0 + x * x + y * y)
            image[place, 2] = pixels[pixel, 2]
            if rgb.shape[0] > 0:
                red, green, blue = np.uint32(rgb[pixel, 0]), np.uint32(rgb[pixel, 1]), np.uint32(rgb[pixel, 2])
                tints[place, 3] = red | (green << _EIGHT) | (blue << _SIXTEEN)


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
    distance: Float32Array,
    weight: Float32Array,
    colour: AnyArray,
    voxel: float,
    R: Float64Array,
    t: Float64Array,
    lens: Float64Array,
    shape: tuple[int, int],
    margin: int,
    image: AnyArray,
    has_colour: bool,
    times: Float32Array,
    band: float,
    heaviest: float,
) -> None:
    """Average a frame into the voxels of blocks near its surface.

    Parameters are the blocks' rows, all blocks' coordinates (n, 3), distances (n, 512; NaN where unknown), weights and
    colours (as whole numbers) of the same shape, the voxel's size, the pose, the lens, the shape and the margin of the
    image without distortion, that image as :func:`straighten` fills it, two 64-bit numbers a pixel, whether it has
    colours, how many times the frame's weight each of the blocks takes, the band in metres and the largest weight.
    """
    f4, u8, i4 = np.float32, np.uint64, np.int32
    zero, least, band4, heaviest4, close = f4(0.0), f4(1e-30), f4(band), f4(heaviest), f4(2.0 * voxel)
    offsets = voxel_offsets(R, voxel)
    place, depth = np.empty(VOXELS, dtype=np.int32), np.empty(VOXELS, dtype=np.float32)
    ahead, fresh = np.empty(VOXELS, dtype=np.float32), np.empty(VOXELS, dtype=np.float32)
    tint = np.empty(VOXELS, dtype=np.uint32)
    seen = np.empty((VOXELS, 2), dtype=np.uint64)
    values, tints = seen.view(np.float32), seen.view(np.uint32)
    for n in range(numbers.shape[0]):
        number = numbers[n]
        project_block(coordinates[number], voxel, R, t, offsets, lens, shape, margin, place, depth)
        for q in range(VOXELS):
            pixel = u8(place[q])
            seen[q, 0] = image[pixel, 0]
            seen[q, 1] = image[pixel, 1]
        n_near, n_coloured = i4(0), i4(0)
        for q in range(VOXELS):
            before = values[q, 0] - depth[q]
            along = before * values[q, 1]
            w = values[q, 2] * times[n]
            w = w if (along >= -band4) & (before >= -(band4 + band4)) else zero
            fresh[q] = w
            ahead[q] = min(along, band4)
            n_near += i4(w > zero)
            shade = tints[q, 3]
            shade = shade if (w > zero) & (abs(along) < close) else np.uint32(0)
            tint[q] = shade
            n_coloured += i4(shade > np.uint32(0))
        if n_near == 0:
            continue
        d, held = distance[number], weight[number]
        for q in range(VOXELS):
            was, had = d[q], held[q]
            total = had + fresh[q]
            share = fresh[q] / max(total, least)
            new = was + share * (ahead[q] - was) if had > zero else ahead[q]
            d[q] = new if fresh[q] > zero else was
            held[q] = min(total, heaviest4)
        if has_colour and n_coloured > 0:
            blend_colours(fresh, held, tint, colour[number])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def blend_colours(fresh: Float32Array, held: Float32Array, tint: AnyArray, colour: AnyArray) -> None:
    """Average colours, three bytes in a number, into those of a block by the new weight over all weight.

    A voxel without colour takes the new one as it is; 0 is no colour, and no channel of one is.
    """
    f4, i4, u4 = np.float32, np.int32, np.uint32
    one, half = f4(1.0), f4(0.5)
    for q in range(VOXELS):
        old, new = colour[q], tint[q]
        share = one if old == u4(0) else fresh[q] / held[q]
        red, green, blue = f4(i4(old & _BYTE)), f4(i4((old >> _EIGHT) & _BYTE)), f4(i4((old >> _SIXTEEN) & _BYTE))
        red += share * (f4(i4(new & _BYTE)) - red)
        green += share * (f4(i4((new >> _EIGHT) & _BYTE)) - green)
        blue += share * (f4(i4((new >> _SIXTEEN) & _BYTE)) - blue)
        mixed = (
            channel(red + half, one) | (channel(green + half, one) << _EIGHT) | (channel(blue + half, one) << _SIXTEEN)
        )
        colour[q] = mixed if new > u4(0) else old


@nb.njit(cache=True, nogil=True, inline="always")
def channel(value: Any, least: Any) -> Any:
    """Whole part of a number, at least some value."""
    return np.uint32(np.int32(max(value, least)))
