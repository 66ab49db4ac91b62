"""The joint error of surfaces and features at one transform, each term weighed by its measured variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.constraints import model_number
from seismo3d.registration.matching import NONE_GIVEN, Memory, Pass, match_surface, surface_meat
from seismo3d.registration.projective import PixelTable
from seismo3d.registration.settings import LoopSettings
from seismo3d.registration.terms import FeaturePass, FeatureTerm, weigh_features
from seismo3d.registration.unseen import Look, is_weak, unseen_directions, weak_directions, without

LEAST_RATIO = 1e-7
FAR_RATIO = 1e-3
"""Share of the largest curvature up to which directions are held where pairs are still wrong."""
LEAST_MATCHED = 0.6
"""Share of elements with a partner from which the surfaces may lie on each other."""
LEAST_SPREAD = 1e-4
"""Least standard deviation of a residual, in voxels."""
USUAL, EXCESS = 0.3, 0.1
"""Squared distance of partners that voxels have anyway, in squared voxels; how much of what exceeds it counts."""
RIDGE = 1e-4
"""Share of the curvature that is added to it, so that directions that nothing is known of do not count."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One level of the loop.

    Attributes
    ----------
    target : VoxelMap
    source : ndarray of shape (n, 8), float32
        The elements that a pass looks at.
    coarser : tuple of Level
        Nearest first.
    table : PixelTable or None
        Partners come from the target's pixels; None searches the nearest.
    """

    target: VoxelMap
    source: Float32Array
    coarser: tuple[Level, ...]
    table: PixelTable | None


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """The fused form at one transform, the factors of both terms in it, and the robust cost of the pairs.

    Directions whose curvature is below ``ratio`` times the largest are not seen; along those that the surfaces do not
    see (``unseen``, orthonormal columns) their part of the form has been taken out.
    """

    form: Float64Array
    shares: tuple[float, float]
    cost: float
    surface: Pass | None
    features: FeaturePass | None
    ratio: float = 0.0
    unseen: Float64Array | None = None


def evaluate(
    level: Level,
    features: FeatureTerm | None,
    A: Float64Array,
    t: Float64Array,
    *,
    radius: float,
    cutoff: float,
    given: Int32Array | None,
    settings: LoopSettings,
    model: str,
    memory: Memory | None = None,
) -> Joint:
    """Match the surfaces at (A, t), take out what they do not see, and fuse them with the features.

    Parameters
    ----------
    level : Level
    features : FeatureTerm or None
    A, t : ndarray
        The transform in the frame.
    radius, cutoff : float
        Largest distance of a pair, and residual along the normal at which its weight reaches zero.
    given : ndarray of shape (n,), int32, or None
        Known partners; None to search.
    settings : LoopSettings
    model : str
    memory : Memory, optional
        Of passes over this level.
    """
    if given is None and level.table is not None:
        given = level.table.partners(level.source, level.target.surface, A, t, radius)
    surface = match_surface(
        level.source,
        level.target,
        A,
        t,
        radius=radius,
        cutoff=cutoff,
        symmetric=settings.symmetric,
        n_threads=settings.n_threads,
        given=NONE_GIVEN if given is None else given,
        memory=memory,
    )
    form, unseen = surface.form, None
    if settings.alpha is None and is_weak(surface, A, model):
        unseen = _unseen(level, surface, A, t, model, settings.n_threads)
        form = without(form, A, t, model, unseen)
    ratio = max(settings.observability, LEAST_RATIO)
    if features is None:
        share = 1.0 / max(surface.spread, LEAST_SPREAD * level.target.size) ** 2
        return Joint(form * share, (share, 0.0), surface.cost, surface, None, ratio, unseen)
    seen = weigh_features(features, A, t)
    if settings.alpha is None:
        shares = (1.0 / surface_variance(level, surface, unseen, A, cutoff, model), 1.0 / seen.variance)
    else:
        shares = ((1.0 - settings.alpha) / max(surface.weight, 1e-12), settings.alpha / max(seen.weight, 1e-12))
    cost = surface.cost + 1.0 - seen.weight / len(seen.weights)
    return Joint(form * shares[0] + seen.form * shares[1], shares, cost, surface, seen, ratio, unseen)


def fuse_features(features: FeatureTerm, A: Float64Array, t: Float64Array) -> Joint:
    """Return the joint error of features alone."""
    seen = weigh_features(features, A, t)
    return Joint(seen.form / seen.variance, (0.0, 1.0 / seen.variance), 0.0, None, seen)


def surface_variance(
    level: Level, surface: Pass, unseen: Float64Array | None, A: Float64Array, cutoff: float, model: str
) -> float:
    """Return the variance along the normal of a residual of weight 1, as far as the surfaces are from lying together.

    Weights are inverse variances up to a factor, and this is the factor: the variance of what the surfaces see, from
    sums of residuals over patches, next to what the weights alone would have. Where neighbouring residuals are
    correlated it is larger than their square. Residuals of nearest pairs are small even far from the solution, where
    pairs are wrong; the distance between partners in excess of what voxels of this size have anyway tells, and counts
    along.
    """
    size = level.target.size
    if not surface.weight > 0.0:
        return size**2
    J = parameter_jacobian(A, model_number(model))
    n, m = J.shape
    meat = surface_meat(surface, level.source, level.target, cutoff, J)
    if unseen is not None and unseen.shape[1] < m:
        J = J @ np.linalg.qr(unseen, mode="complete")[0][:, unseen.shape[1] :]
    curvature = J.T @ surface.form[:n, :n] @ J
    curvature += RIDGE * np.trace(curvature) * np.eye(len(curvature))
    unit = float(np.trace(np.linalg.solve(curvature, J.T @ meat[:n, :n] @ J))) / len(curvature)
    excess = max(0.0, float(np.nanmedian(surface.distances2)) - USUAL * size**2)
    least = (LEAST_SPREAD * size) ** 2
    return max(unit * (1.0 + EXCESS * excess / max(surface.spread**2, least)), least)


def _unseen(level: Level, surface: Pass, A: Float64Array, t: Float64Array, model: str, n_threads: int) -> Float64Array:
    """Return the directions that are not seen; those that the pairs tell little of while they are still wrong."""
    if not _lies_near(surface, level.target.size):
        return weak_directions(surface, A, model, FAR_RATIO)
    looks = [Look(surface, level.source)]
    for coarse in level.coarser:
        size = coarse.target.size
        seen = match_surface(coarse.source, coarse.target, A, t, radius=1.5 * size, cutoff=size, n_threads=n_threads)
        if _lies_near(seen, size):
            looks.append(Look(seen, coarse.source))
    return unseen_directions(looks, A, model)


def _lies_near(surface: Pass, voxel_size: float) -> bool:
    """Return whether most elements lie on a partner: farther off normals differ because pairs are wrong."""
    if not surface.weight > 0.0 or surface.matched < LEAST_MATCHED:
        return False
    return bool(np.nanmedian(surface.distances2) < (0.7 * voxel_size) ** 2)
