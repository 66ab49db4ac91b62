"""The fused loop, from coarse to fine: match surfaces, weigh, solve, extrapolate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration.acceleration import Accelerator, Stall
from seismo3d.registration.fusion import Joint, Level, evaluate, fuse_features
from seismo3d.registration.projective import PixelTable
from seismo3d.registration.robust import TUKEY
from seismo3d.registration.settings import LoopSettings
from seismo3d.registration.solvers import Limits, Prior, moved_from, offsets_from, walk
from seismo3d.registration.terms import FeatureTerm
from seismo3d.registration.wide_search import WideSearch, draw, is_far


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
    levels: list[Level] = []
    result = None
    for k in range(len(target) - 1, -1, -1):
        drawn = draw(source[k].surface, settings.max_elements)
        levels.insert(0, Level(target[k], drawn, tuple(levels), None if tables is None else tables[k]))
        wide = settings.wide_search and k == len(target) - 1
        result = _run_level(levels[0], features, A, t, prior, limits, model, settings, trail, wide=wide, finest=k == 0)
        A, t = result.A, result.t
    if result is None:
        if features is None:
            raise ValueError("the loop needs surfaces or features")
        result = _run_features(features, A, t, prior, limits, model, settings)
    return result


def _run_level(
    level: Level,
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
) -> LoopResult:
    target = level.target
    base = Prior(A, t)
    memory = Accelerator(settings.acceleration)
    tolerance = (1.0 if finest else 5.0) * settings.tolerance * target.size
    stall = Stall()
    search = WideSearch(target, level.source) if wide and is_far(target, level.source, A, t) else None
    cutoff = target.size
    joint = None
    plain: tuple[Float64Array, Float64Array] | None = None
    settled = False
    for iteration in range(settings.max_iterations):
        if iteration == 12 and search is not None:
            search = joint = plain = None
        widened = search is not None
        given, radius = search.partners(A, t, iteration) if search else (None, 1.5 * target.size)
        new = evaluate(level, features, A, t, radius=radius, cutoff=cutoff, given=given, settings=settings, model=model)
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
    joint = fuse_features(features, A, t)
    for _ in range(settings.max_iterations):
        step = walk(joint.form, A, t, model=model, prior=prior, limits=limits, ratio=settings.observability)
        move = offsets_from(Prior(A, t), step.A, step.t, model)
        A, t = step.A, step.t
        joint = fuse_features(features, A, t)
        if np.abs(move).max() < settings.tolerance:
            settled = True
            break
    return LoopResult(A, t, joint, 1.0, settled, ())
