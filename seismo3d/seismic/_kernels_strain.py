"""Weighted sums of products of many terms."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _product(one, other, weights):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(len(weights)):
        total += one[k] * other[k] * weights[k]
    return total


@njit(cache=True, nogil=True, parallel=True)
def sum_products(terms, values, weights, matrix, right):  # type: ignore[no-untyped-def]
    """Write the weighted sums of products of all pairs of terms (one a row), and of each with some values.

    Return that of the values with themselves.
    """
    for a in prange(len(terms)):
        # each sum is one thread's: it does not depend on how many there are
        for b in range(a + 1):
            matrix[a, b] = matrix[b, a] = _product(terms[a], terms[b], weights)
        right[a] = _product(terms[a], values, weights)
    return np.float64(_product(values, values, weights))
