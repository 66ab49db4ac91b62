"""Exact solvers on one quadratic form: every model of transformation, in the plane and in space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import exp_rotation, log_rotation, nearest_rotation
from seismo3d.registration import _kernels_newton as newton_kernels
from seismo3d.registration import _kernels_rigid as rigid_kernels
from seismo3d.registration.certificate import TOLERANCE, multiplier_tables, octahedral_rotations
from seismo3d.registration.constraints import model_number
from seismo3d.registration.result import MODELS

# most steps of Newton's method
STEPS = 60
AT_BOUND = 1e-9
"""Distance from a bound, in the frame's units, up to which a parameter lies on it."""


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Where the transform stays along what the data do not determine: (A, t) in the form's frame.

    Attributes
    ----------
    A : ndarray of shape (d, d), float64
    t : ndarray of shape (d,), float64
    """

    A: Float64Array
    t: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The minimiser of a form, in the form's frame.

    Attributes
    ----------
    A : ndarray of shape (d, d), float64
    t : ndarray of shape (d,), float64
    value : float
        z' Q z at the minimiser.
    gap, norm : float or None
        Certified distance to the global minimum, and the norm of the reduced form; None for models without certificate.
    """

    A: Float64Array
    t: Float64Array
    value: float
    gap: float | None
    norm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Lowest and highest parameters, as offsets from the prior; arrays of shape (m,)."""

    low: Float64Array
    high: Float64Array

    @property
    def bind_motion(self) -> bool:
        """Whether any parameter is bounded."""
        return bool(np.isfinite(self.low).any() or np.isfinite(self.high).any())

    def reached(self, prior: Prior, A: Float64Array, t: Float64Array, model: str) -> tuple[str, ...]:
        """Return the kinds of parameters of which one ended at a bound, where it was not fixed."""
        if not self.bind_motion:
            return ()
        offsets = offsets_from(prior, A, t, model)
        ends = (offsets - self.low < AT_BOUND) | (self.high - offsets < AT_BOUND)
        active = ends & (self.high - self.low > AT_BOUND)
        first = newton_kernels.n_rotation(model_number(model), t.size)
        parts = np.split(active, [first, first + t.size])
        return tuple(kind for kind, part in zip(("rotation", "translation", "scale"), parts) if part.any())

    def in_size(self, old: float, new: float, model: str, dim: int) -> Limits:
        """Return the same limits in a frame of another size, in whose units translations are."""
        first = newton_kernels.n_rotation(model_number(model), dim)
        unit = np.ones_like(self.low)
        unit[first : first + dim] = old / new
        return Limits(self.low * unit, self.high * unit)


def solve_form(Q: Float64Array, *, model: str, prior: Prior, limits: Limits, ratio: float = 1e-6) -> Solution:
    """Minimise z' Q z over a model of transformation.

    Parameters
    ----------
    Q : ndarray of shape (d(d+1)+1, d(d+1)+1), float64
        The quadratic form, in a centred and scaled frame.
    model : str
        One of ``MODELS``.
    prior : Prior
        Held along directions that Q does not see.
    limits : Limits
        Bounds on the parameters' offsets from the prior.
    ratio : float
        Directions whose curvature is below this share of the largest count as not seen.

    Returns
    -------
    Solution
        Global for ``translation``, ``affine`` and unbounded ``rigid`` (certified); the best of many starts otherwise.
    """
    if model == "rigid" and not limits.bind_motion:
        found = _solve_rigid_space(Q, prior) if prior.t.size == 3 else _solve_rigid_plane(Q, prior)
    elif model in ("translation", "affine") and not limits.bind_motion:
        found = _solve_linear(Q, model, prior, ratio)
    else:
        found = _solve_from_many(Q, model, prior, limits)
    if limits.bind_motion and model in ("translation", "rigid"):
        return found
    return hold_at_prior(Q, found, model=model, prior=prior, limits=limits, ratio=ratio)


def walk(
    Q: Float64Array, A: Float64Array, t: Float64Array, *, model: str, prior: Prior, limits: Limits, ratio: float
) -> Solution:
    """Walk from (A, t) to the nearest minimum, leaving unseen directions where they are."""
    A, t = A.copy(), t.copy()
    offsets = offsets_from(prior, A, t, model)
    if limits.bind_motion:
        offsets = np.clip(offsets, limits.low, limits.high)
        A, t = moved_from(prior, offsets, model)
    number = model_number(model)
    value, _ = newton_kernels.newton(Q, A, t, number, ratio, STEPS, limits.low, limits.high, offsets)
    return Solution(A, t, float(value), None, None)


def offsets_from(prior: Prior, A: Float64Array, t: Float64Array, model: str) -> Float64Array:
    """Return the parameters that lead from the prior to (A, t)."""
    if model == "affine":
        return np.concatenate([(A - prior.A).ravel(order="F"), t - prior.t])
    shift = t - prior.t
    if model == "translation":
        return shift
    if model == "rigid" and np.trace(A @ prior.A.T) > t.size - 3.9:
        return np.asarray(newton_kernels.rigid_offsets(prior.A, prior.t, A, t))
    scale, scale_prior = np.linalg.norm(A, axis=0), np.linalg.norm(prior.A, axis=0)
    turn = log_rotation(nearest_rotation((A / scale) @ (prior.A / scale_prior).T))
    ratios = np.log(scale / scale_prior)
    tail = {"rigid": ratios[:0], "similarity": ratios.mean(keepdims=True), "scaled": ratios}[model]
    return np.concatenate([turn, shift, tail])


def moved_from(prior: Prior, offsets: Float64Array, model: str) -> tuple[Float64Array, Float64Array]:
    """Return the (A, t) that the parameters lead to from the prior."""
    A, t = np.empty_like(prior.A), np.empty_like(prior.t)
    newton_kernels.move(prior.A, prior.t, offsets, model_number(model), A, t)
    return A, t


def hold_at_prior(
    Q: Float64Array, found: Solution, *, model: str, prior: Prior, limits: Limits, ratio: float
) -> Solution:
    """Slide a solution along the directions that Q does not see, to where it is nearest to the prior."""
    A, t = found.A, found.t
    number = MODELS.index(model)
    value = found.value
    for _ in range(8):
        _, _, H = newton_kernels.derivatives(Q, A, t, number)
        values, vectors = np.linalg.eigh(H)
        unseen = vectors[:, np.abs(values) <= ratio * np.abs(values).max()]
        if unseen.shape[1] == 0:
            break
        back = unseen @ (unseen.T @ -offsets_from(prior, A, t, model))
        if np.abs(back).max() < 1e-12:
            break
        A_next, t_next = moved_from(Prior(A, t), back, model)
        slid = walk(Q, A_next, t_next, model=model, prior=prior, limits=limits, ratio=ratio)
        A, t, value = slid.A, slid.t, slid.value
    gap = None if found.gap is None else found.gap + max(0.0, value - found.value)
    return Solution(A, t, value, gap, found.norm)


def _solve_rigid_space(Q: Float64Array, prior: Prior) -> Solution:
    R, t, value, gap, norm = rigid_kernels.solve_certified(
        Q, prior.A, prior.t, octahedral_rotations(), *multiplier_tables(), TOLERANCE
    )
    return Solution(R, t, value, gap, norm)


def _solve_rigid_plane(Q: Float64Array, prior: Prior) -> Solution:
    """Find all stationary points on the circle as the roots of one quartic, and keep the lowest."""
    F, K = rigid_kernels.reduce_translation(Q, prior.t)
    turn = np.array([[1.0, 0, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0], [0, 0, 1]])
    a, b, c = turn.T @ F @ turn
    alpha, beta = (a[0] - b[1]) / 2, a[1]  # f = p cos + q sin + alpha cos 2 + beta sin 2 + constant
    p, q = 2 * a[2], 2 * b[2]
    quartic = [beta + 1j * alpha, (q + 1j * p) / 2, 0.0, (q - 1j * p) / 2, beta - 1j * alpha]
    angles = np.append(np.angle(np.roots(quartic)), np.arctan2(prior.A[1, 0], prior.A[0, 0]))
    for _ in range(4):
        cos, sin, cos2, sin2 = np.cos(angles), np.sin(angles), np.cos(2 * angles), np.sin(2 * angles)
        slope = -p * sin + q * cos - 2 * alpha * sin2 + 2 * beta * cos2
        curvature = -p * cos - q * sin - 4 * alpha * cos2 - 4 * beta * sin2
        usable = np.abs(curvature) > 1e-14 * (np.abs(curvature).max() + 1e-300)
        angles = angles - np.clip(np.where(usable, slope / np.where(usable, curvature, 1.0), 0.0), -0.1, 0.1)
    y = np.stack([np.cos(angles), np.sin(angles), np.ones_like(angles)])
    table = np.array([a, b, c])
    values = np.einsum("in,ij,jn->n", y, table, y)
    best = int(np.argmin(values))
    u = y[:2, best]
    multiplier = u @ (table[:2, :2] @ u + table[:2, 2])
    lowest = float(np.linalg.eigvalsh(table[:2, :2])[0] - multiplier)
    A = np.array([[u[0], -u[1]], [u[1], u[0]]])
    t = K @ np.append(A.ravel(order="F"), 1.0)
    return Solution(A, t, float(values[best]), 4.0 * max(0.0, -lowest), float(np.linalg.norm(F)))


def _solve_linear(Q: Float64Array, model: str, prior: Prior, ratio: float) -> Solution:
    """Solve a model that is linear in its parameters, nearest to the prior; Eq. (11)-(15) in the affine case."""
    number = model_number(model)
    A, t = prior.A, prior.t
    for _ in range(2):  # the second pass takes off the rounding of the first
        _, gradient, H = newton_kernels.derivatives(Q, A, t, number)
        step = -np.linalg.pinv(H, rcond=ratio, hermitian=True) @ gradient
        A, t = moved_from(Prior(A, t), step, model)
    value, _, _ = newton_kernels.derivatives(Q, A, t, number)
    return Solution(A, t, float(value), None, None)


def _solve_from_many(Q: Float64Array, model: str, prior: Prior, limits: Limits) -> Solution:
    """Walk from the prior, from the affine solution and from rotations all around; keep the best minimum."""
    affine = _solve_linear(Q, "affine", prior, 1e-10)
    best = walk(Q, prior.A, prior.t, model=model, prior=prior, limits=limits, ratio=1e-12)
    if model == "translation":
        return best
    scale = np.clip(np.linalg.norm(affine.A, axis=0), 0.2, 5.0)
    if model == "rigid":
        scale = np.ones_like(scale)
    elif model == "similarity":
        scale = np.full_like(scale, scale.mean())
    rotations = [nearest_rotation(affine.A), *_rotations_around(prior.t.size)]
    F, K = rigid_kernels.reduce_translation(Q, prior.t)
    for V in np.linalg.eigh(F[:-1, :-1])[1].T:
        turn = V.reshape(prior.A.shape, order="F")
        rotations += [nearest_rotation(turn), nearest_rotation(-turn)]
    for R in rotations:
        A = R * scale
        t = K @ np.append(A.ravel(order="F"), 1.0)
        trial = walk(Q, A, t, model=model, prior=prior, limits=limits, ratio=1e-12)
        if trial.value < best.value * (1 - 1e-13):
            best = trial
    return best


@cache
def _rotations_around(dim: int) -> tuple[Float64Array, ...]:
    if dim == 2:
        return tuple(exp_rotation([angle]) for angle in np.arange(12) * np.pi / 6)
    return tuple(octahedral_rotations())
