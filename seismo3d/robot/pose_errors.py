"""How far a pose may be off, by what kind of error: each kind adds up along the way in its own manner.

Noise adds up as independent steps do. What each frame has wrong alike leads every step the same way, so that standard
deviations add, not variances. And what is stated wrongly of the lens is one number for all frames, by which each pose
is off as the geometry has it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import adjoint


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of a pose, perturbations on the left, (rotation, translation); none by default.

    Attributes
    ----------
    covariance : ndarray of shape (6, 6), float64
        Of noise.
    alike : ndarray of shape (6, 6), float64
        Covariance of what each frame has wrong alike.
    by_lens : ndarray of shape (6, 4), float64
        Change of the pose by the share by which points are taken too small (the depth's scale) and too narrow (the
        focal length), and by the principal point's x and y, in focal lengths.
    """

    covariance: Float64Array = field(default_factory=lambda: np.zeros((6, 6)))
    alike: Float64Array = field(default_factory=lambda: np.zeros((6, 6)))
    by_lens: Float64Array = field(default_factory=lambda: np.zeros((6, 4)))

    @property
    def total(self) -> Float64Array:
        """Covariance (6, 6) of all but what the lens does."""
        return np.asarray(self.covariance + self.alike)

    def beyond(self, other: PoseErrors) -> PoseErrors:
        """Return the errors of a pose that is off by these, and by others on top."""
        alike = add_alike(self.alike, other.alike)
        return PoseErrors(self.covariance + other.covariance, alike, self.by_lens + other.by_lens)

    def carried(self, by: Float64Array) -> PoseErrors:
        """Return the errors after a linear map (6, 6)."""
        return PoseErrors(by @ self.covariance @ by.T, by @ self.alike @ by.T, by @ self.by_lens)

    def moved(self, change: Float64Array) -> PoseErrors:
        """Return the errors after a change (4, 4) of the world's frame."""
        return self.carried(adjoint(change))


def add_alike(one: Float64Array, other: Float64Array) -> Float64Array:
    r"""Return the covariance of the sum of two errors that go the same way, so that standard deviations add.

    :math:`A + B + 2 A \mathbin{\#} B`, with the geometric mean
    :math:`A \mathbin{\#} B = A^{1/2} (A^{-1/2} B A^{-1/2})^{1/2} A^{1/2}` [1]_: the sum is the same in every frame.

    Parameters
    ----------
    one, other : ndarray of shape (n, n), float64

    Returns
    -------
    ndarray of shape (n, n), float64

    References
    ----------
    .. [1] R. Bhatia, "Positive Definite Matrices", Princeton 2007, chapter 4.
    """
    return np.asarray(one + other + 2.0 * _geometric_mean(one, other))


def differ_alike(one: Float64Array, other: Float64Array) -> Float64Array:
    """Return the covariance of the difference of two errors that go the same way: standard deviations less each other.

    Parameters and shapes are those of :func:`add_alike`.
    """
    values, vectors = np.linalg.eigh(one + other - 2.0 * _geometric_mean(one, other))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _geometric_mean(one: Float64Array, other: Float64Array) -> Float64Array:
    if not one.any() or not other.any():
        return np.zeros_like(one)
    little = 1e-12 * (np.trace(one) + np.trace(other)) * np.eye(len(one))
    values, vectors = np.linalg.eigh(one + little)
    root, back = (vectors * np.sqrt(values)) @ vectors.T, (vectors / np.sqrt(values)) @ vectors.T
    values, vectors = np.linalg.eigh(back @ (other + little) @ back)
    half = root @ vectors * np.maximum(values, 0.0) ** 0.25
    return np.asarray(half @ half.T)
