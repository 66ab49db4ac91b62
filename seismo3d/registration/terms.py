"""The two kinds of residuals of the fused loop: dense surfaces and sparse features, each with its measured variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration import quadratic
from seismo3d.registration.robust import TUKEY, tukey_weights


@dataclass(frozen=True, slots=True, eq=False)
class FeatureTerm:
    """Matched features in the registration's frame.

    Attributes
    ----------
    target, source : ndarray of shape (k, d), float64
        Row ``i`` of one matches row ``i`` of the other.
    information : ndarray of shape (k, d, d), float64
        Inverse covariance of each pair's difference, up to one common factor.
    floor : float
        Least standard deviation of a difference along one axis, in units of that covariance.
    """

    target: Float64Array
    source: Float64Array
    information: Float64Array
    floor: float

    def agreeing(self, A: Float64Array, t: Float64Array, reach: float) -> FeatureTerm:
        """Return the pairs that lie within a distance of each other under (A, t)."""
        close = ((self.source @ A.T + t - self.target) ** 2).sum(axis=1) < reach * reach
        return FeatureTerm(self.target[close], self.source[close], self.information[close], self.floor)


@dataclass(frozen=True, slots=True, eq=False)
class FeaturePass:
    """Form (weighted, not divided), sum of weights, variance and inliers of the features at one transform."""

    form: Float64Array
    weight: float
    variance: float
    weights: Float64Array


def weigh_features(term: FeatureTerm, A: Float64Array, t: Float64Array) -> FeaturePass:
    """Weigh the features by how well they agree with (A, t) and gather their form."""
    d = t.size
    offsets = term.source @ A.T + t - term.target
    distances = np.sqrt(np.einsum("ni,nij,nj->n", offsets, term.information, offsets))
    typical = float(np.median(distances)) / (1.18, 1.54)[d - 2]  # median of a chi law with d degrees of freedom
    spread = max(typical, term.floor)
    weights = tukey_weights(distances, TUKEY * d**0.5 * spread)  # of a distance in d dimensions: few pairs, all needed
    form = quadratic.point_form(term.target, term.source, weights[:, None, None] * term.information)
    squares = float(weights @ distances**2)
    variance = max(squares / (d * max(float(weights.sum()), 1e-9)), term.floor**2)
    return FeaturePass(form, float(weights.sum()), variance, weights)
