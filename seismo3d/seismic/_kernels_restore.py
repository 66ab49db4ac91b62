"""Values at scattered places spread onto a grid, and a grid read at scattered places."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def spread(rows, columns, values, sums, weight):  # type: ignore[no-untyped-def]
    """Add values (m, n) at n fractional places to the four grid places around each, by bilinear weights."""
    n_rows, n_columns = weight.shape
    for n in range(len(rows)):
        if not (0.0 <= rows[n] < n_rows - 1 and 0.0 <= columns[n] < n_columns - 1):
            continue
        i, j = int(rows[n]), int(columns[n])
        fr, fc = rows[n] - i, columns[n] - j
        for a in range(2):
            for b in range(2):
                share = (fr if a == 1 else 1.0 - fr) * (fc if b == 1 else 1.0 - fc)
                weight[i + a, j + b] += share
                for m in range(values.shape[0]):
                    sums[m, i + a, j + b] += share * np.float64(values[m, n])


@njit(cache=True, nogil=True, inline="always")
def _between(grid, row, column):  # type: ignore[no-untyped-def]
    """Return the value of a grid at a fractional place, bilinear; beyond its ends that at the end."""
    n_rows, n_columns = grid.shape
    # in this order, so that even no number leads to a place of the grid
    r, c = max(0.0, row), max(0.0, column)
    r, c = min(r, n_rows - 1.0), min(c, n_columns - 1.0)
    i, j = int(r), int(c)
    fr, fc = r - i, c - j
    i1, j1 = min(i + 1, n_rows - 1), min(j + 1, n_columns - 1)
    total = np.float64(grid[i, j]) * (1.0 - fr) * (1.0 - fc)
    total += np.float64(grid[i, j1]) * (1.0 - fr) * fc
    total += np.float64(grid[i1, j]) * fr * (1.0 - fc)
    return total + np.float64(grid[i1, j1]) * fr * fc


@njit(cache=True, nogil=True)
def read_between(grid, rows, columns):  # type: ignore[no-untyped-def]
    """Return the values of a grid at fractional places, float64."""
    out = np.empty(len(rows), np.float64)
    for n in range(len(rows)):
        out[n] = _between(grid, rows[n], columns[n])
    return out


@njit(cache=True, nogil=True)
def enlarge_grid(grid, rows, columns):  # type: ignore[no-untyped-def]
    """Return the values of a grid where fractional rows and columns cross, float64."""
    out = np.empty((len(rows), len(columns)), np.float64)
    for r in range(len(rows)):
        for c in range(len(columns)):
            out[r, c] = _between(grid, rows[r], columns[c])
    return out


@njit(cache=True, nogil=True)
def find_near_motion(points, origin, along, across, first, height, apart, slopes, reach, clear, edge):  # type: ignore[no-untyped-def]
    """Return which points lie between two distances across a surface, and no farther from where it was found than edge.

    And how far across each of them lies from it.
    """
    n_rows, n_columns = height.shape
    found, off = np.empty(len(points), np.int64), np.empty(len(points), np.float64)
    low, high = height[0, 0], height[0, 0]
    for i in range(n_rows):
        for j in range(n_columns):
            low, high = min(low, height[i, j]), max(high, height[i, j])
    # beyond its grid, by no more than the edge, a surface goes straight on
    wide = reach + edge * (abs(slopes[0]) + abs(slopes[1])) + 1e-6
    count = 0
    for n in range(len(points)):
        x, y = points[n, 0] - origin[0], points[n, 1] - origin[1]
        w = x * across[0] + y * across[1]
        row, column = x * along[0] + y * along[1] - first[0], points[n, 2] - first[1]
        if w < low - wide or w > high + wide:
            continue
        r, c = min(max(row, 0.0), n_rows - 1.0), min(max(column, 0.0), n_columns - 1.0)
        beyond = np.hypot(row - r, column - c)
        if beyond > edge:
            continue
        side = w - (_between(height, row, column) + slopes[0] * (row - r) + slopes[1] * (column - c))
        if clear < abs(side) < reach and _between(apart, row, column) + beyond <= edge:
            found[count], off[count] = n, side
            count += 1
    return found[:count].copy(), off[:count].copy()
