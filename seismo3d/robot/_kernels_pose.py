"""The kernel that finds a frame's pose: pairs, weights, form and step; see :mod:`seismo3d.robot.tracking`.

One call a frame: the arrays are small, so that handing each of them from function to function would cost more than the
work. All runs in one thread, in one order.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.registration._kernels_form import plane_form, point_form_full
from seismo3d.registration._kernels_newton import RIGID, newton, without_motions
from seismo3d.registration.robust import NORMAL, TUKEY
from seismo3d.robot._kernels_blind import blind_motions, two_looks
from seismo3d.robot._kernels_tracking import miss_rays, place_on_rays, project_pairs
from seismo3d.robot._kernels_twist import log_motion

RATIO = 1e-5
"""Share of the largest curvature below which a direction counts as not seen."""
LEAST_PAIRS, LEAST_RAYS = 30, 4
"""Pairs and landmarks below which neither says anything."""
_COSINE = 0.8
"""Of the largest angle between the normals of a pair."""
_FLOOR = 0.3
"""Least spread that weights are drawn from: fewer residuals are that small by chance."""
_NEWTON_STEPS = 60
_FROM_MISS = 1.2 / 1.4826
"""Standard deviation of a coordinate over what :func:`scale_of` says of the lengths of misses in the plane."""


@nb.njit(cache=True, nogil=True)
def scale_of(magnitude: Float64Array) -> float:
    """Return the standard deviation of residuals about zero, by the median of their magnitudes (n)."""
    n = magnitude.shape[0]
    if n == 0:
        return 0.0
    ordered = np.partition(magnitude, n // 2)
    middle = ordered[n // 2]
    if n % 2:
        return NORMAL * middle
    below = ordered[0]
    for i in range(n // 2):
        below = max(below, ordered[i])
    return NORMAL * 0.5 * (below + middle)


@nb.njit(cache=True, nogil=True, inline="always")
def _tukey(u: Any) -> Any:
    """Tukey's weight of a residual over the cutoff."""
    left = max(1.0 - u * u, 0.0)
    return left * left


@nb.njit(cache=True, nogil=True)
def weigh_planes(residual: Float64Array, sigma: Float64Array, share: float, weights: Float64Array) -> float:
    """Write the weights of plane pairs, of which each counts for ``share`` of one; return their spread."""
    n = residual.shape[0]
    magnitude = np.empty(n)
    for i in range(n):
        magnitude[i] = abs(residual[i] / sigma[i])
    spread = scale_of(magnitude)
    floored = max(spread, _FLOOR)
    for i in range(n):
        weights[i] = share * _tukey(magnitude[i] / (TUKEY * floored)) / (sigma[i] * floored) ** 2
    return spread


@nb.njit(cache=True, nogil=True)
def weigh_misses(miss: Float64Array, weights: Float64Array) -> tuple[float, int]:
    """Write the weights of landmarks by how many pixels they miss; return their spread, and how many agree."""
    spread, agreeing = _FROM_MISS * scale_of(miss), 0
    floored = max(spread, _FLOOR)
    for i in range(miss.shape[0]):
        weights[i] = _tukey(miss[i] / (TUKEY * floored)) / floored**2
        agreeing += weights[i] > 0.0
    return spread, agreeing


@nb.njit(cache=True, nogil=True)
def centre_of(first: Float64Array, second: Float64Array) -> Float64Array:
    """Mean (3) of the points of two arrays (n, 3) together."""
    out = np.zeros(3)
    for a in range(3):
        for i in range(first.shape[0]):
            out[a] += first[i, a]
        for i in range(second.shape[0]):
            out[a] += second[i, a]
    return out / max(first.shape[0] + second.shape[0], 1)


@nb.njit(cache=True, nogil=True)
def size_about(centre: Float64Array, first: Float64Array, second: Float64Array) -> float:
    """Root mean square distance of the points of two arrays (n, 3) from a centre; 1 where all lie in it."""
    total = 0.0
    for a in range(3):
        for i in range(first.shape[0]):
            total += (first[i, a] - centre[a]) ** 2
        for i in range(second.shape[0]):
            total += (second[i, a] - centre[a]) ** 2
    size = math.sqrt(total / max(first.shape[0] + second.shape[0], 1))
    return size if size > 0.0 else 1.0


