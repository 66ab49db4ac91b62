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
from seismo3d.registration.solvers import Limits, Prior, Solution, moved_from, offsets_from, walk
from seismo3d.registration.terms import FeatureTerm, weigh_features
from seismo3d.registration.wide_search import WideSearch, draw, is_far, is_loose

_WIDE_PASSES = 12
"""Passes after which partners are searched for nearby, wherever the search at any distance has led."""


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
    loop = _LevelLoop(job, A, t, trail, search)
    settled = False
    for iteration in range(job.settings.max_iterations):
        settled = loop.ends(iteration)
        if settled:
            break
    if loop.joint is None:
        raise ParameterError(f"max_iterations is {job.settings.max_iterations}; expected 1 or more passes a level.")
    energies, path = tuple(e for e, _, _ in trail), tuple((B, u) for _, B, u in trail)
    return LoopResult(loop.A, loop.t, loop.joint, loop.cutoff, settled, energies, path)


class _LevelLoop:
    """The passes over one level, and what they hand on to each other.

    Attributes
    ----------
    A, t : ndarray
        Where the next pass is made.
    joint : Joint or None
        The last pass that was not taken back.
    cutoff : float
        Residual along the normal at which weights reach zero.
    """

    def __init__(
        self, job: _LevelJob, A: Float64Array, t: Float64Array, trail: _Trail, search: WideSearch | None
    ) -> None:
        self.A, self.t = A, t
        self.joint: Joint | None = None
        self.cutoff = job.level.target.size
        self._job, self._trail, self._search = job, trail, search
        self._base = Prior(A, t)
        self._accelerator = Accelerator(job.settings.acceleration)
        self._memory = Memory.of(len(job.level.source))
        self._stall = Stall()
        self._cost = np.inf
        # where the last step alone would have led, if it was extrapolated
        self._plain: tuple[Float64Array, Float64Array] | None = None

    def ends(self, iteration: int) -> bool:
        """Make a pass and the step after it; return whether it was the last one."""
        job = self._job
        if iteration == _WIDE_PASSES:
            self._search_near()
        seen = self._look(iteration)
        if self._plain is not None and seen.cost > 1.0005 * self._cost + 1e-9:
            self.A, self.t = self._plain  # the extrapolation went uphill: take the plain step instead
            self._plain = None
            self._accelerator.forget()
            return False
        self.joint, self._cost = seen, seen.cost
        if seen.surface is not None:
            self._trail.append((seen.surface.mean_square, self.A, self.t))
            self._follow_spread(seen.surface.spread)
        step = walk(seen.form, self.A, self.t, model=job.model, prior=job.prior, limits=job.limits, ratio=seen.ratio)
        if self._is_still(step):
            self.A, self.t = step.A, step.t
            if self._search is None:
                return True
            self._search_near()
            self._accelerator.forget()
            return False
        self._advance(step)
        return False

    def _search_near(self) -> None:
        """Search for partners nearby from now on, if they were searched for at any distance."""
        if self._search is not None:
            self._search = self._plain = None

    def _look(self, iteration: int) -> Joint:
        given, radius = None, 1.5 * self._job.level.target.size
        if self._search is not None:
            given, radius = self._search.partners(self.A, self.t, iteration)
            if self._search.keeps_all:
                self.cutoff = radius
                self._accelerator.forget()
        return evaluate(
            self._job.level,
            self._job.features,
            self.A,
            self.t,
            radius=radius,
            cutoff=self.cutoff,
            given=given,
            settings=self._job.settings,
            model=self._job.model,
            memory=self._memory,
        )

    def _follow_spread(self, spread: float) -> None:
        """Let the cutoff follow the spread of the residuals, in steps."""
        size = self._job.level.target.size
        fresh = max(TUKEY * spread, 0.05 * size, 1e-7)
        keeps_all = self._search is not None and self._search.keeps_all
        if not keeps_all and not 0.8 < fresh / self.cutoff < 1.25:
            self.cutoff = min(fresh, 2.0 * size)
            self._accelerator.forget()

    def _is_still(self, step: Solution) -> bool:
        """Return whether a step hardly moves, or passes no longer lower the cost."""
        job = self._job
        tolerance = (1.0 if job.finest else 5.0) * job.settings.tolerance * job.level.target.size
        if self._search is not None:
            tolerance *= 4
        move = offsets_from(Prior(self.A, self.t), step.A, step.t, job.model)
        return bool(np.abs(move).max() < tolerance) or self._stall.reached(self._cost, self.cutoff)

    def _advance(self, step: Solution) -> None:
        """Take a step, or go where the last steps together lead."""
        model = self._job.model
        before = offsets_from(self._base, self.A, self.t, model)
        mixed = self._accelerator.extrapolate(before, offsets_from(self._base, step.A, step.t, model))
        self._plain = None
        self.A, self.t = step.A, step.t
        if mixed is not None and not self._job.limits.bind_motion:
            self._plain = (step.A, step.t)
            self.A, self.t = moved_from(self._base, mixed, model)


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
