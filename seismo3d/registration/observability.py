"""What the data determine and how well: unseen directions, covariance and information of a solution."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration import _kernels_newton as kernels
from seismo3d.registration.constraints import model_number
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.result import Direction
from seismo3d.registration.solvers import Limits


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """Covariance and information in the input's units, and the directions that are not seen."""

    covariance: Float64Array
    information: Float64Array
    unobservable: tuple[Direction, ...]


def assess(
    Q: Float64Array,
    meat: Float64Array,
    A: Float64Array,
    t: Float64Array,
    *,
    model: str,
    frame: Frame,
    ratio: float,
    limits: Limits,
) -> Uncertainty:
    """Return how sure a solution is.

    Parameters
    ----------
    Q : ndarray
        The form that was minimised, in the frame: sum of w r r' over residual rows.
    meat : ndarray of Q's shape
        Sum of w^2 sigma^2 r r': the covariance of the form's gradient, up to a factor of four. For weights that are
        inverse variances up to one factor s^2 it is s^2 Q.
    A, t : ndarray
        The solution in the frame.
    model, frame, ratio, limits
        As given to the solver. Parameters that are fixed have no uncertainty; they count as known.

    Returns
    -------
    Uncertainty
        Sandwich covariance H^-1 M H^-1, infinite along the unseen directions.
    """
    number = model_number(model)
    _, _, H = kernels.derivatives(Q, A, t, number)
    J = kernels.parameter_jacobian(A, number)
    n = J.shape[0]
    bread = J.T @ Q[:n, :n] @ J
    spread = J.T @ meat[:n, :n] @ J
    fixed = limits.high - limits.low < 1e-12
    keep = np.flatnonzero(~fixed)
    unseen, seen = _split(H[np.ix_(keep, keep)], ratio, keep, H.shape[0])
    change = to_input_units(A, t, model, frame)
    directions = tuple(_direction(v, s, A, model, frame) for v, s in unseen)
    covariance = np.zeros_like(H)
    information = np.zeros_like(H)
    if seen.shape[1]:
        # a square of its root, so that rounding leaves no variance negative
        values, vectors = np.linalg.eigh(seen.T @ spread @ seen)
        root = np.linalg.inv(seen.T @ bread @ seen) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
        inner = root @ root.T
        outer = change @ seen @ root
        covariance = outer @ outer.T
        back = np.linalg.inv(change).T @ seen
        information = back @ np.linalg.pinv(inner, hermitian=True) @ back.T
    for vector, _ in unseen:
        _add_infinite(covariance, change @ vector)
    return Uncertainty((covariance + covariance.T) / 2, (information + information.T) / 2, directions)


def _split(
    H: Float64Array, ratio: float, keep: np.ndarray, size: int
) -> tuple[list[tuple[Float64Array, float]], Float64Array]:
    if keep.size == 0:
        return [], np.zeros((size, 0))
    values, vectors = np.linalg.eigh(H)
    full = np.zeros((size, keep.size))
    full[keep] = vectors
    largest = float(np.abs(values).max()) or 1.0
    is_unseen = np.abs(values) <= ratio * largest
    unseen = [(full[:, k], float(abs(values[k])) / largest) for k in np.flatnonzero(is_unseen)]
    return unseen, full[:, ~is_unseen]


def to_input_units(A: Float64Array, t: Float64Array, model: str, frame: Frame) -> Float64Array:
    """Return the matrix from the frame's parameters to a perturbation on the left, in the input's units."""
    d = t.size
    number = model_number(model)
    m = kernels.n_parameters(number, d)
    place = frame.size * t + frame.target_center
    change = np.zeros((m, m))
    if model == "affine":
        inverse = np.linalg.pinv(A)
        change[: d * d, : d * d] = np.kron(inverse.T, np.eye(d))
        change[d * d :, d * d :] = frame.size * np.eye(d)
        change[d * d :, : d * d] = -np.kron((inverse @ place)[None, :], np.eye(d))
        return change
    r = kernels.n_rotation(number, d)
    change[:r, :r] = np.eye(r)
    change[r : r + d, r : r + d] = frame.size * np.eye(d)
    if r == 3:
        x, y, z = place
        change[3:6, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    elif r == 1:
        change[1:3, 0] = [place[1], -place[0]]
    scales = np.arange(r + d, m)
    change[scales, scales] = 1.0
    if model == "similarity":
        change[r : r + d, -1] = -place
    elif model == "scaled":
        change[r : r + d, scales] = -frame.growth * A * frame.source_center
    return change


def _direction(vector: Float64Array, strength: float, A: Float64Array, model: str, frame: Frame) -> Direction:
    d = A.shape[0]
    if model == "affine":
        return Direction(vector[:0], frame.size * vector[d * d :], frame.growth * vector[: d * d], strength)
    r = kernels.n_rotation(model_number(model), d)
    return Direction(vector[:r], frame.size * vector[r : r + d], vector[r + d :], strength)


def _add_infinite(covariance: Float64Array, vector: Float64Array) -> None:
    """Set the entries that a direction of infinite variance touches; the sign is that of the product."""
    weight = np.abs(vector) / np.abs(vector).max()
    touched = np.flatnonzero(weight > 1e-6)
    for i in touched:
        for j in touched:
            if i == j:
                covariance[i, j] = math.inf
            elif math.isfinite(covariance[i, j]):
                covariance[i, j] = math.copysign(math.inf, vector[i] * vector[j])
