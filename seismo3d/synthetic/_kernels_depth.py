"""Compiled model of a structured-light depth camera: noise and steps of disparity, shadows, edges, limits.

A structured-light sensor measures disparity f b / z, so that its noise in depth grows as z^2; what the projector, a
baseline b to the right of the camera, does not light has no depth.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from seismo3d.synthetic._kernels_render import hashed, normal_number


@njit(cache=True, nogil=True)
def _mark_shadow(depth, row, throw, lit):
    """Mark what the projector lights in one row, from right to left: a ray that has passed a nearer one is stopped."""
    first = np.inf
    for column in range(depth.shape[1] - 1, -1, -1):
        z = depth[row, column]
        lit[column] = True
        if not z > 0.0:
            continue
        place = column - throw / z
        lit[column] = place <= first + 1.0
        first = min(first, place)


@njit(cache=True, nogil=True)
def _bends(depth, row, column, limit):
    """Whether depth jumps at a pixel: its second difference, which is small on any plane, is large."""
    z = depth[row, column]
    rows, columns = depth.shape
    if 0 < column < columns - 1:
        bend = abs(depth[row, column - 1] - 2.0 * z + depth[row, column + 1])
        if not bend < limit * z:
            return True
    if 0 < row < rows - 1:
        bend = abs(depth[row - 1, column] - 2.0 * z + depth[row + 1, column])
        if not bend < limit * z:
            return True
    return False


@njit(cache=True, nogil=True, parallel=True)
def measure_depth(depth, facing, settings, key, out):
    """Write what the sensor makes of exact depth (metres, NaN in the sky) and the cosine of incidence; NaN for none.

    ``settings``: f b in pixel metres, noise and step of disparity in pixels, least and greatest depth, cosine below
    which nothing comes back and above which all does, jump that makes an edge (share of depth), share of edge pixels
    lost, share of all pixels lost.
    """
    throw, sigma, step, low, high, blind, clear, jump, lost_edges, lost = settings
    for row in prange(depth.shape[0]):
        lit = np.empty(depth.shape[1], dtype=np.bool_)
        _mark_shadow(depth, row, throw, lit)
        for column in range(depth.shape[1]):
            z = depth[row, column]
            out[row, column] = np.nan
            if not (z >= low and z <= high) or not lit[column]:
                continue
            place = row * depth.shape[1] + column
            chance = np.float64(hashed(key, place, 1) >> np.uint64(11)) / 9007199254740992.0
            back = min(max((facing[row, column] - blind) / (clear - blind), 0.0), 1.0) * (1.0 - lost)
            if lost_edges > 0.0 and _bends(depth, row, column, jump):
                back *= 1.0 - lost_edges
            if chance >= back:
                continue
            disparity = throw / z + sigma * normal_number(key, place, 2)
            if step > 0.0:
                disparity = step * math.floor(disparity / step + 0.5)
            if disparity > 0.0:
                measured = throw / disparity
                if low <= measured <= high:
                    out[row, column] = measured


@njit(cache=True, nogil=True, parallel=True)
def measure_colour(colour, sigma, key, out):
    """Round colours 0 to 255, with noise of so many grey levels (a sum of three even ones), into uint8."""
    seven = np.uint64(127)
    for row in prange(colour.shape[0]):
        for column in range(colour.shape[1]):
            bits = hashed(key, row * colour.shape[1] + column, 3)
            for channel in range(3):
                total = (bits & seven) + ((bits >> np.uint64(7)) & seven) + ((bits >> np.uint64(14)) & seven)
                bits = bits >> np.uint64(21)
                value = colour[row, column, channel] + sigma * (np.float64(total) - 190.5) / 63.998
                out[row, column, channel] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
