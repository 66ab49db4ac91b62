"""Kernels that gather residuals into the quadratic form; see :mod:`seismo3d.registration.quadratic`.

Sums run over fixed blocks or lanes of pairs, which are added in order, so that the result does not depend on threads.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._multiply_add import multiply_add
from seismo3d._typing import Float64Array

BLOCK = 4096
LANES = 8
"""Pairs that are added side by side, so that the processor's vectors take them in a step."""


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
    if d == 3:
        return unpack_planes(_sum_planes_in_space(p, q, n, w), d)
    size = (d + 1) * (d + 2) // 2 * (d * (d + 1) // 2) + (d + 1) * d + 1
    total = np.zeros(size)
    for start in range(0, p.shape[0], BLOCK):
        sums = np.zeros(size)
        for i in range(start, min(start + BLOCK, p.shape[0])):
            add_plane_pair(sums, p[i], q[i], n[i], w[i], d)
        total += sums
    return unpack_planes(total, d)


@nb.njit(cache=True, nogil=True)
def _sum_planes_in_space(p: Float64Array, q: Float64Array, n: Float64Array, w: Float64Array) -> Float64Array:
    """Return the sums of :func:`add_plane_pair` over all pairs; pair i goes to lane i % 8 of each sum."""
    sums = np.zeros((73, LANES))
    h, c = np.zeros((4, LANES)), np.zeros(LANES)
    normal, products = np.zeros((3, LANES)), np.zeros((6, LANES))
    h[3, :] = 1.0
    weighted, both = np.zeros(LANES), np.zeros(LANES)
    for start in range(0, p.shape[0], LANES):
        for lane in range(LANES):
            i = min(start + lane, p.shape[0] - 1)
            weight = w[i] if start + lane < p.shape[0] else 0.0
            h[0, lane], h[1, lane], h[2, lane] = p[i, 0], p[i, 1], p[i, 2]
            x, y, z = n[i, 0], n[i, 1], n[i, 2]
            normal[0, lane], normal[1, lane], normal[2, lane] = weight * x, weight * y, weight * z
            products[0, lane], products[1, lane], products[2, lane] = weight * x * x, weight * x * y, weight * x * z
            products[3, lane], products[4, lane], products[5, lane] = weight * y * y, weight * y * z, weight * z * z
            c[lane] = x * q[i, 0] + y * q[i, 1] + z * q[i, 2]
            weighted[lane] = weight
        k = 0
        for a in range(4):
            for b in range(a, 4):
                for lane in range(LANES):
                    both[lane] = h[a, lane] * h[b, lane]
                for j in range(6):
                    for lane in range(LANES):
                        sums[k + j, lane] = multiply_add(both[lane], products[j, lane], sums[k + j, lane])
                k += 6
        for a in range(4):
            for lane in range(LANES):
                both[lane] = h[a, lane] * c[lane]
            for j in range(3):
                for lane in range(LANES):
                    sums[k + j, lane] = multiply_add(both[lane], normal[j, lane], sums[k + j, lane])
            k += 3
        for lane in range(LANES):
            sums[k, lane] += weighted[lane] * c[lane] * c[lane]
    out = np.zeros(73)
    for k in range(73):
        for lane in range(LANES):
            out[k] += sums[k, lane]
    return out


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
