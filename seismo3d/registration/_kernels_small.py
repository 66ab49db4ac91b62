"""Small dense linear algebra for the solvers: sizes up to 12, no checks, no memory beyond the results."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float64Array


@nb.njit(cache=True, nogil=True)
def jacobi_eigen(S: Float64Array, values: Float64Array, vectors: Float64Array) -> None:
    """Eigenvalues, ascending, and eigenvectors (columns) of a small symmetric matrix by cyclic Jacobi turns."""
    n = S.shape[0]
    a = S.copy()
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):
        off = 0.0
        norm = 0.0
        for i in range(n):
            norm += a[i, i] * a[i, i]
            for j in range(i + 1, n):
                off += a[i, j] * a[i, j]
        if off <= 1e-32 * norm or off == 0.0:
            break
        for p in range(n - 1):
            for q in range(p + 1, n):
                apq = a[p, q]
                if apq == 0.0:
                    continue
                theta = 0.5 * (a[q, q] - a[p, p]) / apq
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    akp = a[k, p]
                    akq = a[k, q]
                    a[k, p] = c * akp - s * akq
                    a[k, q] = s * akp + c * akq
                for k in range(n):
                    apk = a[p, k]
                    aqk = a[q, k]
                    a[p, k] = c * apk - s * aqk
                    a[q, k] = s * apk + c * aqk
                    vkp = vectors[k, p]
                    vkq = vectors[k, q]
                    vectors[k, p] = c * vkp - s * vkq
                    vectors[k, q] = s * vkp + c * vkq
    for i in range(n):
        values[i] = a[i, i]
    for i in range(n - 1):
        low = i
        for j in range(i + 1, n):
            if values[j] < values[low]:
                low = j
        if low != i:
            values[i], values[low] = values[low], values[i]
            for k in range(n):
                vectors[k, i], vectors[k, low] = vectors[k, low], vectors[k, i]


@nb.njit(cache=True, nogil=True)
def exp3(wx: float, wy: float, wz: float) -> Float64Array:
    """Rotation matrix of a rotation vector."""
    angle2 = wx * wx + wy * wy + wz * wz
    if angle2 < 1e-8:
        f = 1.0 - angle2 / 6.0
        g = 0.5 - angle2 / 24.0
    else:
        angle = math.sqrt(angle2)
        f = math.sin(angle) / angle
        g = (1.0 - math.cos(angle)) / angle2
    R = np.empty((3, 3))
    R[0, 0] = 1.0 - g * (wy * wy + wz * wz)
    R[1, 1] = 1.0 - g * (wx * wx + wz * wz)
    R[2, 2] = 1.0 - g * (wx * wx + wy * wy)
    R[0, 1] = g * wx * wy - f * wz
    R[1, 0] = g * wx * wy + f * wz
    R[0, 2] = g * wx * wz + f * wy
    R[2, 0] = g * wx * wz - f * wy
    R[1, 2] = g * wy * wz - f * wx
    R[2, 1] = g * wy * wz + f * wx
    return R


@nb.njit(cache=True, nogil=True)
def multiply3(A: Float64Array, B: Float64Array, out: Float64Array) -> None:
    """Matrix product of two 3 x 3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@nb.njit(cache=True, nogil=True)
def project_rotation3(A: Float64Array) -> Float64Array:
    """Nearest rotation to a 3 x 3 matrix; any of the nearest where there are many."""
    S = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            S[i, j] = A[0, i] * A[0, j] + A[1, i] * A[1, j] + A[2, i] * A[2, j]
    values = np.empty(3)
    V = np.empty((3, 3))
    jacobi_eigen(S, values, V)
    U = np.zeros((3, 3))
    R = np.eye(3)
    if values[2] <= 1e-30:
        return R
    for k in range(2):
        c = 2 - k
        for i in range(3):
            U[i, k] = A[i, 0] * V[0, c] + A[i, 1] * V[1, c] + A[i, 2] * V[2, c]
    length = math.sqrt(U[0, 0] ** 2 + U[1, 0] ** 2 + U[2, 0] ** 2)
    for i in range(3):
        U[i, 0] /= length
    along = U[0, 0] * U[0, 1] + U[1, 0] * U[1, 1] + U[2, 0] * U[2, 1]
    for i in range(3):
        U[i, 1] -= along * U[i, 0]
    length2 = math.sqrt(U[0, 1] ** 2 + U[1, 1] ** 2 + U[2, 1] ** 2)
    if length2 <= 1e-12 * length:
        low = 0
        for i in range(1, 3):
            if abs(U[i, 0]) < abs(U[low, 0]):
                low = i
        for i in range(3):
            U[i, 1] = (1.0 if i == low else 0.0) - U[low, 0] * U[i, 0]
        length2 = math.sqrt(U[0, 1] ** 2 + U[1, 1] ** 2 + U[2, 1] ** 2)
    for i in range(3):
        U[i, 1] /= length2
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        U[k, 2] = U[a, 0] * U[b, 1] - U[b, 0] * U[a, 1]
        S[k, 2] = V[a, 2] * V[b, 1] - V[b, 2] * V[a, 1]
        S[k, 0] = V[k, 2]
        S[k, 1] = V[k, 1]
    for i in range(3):
        for j in range(3):
            R[i, j] = U[i, 0] * S[j, 0] + U[i, 1] * S[j, 1] + U[i, 2] * S[j, 2]
    return R


@nb.njit(cache=True, nogil=True)
def pseudo_solve(S: Float64Array, rhs: Float64Array, tolerance: float) -> Float64Array:
    """Return S^+ rhs for a small symmetric matrix, eigenvalues below tolerance times the largest taken as zero."""
    n = S.shape[0]
    values = np.empty(n)
    vectors = np.empty((n, n))
    jacobi_eigen(S, values, vectors)
    limit = tolerance * max(abs(values[0]), abs(values[n - 1]))
    out = np.zeros(n)
    for k in range(n):
        if abs(values[k]) > limit:
            along = 0.0
            for i in range(n):
                along += vectors[i, k] * rhs[i]
            for i in range(n):
                out[i] += along / values[k] * vectors[i, k]
    return out
