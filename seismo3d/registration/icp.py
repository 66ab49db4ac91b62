"""The fused loop, from coarse to fine: match surfaces, weigh, solve, extrapolate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.acceleration import Accelerator, Stall
from seismo3d.registration.constraints import model_number
from seismo3d.registration.fusion import Joint, fuse, surface_variance
from seismo3d.registration.matching import NONE_GIVEN, Pass, match_surface, surface_meat
from seismo3d.registration.projective import PixelTable
from seismo3d.registration.robust import TUKEY
from seismo3d.registration.solvers import Limits, Prior, moved_from, offsets_from, walk
from seismo3d.registration.terms import FeatureTerm, weigh_features
from seismo3d.registration.unseen import Look, is_weak, unseen_directions, weak_directions, without
from seismo3d.registration.wide_search import WideSearch, draw, is_far

LEAST_RATIO = 1e-7
FAR_RATIO = 1e-3
"""Share of the largest curvature up to which directions are held where pairs are still wrong."""
LEAST_MATCHED = 0.6
"""Share of elements with a partner from which the surfaces may lie on each other."""


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Settings of the fused loop; the defaults are right.

    Attributes
    ----------
    max_iterations : int
        Most passes a level.
    tolerance : float
        The finest level ends where a step moves no parameter by more than this share of a voxel, in radians and in
        shares of the scan's size; coarser levels end at five times that.
    max_elements : int
        Most source elements that a pass looks at, drawn evenly.
    observability : float
        Directions whose curvature is below this share of the largest are left as they are.
    symmetric : bool
        Measure along the mean of both surfaces' normals.
    acceleration : int
        Steps that are remembered to extrapolate from; 0 for none.
    alpha : float or None
        Fixed share of the features as in Eq. (16), or None to weigh by measured variance.
    n_threads : int
        Threads to match on; the result does not depend on them.
    wide_search : bool
        Search the coarsest level without a limit of distance first.
    """

    max_iterations: int = 30
    tolerance: float = 0.004
    max_elements: int = 5000
    observability: float = 1e-6
    symmetric: bool = False
    acceleration: int = 4
    alpha: float | None = None
    n_threads: int = 1
    wide_search: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class LoopResult:
    """Where the loop ended, in the frame.

    Attributes
    ----------
    A, t : ndarray
    joint : Joint
        The last pass.
    cutoff : float
        Residual along the normal at which weights reached zero.
    settled : bool
        The last step was below the tolerance.
    energies : tuple of float
        Mean square residual of the matched points at each pass, in the frame.
    path : tuple of (A, t)
        Where each of those passes was made.
    """

    A: Float64Array
    t: Float64Array
    joint: Joint
    cutoff: float
    settled: bool
    energies: tuple[float, ...]
    path: tuple[tuple[Float64Array, Float64Array], ...] = ()


def run_levels(
    target: list[VoxelMap],
    source: list[VoxelMap],
    features: FeatureTerm | None,
    *,
    start: Prior,
    prior: Prior,
    limits: Limits,
    model: str,
    settings: LoopSettings,
    tables: list[PixelTable] | None = None,
) -> LoopResult:
    """Run the loop from the coarsest level to the finest.

    Parameters
    ----------
    target, source : list of VoxelMap
        Levels in the frame, finest first; empty for features alone.
    features : FeatureTerm or None
    start : Prior
        Transform to start from.
    prior : Prior
        Transform that limits are relative to.
    limits : Limits
    model : str
    settings : LoopSettings
    tables : list of PixelTable, optional
        By level: partners come from the target's pixels; None searches the nearest.
    """
    A, t = start.A, start.t
    trail: list[tuple[float, Float64Array, Float64Array]] = []
    coarser: list[tuple[VoxelMap, Float32Array]] = []
    result = None
    for level in range(len(target) - 1, -1, -1):
        coarsest = level == len(target) - 1
        result = _run_level(
            target[level], source[level], features, A, t, prior, limits, model, settings, trail,
            wide=coarsest and settings.wide_search, finest=level == 0,
            table=None if tables is None else tables[level], coarser=coarser,
        )  # fmt: skip
        A, t = result.A, result.t
        coarser.insert(0, (target[level], draw(source[level].surface, settings.max_elements)))
    if result is None:
        if features is None:
            raise ValueError("the loop needs surfaces or features")
        result = _run_features(features, A, t, prior, limits, model, settings)
    return result


