"""Kernels that carry the parts of a sheet up to where it is cut."""

from __future__ import annotations

from numba import njit, prange

from seismo3d._typing import Float64Array, IntArray


@njit(cache=True, nogil=True, parallel=True)
def carry_to_places(
    w: Float64Array,
    known: Float64Array,
    sides: IntArray,
    rows: IntArray,
    columns: IntArray,
    wanted: IntArray,
    row_taps: Float64Array,
    column_taps: Float64Array,
    slopes: tuple[float, float],
    stiffness: tuple[float, float],
    height: Float64Array,
    weight: Float64Array,
) -> None:
    """Fit a plane to the known nodes around places, of one side of all cuts, and write its height there.

    Parameters
    ----------
    w, known : ndarray of shape (row, column)
        Heights, and how much each tells, 0 to 1.
    sides : ndarray of the same shape
        A bit a cut; negative where a node tells nothing.
    rows, columns, wanted : ndarray of shape (n,)
        Where a height is wanted, and of the nodes of which sides.
    row_taps, column_taps : ndarray of odd length
        Weights of the window's nodes along each axis.
    slopes : tuple of float
        What the plane's slopes lean to.
    stiffness : tuple of float
        How much they do, along rows and columns: the weight of nodes times their squared distance.
    height, weight : ndarray of shape (n,)
        Filled: height, 0 where there is none, and how many nodes told it.
    """
    row_reach, column_reach = len(row_taps) // 2, len(column_taps) // 2
    for n in prange(len(rows)):
        r, c, side = rows[n], columns[n], wanted[n]
        total = x = y = h = xx = xy = yy = xh = yh = 0.0
        for i in range(max(0, r - row_reach), min(w.shape[0], r + row_reach + 1)):
            a, across = float(i - r), row_taps[i - r + row_reach]
            for j in range(max(0, c - column_reach), min(w.shape[1], c + column_reach + 1)):
                if sides[i, j] != side:
                    continue
                b, part = float(j - c), known[i, j] * across * column_taps[j - c + column_reach]
                left = w[i, j] - slopes[0] * a - slopes[1] * b
                total += part
                x += part * a
                y += part * b
                h += part * left
                xx += part * a * a
                xy += part * a * b
                yy += part * b * b
                xh += part * a * left
                yh += part * b * left
        height[n], weight[n] = 0.0, total
        if total <= 0.0:
            continue
        x, y, h = x / total, y / total, h / total
        rr, cc = (xx + stiffness[0]) / total - x * x, (yy + stiffness[1]) / total - y * y
        rc, rh, ch = xy / total - x * y, xh / total - x * h, yh / total - y * h
        size = max(rr * cc - rc * rc, 1e-12)
        height[n] = h - (cc * rh - rc * ch) / size * x - (rr * ch - rc * rh) / size * y
