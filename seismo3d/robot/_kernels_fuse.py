"""Kernels that average a frame into signed-distance blocks; see :mod:`seismo3d.robot.tsdf`.

All voxels of a block are treated at once: projected, looked up in the image, averaged, each in a loop of its own over
arrays that lie in a row, so that the processor's vectors take many voxels in a step. The image is one without
distortion and with a margin, and a last pixel without weight for what falls outside.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.robot._kernels_blocks import SIDE
from seismo3d.robot._kernels_frame import DEPTH_BIT, DEPTH_UNIT, ROOT_UNIT, SLOPE_UNIT, TEN_BITS

VOXELS = SIDE * SIDE * SIDE
_SIDES, _GREEN = np.uint32(0xFF00FF), np.uint32(0x00FF00)


@nb.njit(cache=True, nogil=True)
def straighten(first: int, last: int, table: Int32Array, pixels: AnyArray, rgb: AnyArray, image: AnyArray) -> None:
    """Fill some rows of a frame's image without distortion, by a table of pixels.

    ``image`` (n + 1) receives the packed pixels, with red, green and blue in their lowest bytes, from the low one on;
    0 without colour.
    """
    columns = table.shape[1]
    has_colour = rgb.shape[0] > 0
    for r in range(first, last):
        for c in range(columns):
            code = np.uint64(0)
            if table[r, c] >= 0:
                pixel = np.uint64(table[r, c])
                code = pixels[pixel]
                if has_colour and code > np.uint64(0):
                    red, green, blue = np.uint64(rgb[pixel, 0]), np.uint64(rgb[pixel, 1]), np.uint64(rgb[pixel, 2])
                    code |= red | (green << np.uint64(8)) | (blue << np.uint64(16))
            image[r * columns + c] = code


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
    times: Float32Array,
    band: float,
    heaviest: float,
) -> None:
    """Average a frame into the voxels of blocks near its surface.

    Parameters are the blocks' rows, all blocks' coordinates (n, 3), distances (n, 512; NaN where unknown), weights and
    colours (as whole numbers) of the same shape, the voxel's size, the pose, the lens, the shape and the margin of the
    image without distortion, that image as :func:`straighten` fills it, how many times the frame's weight each of the
    blocks takes, the band in metres and the largest weight.
    """
    f4, u8, i4, u4 = np.float32, np.uint64, np.int32, np.uint32
    zero, least, band4, heaviest4, close = f4(0.0), f4(1e-30), f4(band), f4(heaviest), f4(2.0 * voxel)
    offsets = voxel_offsets(R, voxel)
    place, depth = np.empty(VOXELS, dtype=np.int32), np.empty(VOXELS, dtype=np.float32)
    ahead, fresh = np.empty(VOXELS, dtype=np.float32), np.empty(VOXELS, dtype=np.float32)
    tint, seen = np.empty(VOXELS, dtype=np.uint32), np.empty(VOXELS, dtype=np.uint64)
    for n in range(numbers.shape[0]):
        number = numbers[n]
        project_block(coordinates[number], voxel, R, t, offsets, lens, shape, margin, place, depth)
        for q in range(VOXELS):
            seen[q] = image[u8(place[q])]
        n_near, n_coloured, often = i4(0), i4(0), times[n] * f4(ROOT_UNIT * ROOT_UNIT)
        for q in range(VOXELS):
            upper = u4(seen[q] >> u8(24))
            lower = u4(seen[q])
            root = f4(i4(upper & TEN_BITS))
            before = f4(i4(u4(seen[q] >> u8(DEPTH_BIT)))) * f4(DEPTH_UNIT) - depth[q]
            along = before * (f4(i4((upper >> u4(10)) & TEN_BITS)) * f4(SLOPE_UNIT))
            w = root * root * often
            w = w if (along >= -band4) & (before >= -(band4 + band4)) else zero
            fresh[q] = w
            ahead[q] = min(along, band4)
            n_near += i4(w > zero)
            shade = lower & u4(0xFFFFFF)
            shade = shade if (w > zero) & (abs(along) < close) else u4(0)
            tint[q] = shade
            n_coloured += i4(shade > u4(0))
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
        if n_coloured > 0:
            blend_colours(fresh, held, tint, colour[number])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def blend_colours(fresh: Float32Array, held: Float32Array, tint: AnyArray, colour: AnyArray) -> None:
    """Average colours, three bytes in a number, into those of a block by the new weight over all weight.

    A voxel without colour takes the new one as it is; 0 is no colour, and no channel of one is.
    """
    f4, i4, u4 = np.float32, np.int32, np.uint32
    one, whole = f4(1.0), f4(256.0)
    for q in range(VOXELS):
        old, new = colour[q], tint[q]
        # red and blue side by side, two bytes each, so that both are mixed in one product
        share = u4(i4(min(fresh[q] / held[q], one) * whole + f4(0.5)))
        rest = u4(256) - share
        sides = ((old & _SIDES) * rest + (new & _SIDES) * share + u4(0x800080)) >> u4(8)
        green = ((old & _GREEN) * rest + (new & _GREEN) * share + u4(0x8000)) >> u4(8)
        mixed = (sides & _SIDES) | (green & _GREEN)
        mixed = new if old == u4(0) else mixed
        colour[q] = mixed if new > u4(0) else old
