"""The stiff surface through what the traces of a horizon tell."""

from __future__ import annotations

import numpy as np
from numba import njit

# bits of a trace's links: to the next inline, to the next crossline
_DOWN, _ALONG = np.uint8(1), np.uint8(2)


@njit(cache=True, nogil=True)
def add_bending(u, linked, stiffness, out):  # type: ignore[no-untyped-def]
    """Add the derivatives of half the bending energy of a surface; what is not linked does not bend."""
    n0, n1 = u.shape
    for i in range(n0):
        for j in range(n1):
            here = linked[i, j]
            if i > 0 and here & linked[i - 1, j] & _DOWN:
                bend = stiffness * (u[i - 1, j] - 2.0 * u[i, j] + u[i + 1, j])
                out[i - 1, j] += bend
                out[i, j] -= 2.0 * bend
                out[i + 1, j] += bend
            if j > 0 and here & linked[i, j - 1] & _ALONG:
                bend = stiffness * (u[i, j - 1] - 2.0 * u[i, j] + u[i, j + 1])
                out[i, j - 1] += bend
                out[i, j] -= 2.0 * bend
                out[i, j + 1] += bend
            # the four traces of a cell, which count for both mixed derivatives
            if here & _DOWN and here & _ALONG and linked[i, j + 1] & _DOWN and linked[i + 1, j] & _ALONG:
                twist = 2.0 * stiffness * (u[i, j] - u[i + 1, j] - u[i, j + 1] + u[i + 1, j + 1])
                out[i, j] += twist
                out[i + 1, j] -= twist
                out[i, j + 1] -= twist
                out[i + 1, j + 1] += twist


@njit(cache=True, nogil=True)
def _count_bends(linked, stiffness, out):  # type: ignore[no-untyped-def]
    """Add the diagonal of the same."""
    n0, n1 = linked.shape
    for i in range(n0):
        for j in range(n1):
            here = linked[i, j]
            if i > 0 and here & linked[i - 1, j] & _DOWN:
                out[i - 1, j] += stiffness
                out[i, j] += 4.0 * stiffness
                out[i + 1, j] += stiffness
            if j > 0 and here & linked[i, j - 1] & _ALONG:
                out[i, j - 1] += stiffness
                out[i, j] += 4.0 * stiffness
                out[i, j + 1] += stiffness
            if here & _DOWN and here & _ALONG and linked[i, j + 1] & _DOWN and linked[i + 1, j] & _ALONG:
                out[i, j] += 2.0 * stiffness
                out[i + 1, j] += 2.0 * stiffness
                out[i, j + 1] += 2.0 * stiffness
                out[i + 1, j + 1] += 2.0 * stiffness


@njit(cache=True, nogil=True)
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            total += a[i, j] * b[i, j]
    return total


@njit(cache=True, nogil=True)
def stiffen(values, weights, linked, stiffness, tolerance, most, out):  # type: ignore[no-untyped-def]
    """Write the surface that least misses the values, as weighed, and bends least.

    Values without weight must be finite, and are the start there. Conjugate gradients, the diagonal as preconditioner;
    they end after so many steps at most, or where the misfit left is below the tolerance, in the unit of the values.
    """
    diagonal = weights.copy()
    _count_bends(linked, stiffness, diagonal)
    left = np.zeros_like(values)
    out[:] = values
    add_bending(out, linked, stiffness, left)
    inverse, step, towards = np.empty_like(values), np.empty_like(values), np.empty_like(values)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            left[i, j] = -left[i, j]
            inverse[i, j] = 1.0 / diagonal[i, j] if diagonal[i, j] > 0.0 else 0.0
            step[i, j] = inverse[i, j] * left[i, j]
    energy = _dot(left, step)
    enough = tolerance * tolerance * weights.sum()
    for _ in range(most):
        if energy <= enough:
            return
        towards[:] = 0.0
        add_bending(step, linked, stiffness, towards)
        for i in range(values.shape[0]):
            for j in range(values.shape[1]):
                towards[i, j] += weights[i, j] * step[i, j]
        share = energy / _dot(step, towards)
        for i in range(values.shape[0]):
            for j in range(values.shape[1]):
                out[i, j] += share * step[i, j]
                left[i, j] -= share * towards[i, j]
        before, energy = energy, 0.0
        for i in range(values.shape[0]):
            for j in range(values.shape[1]):
                energy += left[i, j] * left[i, j] * inverse[i, j]
        for i in range(values.shape[0]):
            for j in range(values.shape[1]):
                step[i, j] = inverse[i, j] * left[i, j] + energy / before * step[i, j]
