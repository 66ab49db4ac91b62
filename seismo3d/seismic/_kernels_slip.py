"""Both sides of a fault compared about a throw that is known roughly, and smooth fields fitted to what matched."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def match_about(hanging, foot, in_hanging, in_foot, usual, share, thin, loud, cost, energy, weight):  # type: ignore[no-untyped-def]
    """Compare every `thin`-th place of the hanging wall with where throws about the usual one say that it came from.

    Throw number c is the usual one there plus c - n // 2 samples, and the place has moved along the rows by `share`
    times that. Written are the squared difference, at most `loud`, the energy of both sides, and 1 where both are
    known.
    """
    n_rows, n_samples = hanging.shape
    n_shifts, thin_rows, thin_samples = cost.shape
    for number in prange(n_shifts):
        shift = np.float32(np.int64(number) - n_shifts // 2)
        for a in range(thin_rows):
            for b in range(thin_samples):
                r, k = a * thin, b * thin
                cost[number, a, b] = 0.0
                energy[number, a, b] = 0.0
                weight[number, a, b] = 0.0
                throw = usual[a, b] + shift
                row, above = r - share * throw, k - throw
                inside = 0.0 <= row <= n_rows - 1 and 0.0 <= above <= n_samples - 1
                if not inside or in_hanging[r, k] <= 0:
                    continue
                i, j = int(row), int(above)
                fr, fk = np.float32(row - i), np.float32(above - j)
                i1 = i + 1 if fr > 0 else i
                j1 = j + 1 if fk > 0 else j
                if in_foot[i, j] > 0 and in_foot[i1, j] > 0 and in_foot[i, j1] > 0 and in_foot[i1, j1] > 0:
                    one = np.float32(1.0)
                    value = (foot[i, j] * (one - fk) + foot[i, j1] * fk) * (one - fr)
                    value += (foot[i1, j] * (one - fk) + foot[i1, j1] * fk) * fr
                    difference = hanging[r, k] - value
                    cost[number, a, b] = min(difference * difference, loud)
                    energy[number, a, b] = hanging[r, k] * hanging[r, k] + value * value
                    weight[number, a, b] = 1.0


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
    for j in range(n):
        # column j of the factor U, with A = U' U
        for i in range(max(0, j - width), j + 1):
            total = bands[width - j + i, j]
            for k in range(max(0, j - width), i):
                total -= bands[width - i + k, i] * bands[width - j + k, j]
            bands[width - j + i, j] = np.sqrt(total) if i == j else total / bands[width, i]
    for j in range(n):
        for k in range(max(0, j - width), j):
            right[j] -= bands[width - j + k, j] * right[k]
        right[j] /= bands[width, j]
    for j in range(n - 1, -1, -1):
        right[j] /= bands[width, j]
        for k in range(max(0, j - width), j):
            right[k] -= bands[width - j + k, j] * right[j]
