"""The joint error of surfaces and features: each term weighed by its measured variance, feigned curvature taken out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.constraints import model_number
from seismo3d.registration.matching import Pass
from seismo3d.registration.quadratic import stack
from seismo3d.registration.terms import FeaturePass

NORMAL_NOISE = 3.0
"""Curvature that noise of the normals feigns, in medians of the squared sine between matched normals."""
MOST_FEIGNED = 0.004
"""Most of it: far from the solution normals differ because pairs are wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """The fused form at one transform, the factors of both terms in it, and the robust cost of the pairs.

    Directions whose curvature is below ``ratio`` times the largest are not seen.
    """

    form: Float64Array
    shares: tuple[float, float]
    cost: float
    surface: Pass | None
    features: FeaturePass | None
    ratio: float = 0.0


def fuse(surface: Pass | None, features: FeaturePass | None, alpha: float | None, voxel_size: float) -> Joint:
    """Join both terms: by their measured variances, or with the fixed share alpha of Eq. (16)."""
    if surface is None:
        if features is None:
            raise ValueError("nothing to fuse")
        form = features.form / features.variance
        return Joint(form, (0.0, 1.0 / features.variance), 0.0, None, features)
    if features is None:
        factor = 1.0 / max(surface.spread, 1e-4 * voxel_size) ** 2
        return Joint(surface.form * factor, (factor, 0.0), surface.cost, surface, None)
    dense_variance = surface_variance(surface, voxel_size)
    if alpha is None:
        shares = (1.0 / dense_variance, 1.0 / features.variance)
    else:
        shares = ((1.0 - alpha) / max(surface.weight, 1e-12), alpha / max(features.weight, 1e-12))
    form = surface.form * shares[0] + features.form * shares[1]
    n_features = len(features.weights)
    outside = 1.0 - features.weight / n_features
    cost = surface.cost + outside
    return Joint(form, shares, cost, surface, features)


def normal_noise(surface: Pass, source: Float32Array, A: Float64Array) -> float:
    """Return the median squared sine of the angle between matched normals: information that noise feigns.

    A plane with noisy normals seems to hold what slides along it, by as much as its normals waver.
    """
    d = A.shape[0]
    turned = source[:, 4 : 4 + d] @ A.T.astype(np.float32)
    length2 = (turned * turned).sum(axis=1)
    usable = np.isfinite(surface.residuals) & (length2 > 0.0)
    if not usable.any():
        return 0.0
    cosine = (turned[usable] * surface.normals[usable, :d]).sum(axis=1)
    return float(np.median(np.maximum(0.0, 1.0 - cosine * cosine / length2[usable])))


def feigned(surface: Pass, source: Float32Array, A: Float64Array) -> float:
    """Return the share of the largest curvature up to which noise may feign curvature."""
    return min(NORMAL_NOISE * normal_noise(surface, source, A), MOST_FEIGNED)


def seen_part(form: Float64Array, A: Float64Array, t: Float64Array, model: str, ratio: float) -> Float64Array:
    """Return the surfaces' form without what noise feigns: directions of weak curvature at (A, t) are taken out of it.

    Features then lead along those directions alone.
    """
    J = parameter_jacobian(A, model_number(model))
    n = J.shape[0]
    values, vectors = np.linalg.eigh(J.T @ form[:n, :n] @ J)
    weak = values <= ratio * values[-1]
    if not weak.any():
        return form
    strong = vectors[:, ~weak]
    keep = J @ strong @ strong.T @ np.linalg.pinv(J)
    P = np.eye(n + 1)
    P[:n, :n] = keep
    P[:n, n] = (np.eye(n) - keep) @ stack(A, t)[:n]
    return np.asarray(P.T @ form @ P)


def surface_variance(surface: Pass, voxel_size: float) -> float:
    """Return the variance of a residual along the normal, as far as the surfaces are from lying on each other.

    Residuals of nearest pairs are small even far from the solution, where pairs are wrong; the distance between
    partners in excess of what voxels of this size have anyway tells, and counts along with the residuals' own spread.
    """
    if surface.matched == 0.0:
        return voxel_size**2
    usual = 0.3 * voxel_size**2
    excess = max(0.0, float(np.nanmedian(surface.distances2)) - usual)
    return max(surface.spread**2 + 0.1 * excess, (1e-4 * voxel_size) ** 2)
