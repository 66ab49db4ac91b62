"""Kernel that follows patches from one image to another, by Lucas and Kanade on a pyramid [1]_.

Images are padded by ``PAD`` pixels on all sides, so that the patch of each pixel of them lies within. Exposure may
change between them: a step knows nothing of how much brighter a patch has become, nor of how its contrast has grown.

References
----------
.. [1] J.-Y. Bouguet, "Pyramidal implementation of the Lucas Kanade feature tracker", Intel Corporation, 2000.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array

RADIUS = 7
"""Half the side of a patch, pixels."""
PAD = RADIUS + 3
_SIDE = 2 * RADIUS + 1
_WIDE = 16
"""Numbers of a patch's row, the last one without weight: as many as the processor's vectors take in whole steps."""
_MOST_STEPS, _STILL = 12, 0.03
"""Steps at most on a level, and the length of one, pixels, that is the last."""
_FLAT = 0.1
"""Mean square of the gradient, grey values a pixel, along the direction of its least, below which nothing is told."""
_MOST_LIGHT = 8.0
"""Times that the contrast of a patch is taken to grow, or to shrink, at most."""


@nb.njit(cache=True, nogil=True, inline="always")
def _corners(x: float, y: float) -> Any:
    """Row and column of the pixel before a place in a padded image, and the weights of the four around it."""
    f4 = np.float32
    column, row = math.floor(x), math.floor(y)
    a, b = f4(x - column), f4(y - row)
    c, d = f4(1.0) - a, f4(1.0) - b
    return np.int64(row) + PAD, np.int64(column) + PAD, c * d, a * d, c * b, a * b


@nb.njit(cache=True, nogil=True, error_model="numpy")
def take_patch(
    image: AnyArray, x: float, y: float, wide: Float32Array, patch: Float32Array, gx: Float32Array, gy: Float32Array
) -> None:
    """Write the patch (15, 16) about a place of a padded image, and its gradient by Scharr's operator.

    ``wide`` (17, 18) is room for the patch with what is around it.
    """
    f4 = np.float32
    row, column, w0, w1, w2, w3 = _corners(x, y)
    row, column = row - RADIUS - 1, column - RADIUS - 1
    for i in range(_SIDE + 2):
        above, below, to = image[row + i, column:], image[row + i + 1, column:], wide[i]
        for j in range(_WIDE + 1):
            to[j] = w0 * f4(above[j]) + w1 * f4(above[j + 1]) + w2 * f4(below[j]) + w3 * f4(below[j + 1])
    near, far = f4(10.0 / 32.0), f4(3.0 / 32.0)
    for i in range(_SIDE):
        above, middle, below = wide[i], wide[i + 1], wide[i + 2]
        to, across, down = patch[i], gx[i], gy[i]
        for j in range(_SIDE):
            to[j] = middle[j + 1]
            across[j] = near * (middle[j + 2] - middle[j]) + far * (above[j + 2] - above[j] + below[j + 2] - below[j])
            down[j] = near * (below[j + 1] - above[j + 1]) + far * (below[j] - above[j] + below[j + 2] - above[j + 2])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _products(gx: Float32Array, gy: Float32Array, lanes: Float32Array) -> tuple[float, float, float]:
    """Return the sums of the products of the gradient's parts over a patch."""
    lanes[:] = np.float32(0.0)
    first, second, third = lanes[0], lanes[1], lanes[2]
    for i in range(_SIDE):
        across, down = gx[i], gy[i]
        for j in range(_WIDE):
            first[j] += across[j] * across[j]
            second[j] += across[j] * down[j]
            third[j] += down[j] * down[j]
    xx, xy, yy = 0.0, 0.0, 0.0
    for j in range(_WIDE):
        xx, xy, yy = xx + first[j], xy + second[j], yy + third[j]
    return xx, xy, yy