@nb.njit(cache=True, nogil=True)
def _framed(points: Float64Array, centre: Float64Array, size: float) -> Float64Array:
    """Points (n, 3) less a centre, over a size."""
    out = np.empty((points.shape[0], 3))
    for i in range(points.shape[0]):
        for a in range(3):
            out[i, a] = (points[i, a] - centre[a]) / size
    return out


@nb.njit(cache=True, nogil=True)
def _is_useful(Q: Float64Array) -> bool:
    """Whether a form is finite and says anything."""
    size, largest = Q.shape[0], 0.0
    for a in range(size):
        for b in range(size):
            if not math.isfinite(Q[a, b]):
                return False
            if a < size - 1 and b < size - 1:
                largest = max(largest, abs(Q[a, b]))
    return largest > 0.0


@nb.njit(cache=True, nogil=True)
def _moved_by(before: Float64Array, after: Float64Array) -> tuple[float, float]:
    """Turn (rad) and shift (m) from one pose to another; no number for a turn of nearly half a circle or more."""
    T = np.zeros((4, 4))
    for a in range(3):
        for b in range(3):
            for c in range(3):
                T[a, b] += before[c, a] * after[c, b]
            T[a, 3] += before[b, a] * (after[b, 3] - before[b, 3])
    T[3, 3] = 1.0
    move = log_motion(T)
    turn = math.sqrt(move[0] ** 2 + move[1] ** 2 + move[2] ** 2)
    return turn, math.sqrt(move[3] ** 2 + move[4] ** 2 + move[5] ** 2)


@nb.njit(cache=True, nogil=True)
def place_in_frame(
    T: Float64Array, centre_source: Float64Array, centre_target: Float64Array, size: float
) -> tuple[Float64Array, Float64Array]:
    """Return a pose as (A, t) between points less their centres, over a size."""
    A, t = np.empty((3, 3)), np.empty(3)
    for a in range(3):
        t[a] = T[a, 3] - centre_target[a]
        for b in range(3):
            A[a, b] = T[a, b]
            t[a] += T[a, b] * centre_source[b]
        t[a] /= size
    return A, t


