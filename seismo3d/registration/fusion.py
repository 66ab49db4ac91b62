"""The joint error of surfaces and features: each term weighed by its measured variance, feigned curvature taken out."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array

EXC = float(os.environ.get("EXC", "0.1"))
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.constraints import model_number
from seismo3d.registration.matching import Pass
from seismo3d.registration.terms import FeaturePass


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """The fused form at one transform, the factors of both terms in it, and the robust cost of the pairs.

    Directions whose curvature is below ``ratio`` times the largest are not seen; the surfaces' part has been taken out
    along those that they do not see (``unseen``, orthonormal columns).
    """

    form: Float64Array
    shares: tuple[float, float]
    cost: float
    surface: Pass | None
    features: FeaturePass | None
    ratio: float = 0.0
    unseen: Float64Array | None = None


def fuse(
    surface: Pass | None,
    features: FeaturePass | None,
    alpha: float | None,
    voxel_size: float,
    dense_variance: float = 1.0,
) -> Joint:
    """Join both terms: by their measured variances, or with the fixed share alpha of Eq. (16)."""
    if surface is None:
        if features is None:
            raise ValueError("nothing to fuse")
        form = features.form / features.variance
        return Joint(form, (0.0, 1.0 / features.variance), 0.0, None, features)
    if features is None:
        factor = 1.0 / max(surface.spread, 1e-4 * voxel_size) ** 2
        return Joint(surface.form * factor, (factor, 0.0), surface.cost, surface, None)
    if alpha is None:
        shares = (1.0 / dense_variance, 1.0 / features.variance)
    else:
        shares = ((1.0 - alpha) / max(surface.weight, 1e-12), alpha / max(features.weight, 1e-12))
    form = surface.form * shares[0] + features.form * shares[1]
    n_features = len(features.weights)
    outside = 1.0 - features.weight / n_features
    cost = surface.cost + outside
    return Joint(form, shares, cost, surface, features)


def surface_variance(surface: Pass, meat: Float64Array, A: Float64Array, model: str, voxel_size: float) -> float:
    """Return the variance along the normal of a residual of weight 1, as far as the surfaces are from lying together.

    Weights are inverse variances up to a factor, and this is the factor: the mean variance of the parameters, from sums
    of residuals over patches, next to what the weights alone would have. Where neighbouring residuals are correlated it
    is larger than their square. Residuals of nearest pairs are small even far from the solution, where pairs are wrong;
    the distance between partners in excess of what voxels of this size have anyway tells, and counts along.
    """
    least = (1e-4 * voxel_size) ** 2
    if surface.weight == 0.0:
        return voxel_size**2
    J = parameter_jacobian(A, model_number(model))
    n, m = J.shape
    curvature = J.T @ surface.form[:n, :n] @ J
    curvature += 1e-4 * np.trace(curvature) * np.eye(m)
    unit = float(np.trace(np.linalg.solve(curvature, J.T @ meat[:n, :n] @ J))) / m
    excess = max(0.0, float(np.nanmedian(surface.distances2)) - 0.3 * voxel_size**2)
    return max(unit * (1.0 + EXC * excess / max(surface.spread**2, least)), least)
