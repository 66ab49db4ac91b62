"""The fused loop, from coarse to fine: match surfaces, weigh, solve, extrapolate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import ParameterError
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration.acceleration import Accelerator, Stall
from seismo3d.registration.fusion import Joint, Level, evaluate, fuse_features
from seismo3d.registration.matching import Memory, match_surface
from seismo3d.registration.projective import PixelTable
from seismo3d.registration.robust import TUKEY
from seismo3d.registration.settings import LoopSettings
from seismo3d.registration.solvers import Limits, Prior, moved_from, offsets_from, walk
from seismo3d.registration.terms import FeatureTerm, weigh_features
from seismo3d.registration.wide_search import WideSearch, draw, is_far, is_loose


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
    trail: _Trail = []
    levels: list[Level] = []
    result = None
    for k in range(len(target) - 1, -1, -1):
        drawn = draw(source[k].surface, settings.max_elements)
        levels.insert(0, Level(target[k], drawn, tuple(levels), None if tables is None else tables[k]))
        job = _LevelJob(levels[0], features, prior, limits, model, settings, finest=k == 0)
        wide = settings.wide_search and k == len(target) - 1
        result = _run_coarsest(job, A, t, trail) if wide else _run_level(job, A, t, trail)
        A, t = result.A, result.t
    if result is None:
        if features is None:
            raise ParameterError("the loop is given neither surfaces nor features; expected one of them.")
        result = _run_features(features, A, t, prior, limits, model, settings)
    return result


@dataclass(frozen=True, slots=True, eq=False)
class _LevelJob:
    """What the loop needs to know on one level."""

    level: Level
    features: FeatureTerm | None
    prior: Prior
    limits: Limits
    model: str
    settings: LoopSettings
    finest: bool


_Trail = list[tuple[float, Float64Array, Float64Array]]


def _run_coarsest(job: _LevelJob, A: Float64Array, t: Float64Array, trail: _Trail) -> LoopResult:
    """Run the coarsest level, with partners at any distance where the start is far.

    Where the answer lies near but for some direction along which it has found no hold, look for one at any distance
    too, and keep the answer that fits better.
    """
    target, source = job.level.target, job.level.source
    threads = job.settings.n_threads
    far = is_far(target, source, A, t)
    search = WideSearch(target, source, keeps_all=False, n_threads=threads) if far else None
    found = _run_level(job, A, t, trail, search=search)
    if found.joint.surface is None or not is_loose(found.joint.surface, source, target.size):
        return found
    widely: _Trail = []
    search = WideSearch(target, source, keeps_all=True, n_threads=threads)
    other = _run_level(job, found.A, found.t, widely, search=search)
    if _misfit(job, other) < _misfit(job, found):
        trail += widely
        return other
    return found


def _misfit(job: _LevelJob, found: LoopResult) -> float:
    """Return the robust cost of an answer by one measure for all, plus the share of features that disagree."""
    target = job.level.target
    seen = match_surface(job.level.source, target, found.A, found.t, radius=target.size, cutoff=0.5 * target.size)
    if job.features is None:
        return seen.cost
    return seen.cost + 1.0 - weigh_features(job.features, found.A, found.t).weight / len(job.features.target)


def _run_level(
    job: _LevelJob, A: Float64Array, t: Float64Array, trail: _Trail, *, search: WideSearch | None = None
) -> LoopResult:
    level, features, settings, model = job.level, job.features, job.settings, job.model
    target = level.target
    base = Prior(A, t)
    accelerator = Accelerator(settings.acceleration)
    memory = Memory.of(len(level.source))
    tolerance = (1.0 if job.finest else 5.0) * settings.tolerance * target.size
    stall = Stall()
    cutoff = target.size
    joint = None
    plain: tuple[Float64Array, Float64Array] | None = None
    settled = False
    for iteration in range(settings.max_iterations):
        if iteration == 12 and search is not None:
            search = joint = plain = None
        widened = search is not None
        given, radius = search.partners(A, t, iteration) if search else (None, 1.5 * target.size)
        keeps_all = search is not None and search.keeps_all
        if keeps_all:
            cutoff = radius
            accelerator.forget()
        new = evaluate(
            level,
            features,
            A,
            t,
            radius=radius,
            cutoff=cutoff,
            given=given,
            settings=settings,
            model=model,
            memory=memory,
        )
        if plain is not None and joint is not None and new.cost > 1.0005 * joint.cost + 1e-9:
            A, t = plain  # the extrapolation went uphill: take the plain step instead
            plain = None
            accelerator.forget()
            continue
        joint = new
        surface = joint.surface
        if surface is not None:
            trail.append((surface.mean_square, A, t))
            fresh = max(TUKEY * surface.spread, 0.05 * target.size, 1e-7)
            if not keeps_all and not 0.8 < fresh / cutoff < 1.25:
                cutoff = min(fresh, 2.0 * target.size)
                accelerator.forget()
        step = walk(joint.form, A, t, model=model, prior=job.prior, limits=job.limits, ratio=joint.ratio)
        move = offsets_from(Prior(A, t), step.A, step.t, model)
        if np.abs(move).max() < (tolerance if not widened else 4 * tolerance) or stall.reached(joint.cost, cutoff):
            A, t = step.A, step.t
            if search is None:
                settled = True
                break
            search = None
            accelerator.forget()
            joint = plain = None
            continue
        before = offsets_from(base, A, t, model)
        after = offsets_from(base, step.A, step.t, model)
        mixed = accelerator.extrapolate(before, after)
        plain = None
        A, t = step.A, step.t
        if mixed is not None and not job.limits.bind_motion:
            plain = (A, t)
            A, t = moved_from(base, mixed, model)
    if joint is None:
        raise ParameterError(f"max_iterations is {job.settings.max_iterations}; expected 1 or more passes a level.")
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
