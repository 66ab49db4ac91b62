"""Kernels that carry sheets on."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d._typing import BoolArray, Float64Array, IntArray


@njit(cache=True, nogil=True, parallel=True)
def fit_local_planes(
    w: Float64Array, inside: BoolArray, rows: IntArray, columns: IntArray, taps: Float64Array, spread: float,
    planes: Float64Array,
) -> None:  # fmt: skip
    """Fit a plane to the known nodes around each of some, and give its height there and its slopes.

    Parameters
    ----------
    w : ndarray of shape (row, column)
        Heights.
    inside : ndarray of the same shape
        Where they are known.
    rows, columns : ndarray of shape (n,)
        Where a plane is wanted.
    taps : ndarray of odd length
        Weights of the nodes around along each axis.
    spread : float
        Added to that of the places, in nodes squared: it keeps a plane level across a line of nodes.
    planes : ndarray of shape (n, 3)
        Filled: height, and slopes along rows and columns; 0 where nothing is known around.
    """
    reach = len(taps) // 2
    for k in prange(len(rows)):
        total = x = y = h = xx = xy = yy = xh = yh = 0.0
        for i in range(max(0, rows[k] - reach), min(w.shape[0], rows[k] + reach + 1)):
            r = float(i - rows[k])
            for j in range(max(0, columns[k] - reach), min(w.shape[1], columns[k] + reach + 1)):
                if not inside[i, j]:
                    continue
                c = float(j - columns[k])
                weight = taps[i - rows[k] + reach] * taps[j - columns[k] + reach]
                total += weight
                x += weight * r
                y += weight * c
                h += weight * w[i, j]
                xx += weight * r * r
                xy += weight * r * c
                yy += weight * c * c
                xh += weight * r * w[i, j]
                yh += weight * c * w[i, j]
        planes[k] = 0.0
        if total <= 0.0:
            continue
        x, y, h = x / total, y / total, h / total
        rr, cc, rc = xx / total - x * x + spread, yy / total - y * y + spread, xy / total - x * y
        rh, ch = xh / total - x * h, yh / total - y * h
        size = max(rr * cc - rc * rc, 1e-12)
        along, down = (cc * rh - rc * ch) / size, (rr * ch - rc * rh) / size
        planes[k, 0], planes[k, 1], planes[k, 2] = h - along * x - down * y, along, down


@njit(cache=True, nogil=True, inline="always")
def _lay(positions, n, origin, along, across, first_s, first_sample, step):  # type: ignore[no-untyped-def]
    """Return the row and column of the node of a sheet's grid nearest to a point, and its height."""
    x, y = positions[n, 0] - origin[0], positions[n, 1] - origin[1]
    row = np.int64(np.rint(x * along[0] + y * along[1] - first_s))
    column = np.int64(np.rint((positions[n, 2] - np.float32(first_sample)) / np.float32(step)))
    return row, column, x * across[0] + y * across[1]


@njit(cache=True, nogil=True)
def find_beside(  # type: ignore[no-untyped-def]
    positions, score, origin, along, across, first_s, first_sample, step, shape, low, high, weakest
):
    """Return the numbers of the points, of a score of `weakest` or more, on a sheet's grid and between two heights."""
    count, most = 0, 1024
    found = np.empty(most, np.int64)
    for n in range(len(positions)):
        if score[n] < weakest:
            continue
        row, column, height = _lay(positions, n, origin, along, across, first_s, first_sample, step)
        if not (0 <= row < shape[0] and 0 <= column < shape[1] and low < height < high):
            continue
        if count == most:
            most *= 2
            longer = np.empty(most, np.int64)
            longer[:count] = found
            found = longer
        found[count] = n
        count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def lay_on_grid(positions, numbers, origin, along, across, first_s, first_sample, step):  # type: ignore[no-untyped-def]
    """Return rows and columns of the nodes of a sheet's grid nearest to some points, and the points' heights."""
    n = len(numbers)
    rows, columns, heights = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.float64)
    for m in range(n):
        rows[m], columns[m], heights[m] = _lay(
            positions, numbers[m], origin, along, across, first_s, first_sample, step
        )
    return rows, columns, heights


@njit(cache=True, nogil=True)
def follow_planes(  # type: ignore[no-untyped-def]
    number, planes, along, across, step, rows, columns, height, score, normals, off_plane, least_cosine, best, heights
):
    """Write, for every node that has a plane, the score and the height of the best point that lies on it and in it.

    `number` is the node's place among the planes, -1 without one. Of equal points the last one counts.
    """
    for n in range(len(rows)):
        place = number[rows[n], columns[n]]
        if place < 0 or abs(height[n] - planes[place, 0]) > off_plane or score[n] < best[place]:
            continue
        x = across[0] - planes[place, 1] * along[0]
        y = across[1] - planes[place, 1] * along[1]
        z = -planes[place, 2] / step
        dot = x * normals[n, 0] + y * normals[n, 1] + z * normals[n, 2]
        if abs(dot / np.sqrt(x * x + y * y + z * z)) >= least_cosine:
            best[place] = score[n]
            heights[place] = height[n]
