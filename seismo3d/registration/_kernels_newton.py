"""Newton's method on the quadratic form for every model of transformation, in the plane and in space.

Parameters are ordered (rotation, translation, scale): rotation vector in the target frame, translation of the source's
centre, logarithms of scale. The affine model has (entries of A column by column, translation).
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.registration._kernels_small import exp3, jacobi_eigen

TRANSLATION, RIGID, SIMILARITY, SCALED, AFFINE = 0, 1, 2, 3, 4
LEAST_PIVOT = 1e-8
"""Share of the largest curvature that all pivots must exceed for a step to be taken without eigenvectors."""


@nb.njit(cache=True, nogil=True)
def n_rotation(model: int, d: int) -> int:
    """Count the rotation parameters."""
    if model in (TRANSLATION, AFFINE):
        return 0
    return 3 if d == 3 else 1


@nb.njit(cache=True, nogil=True)
def n_parameters(model: int, d: int) -> int:
    """Count the parameters of a model."""
    if model == AFFINE:
        return d * d + d
    scales = 0
    if model == SIMILARITY:
        scales = 1
    elif model == SCALED:
        scales = d
    return n_rotation(model, d) + d + scales


@nb.njit(cache=True, nogil=True)
def parameter_jacobian(A: Float64Array, model: int) -> Float64Array:
    """Return the derivative of [vec(A); t] by the parameters."""
    d = A.shape[0]
    m = n_parameters(model, d)
    J = np.zeros((d * d + d, m))
    if model == AFFINE:
        for i in range(m):
            J[i, i] = 1.0
        return J
    r = n_rotation(model, d)
    for c in range(d):
        for k in range(r):
            if d == 3:
                a, b = (k + 1) % 3, (k + 2) % 3
                J[3 * c + b, k] = A[a, c]
                J[3 * c + a, k] = -A[b, c]
            else:
                J[2 * c, 0] = -A[1, c]
                J[2 * c + 1, 0] = A[0, c]
        J[d * d + c, r + c] = 1.0
        for i in range(d):
            if model == SIMILARITY:
                J[d * c + i, r + d] = A[i, c]
            elif model == SCALED:
                J[d * c + i, r + d + c] = A[i, c]
    return J


@nb.njit(cache=True, nogil=True)
def without_motions(
    form: Float64Array, A: Float64Array, t: Float64Array, model: int, unseen: Float64Array
) -> Float64Array:
    """Return a form that does not change along some directions of the parameters (columns) at (A, t)."""
    J = parameter_jacobian(A, model)
    n, m = J.shape
    keep = J @ (np.eye(m) - unseen @ unseen.T) @ np.linalg.pinv(J)
    here = np.empty(n)
    here[: A.size], here[A.size :] = A.T.copy().ravel(), t
    P = np.eye(n + 1)
    P[:n, :n] = keep
    P[:n, n] = (np.eye(n) - keep) @ here
    return P.T @ form @ P


@nb.njit(cache=True, nogil=True)
def derivatives(
    Q: Float64Array, A: Float64Array, t: Float64Array, model: int
) -> tuple[float, Float64Array, Float64Array]:
    """Return the value, gradient and Hessian of z' Q z by the parameters."""
    d = A.shape[0]
    n = d * d + d
    z = np.ones(n + 1)
    for c in range(d):
        z[d * d + c] = t[c]
        for i in range(d):
            z[d * c + i] = A[i, c]
    half = np.zeros(n + 1)
    value = 0.0
    for a in range(n + 1):
        for b in range(n + 1):
            half[a] += Q[a, b] * z[b]
        value += half[a] * z[a]
    J = parameter_jacobian(A, model)
    m = J.shape[1]
    QJ = np.zeros((n, m))
    for a in range(n):
        for b in range(n):
            f = Q[a, b]
            for k in range(m):
                QJ[a, k] += f * J[b, k]
    gradient = np.zeros(m)
    H = np.zeros((m, m))
    for k in range(m):
        for a in range(n):
            gradient[k] += 2.0 * J[a, k] * half[a]
            for c in range(k, m):
                H[k, c] += 2.0 * J[a, k] * QJ[a, c]
    for k in range(m):
        for c in range(k):
            H[k, c] = H[c, k]
    if model in (RIGID, SIMILARITY, SCALED):
        _add_curvature(H, half, A, J, model)
    return value, gradient, H


@nb.njit(cache=True, nogil=True)
def _add_curvature(H: Float64Array, half: Float64Array, A: Float64Array, J: Float64Array, model: int) -> None:
    """Add the second derivatives of A by the parameters, weighed by the form's gradient."""
    d = A.shape[0]
    r = n_rotation(model, d)
    N = np.zeros((d, d))
    for c in range(d):
        for i in range(d):
            for j in range(d):
                N[i, j] += half[d * c + i] * A[j, c]
    trace = 0.0
    for i in range(d):
        trace += N[i, i]
    if d == 3:
        for i in range(3):
            for j in range(3):
                H[i, j] += N[i, j] + N[j, i]
            H[i, i] -= 2.0 * trace
    else:
        H[0, 0] -= 2.0 * trace
    n_scales = H.shape[0] - r - d
    for s in range(n_scales):
        k = r + d + s
        for c in range(d):
            if model == SCALED and c != s:
                continue
            for i in range(d):
                g = 2.0 * half[d * c + i]
                H[k, k] += g * A[i, c]
                for w in range(r):
                    H[k, w] += g * J[d * c + i, w]
                    H[w, k] += g * J[d * c + i, w]


