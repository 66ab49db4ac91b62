"""The stiff surface through what the traces of a horizon tell."""

from __future__ import annotations

import numpy as np
from numba import njit

# bits of a trace's links: to the next inline, to the next crossline
_DOWN, _ALONG = np.uint8(1), np.uint8(2)


@njit(cache=True, nogil=True)
def _find_bends(linked, stiffness, down, along, twist):  # type: ignore[no-untyped-def]
    """Write what each second difference counts, 0 where traces are not linked; one trace more lies all around.

    `down` and `along` are of the traces before and after one, `twist` of the four of a cell, of which it is the first:
    that counts for both mixed derivatives.
    """
    n0, n1 = linked.shape
    for i in range(n0):
        for j in range(n1):
            here = linked[i, j]
            if i > 0 and here & linked[i - 1, j] & _DOWN:
                down[i + 1, j + 1] = stiffness
            if j > 0 and here & linked[i, j - 1] & _ALONG:
                along[i + 1, j + 1] = stiffness
            if here & _DOWN and here & _ALONG and linked[i, j + 1] & _DOWN and linked[i + 1, j] & _ALONG:
                twist[i + 1, j + 1] = 2.0 * stiffness


@njit(cache=True, nogil=True)
def _bend(u, bends, pulls):  # type: ignore[no-untyped-def]
    """Write the second differences of a surface times what they count."""
    for i in range(1, u.shape[0] - 1):
        for j in range(1, u.shape[1] - 1):
            here = u[i, j]
            pulls[0][i, j] = bends[0][i, j] * (u[i - 1, j] - 2.0 * here + u[i + 1, j])
            pulls[1][i, j] = bends[1][i, j] * (u[i, j - 1] - 2.0 * here + u[i, j + 1])
            pulls[2][i, j] = bends[2][i, j] * (here - u[i + 1, j] - u[i, j + 1] + u[i + 1, j + 1])


@njit(cache=True, nogil=True, inline="always")
def _pull_at(pulls, i, j):  # type: ignore[no-untyped-def]
    """Return the derivative of half the bending energy by the value of one trace."""
    down, along, twist = pulls
    pull = down[i - 1, j] - 2.0 * down[i, j] + down[i + 1, j]
    pull += along[i, j - 1] - 2.0 * along[i, j] + along[i, j + 1]
    return pull + twist[i, j] - twist[i - 1, j] - twist[i, j - 1] + twist[i - 1, j - 1]


@njit(cache=True, nogil=True, inline="always")
def _stiffness_at(bends, i, j):  # type: ignore[no-untyped-def]
    """Return how that grows with the value."""
    down, along, twist = bends
    total = down[i - 1, j] + 4.0 * down[i, j] + down[i + 1, j]
    total += along[i, j - 1] + 4.0 * along[i, j] + along[i, j + 1]
    return total + twist[i, j] + twist[i - 1, j] + twist[i, j - 1] + twist[i - 1, j - 1]


@njit(cache=True, nogil=True)
def stiffen(values, weights, linked, stiffness, tolerance, most, out):  # type: ignore[no-untyped-def]
    """Write the surface that least misses the values, as weighed, and bends least.

    Values without weight must be finite, and are the start there. Conjugate gradients, the diagonal as preconditioner;
    they end after so many steps at most, or where the misfit left is below the tolerance, in the unit of the values.
    """
    n0, n1 = values.shape
    wide = (n0 + 2, n1 + 2)
    bends = (np.zeros(wide), np.zeros(wide), np.zeros(wide))
    pulls = (np.zeros(wide), np.zeros(wide), np.zeros(wide))
    _find_bends(linked, stiffness, *bends)
    # what is smoothed has one trace more all around, which nothing is linked to
    step, towards, left, inverse = np.zeros(wide), np.empty((n0, n1)), np.empty((n0, n1)), np.zeros((n0, n1))
    step[1:-1, 1:-1] = values
    out[:] = values
    _bend(step, bends, pulls)
    energy = 0.0
    for i in range(n0):
        for j in range(n1):
            diagonal = weights[i, j] + _stiffness_at(bends, i + 1, j + 1)
            if diagonal > 0.0:
                inverse[i, j] = 1.0 / diagonal
            left[i, j] = -_pull_at(pulls, i + 1, j + 1)
            energy += left[i, j] * left[i, j] * inverse[i, j]
    step[1:-1, 1:-1] = inverse * left
    # sums over columns first: one after the other, each sum would wait for the last
    sums = np.empty(n1)
    enough = tolerance * tolerance * weights.sum()
    for _ in range(most):
        if energy <= enough:
            return
        _bend(step, bends, pulls)
        sums[:] = 0.0
        for i in range(n0):
            for j in range(n1):
                towards[i, j] = _pull_at(pulls, i + 1, j + 1) + weights[i, j] * step[i + 1, j + 1]
                sums[j] += step[i + 1, j + 1] * towards[i, j]
        share, before = energy / sums.sum(), energy
        sums[:] = 0.0
        for i in range(n0):
            for j in range(n1):
                out[i, j] += share * step[i + 1, j + 1]
                left[i, j] -= share * towards[i, j]
                sums[j] += left[i, j] * left[i, j] * inverse[i, j]
        energy = sums.sum()
        for i in range(n0):
            for j in range(n1):
                step[i + 1, j + 1] = inverse[i, j] * left[i, j] + energy / before * step[i + 1, j + 1]
