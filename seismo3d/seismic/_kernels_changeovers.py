"""Smooth surfaces through points that belong to one of two, not all of them to the one that they are said to."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _solve(terms, height, weights, ridge, factors):  # type: ignore[no-untyped-def]
    """Write the factors of the surface through weighed points; the square of a bend costs `ridge` a weight."""
    n = terms.shape[1]
    matrix, right, total = np.zeros((n, n)), np.zeros(n), 0.0
    for a in range(len(height)):
        weight = weights[a]
        if weight == 0.0:
            continue
        total += weight
        for i in range(n):
            term = weight * terms[a, i]
            right[i] += term * height[a]
            for j in range(i + 1):
                matrix[i, j] += term * terms[a, j]
    for i in range(n):
        for j in range(i):
            matrix[j, i] = matrix[i, j]
        matrix[i, i] += total * (ridge if i > 2 else 1e-9)
    factors[:] = np.linalg.solve(matrix, right)


@njit(cache=True, nogil=True, inline="always")
def _off(terms, height, factors, a):  # type: ignore[no-untyped-def]
    left = height[a]
    for i in range(terms.shape[1]):
        left -= factors[i] * terms[a, i]
    return abs(left)


@njit(cache=True, nogil=True)
def fit_most(terms, height, ridge, rounds):  # type: ignore[no-untyped-def]
    """Return how far points lie off the surface through most of them."""
    factors, weights = np.empty(terms.shape[1]), np.ones(len(height))
    for _ in range(rounds):
        _solve(terms, height, weights, ridge, factors)
        for a in range(len(height)):
            weights[a] = 1.0 / (1.0 + _off(terms, height, factors, a) ** 2)
    off = np.empty(len(height))
    for a in range(len(height)):
        off[a] = _off(terms, height, factors, a)
    return off


@njit(cache=True, nogil=True)
def settle_points(terms, height, on_second, ridge, more, farthest, least, rounds, factors):  # type: ignore[no-untyped-def]
    """Write two surfaces, and in `on_second` on which of them each point lies, by turns.

    A point goes over to the surface that is nearer by `more`; what is farther off both than `farthest` tells of none.
    Returns the mean distance of the points from the nearer surface and what both bend; infinite if a surface has fewer
    points than `least`.
    """
    n = len(height)
    weights, near = np.empty(n), np.ones(n, np.bool_)
    for _ in range(rounds):
        for surface in range(2):
            count = 0
            for a in range(n):
                mine = near[a] and on_second[a] == (surface == 1)
                weights[a] = 1.0 if mine else 0.0
                count += mine
            if count < least:
                return np.inf
            _solve(terms, height, weights, ridge, factors[surface])
        changed = False
        for a in range(n):
            one, other = _off(terms, height, factors[0], a), _off(terms, height, factors[1], a)
            here = other < one if abs(one - other) > more else on_second[a]
            close = min(one, other) < farthest
            changed |= here != on_second[a] or close != near[a]
            on_second[a], near[a] = here, close
        if not changed:
            break
    left = 0.0
    for a in range(n):
        left += min(_off(terms, height, factors[0], a), _off(terms, height, factors[1], a), farthest)
    bends = 0.0
    for surface in range(2):
        for i in range(3, terms.shape[1]):
            bends += factors[surface, i] ** 2
    return left / n + ridge * bends