@nb.njit(cache=True, nogil=True)
def move(
    A: Float64Array, t: Float64Array, step: Float64Array, model: int, new_A: Float64Array, new_t: Float64Array
) -> None:
    """Apply a step of the parameters on the left."""
    d = A.shape[0]
    if model == AFFINE:
        for c in range(d):
            for i in range(d):
                new_A[i, c] = A[i, c] + step[d * c + i]
            new_t[c] = t[c] + step[d * d + c]
        return
    r = n_rotation(model, d)
    turn = np.eye(d)
    if r == 3:
        turn = exp3(step[0], step[1], step[2])
    elif r == 1:
        turn[0, 0] = turn[1, 1] = math.cos(step[0])
        turn[1, 0] = math.sin(step[0])
        turn[0, 1] = -turn[1, 0]
    for c in range(d):
        factor = 1.0
        if model == SIMILARITY:
            factor = math.exp(step[r + d])
        elif model == SCALED:
            factor = math.exp(step[r + d + c])
        for i in range(d):
            value = 0.0
            for j in range(d):
                value += turn[i, j] * A[j, c]
            new_A[i, c] = factor * value
    for i in range(d):
        new_t[i] = t[i] + step[r + i]


@nb.njit(cache=True, nogil=True)
def _left_jacobian(x: Float64Array) -> Float64Array:
    """Return J with exp(x + e) = exp(J e) exp(x) to first order in e."""
    angle2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    if angle2 < 1e-8:
        f, g = 0.5, 1.0 / 6.0
    else:
        angle = math.sqrt(angle2)
        f = (1.0 - math.cos(angle)) / angle2
        g = (angle - math.sin(angle)) / (angle2 * angle)
    W = np.zeros((3, 3))
    W[0, 1], W[0, 2], W[1, 2] = -x[2], x[1], -x[0]
    W[1, 0], W[2, 0], W[2, 1] = x[2], -x[1], x[0]
    return np.eye(3) + f * W + g * (W @ W)


@nb.njit(cache=True, nogil=True)
def weakest_share(Q: Float64Array, A: Float64Array, model: int) -> float:
    """Return the smallest over the largest eigenvalue of J' Q J, J the derivative of [vec(A); t] by the parameters."""
    J = parameter_jacobian(A, model)
    n, m = J.shape
    H = np.zeros((m, m))
    QJ = np.zeros((n, m))
    for a in range(n):
        for b in range(n):
            for k in range(m):
                QJ[a, k] += Q[a, b] * J[b, k]
    for a in range(n):
        for k in range(m):
            for c in range(m):
                H[k, c] += J[a, k] * QJ[a, c]
    values = np.empty(m)
    vectors = np.empty((m, m))
    jacobi_eigen(H, values, vectors)
    return values[0] / values[m - 1] if values[m - 1] > 0.0 else 0.0


@nb.njit(cache=True, nogil=True)
def rigid_offsets(A0: Float64Array, t0: Float64Array, A: Float64Array, t: Float64Array) -> Float64Array:
    """Return rotation vector (or angle) and translation that lead from one rigid motion to another; angles below pi."""
    d = t.shape[0]
    D = A @ A0.T
    if d == 2:
        out = np.empty(3)
        out[0] = math.atan2(D[1, 0] - D[0, 1], D[0, 0] + D[1, 1])
    else:
        out = np.empty(6)
        x, y, z = 0.5 * (D[2, 1] - D[1, 2]), 0.5 * (D[0, 2] - D[2, 0]), 0.5 * (D[1, 0] - D[0, 1])
        sine = math.sqrt(x * x + y * y + z * z)
        cosine = 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0)
        factor = math.atan2(sine, cosine) / sine if sine > 1e-9 else 1.0
        out[0], out[1], out[2] = factor * x, factor * y, factor * z
    for k in range(d):
        out[out.shape[0] - d + k] = t[k] - t0[k]
    return out


@nb.njit(cache=True, nogil=True)
def _solve_positive(H: Float64Array, gradient: Float64Array, step: Float64Array) -> bool:
    """Write -H^-1 gradient to ``step`` by Cholesky's factors; False where H is not clearly positive definite."""
    m = H.shape[0]
    L = np.empty((m, m))
    largest = 0.0
    for i in range(m):
        largest = max(largest, H[i, i])
    for i in range(m):
        for j in range(i + 1):
            total = H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > LEAST_PIVOT * largest:
                    return False
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    for i in range(m):
        total = -gradient[i]
        for k in range(i):
            total -= L[i, k] * step[k]
        step[i] = total / L[i, i]
    for i in range(m - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, m):
            total -= L[k, i] * step[k]
        step[i] = total / L[i, i]
    return True