@nb.njit(cache=True, nogil=True, error_model="numpy")
def blind_to_light(patch: Float32Array, gx: Float32Array, gy: Float32Array) -> None:
    """Take the mean from a patch, and from its gradient what a change of brightness or contrast could feign."""
    f4, many = np.float32, _SIDE * _SIDE
    mean, across, down = 0.0, 0.0, 0.0
    for i in range(_SIDE):
        for j in range(_SIDE):
            mean, across, down = mean + patch[i, j], across + gx[i, j], down + gy[i, j]
    power, x, y = 0.0, 0.0, 0.0
    for i in range(_SIDE):
        for j in range(_SIDE):
            patch[i, j] -= f4(mean / many)
            power += patch[i, j] * patch[i, j]
            x += gx[i, j] * patch[i, j]
            y += gy[i, j] * patch[i, j]
    share = 1.0 / power if power > 0.0 else 0.0
    for i in range(_SIDE):
        for j in range(_SIDE):
            gx[i, j] -= f4(across / many) + f4(x * share) * patch[i, j]
            gy[i, j] -= f4(down / many) + f4(y * share) * patch[i, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _contrast(image: AnyArray, x: float, y: float, patch: Float32Array) -> float:
    """Return how many times as much contrast an image has about a place as a patch without its mean."""
    row, column = np.int64(math.floor(y)) + PAD - RADIUS, np.int64(math.floor(x)) + PAD - RADIUS
    total, square, power = 0.0, 0.0, 0.0
    for i in range(_SIDE):
        for j in range(_SIDE):
            value = np.float64(image[row + i, column + j])
            total, square, power = total + value, square + value * value, power + patch[i, j] * patch[i, j]
    spread = square - total * total / (_SIDE * _SIDE)
    return min(max(math.sqrt(spread / power), 1.0 / _MOST_LIGHT), _MOST_LIGHT) if power > 0.0 else 1.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _miss(
    image: AnyArray, x: float, y: float, gx: Float32Array, gy: Float32Array, lanes: Float32Array
) -> tuple[float, float]:
    """Return the sums of the gradient, which is orthogonal to its patch, times an image about a place."""
    f4 = np.float32
    row, column, w0, w1, w2, w3 = _corners(x, y)
    row, column = row - RADIUS, column - RADIUS
    lanes[:] = f4(0.0)
    right, low = lanes[0], lanes[1]
    for i in range(_SIDE):
        above, below, across, down = image[row + i, column:], image[row + i + 1, column:], gx[i], gy[i]
        for j in range(_WIDE):
            new = w0 * f4(above[j]) + w1 * f4(above[j + 1]) + w2 * f4(below[j]) + w3 * f4(below[j + 1])
            right[j] += new * across[j]
            low[j] += new * down[j]
    bx, by = 0.0, 0.0
    for j in range(_WIDE):
        bx += right[j]
        by += low[j]
    return bx, by


@nb.njit(cache=True, nogil=True, error_model="numpy")
def follow_patches(
    before: tuple[AnyArray, ...],
    now: tuple[AnyArray, ...],
    top: int,
    pixels: Float64Array,
    places: Float64Array,
    found: BoolArray,
) -> None:
    """Follow the patches about some pixels (n, 2; column, row) of an image to another.

    Parameters are the padded images, each level half the size of the one before it, the level that is begun with, the
    pixels, where they are sought, which becomes where they are, and whether each was found: inside the image, on a
    patch that tells where it is.
    """
    wide = np.zeros((_SIDE + 2, _WIDE + 2), dtype=np.float32)
    patch, lanes = np.zeros((_SIDE, _WIDE), dtype=np.float32), np.zeros((3, _WIDE), dtype=np.float32)
    gx, gy = np.zeros((_SIDE, _WIDE), dtype=np.float32), np.zeros((_SIDE, _WIDE), dtype=np.float32)
    for n in range(pixels.shape[0]):
        u, v = places[n, 0] / (1 << top), places[n, 1] / (1 << top)
        found[n] = True
        for level in range(top, -1, -1):
            image = now[level]
            rows, columns = image.shape[0] - 2 * PAD, image.shape[1] - 2 * PAD
            x, y = pixels[n, 0] / (1 << level), pixels[n, 1] / (1 << level)
            within = 0.0 <= x <= columns - 1 and 0.0 <= y <= rows - 1
            xx, xy, yy = 0.0, 0.0, 0.0
            if within:
                take_patch(before[level], x, y, wide, patch, gx, gy)
                blind_to_light(patch, gx, gy)
                xx, xy, yy = _products(gx, gy, lanes)
            least = 0.5 * (xx + yy - math.sqrt((xx - yy) ** 2 + 4.0 * xy * xy))
            known = within and least >= _FLAT * _SIDE * _SIDE
            last_x, last_y, determinant = 0.0, 0.0, xx * yy - xy * xy
            if known and 0.0 <= u <= columns - 1 and 0.0 <= v <= rows - 1:
                determinant *= _contrast(image, u, v, patch)
            for step in range(_MOST_STEPS if known else 0):
                if not (0.0 <= u <= columns - 1 and 0.0 <= v <= rows - 1):
                    known = False
                    break
                bx, by = _miss(image, u, v, gx, gy, lanes)
                du, dv = (xy * by - yy * bx) / determinant, (xy * bx - xx * by) / determinant
                u, v = u + du, v + dv
                if du * du + dv * dv <= _STILL * _STILL:
                    break
                if step > 0 and abs(du + last_x) < 0.01 and abs(dv + last_y) < 0.01:  # to and fro
                    u, v = u - 0.5 * du, v - 0.5 * dv
                    break
                last_x, last_y = du, dv
            if level > 0:
                u, v = 2.0 * u, 2.0 * v
            else:
                found[n] = known and 0.0 <= u <= columns - 1 and 0.0 <= v <= rows - 1
        places[n, 0], places[n, 1] = u, v


@nb.njit(cache=True, nogil=True, error_model="numpy")
def compare_patches(
    before: AnyArray, now: AnyArray, pixels: Float64Array, places: Float64Array, likeness: Float64Array
) -> None:
    """Write the correlation of the patches about pixels (n, 2) of a padded image and about places of another one.

    The pixels and places lie in the images.
    """
    for n in range(pixels.shape[0]):
        old_row, old_column, a0, a1, a2, a3 = _corners(pixels[n, 0], pixels[n, 1])
        row, column, b0, b1, b2, b3 = _corners(places[n, 0], places[n, 1])
        x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(-RADIUS, RADIUS + 1):
            for j in range(-RADIUS, RADIUS + 1):
                r, c = old_row + i, old_column + j
                old = a0 * before[r, c] + a1 * before[r, c + 1] + a2 * before[r + 1, c] + a3 * before[r + 1, c + 1]
                r, c = row + i, column + j
                new = b0 * now[r, c] + b1 * now[r, c + 1] + b2 * now[r + 1, c] + b3 * now[r + 1, c + 1]
                x, y, xx, xy, yy = x + old, y + new, xx + old * old, xy + old * new, yy + new * new
        many = _SIDE * _SIDE
        spread = (xx - x * x / many) * (yy - y * y / many)
        likeness[n] = (xy - x * y / many) / math.sqrt(spread) if spread > 0.0 else 0.0
