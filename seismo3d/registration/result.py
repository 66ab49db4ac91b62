"""What registration yields: the transform, how sure it is, and what could not be seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.geometry.rotations import nearest_rotation, rotation_angle, transform_points
from seismo3d.registration.certificate import Certificate

MODELS = ("translation", "rigid", "similarity", "scaled", "affine")
"""The classes of transformation, by name; a model's place is its number in the kernels."""
SIZE_IS_FREE = ("similarity", "scaled", "affine")
"""The models that may shrink and grow."""


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """One direction of motion that the data do not determine, in the target frame, about the source's centre.

    Attributes
    ----------
    rotation : ndarray of shape (3,) or (1,), float64
        Rotation part of the direction, radians per unit; empty for models without rotation.
    translation : ndarray of shape (d,), float64
        Motion of the source's centre, in the input's units per unit.
    scale : ndarray of shape (k,), float64
        Part of the logarithm of scale, or of the entries of A for the affine model; empty for rigid models.
    strength : float
        Curvature along the direction over the largest curvature of all.
    """

    rotation: Float64Array
    translation: Float64Array
    scale: Float64Array
    strength: float


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """The transform that carries the source onto the target.

    Attributes
    ----------
    T_target_source : ndarray of shape (d+1, d+1), float64
        Homogeneous matrix; maps source to target.
    covariance : ndarray of shape (m, m), float64
        Covariance of a perturbation on the left in the target frame, order (rotation, translation, scale); radians and
        the input's units. Infinite along what is unobservable.
    information : ndarray of shape (m, m), float64
        The covariance's inverse, zero along what is unobservable: what graphs and filters need.
    rmse : float
        Weighted root mean square residual over the inliers, in the input's units.
    overlap : float
        Share of the source that lies on the target, 0 to 1.
    converged : bool
        The state is ``"converged"``.
    state : str
        ``"converged"``, ``"not_converged"`` (steps ran out), ``"no_overlap"`` (too few pairs within reach),
        ``"poor_fit"`` (a minimum with little overlap; one of less than good overlap beside which a search found others
        that fit nearly as well, as it does on unrelated scans; or one whose scale ran to a bound), ``"ambiguous"`` (a
        good fit beside which a search found another, elsewhere, that explains nearly as much: scans of parts of a
        symmetric shape do not tell which part each shows; start nearer, or give matches).
    certificate : Certificate or None
        Bound on the distance to the global minimum for the final pairs; None for models without one.
    unobservable : tuple of Direction
        Directions along which the transform was left at its start.
    model : str
    scale : ndarray of shape (1,) or (d,), float64
        Factors of scale: the lengths of the columns of the linear part.
    energies : tuple of float
        Mean square residual after each step of the loop, the input's units squared; empty for the exact solve alone.
    path : tuple of ndarray of shape (d+1, d+1)
        Transforms at which those energies were measured.
    at_bounds : tuple of str
        Which of ``"rotation"``, ``"translation"`` and ``"scale"`` ended at a bound, where they were not fixed: without
        it they would have gone on.
    stage : str
        ``"exact"`` (given pairs), ``"local"`` or ``"global"``: the stage whose answer this is.
    find_inliers : callable
        Finds ``inliers``.
    """

    T_target_source: Float64Array
    covariance: Float64Array
    information: Float64Array
    rmse: float
    overlap: float
    state: str
    certificate: Certificate | None
    unobservable: tuple[Direction, ...]
    model: str
    scale: Float64Array
    energies: tuple[float, ...] = ()
    path: tuple[Float64Array, ...] = ()
    at_bounds: tuple[str, ...] = ()
    stage: str = "exact"
    find_inliers: Callable[[], BoolArray] = field(default=lambda: np.zeros(0, dtype=bool), repr=False)

    @property
    def inliers(self) -> BoolArray:
        """Rows of the source (or of the given pairs) that agree with the transform; found anew at each call."""
        return self.find_inliers()

    @property
    def converged(self) -> bool:
        """Whether the state is ``"converged"``."""
        return self.state == "converged"

    @property
    def angle(self) -> float:
        """Angle of the rotation in radians, 0 to pi."""
        d = self.T_target_source.shape[0] - 1
        return rotation_angle(nearest_rotation(self.T_target_source[:d, :d]))

    def apply(self, points: Float64Array) -> Float64Array:
        """Carry source points, one a row, into the target frame."""
        return transform_points(self.T_target_source, points)