@nb.njit(cache=True, nogil=True)
def newton(
    Q: Float64Array,
    A: Float64Array,
    t: Float64Array,
    model: int,
    ratio: float,
    max_steps: int,
    low: Float64Array,
    high: Float64Array,
    x: Float64Array,
) -> tuple[float, int]:
    """Walk (A, t), changed in place, down to a local minimum of the form; return its value and the steps taken.

    Directions whose curvature is below ``ratio`` times the largest are left where they are. ``x`` holds the parameters'
    offsets from the prior, changed in place, kept between ``low`` and ``high``; the caller passes the offsets of (A,
    t).
    """
    d = A.shape[0]
    m = n_parameters(model, d)
    r = n_rotation(model, d)
    free = np.ones(m, dtype=np.bool_)
    bounded = turned = False
    for k in range(m):
        bounded = bounded or low[k] > -np.inf or high[k] < np.inf
        if k == 2:
            turned = bounded and r == 3  # a bounded rotation vector has to be stepped itself
    new_A = A.copy()
    new_t = t.copy()
    values = np.empty(m)
    V = np.empty((m, m))
    step = np.zeros(m)
    value, gradient, H = derivatives(Q, A, t, model)
    steps = 0
    for _ in range(max_steps):
        if turned:
            L = np.eye(m)
            L[:3, :3] = _left_jacobian(x[:3])
            gradient = L.T @ gradient
            H = L.T @ H @ L
        if bounded:
            _pin(x, low, high, gradient, H, free)
        if not (ratio < LEAST_PIVOT and _solve_positive(H, gradient, step)):
            jacobi_eigen(H, values, V)
            limit = ratio * max(abs(values[0]), abs(values[m - 1]))
            step[:] = 0.0
            for k in range(m):
                if abs(values[k]) <= limit:
                    continue
                along = 0.0
                for i in range(m):
                    along += V[i, k] * gradient[i]
                for i in range(m):
                    step[i] -= along / abs(values[k]) * V[i, k]
        longest = 0.0
        for k in range(m):
            if not free[k]:
                step[k] = 0.0
            longest = max(longest, abs(step[k]))
        if longest > 1.0:
            step *= 1.0 / longest
        factor = 1.0
        better = False
        for _ in range(25):
            trial = factor * step
            if bounded:
                for k in range(m):
                    trial[k] = min(max(trial[k], low[k] - x[k]), high[k] - x[k])
            if turned:
                _apply_bounded(A, t, x, trial, model, new_A, new_t)
            else:
                move(A, t, trial, model, new_A, new_t)
            new_value, new_gradient, new_H = derivatives(Q, new_A, new_t, model)
            slope = new_slope = 0.0
            for k in range(m):
                if free[k]:
                    slope += gradient[k] ** 2
                    new_slope += new_gradient[k] ** 2
            flatter = not turned and longest < 1e-4 and new_slope < 0.25 * slope
            if new_value < value or flatter:  # near the minimum the gradient is exact long after the value is not
                better = True
                break
            factor *= 0.35
            if factor * longest < 1e-11:
                break
        if not better:
            break
        steps += 1
        A[:] = new_A
        t[:] = new_t
        x += trial
        value, gradient, H = new_value, new_gradient, new_H
        if factor * longest < 1e-10:
            break
    return value, steps


@nb.njit(cache=True, nogil=True)
def _apply_bounded(
    A: Float64Array,
    t: Float64Array,
    x: Float64Array,
    trial: Float64Array,
    model: int,
    new_A: Float64Array,
    new_t: Float64Array,
) -> None:
    """Apply a step of the rotation vector itself, so that its bounds hold exactly."""
    move(A, t, trial, model, new_A, new_t)
    before = exp3(x[0], x[1], x[2])
    after = exp3(x[0] + trial[0], x[1] + trial[1], x[2] + trial[2])
    wrong = exp3(trial[0], trial[1], trial[2])
    new_A[:] = after @ before.T @ wrong.T @ new_A


@nb.njit(cache=True, nogil=True)
def _pin(
    x: Float64Array, low: Float64Array, high: Float64Array, gradient: Float64Array, H: Float64Array, free: BoolArray
) -> None:
    """Take the parameters that press against a bound out of the system."""
    m = x.shape[0]
    diagonal = 0.0
    for k in range(m):
        diagonal = max(diagonal, H[k, k])
        at_low = x[k] <= low[k] + 1e-12 and gradient[k] >= 0.0
        at_high = x[k] >= high[k] - 1e-12 and gradient[k] <= 0.0
        free[k] = not (at_low or at_high or high[k] - low[k] < 1e-12)
    for k in range(m):
        if not free[k]:
            gradient[k] = 0.0
            for i in range(m):
                H[k, i] = 0.0
                H[i, k] = 0.0
            H[k, k] = diagonal
