"""One pass of the fused loop: nearest surface element, robust weight and sums of the quadratic form, pair by pair."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_nearest_voxel import cell_around, nearest_voxel

BLOCK = 256
"""Source points a block: sums are added block by block, so that the result does not depend on threads."""

MARGIN = 0.1
"""Share of a voxel that a search looks beyond the nearest where it is remembered: half of what a point may move."""

N_EXTRA = 5
"""Sums behind those of the form: weights, robust cost, matched points, weighted squares,
slopes of the influence function."""


@nb.njit(cache=True, nogil=True)
def n_sums(d: int) -> int:
    """Length of a block's row of sums."""
    return (d + 1) * (d + 2) // 2 * (d * (d + 1) // 2) + (d + 1) * d + 1 + N_EXTRA


@nb.njit(cache=True, nogil=True, inline="always")
def _add_pair_in_space(
    row: Float64Array,
    products: Float64Array,
    squares: Float64Array,
    h: Float64Array,
    n: Float64Array,
    w: float,
    level: float,
) -> None:
    """Add a pair to the packed sums of :func:`~seismo3d.registration._kernels_form.add_plane_pair`, unrolled."""
    x, y, z = h[0], h[1], h[2]
    products[0], products[1], products[2], products[3] = x * x, x * y, x * z, x
    products[4], products[5], products[6] = y * y, y * z, y
    products[7], products[8], products[9] = z * z, z, 1.0
    squares[0], squares[1], squares[2] = w * n[0] * n[0], w * n[0] * n[1], w * n[0] * n[2]
    squares[3], squares[4], squares[5] = w * n[1] * n[1], w * n[1] * n[2], w * n[2] * n[2]
    for a in range(10):
        for b in range(6):
            row[6 * a + b] += products[a] * squares[b]
    for a in range(4):
        wl = w * level * h[a]
        row[60 + 3 * a] += wl * n[0]
        row[61 + 3 * a] += wl * n[1]
        row[62 + 3 * a] += wl * n[2]
    row[72] += w * level * level


@nb.njit(cache=True, nogil=True, inline="always")
def _add_pair_in_plane(row: Float64Array, h: Float64Array, n: Float64Array, w: float, level: float) -> None:
    """Add a pair of the plane to the packed sums."""
    k = 0
    for a in range(3):
        for b in range(a, 3):
            wab = w * h[a] * h[b]
            row[k] += wab * n[0] * n[0]
            row[k + 1] += wab * n[0] * n[1]
            row[k + 2] += wab * n[1] * n[1]
            k += 3
    for a in range(3):
        wl = w * level * h[a]
        row[k] += wl * n[0]
        row[k + 1] += wl * n[1]
        k += 2
    row[k] += w * level * level


@nb.njit(cache=True, nogil=True, inline="always")
def _recall(
    moved: Float64Array, place: Float64Array, j: int, target: Float32Array, d: int, radius2: float
) -> tuple[bool, int]:
    """Return whether the partner that was found from a place nearby is still the one, and the partner or -1.

    The place's fourth number is the least distance of all others from it: they have come nearer by no more than the
    point has moved since.
    """
    step2 = 0.0
    for k in range(d):
        step2 += (moved[k] - place[k]) ** 2
    others = place[3] - math.sqrt(step2)
    if j < 0:
        return others * abs(others) > radius2, -1
    distance2 = 0.0
    for k in range(d):
        distance2 += (moved[k] - target[j, k]) ** 2
    return others * abs(others) > distance2, j if distance2 < radius2 else -1


@nb.njit(cache=True, nogil=True, inline="always")
def _direct(
    turned: Float64Array, quality_s: np.float32, target: Float32Array, j: int, least_cosine: float, symmetric: bool,
    normal: Float64Array,
) -> np.float32:  # fmt: skip
    """Write the direction that a pair is measured along; return the pair's quality, -1 where the normals disagree.

    That is the target's normal, or the mean of both; the source's where the target has none.
    """
    quality = target[j, 3]
    cosine = turned[0] * target[j, 4] + turned[1] * target[j, 5] + turned[2] * target[j, 6]
    length2 = turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2
    crossed = cosine * cosine < least_cosine * least_cosine * length2
    if quality_s > 0.0 and quality > 0.0 and crossed:
        return np.float32(-1.0)
    sign = 1.0 if cosine >= 0.0 else -1.0
    use_source = (symmetric and quality_s > 0.0) or quality <= 0.0
    for k in range(3):
        normal[k] = target[j, 4 + k] if quality > 0.0 else 0.0
        if use_source:
            normal[k] += sign * turned[k]
    if not use_source:
        return quality
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if length <= 1e-12 or (quality <= 0.0 and quality_s <= 0.0):
        return np.float32(-1.0)
    for k in range(3):
        normal[k] /= length
    return max(quality, quality_s)


