"""Kernels of the certified rigid solve in space; see :mod:`seismo3d.registration.solvers` and ``certificate``."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration._kernels_small import exp3, jacobi_eigen, multiply3, project_rotation3, pseudo_solve

NULL = 1e-10


@nb.njit(cache=True, nogil=True)
def reduce_translation(Q: Float64Array, prior: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Eliminate t from Q: return the form in [r; 1] and the matrix K with t = K [r; 1].

    Where Q does not see t (all normals in one plane, say) t stays at the prior.
    """
    d = prior.shape[0]
    m = d * d
    values = np.empty(d)
    V = np.empty((d, d))
    tt = Q[m : m + d, m : m + d].copy()
    jacobi_eigen(tt, values, V)
    K = np.zeros((d, m + 1))
    for k in range(d):
        if values[k] > NULL * values[d - 1]:
            for c in range(m + 1):
                column = c if c < m else m + d
                along = 0.0
                for i in range(d):
                    along += V[i, k] * Q[m + i, column]
                for i in range(d):
                    K[i, c] -= along / values[k] * V[i, k]
        else:
            along = 0.0
            for i in range(d):
                along += V[i, k] * prior[i]
            for i in range(d):
                K[i, m] += along * V[i, k]
    F = np.empty((m + 1, m + 1))
    for a in range(m + 1):
        row = a if a < m else m + d
        for b in range(a, m + 1):
            column = b if b < m else m + d
            value = Q[row, column]
            for i in range(d):
                value += K[i, a] * Q[m + i, column] + Q[row, m + i] * K[i, b]
                for j in range(d):
                    value += K[i, a] * tt[i, j] * K[j, b]
            F[a, b] = value
            F[b, a] = value
    return F, K


