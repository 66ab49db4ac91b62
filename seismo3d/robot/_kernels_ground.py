"""Compiled loops over the ground's height: slope of a fitted plane, and steps between neighbours."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def fit_slopes(height, cell, reach, slope):
    """Write the slope (rise over run) of the plane through the heights within ``reach`` cells of each cell.

    NaN where the cell itself, or all but a line of its surroundings, is unknown. Each cell's answer depends on its own
    surroundings alone, to the last bit, so that a part of a map can be done again by itself.
    """
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            slope[r, c] = np.nan
            if not math.isfinite(height[r, c]):
                continue
            n, sx, sy, sz, sxx, sxy, syy, sxz, syz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(max(r - reach, 0), min(r + reach + 1, rows)):
                for j in range(max(c - reach, 0), min(c + reach + 1, columns)):
                    if not math.isfinite(height[i, j]):
                        continue
                    x, y, z = float(j - c), float(i - r), np.float64(height[i, j]) - np.float64(height[r, c])
                    n, sx, sy, sz = n + 1.0, sx + x, sy + y, sz + z
                    sxx, sxy, syy, sxz, syz = sxx + x * x, sxy + x * y, syy + y * y, sxz + x * z, syz + y * z
            xx, xy, yy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
            xz, yz = sxz - sx * sz / n, syz - sy * sz / n
            det = xx * yy - xy * xy
            if det > 1e-6:
                a, b = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
                slope[r, c] = math.sqrt(a * a + b * b) / cell


@njit(cache=True, nogil=True)
def find_steps(height, step):
    """Write the greatest difference of height between each cell and its known neighbours; 0 where it is unknown."""
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            most = 0.0
            if math.isfinite(height[r, c]):
                for i in range(max(r - 1, 0), min(r + 2, rows)):
                    for j in range(max(c - 1, 0), min(c + 2, columns)):
                        if math.isfinite(height[i, j]):
                            most = max(most, abs(np.float64(height[i, j]) - np.float64(height[r, c])))
            step[r, c] = most
