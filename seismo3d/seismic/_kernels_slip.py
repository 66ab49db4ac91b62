"""Throws pulled towards those that are known roughly, and smooth fields fitted to what matched."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def find_in_view(in_hanging, in_foot, throw, thin, share):  # type: ignore[no-untyped-def]
    """Return where the hanging wall is known and so is the footwall at the place that it came from."""
    n_rows, n_samples = in_foot.shape
    found = np.zeros(throw.shape, np.bool_)
    for r in range(throw.shape[0]):
        for k in range(throw.shape[1]):
            if in_hanging[thin * r, thin * k] <= 0:
                continue
            row, sample = (
                np.rint(thin * r - np.float64(share * throw[r, k])),
                np.rint(thin * k - np.float64(throw[r, k])),
            )
            if 0 <= row < n_rows and 0 <= sample < n_samples:
                found[r, k] = in_foot[np.int64(row), np.int64(sample)] > 0
    return found


@njit(cache=True, nogil=True)
def pull_shifts(cost, known, usual, pull, shift, least, rise):  # type: ignore[no-untyped-def]
    """Write the cheapest shift at every place, refined by a parabola.

    To its cost comes `pull` times the square of its distance from the usual one. `least` is its cost, `rise` by how
    much that is less than three shifts off; where nothing is known, or all costs are infinite, these are infinite and
    0.
    """
    n_rows, n_samples, n = cost.shape
    middle = n // 2
    for r in range(n_rows):
        for k in range(n_samples):
            best, total = -1, np.inf
            if known[r, k]:
                for c in range(n):
                    trial = cost[r, k, c] + pull * (c - middle - usual[r, k]) ** 2
                    if trial < total:
                        best, total = c, trial
            shift[r, k], least[r, k], rise[r, k] = 0.0, np.inf, 0.0
            if best < 0:
                continue
            refined = 0.0
            if 0 < best < n - 1:
                before = cost[r, k, best - 1] + pull * (best - 1 - middle - usual[r, k]) ** 2
                after = cost[r, k, best + 1] + pull * (best + 1 - middle - usual[r, k]) ** 2
                bend = before - 2.0 * total + after
                if np.isfinite(bend) and bend > 1e-9:
                    refined = min(max(0.5 * (before - after) / bend, -0.5), 0.5)
            shift[r, k] = best - middle + refined
            least[r, k] = cost[r, k, best]
            flank = min(cost[r, k, max(best - 3, 0)], cost[r, k, min(best + 3, n - 1)])
            rise[r, k] = min(flank, np.float32(1.0)) - cost[r, k, best]


@njit(cache=True, nogil=True)
def add_places(values, weights, coarse, n_columns, bands, right):  # type: ignore[no-untyped-def]
    """Add weighted values on a grid to the normal equations of a bilinear field, its nodes `coarse` places apart.

    `bands` is the upper band storage of the symmetric matrix, its last row the diagonal.
    """
    width = bands.shape[0] - 1
    n_rows = bands.shape[1] // n_columns
    node, share = np.empty(4, np.int64), np.empty(4)
    for r in range(values.shape[0]):
        for k in range(values.shape[1]):
            w = weights[r, k]
            if w <= 0:
                continue
            i, j = r // coarse, k // coarse
            fr, fk = r / coarse - i, k / coarse - j
            for m in range(4):
                a, b = m // 2, m % 2
                node[m] = min(i + a, n_rows - 1) * n_columns + min(j + b, n_columns - 1)
                share[m] = (fr if a else 1.0 - fr) * (fk if b else 1.0 - fk)
            for m in range(4):
                right[node[m]] += w * share[m] * values[r, k]
                for n in range(4):
                    if node[n] >= node[m]:
                        bands[width - node[n] + node[m], node[n]] += w * share[m] * share[n]


@njit(cache=True, nogil=True)
def _add_square(node, factor, n, stiffness, bands):  # type: ignore[no-untyped-def]
    width = bands.shape[0] - 1
    for p in range(n):
        for q in range(n):
            if node[q] >= node[p]:
                bands[width - node[q] + node[p], node[q]] += stiffness * factor[p] * factor[q]


@njit(cache=True, nogil=True)
def add_bending(n_columns, stiffness, bands):  # type: ignore[no-untyped-def]
    """Add `stiffness` times the squared second differences of the field: along rows, along columns, and the mixed."""
    n_rows = bands.shape[1] // n_columns
    node, factor = np.empty(4, np.int64), np.empty(4)
    for i in range(n_rows):
        for j in range(n_columns):
            at = i * n_columns + j
            factor[0], factor[1], factor[2] = 1.0, -2.0, 1.0
            if 0 < i < n_rows - 1:
                node[0], node[1], node[2] = at - n_columns, at, at + n_columns
                _add_square(node, factor, 3, stiffness, bands)
            if 0 < j < n_columns - 1:
                node[0], node[1], node[2] = at - 1, at, at + 1
                _add_square(node, factor, 3, stiffness, bands)
            if i < n_rows - 1 and j < n_columns - 1:
                node[0], node[1], node[2], node[3] = at, at + 1, at + n_columns, at + n_columns + 1
                factor[0], factor[1], factor[2], factor[3] = 1.0, -1.0, -1.0, 1.0
                _add_square(node, factor, 4, 2.0 * stiffness, bands)


@njit(cache=True, nogil=True)
def solve_bands(bands, right):  # type: ignore[no-untyped-def]
    """Solve a positive definite system in upper band storage by Cholesky's method, both arrays in place.

    LAPACK's own would wake the threads of BLAS for a few hundred unknowns, and these would then wait in the way of the
    kernels' threads.
    """
    width, n = bands.shape[0] - 1, bands.shape[1]
    # row k of the factor U, with A = U' U, lies along a row here, and is taken off all that is left below it
    rows = np.zeros((n, width + 1))
    for j in range(n):
        for i in range(max(0, j - width), j + 1):
            rows[i, j - i] = bands[width - j + i, j]
    for k in range(n):
        own = rows[k]
        own[0] = np.sqrt(own[0])
        reach = min(width, n - 1 - k)
        for m in range(1, reach + 1):
            own[m] /= own[0]
        for i in range(1, reach + 1):
            below, pull, ahead = rows[k + i], own[i], own[i:]
            for m in range(reach + 1 - i):
                below[m] -= pull * ahead[m]
    for j in range(n):
        for i in range(max(0, j - width), j + 1):
            bands[width - j + i, j] = rows[i, j - i]
    for j in range(n):
        for k in range(max(0, j - width), j):
            right[j] -= bands[width - j + k, j] * right[k]
        right[j] /= bands[width, j]
    for j in range(n - 1, -1, -1):
        right[j] /= bands[width, j]
        for k in range(max(0, j - width), j):
            right[k] -= bands[width - j + k, j] * right[j]