@nb.njit(cache=True, nogil=True)
def form_value(F: Float64Array, R: Float64Array) -> float:
    """Return [vec(R); 1]' F [vec(R); 1]."""
    total = F[9, 9]
    for a in range(9):
        ra = R[a % 3, a // 3]
        row = 2.0 * F[a, 9]
        for b in range(9):
            row += F[a, b] * R[b % 3, b // 3]
        total += ra * row
    return total


@nb.njit(cache=True, nogil=True)
def rotation_derivatives(F: Float64Array, R: Float64Array, gradient: Float64Array, hessian: Float64Array) -> None:
    """Gradient and Hessian of the form along R exp([omega]), at omega = 0."""
    G = np.empty((3, 3))
    for a in range(9):
        value = F[a, 9]
        for b in range(9):
            value += F[a, b] * R[b % 3, b // 3]
        G[a % 3, a // 3] = value
    N = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            N[i, j] = R[0, i] * G[0, j] + R[1, i] * G[1, j] + R[2, i] * G[2, j]
    J = np.zeros((9, 3))
    for i in range(3):
        J[3 + i, 0] = R[i, 2]
        J[6 + i, 0] = -R[i, 1]
        J[i, 1] = -R[i, 2]
        J[6 + i, 1] = R[i, 0]
        J[i, 2] = R[i, 1]
        J[3 + i, 2] = -R[i, 0]
    trace = N[0, 0] + N[1, 1] + N[2, 2]
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        gradient[k] = 2.0 * (N[q, p] - N[p, q])
    AJ = np.zeros((9, 3))
    for a in range(9):
        for b in range(9):
            f = F[a, b]
            AJ[a, 0] += f * J[b, 0]
            AJ[a, 1] += f * J[b, 1]
            AJ[a, 2] += f * J[b, 2]
    for k in range(3):
        for c in range(k, 3):
            value = N[k, c] + N[c, k]
            if k == c:
                value -= 2.0 * trace
            for a in range(9):
                value += 2.0 * J[a, k] * AJ[a, c]
            hessian[k, c] = value
            hessian[c, k] = value


@nb.njit(cache=True, nogil=True)
def newton_rotation(F: Float64Array, R: Float64Array) -> float:
    """Walk R (changed in place) to a local minimum of the form on SO(3); return its value."""
    scale = 0.0
    for a in range(10):
        scale += abs(F[a, a])
    gradient = np.empty(3)
    hessian = np.empty((3, 3))
    values = np.empty(3)
    V = np.empty((3, 3))
    trial = np.empty((3, 3))
    value = form_value(F, R)
    for _ in range(60):
        rotation_derivatives(F, R, gradient, hessian)
        jacobi_eigen(hessian, values, V)
        floor = 1e-12 * scale + 1e-300
        w = np.zeros(3)
        for k in range(3):
            along = V[0, k] * gradient[0] + V[1, k] * gradient[1] + V[2, k] * gradient[2]
            curvature = abs(values[k])
            step = -along / curvature if curvature > floor else 0.0
            if values[k] < -1e-9 * scale and abs(step) < 1e-3:
                step = 0.3 if along <= 0.0 else -0.3
            for i in range(3):
                w[i] += step * V[i, k]
        length = math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
        if length < 1e-9:
            multiply3(R, exp3(w[0], w[1], w[2]), trial)
            R[:] = trial
            break
        factor = 1.0 if length < 1.5 else 1.5 / length
        improved = False
        for _ in range(30):
            multiply3(R, exp3(factor * w[0], factor * w[1], factor * w[2]), trial)
            new = form_value(F, trial)
            if new < value:
                improved = True
                break
            factor *= 0.4
        if not improved:
            break
        R[:] = trial
        value = new
    R[:] = project_rotation3(R)
    return form_value(F, R)


@nb.njit(cache=True, nogil=True)
def affine_start(F: Float64Array, prior: Float64Array) -> Float64Array:
    """Minimiser of the form without constraints, nearest to the prior along its null directions, as a rotation."""
    gradient = np.empty(9)
    for a in range(9):
        gradient[a] = F[a, 9]
        for b in range(9):
            gradient[a] += F[a, b] * prior[b % 3, b // 3]
    move = pseudo_solve(F[:9, :9].copy(), gradient, NULL)
    start = np.empty((3, 3))
    for a in range(9):
        start[a % 3, a // 3] = prior[a % 3, a // 3] - move[a]
    return project_rotation3(start)


@nb.njit(cache=True, nogil=True)
def many_starts(F: Float64Array, R: Float64Array, prior: Float64Array, octahedral: Float64Array) -> float:
    """Walk from the prior, from the eigenvectors of the form and from the octahedral rotations; keep the best in R."""
    best = form_value(F, R)
    values = np.empty(9)
    V = np.empty((9, 9))
    jacobi_eigen(F[:9, :9].copy(), values, V)
    n_octahedral = octahedral.shape[0]
    root3 = math.sqrt(3.0)
    start = np.empty((3, 3))
    for k in range(1 + 18 + n_octahedral):
        if k == 0:
            trial = prior.copy()
        elif k <= 18:
            sign = root3 if k % 2 else -root3
            for a in range(9):
                start[a % 3, a // 3] = sign * V[a, (k - 1) // 2]
            trial = project_rotation3(start)
        else:
            trial = octahedral[k - 19].copy()
        value = newton_rotation(F, trial)
        if value < best - 1e-15 * abs(best):
            best = value
            R[:] = trial
    return best


@nb.njit(cache=True, nogil=True)
def conjugate(F: Float64Array, R: Float64Array) -> Float64Array:
    """Return the form in X, where the rotation is R X: the found rotation becomes X = I."""
    half = np.empty((10, 10))
    out = np.empty((10, 10))
    for a in range(10):
        for k in range(3):
            for j in range(3):
                value = 0.0
                for i in range(3):
                    value += F[a, 3 * k + i] * R[i, j]
                half[a, 3 * k + j] = value
        half[a, 9] = F[a, 9]
    for b in range(10):
        for k in range(3):
            for j in range(3):
                value = 0.0
                for i in range(3):
                    value += half[3 * k + i, b] * R[i, j]
                out[3 * k + j, b] = value
        out[9, b] = half[9, b]
    return out


@nb.njit(cache=True, nogil=True)
def first_multipliers(F: Float64Array, value: float, correction: Float64Array) -> Float64Array:
    """Return S = F - f E - sum lambda_k P_k with the least-squares multipliers of S y = 0, y = [vec(I); 1]."""
    S = F.copy()
    S[9, 9] -= value
    h = np.empty(10)
    for a in range(10):
        h[a] = S[a, 0] + S[a, 4] + S[a, 8] + S[a, 9]
    for c in range(10):
        for a in range(10):
            for b in range(10):
                S[a, b] -= correction[c, a, b] * h[c]
    return S


@nb.njit(cache=True, nogil=True)
def smallest_eigenvalue(S: Float64Array) -> float:
    """Smallest eigenvalue of a symmetric matrix."""
    return float(np.linalg.eigvalsh(S)[0])


@nb.njit(cache=True, nogil=True)
def raise_smallest(
    S: Float64Array, null: Float64Array, small: Float64Array, basis: Float64Array, enough: float, max_steps: int
) -> Float64Array:
    """Return ``S + sum nu_j null_j`` with its smallest eigenvalue on y's complement raised by a barrier method.

    Maximises tau under ``B' (S + sum nu_j N_j) B - tau I`` positive definite, B the complement's basis of shape (10,
    9); ``small`` holds the B' N_j B, flat, of shape (m, 81). Stops as soon as the smallest eigenvalue is at least
    ``enough``.
    """
    m = null.shape[0]
    F0 = basis.T @ S @ basis
    scale = np.sqrt(np.sum(F0 * F0)) + 1e-300
    F0 /= scale
    F = F0.copy()
    nu = np.zeros(m)
    best_nu = np.zeros(m)
    best = np.linalg.eigvalsh(F)[0]
    tau = best - 0.02
    weight = 9.0 / 0.02
    gradient = np.empty(m + 1)
    H = np.empty((m + 1, m + 1))
    eye = np.eye(9)
    tall = small.reshape(m * 9, 9)
    for _ in range(max_steps):
        Z = np.ascontiguousarray(np.linalg.inv(F - tau * eye))
        right = np.ascontiguousarray(tall @ Z).reshape(m, 9, 9)
        both = np.empty((m, 81))
        for j in range(m):
            both[j] = np.ascontiguousarray(Z @ right[j]).reshape(81)
        flat = Z.reshape(81)
        square = np.ascontiguousarray(Z @ Z).reshape(81)
        H[:m, :m] = both @ small.T
        H[m, :m] = -(small @ square)
        H[:m, m] = H[m, :m]
        H[m, m] = np.sum(flat * flat)
        gradient[:m] = -(small @ flat)
        gradient[m] = np.trace(Z) - weight
        for i in range(m + 1):
            H[i, i] *= 1.0 + 1e-13
        step = -np.linalg.solve(H, gradient)
        decrement = -np.sum(gradient * step)
        factor = 1.0 if decrement < 0.25 else 1.0 / (1.0 + math.sqrt(decrement))
        ok = False
        for _ in range(30):
            new_F = F0 + ((nu + factor * step[:m]) @ small).reshape(9, 9)
            low = np.linalg.eigvalsh(new_F)[0]
            if low > tau + factor * step[m]:
                ok = True
                break
            factor *= 0.5
        if not ok:
            break
        nu += factor * step[:m]
        tau += factor * step[m]
        F = new_F
        if low > best:
            best = low
            best_nu[:] = nu
        if best * scale >= enough or 9.0 / weight < 1e-12:
            break
        if decrement < 1.0:
            weight *= 20.0
    out = S.copy()
    for j in range(m):
        out += scale * best_nu[j] * null[j]
    return out


@nb.njit(cache=True, nogil=True)
def solve_certified(
    Q: Float64Array,
    prior_R: Float64Array,
    prior_t: Float64Array,
    octahedral: Float64Array,
    correction: Float64Array,
    null: Float64Array,
    small: Float64Array,
    basis: Float64Array,
    tolerance: float,
) -> tuple[Float64Array, Float64Array, float, float, float]:
    """Return R, t, the least value, the certified gap and the norm of the form that gaps are relative to."""
    F, K = reduce_translation(Q, prior_t)
    norm = math.sqrt(np.sum(F * F)) + 1e-300
    R = affine_start(F, prior_R)
    value = newton_rotation(F, R)
    S = first_multipliers(conjugate(F, R), value, correction)
    low = smallest_eigenvalue(S)
    limit = -0.05 * tolerance * norm
    if low < limit:
        S = raise_smallest(S, null, small, basis, limit, 12)
        low = max(low, smallest_eigenvalue(S))
    if low < limit:
        better = many_starts(F, R, prior_R, octahedral)
        if better < value - 1e-12 * norm:
            value = better
            S = first_multipliers(conjugate(F, R), value, correction)
            low = smallest_eigenvalue(S)
    if low < limit:
        S = raise_smallest(S, null, small, basis, limit, 80)
        low = max(low, smallest_eigenvalue(S))
    t = np.empty(3)
    for i in range(3):
        t[i] = K[i, 9]
        for a in range(9):
            t[i] += K[i, a] * R[a % 3, a // 3]
    return R, t, value, 4.0 * max(0.0, -low), norm