@nb.njit(cache=True, nogil=True)
def match_blocks(
    first: int, last: int, source: Float32Array, A: Float64Array, t: Float64Array, turn: Float64Array,
    origin: Float64Array, inverse_size: float, table_keys: Int64Array, table: Int32Array, shift: int,
    target: Float32Array, given: Int32Array, cells: Int64Array, places: Float64Array, nearest: Int32Array,
    radius2: float, cutoff: float, least_cosine: float, symmetric: bool, sums: Float64Array, residuals: Float32Array,
    distances2: Float32Array, partners: Int32Array, normals: Float32Array,
) -> None:  # fmt: skip
    """Match the source elements of blocks first to last - 1 and add up the form of their plane pairs.

    ``given`` holds the partners where they are known (a search that was done elsewhere), or is empty. Points without a
    partner have partner -1 and residual NaN, and count with the full robust cost of 1. ``cells``, ``places`` and
    ``nearest`` hold what earlier passes have found, or are empty: see :class:`~seismo3d.registration.matching.Memory`.
    """
    d = A.shape[0]
    n_form = n_sums(d) - N_EXTRA
    h = np.ones(d + 1)
    normal = np.empty(3)
    moved = np.zeros(3)
    turned = np.zeros(3)
    products = np.empty(10)
    squares = np.empty(6)
    inverse_cutoff2 = 1.0 / (cutoff * cutoff)
    searching = given.shape[0] == 0
    remembering = cells.shape[0] > 0
    margin = MARGIN / inverse_size if remembering else 0.0
    for block in range(first, last):
        row = sums[block]
        row[:] = 0.0
        for i in range(block * BLOCK, min((block + 1) * BLOCK, source.shape[0])):
            for k in range(d):
                moved[k] = t[k]
                turned[k] = 0.0
                for c in range(d):
                    moved[k] += A[k, c] * source[i, c]
                    turned[k] += A[k, c] * source[i, 4 + c]
            residuals[i] = np.nan
            partners[i] = -1
            distances2[i] = np.nan
            if searching:
                known = False
                j = -1
                if remembering:
                    cell = cell_around(moved[0], moved[1], moved[2], turn, origin, inverse_size, d)
                    if cell == cells[i]:
                        known, j = _recall(moved, places[i], nearest[i], target, d, radius2)
                if not known:
                    j, others2 = nearest_voxel(
                        moved[0], moved[1], moved[2], turn, origin, inverse_size, d, table_keys, table, shift, target,
                        radius2, margin,
                    )  # fmt: skip
                    if remembering:
                        cells[i] = cell
                        nearest[i] = j
                        places[i, 0], places[i, 1], places[i, 2] = moved[0], moved[1], moved[2]
                        places[i, 3] = math.sqrt(others2)
            else:
                j = given[i]
            if j < 0:
                row[n_form + 1] += 1.0
                continue
            if target[j, 3] < 0.0:  # its normal is still to be found
                partners[i] = j
                row[n_form + 1] += 1.0
                continue
            quality = _direct(turned, source[i, 3], target, j, least_cosine, symmetric, normal)
            if quality < 0.0:
                row[n_form + 1] += 1.0
                continue
            r = 0.0
            distance2 = 0.0
            level = 0.0
            for k in range(d):
                offset = moved[k] - target[j, k]
                r += normal[k] * offset
                distance2 += offset * offset
                level += normal[k] * target[j, k]
                h[k] = source[i, k]
            residuals[i] = r
            distances2[i] = distance2
            for k in range(3):
                normals[i, k] = normal[k]
            partners[i] = j
            row[n_form + 2] += 1.0
            u = 1.0 - r * r * inverse_cutoff2
            if u <= 0.0:
                row[n_form + 1] += 1.0
                continue
            row[n_form + 1] += 1.0 - u * u * u
            base = quality * source[i, 7] * target[j, 7]
            w = base * u * u
            row[n_form + 4] += base * u * (5.0 * u - 4.0)
            row[n_form] += w
            row[n_form + 3] += w * r * r
            if d == 3:
                _add_pair_in_space(row, products, squares, h, normal, w, level)
            else:
                _add_pair_in_plane(row, h, normal, w, level)


@nb.njit(cache=True, nogil=True)
def clustered_scores(
    source: Float32Array,
    target: Float32Array,
    residuals: Float32Array,
    partners: Int32Array,
    normals: Float32Array,
    cutoff: float,
    clusters: Int32Array,
    n_clusters: int,
    J: Float64Array,
    inverse: Float64Array,
) -> Float64Array:
    """Return the sum over clusters of s s', s a cluster's half gradient by the parameters, as if it had been left out.

    ``J`` leads from the parameters to [vec(A); t], ``inverse`` is the inverse of the curvature of all pairs. The
    solution leans to each cluster, by the share that the cluster has in the curvature: residuals are smaller there than
    they would be without it, and s is what they would be, (1 - H_cluster H^-1)^-1 times the sum.
    """
    n, m = J.shape
    d = 3 if n == 12 else 2
    scores = np.zeros((n_clusters, m))
    shares = np.zeros((n_clusters, m, m))
    row = np.empty(n)
    slope = np.empty(m)
    for i in range(source.shape[0]):
        r = residuals[i]
        u = 1.0 - r * r / (cutoff * cutoff)
        if not u > 0.0:
            continue
        j = partners[i]
        quality = target[j, 3] if target[j, 3] > 0.0 else source[i, 3]
        w = quality * source[i, 7] * target[j, 7] * u * u
        for a in range(d + 1):
            h = source[i, a] if a < d else 1.0
            for c in range(d):
                row[a * d + c] = h * normals[i, c]
        for a in range(m):
            slope[a] = 0.0
            for b in range(n):
                slope[a] += J[b, a] * row[b]
        k = clusters[i]
        for a in range(m):
            scores[k, a] += w * r * slope[a]
            for b in range(m):
                shares[k, a, b] += w * slope[a] * slope[b]
    meat = np.zeros((m, m))
    own = np.eye(m)
    for k in range(n_clusters):
        if shares[k, m - 1, m - 1] > 0.0:
            s = np.linalg.solve(own - shares[k] @ inverse, scores[k])
            for a in range(m):
                for b in range(m):
                    meat[a, b] += s[a] * s[b]
    return meat
