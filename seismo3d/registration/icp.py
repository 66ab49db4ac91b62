"""The fused loop, from coarse to fine: match surfaces, weigh, solve, extrapolate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration._kernels_newton import weakest_share
from seismo3d.registration.acceleration import Accelerator, Stall
from seismo3d.registration.constraints import model_number
from seismo3d.registration.fusion import MOST_FEIGNED, Joint, feigned, fuse, seen_part
from seismo3d.registration.matching import NONE_GIVEN, match_surface
from seismo3d.registration.projective import PixelTable
from seismo3d.registration.robust import TUKEY
from seismo3d.registration.solvers import Limits, Prior, moved_from, offsets_from, walk
from seismo3d.registration.terms import FeatureTerm, weigh_features
from seismo3d.registration.wide_search import WideSearch, draw, is_far

LEAST_RATIO = 1e-7


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
    observability: float = 1e-3
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
    result = None
    for level in range(len(target) - 1, -1, -1):
        coarsest = level == len(target) - 1
        result = _run_level(
            target[level], source[level], features, A, t, prior, limits, model, settings, trail,
            wide=coarsest and settings.wide_search, finest=level == 0,
            table=None if tables is None else tables[level],
        )  # fmt: skip
        A, t = result.A, result.t
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
        new = _evaluate(target, drawn, features, A, t, radius, cutoff, given, settings, model)
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
    ratio = settings.observability
    weak = surface.weight > 0.0 and weakest_share(surface.form, A, model_number(model)) < MOST_FEIGNED
    if weak and surface.matched > 0.6 and np.nanmedian(surface.distances2) < (0.7 * target.size) ** 2:
        ratio = max(ratio, feigned(surface, source, A))
    if weak and seen is not None and settings.alpha is None:
        surface = replace(surface, form=seen_part(surface.form, A, t, model, ratio))
        ratio = 0.0
    return replace(fuse(surface, seen, settings.alpha, target.size), ratio=max(ratio, LEAST_RATIO))


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
