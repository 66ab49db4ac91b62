"""Kernels that gather residuals into the quadratic form; see :mod:`seismo3d.registration.quadratic`.

Sums run over fixed blocks of pairs and the blocks are added in order, so that the result does not depend on threads.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._typing import Float64Array

BLOCK = 4096


@nb.njit(cache=True, nogil=True)
def add_plane_pair(sums: Float64Array, p: Float64Array, q: Float64Array, n: Float64Array, w: float, d: int) -> None:
    """Add one weighted row ``n . (A p + t - q)`` to the packed sums ``(1 + d)(2 + d)/2 x d(d + 1)/2 + (1 + d) d + 1``.

    With h = [p; 1] and c = n . q the sums are the upper triangles of h h' times those of n n', then c h n', then c^2.
    """
    c = 0.0
    for i in range(d):
        c += n[i] * q[i]
    k = 0
    for a in range(d + 1):
        ha = p[a] if a < d else 1.0
        for b in range(a, d + 1):
            hab = w * ha * (p[b] if b < d else 1.0)
            for i in range(d):
                hn = hab * n[i]
                for j in range(i, d):
                    sums[k] += hn * n[j]
                    k += 1
    for a in range(d + 1):
        hc = w * c * (p[a] if a < d else 1.0)
        for i in range(d):
            sums[k] += hc * n[i]
            k += 1
    sums[k] += w * c * c


@nb.njit(cache=True, nogil=True)
def unpack_planes(sums: Float64Array, d: int) -> Float64Array:
    """Spread the packed sums of plane pairs over the symmetric matrix Q in z = [vec(A); t; 1]."""
    m = d * (d + 1)
    Q = np.zeros((m + 1, m + 1))
    k = 0
    for a in range(d + 1):
        for b in range(a, d + 1):
            for i in range(d):
                for j in range(i, d):
                    value = sums[k]
                    Q[a * d + i, b * d + j] = value
                    Q[a * d + j, b * d + i] = value
                    Q[b * d + i, a * d + j] = value
                    Q[b * d + j, a * d + i] = value
                    k += 1
    for a in range(d + 1):
        for i in range(d):
            Q[a * d + i, m] = -sums[k]
            Q[m, a * d + i] = -sums[k]
            k += 1
    Q[m, m] = sums[k]
    return Q


@nb.njit(cache=True, nogil=True)
def plane_form(p: Float64Array, q: Float64Array, n: Float64Array, w: Float64Array) -> Float64Array:
    """Return Q of plane pairs: source points, target points, target normals, weights."""
    d = p.shape[1]
    size = (d + 1) * (d + 2) // 2 * (d * (d + 1) // 2) + (d + 1) * d + 1
    total = np.zeros(size)
    for start in range(0, p.shape[0], BLOCK):
        sums = np.zeros(size)
        for i in range(start, min(start + BLOCK, p.shape[0])):
            add_plane_pair(sums, p[i], q[i], n[i], w[i], d)
        total += sums
    return unpack_planes(total, d)


@nb.njit(cache=True, nogil=True)
def point_form(p: Float64Array, q: Float64Array, w: Float64Array) -> Float64Array:
    """Return Q of point pairs ``|A p + t - q|^2``: source points, target points, weights."""
    d = p.shape[1]
    m = d * (d + 1)
    hh = np.zeros((d + 1, d + 1))
    hq = np.zeros((d + 1, d))
    qq = 0.0
    h = np.ones(d + 1)
    for start in range(0, p.shape[0], BLOCK):
        part_hh = np.zeros((d + 1, d + 1))
        part_hq = np.zeros((d + 1, d))
        part_qq = 0.0
        for i in range(start, min(start + BLOCK, p.shape[0])):
            for a in range(d):
                h[a] = p[i, a]
                part_qq += w[i] * q[i, a] * q[i, a]
            for a in range(d + 1):
                for b in range(d + 1):
                    part_hh[a, b] += w[i] * h[a] * h[b]
                for b in range(d):
                    part_hq[a, b] += w[i] * h[a] * q[i, b]
        hh += part_hh
        hq += part_hq
        qq += part_qq
    Q = np.zeros((m + 1, m + 1))
    for a in range(d + 1):
        for b in range(d + 1):
            for i in range(d):
                Q[a * d + i, b * d + i] = hh[a, b]
        for i in range(d):
            Q[a * d + i, m] = -hq[a, i]
            Q[m, a * d + i] = -hq[a, i]
    Q[m, m] = qq
    return Q


@nb.njit(cache=True, nogil=True)
def point_form_full(p: Float64Array, q: Float64Array, W: Float64Array) -> Float64Array:
    """Return Q of point pairs ``r' W r``, r = A p + t - q, with one information matrix of shape (d, d) a pair."""
    d = p.shape[1]
    m = d * (d + 1)
    Q = np.zeros((m + 1, m + 1))
    h = np.ones(d + 1)
    for start in range(0, p.shape[0], BLOCK):
        part = np.zeros((m + 1, m + 1))
        for i in range(start, min(start + BLOCK, p.shape[0])):
            for a in range(d):
                h[a] = p[i, a]
            for a in range(d + 1):
                for k in range(d):
                    for b in range(d + 1):
                        for j in range(d):
                            part[a * d + k, b * d + j] += h[a] * h[b] * W[i, k, j]
                    for j in range(d):
                        part[a * d + k, m] -= h[a] * W[i, k, j] * q[i, j]
            for k in range(d):
                for j in range(d):
                    part[m, m] += q[i, k] * W[i, k, j] * q[i, j]
        Q += part
    Q[m, :m] = Q[:m, m]
    return Q