@nb.njit(cache=True, nogil=True)
def walk_from(
    T: Float64Array, Q: Float64Array, centre_source: Float64Array, centre_target: Float64Array, size: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Walk from a pose to the nearest minimum of a form; return (A, t) in the form's frame, and the new pose."""
    A, t = place_in_frame(T, centre_source, centre_target, size)
    free = np.full(6, np.inf)
    newton(Q, A, t, RIGID, RATIO, _NEWTON_STEPS, -free, free, np.zeros(6))
    out = np.eye(4)
    for a in range(3):
        out[a, 3] = size * t[a] + centre_target[a]
        for b in range(3):
            out[a, b] = A[a, b]
            out[a, 3] -= A[a, b] * centre_source[b]
    return A, t, out


@nb.njit(cache=True, nogil=True)
def fit_frame(
    T: Float64Array,
    vertices: Float32Array,
    normals: Float32Array,
    steps: tuple[int, int],
    points_seen: Float32Array,
    normals_seen: Float32Array,
    T_seen: Float64Array,
    lens_seen: Float64Array,
    reaches: tuple[float, float, float, float],
    per_plane: float,
    points: Float64Array,
    T_depth_pixel: Float64Array,
    rays: Float64Array,
    focal: tuple[float, float],
    uses: tuple[tuple[bool, bool], tuple[bool, bool]],
    lead: tuple[int, int, float, bool],
    least: tuple[float, float],
    max_steps: int,
) -> Any:
    """Find the pose at which a frame fits the prediction and the landmarks, from ``T``.

    ``steps`` are every how manieth vertices are paired far from the solution and near it, ``reaches`` how far in the
    first steps, and all later ones, ``per_plane`` how many pixels of the half image count as one pair. ``points``,
    ``T_depth_pixel``, ``rays`` are the landmarks, ``focal`` the image's focal lengths in pixels. ``uses`` says far from
    the solution and near it whether planes and landmarks are used. Landmarks take the first ``lead[0]`` steps alone
    where at least ``lead[1]`` agree and are off by more than ``lead[2]`` pixels. Near the solution, and far from it
    with ``lead[3]``, planes say nothing along motions that only the noise of their normals seems to see. Steps below
    ``least`` (rad and m) end the coarse part and the whole.

    Returned are the number of steps, 0 where nothing is left to fit it by, the pose, the last step's form Q with (A, t)
    and its frame (centres of source and target, size); of its planes whether there are any, source, target, normals,
    weights, residuals, how many were tried, their spread and the motions (6, k) in the form's frame that they do not
    see; of its landmarks whether there are any, their weights, spread, and how many agree.
    """
    m = points.shape[0]
    n = (vertices.shape[0] // min(steps) + 1) * (vertices.shape[1] // min(steps) + 1)
    source, target, normal, turned = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    sigma, residual, weights = np.empty(n), np.empty(n), np.empty(n)
    depth, miss, ray_weights = np.empty(m), np.empty(m), np.zeros(m)
    on_rays, information = np.empty((m, 3)), np.empty((m, 3, 3))
    R_seen, t_seen = T_seen[:3, :3].copy(), T_seen[:3, 3].copy()
    T, Q, A, t = T.copy(), np.zeros((13, 13)), np.eye(3), np.zeros(3)
    c_source, c_target, size = np.zeros(3), np.zeros(3), 0.0
    count, tried, agreeing, spread, spread_rays = 0, 0, 0, np.inf, np.inf
    near, n_left, done = 0, max_steps // 2, 0
    has_pairs = has_rays = False
    every, count_new, tried_new, spread_planes, spread_new, agreeing_new = 1, 0, 0, 0.0, 0.0, 0
    none, sees_all = np.empty((0, 3)), np.empty((6, 0))
    blind = blind_new = sees_all
    for step in range(max_steps):
        with_planes, with_rays = uses[near]
        with_rays = with_rays and m >= LEAST_RAYS
        if with_rays:
            miss_rays(T, T_depth_pixel, points, rays, focal[0], focal[1], depth, miss)
            spread_new, agreeing_new = weigh_misses(miss, ray_weights)
            place_on_rays(T, T_depth_pixel, rays, depth, ray_weights, focal[0], on_rays, information)
            if step < lead[0] and agreeing_new >= lead[1] and spread_new > lead[2]:
                with_planes = False
        if with_planes:
            every = steps[near]
            R, shift = T[:3, :3].copy(), T[:3, 3].copy()
            count_new, tried_new = project_pairs(
                vertices, normals, every, R, shift, R_seen, t_seen, lens_seen, points_seen, normals_seen,
                reaches[min(step, 3)], _COSINE, source, target, normal, turned, sigma, residual,
            )  # fmt: skip
            with_planes = count_new >= LEAST_PAIRS
        if not (with_planes or with_rays):
            done = 0
            break
        s = source[:count_new] if with_planes else none
        g = target[:count_new] if with_planes else none
        if size == 0.0:
            c_source = centre_of(s, on_rays if with_rays else none)
            c_target = centre_of(g, points if with_rays else none)
            size = size_about(c_source, s, on_rays if with_rays else none)
        Q_new = np.zeros((13, 13))
        if with_planes:
            share = every * every / (4.0 * per_plane)
            spread_planes = weigh_planes(residual[:count_new], sigma[:count_new], share, weights[:count_new])
            arms, w = _framed(s, c_source, size), weights[:count_new]
            Q_new += plane_form(arms, _framed(g, c_target, size), normal[:count_new], w)
            blind_new = sees_all
            if near or lead[3]:
                A, t = place_in_frame(T, c_source, c_target, size)
                agreed, noise = two_looks(arms @ A.T, normal[:count_new], turned[:count_new], w)
                blind_new = blind_motions(agreed, noise, RATIO)
                if blind_new.shape[1]:
                    Q_new = without_motions(Q_new, A, t, RIGID, blind_new)
        if with_rays:
            Q_new += point_form_full(_framed(on_rays, c_source, size), _framed(points, c_target, size), information)
        if not _is_useful(Q_new):
            done = 0
            break
        A, t, T_new = walk_from(T, Q_new, c_source, c_target, size)
        turn, moved = _moved_by(T, T_new)
        T, Q, done = T_new, Q_new, done + 1
        has_pairs, has_rays = with_planes, with_rays
        if with_planes:
            count, tried, blind, spread = count_new, tried_new, blind_new, spread_planes
        if with_rays:
            agreeing, spread_rays = agreeing_new, spread_new
        n_left -= 1
        if n_left == 0 or (turn < least[near] and moved < least[near]):
            if near:
                break
            near, n_left = 1, max_steps - max_steps // 2
    form = (Q, A, t, c_source, c_target, size)
    count = count if has_pairs else 0
    planes = (source[:count], target[:count], normal[:count], weights[:count], residual[:count], tried, spread, blind)
    return done, T, form, has_pairs, planes, has_rays, (ray_weights, spread_rays, agreeing)