def _run_level(
    target: VoxelMap,
    source: VoxelMap,
    features: FeatureTerm | None,
    A: Float64Array,
    t: Float64Array,
    prior: Prior,
    limits: Limits,
    model: str,
    settings: LoopSettings,
    trail: list[tuple[float, Float64Array, Float64Array]],
    *,
    wide: bool,
    finest: bool,
    table: PixelTable | None,
    coarser: list[tuple[VoxelMap, Float32Array]],
) -> LoopResult:
    base = Prior(A, t)
    memory = Accelerator(settings.acceleration)
    tolerance = (1.0 if finest else 5.0) * settings.tolerance * target.size
    drawn = draw(source.surface, settings.max_elements)
    stall = Stall()
    search = WideSearch(target, drawn) if wide and is_far(target, drawn, A, t) else None
    cutoff = target.size
    joint = None
    plain: tuple[Float64Array, Float64Array] | None = None
    settled = False
    for iteration in range(settings.max_iterations):
        if iteration == 12 and search is not None:
            search = joint = plain = None
        widened = search is not None
        given, radius = search.partners(A, t, iteration) if search else (None, 1.5 * target.size)
        if table is not None and search is None:
            given = table.partners(drawn, target.surface, A, t, radius)
        new = _evaluate(target, drawn, features, A, t, radius, cutoff, given, settings, model, coarser)
        if plain is not None and joint is not None and new.cost > 1.0005 * joint.cost + 1e-9:
            A, t = plain  # the extrapolation went uphill: take the plain step instead
            plain = None
            memory.forget()
            continue
        joint = new
        surface = joint.surface
        if surface is not None:
            trail.append((surface.mean_square, A, t))
            fresh = max(TUKEY * surface.spread, 0.05 * target.size, 1e-7)
            if not 0.8 < fresh / cutoff < 1.25:
                cutoff = min(fresh, 2.0 * target.size)
                memory.forget()
        step = walk(joint.form, A, t, model=model, prior=prior, limits=limits, ratio=joint.ratio)
        move = offsets_from(Prior(A, t), step.A, step.t, model)
        if np.abs(move).max() < (tolerance if not widened else 4 * tolerance) or stall.reached(joint.cost, cutoff):
            A, t = step.A, step.t
            if search is None:
                settled = True
                break
            search = None
            memory.forget()
            joint = plain = None
            continue
        before = offsets_from(base, A, t, model)
        after = offsets_from(base, step.A, step.t, model)
        mixed = memory.extrapolate(before, after)
        plain = None
        A, t = step.A, step.t
        if mixed is not None and not limits.bind_motion:
            plain = (A, t)
            A, t = moved_from(base, mixed, model)
    if joint is None:
        raise ValueError("max_iterations must be positive")
    return LoopResult(A, t, joint, cutoff, settled, tuple(e for e, _, _ in trail), tuple((B, u) for _, B, u in trail))


def _evaluate(
    target: VoxelMap,
    source: Float32Array,
    features: FeatureTerm | None,
    A: Float64Array,
    t: Float64Array,
    radius: float,
    cutoff: float,
    given: Int32Array | None,
    settings: LoopSettings,
    model: str,
    coarser: list[tuple[VoxelMap, Float32Array]],
) -> Joint:
    surface = match_surface(
        source,
        target,
        A,
        t,
        radius=radius,
        cutoff=cutoff,
        symmetric=settings.symmetric,
        n_threads=settings.n_threads,
        given=NONE_GIVEN if given is None else given,
    )
    seen = None if features is None else weigh_features(features, A, t)
    unseen = None
    form = surface.form
    if settings.alpha is None and is_weak(surface, A, model):
        unseen = _unseen(surface, source, target, coarser, A, t, model)
        if unseen.shape[1]:
            form = without(surface.form, A, t, model, unseen)
    variance = 1.0
    if seen is not None and settings.alpha is None and surface.weight > 0.0:
        J = parameter_jacobian(A, model_number(model))
        meat = surface_meat(surface, source, target, cutoff, J)
        variance = surface_variance(surface, meat, A, model, target.size)
    joint = fuse(replace(surface, form=form), seen, settings.alpha, target.size, variance)
    return replace(joint, surface=surface, ratio=max(settings.observability, LEAST_RATIO), unseen=unseen)


def _unseen(
    surface: Pass,
    source: Float32Array,
    target: VoxelMap,
    coarser: list[tuple[VoxelMap, Float32Array]],
    A: Float64Array,
    t: Float64Array,
    model: str,
) -> Float64Array:
    """Return the directions that are not seen; those that the pairs tell little of while they are still wrong."""
    if not _lies_near(surface, target.size):
        return weak_directions(surface, A, model, FAR_RATIO)
    looks = [Look(surface, source)]
    for level, drawn in coarser:
        seen = match_surface(drawn, level, A, t, radius=1.5 * level.size, cutoff=level.size)
        if _lies_near(seen, level.size):
            looks.append(Look(seen, drawn))
    return unseen_directions(looks, A, model)


def _lies_near(surface: Pass, voxel_size: float) -> bool:
    """Return whether most elements lie on a partner: farther off normals differ because pairs are wrong."""
    if not surface.weight > 0.0 or surface.matched < LEAST_MATCHED:
        return False
    return bool(np.nanmedian(surface.distances2) < (0.7 * voxel_size) ** 2)


def _run_features(
    features: FeatureTerm,
    A: Float64Array,
    t: Float64Array,
    prior: Prior,
    limits: Limits,
    model: str,
    settings: LoopSettings,
) -> LoopResult:
    settled = False
    joint = fuse(None, weigh_features(features, A, t), settings.alpha, 0.0)
    for _ in range(settings.max_iterations):
        step = walk(joint.form, A, t, model=model, prior=prior, limits=limits, ratio=settings.observability)
        move = offsets_from(Prior(A, t), step.A, step.t, model)
        A, t = step.A, step.t
        joint = fuse(None, weigh_features(features, A, t), settings.alpha, 0.0)
        if np.abs(move).max() < settings.tolerance:
            settled = True
            break
    return LoopResult(A, t, joint, 1.0, settled, ())
