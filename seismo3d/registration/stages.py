"""The stages of a registration: the local loop, what matched rasters lead to, the search over poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration.chance import Tried
from seismo3d.registration.dense import DensePair
from seismo3d.registration.feature_pairs import feature_term
from seismo3d.registration.icp import LoopResult, run_levels
from seismo3d.registration.initial import poses_by_features
from seismo3d.registration.matching import match_surface
from seismo3d.registration.projective import PixelTable
from seismo3d.registration.raster_matches import match_rasters
from seismo3d.registration.settings import LoopSettings
from seismo3d.registration.shape_matches import poses_by_shape
from seismo3d.registration.solvers import Limits, Prior
from seismo3d.registration.terms import FeatureTerm
from seismo3d.scan import Scan

AGREES = 0.15
"""Share of a voxel, along the normal, beyond which elements disagree on the levels that answers are compared on.

Many points tell where an element lies: it is some hundredths of a voxel off where an answer is right, and a fifth, in
the median, where surfaces have but been laid on each other.
"""
GOOD_OVERLAP = 0.8
"""Overlap from which the local answer is taken without a global search."""
N_POSES = 24
N_FINALISTS = 4
WIDE, NEAR = (5.0, 10.0), (4.0, 8.0)
"""Radii of the descriptors of shape, in voxels of a middle level, and of the next finer one.

The wider see through noise; but where scans overlap by half, most of what lies within them is in one scan only.
"""
LEAST_AGREEING = 4
"""Features that must agree with a pose for it to lead."""
MANY_AGREEING = 20
MOST_AGREE = 0.5
"""Number and share of features that must agree for no other start to be tried, and no search to be made."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """All that the stages share."""

    target: Scan
    source: Scan
    pair: DensePair
    features: FeatureTerm | None
    prior: Prior
    limits: Limits
    model: str
    settings: LoopSettings
    tables: list[PixelTable] | None = None


def overlap_of(found: LoopResult) -> float:
    """Return the share of source elements that lie on the target at the end of the loop."""
    surface = found.joint.surface
    if surface is None:
        return 1.0
    return float(np.count_nonzero(np.abs(surface.residuals) < found.cutoff)) / len(surface.residuals)


def is_sure(task: Task, found: LoopResult) -> bool:
    """Return whether an answer's overlap is good, or many features confirm it: nothing further is searched for then."""
    if overlap_of(found) >= GOOD_OVERLAP:
        return True
    if task.features is None:
        return False
    agree = len(task.features.agreeing(found.A, found.t, _feature_reach(task.pair)).target)
    return agree >= MANY_AGREEING and agree >= MOST_AGREE * len(task.features.target)


def run(task: Task, start: Prior) -> LoopResult:
    """Run the loop on all levels."""
    return run_levels(
        task.pair.target,
        task.pair.source,
        task.features,
        start=start,
        prior=task.prior,
        limits=task.limits,
        model=task.model,
        settings=task.settings,
        tables=task.tables,
    )


def run_local(task: Task, start: Prior) -> LoopResult:
    """Run the loop from where most features agree, if many do; else from the start too, and keep the better answer."""
    if task.features is None:
        return run(task, start)
    reach = _feature_reach(task.pair)
    led: list[LoopResult] = []
    for A, t in poses_by_features(task.features, n_poses=4, reach=reach):
        agree = task.features.agreeing(A, t, 2.0 * reach)
        share = len(agree.target) / len(task.features.target)
        if len(agree.target) < LEAST_AGREEING:
            continue
        with_these = replace(task, features=agree, settings=replace(task.settings, wide_search=False))
        led.append(run(with_these, _start_at(task, A, t)))
        if len(agree.target) >= MANY_AGREEING and share >= MOST_AGREE:
            return led[-1]
    return min([*led, run(task, start)], key=lambda found: joint_cost(task, found))


def _start_at(task: Task, A: Float64Array, t: Float64Array) -> Prior:
    """Return the start that a rigid pose leads to: of the task's own size, and turned only if the model may turn."""
    return Prior(task.prior.A if task.model == "translation" else A * scale_of(task.prior.A), t)


def _feature_reach(pair: DensePair) -> float:
    """Return the distance in the frame up to which a feature agrees with a pose."""
    return max(0.05, 1.5 * pair.target[0].size)


def joint_cost(task: Task, found: LoopResult, level: int | None = None) -> float:
    """Return the surfaces' robust cost, plus the share of features that disagree, plus what is missing of many.

    A handful of features agrees with any pose by chance, many do not: where most matches are wrong, the share alone
    would leave the choice to surfaces that fit as well upside down. Costs are those on a middle level where none is
    given.
    """
    cost = _cost(task, found, middle_level(task.pair) if level is None else level)
    if task.features is None:
        return cost
    n_all = len(task.features.target)
    n_agree = len(task.features.agreeing(found.A, found.t, _feature_reach(task.pair)).target)
    return cost + 1.0 - n_agree / n_all + 1.0 - min(1.0, n_agree / min(MANY_AGREEING, n_all))


def led_by_rasters(task: Task, first: Prior, found: LoopResult, stage: str) -> tuple[Task, LoopResult, str]:
    """Match the grids that the scans were made from, where no matches were given; keep them where they lead further."""
    matches = match_rasters(task.target, task.source) if task.features is None else None
    if matches is None or len(matches) < LEAST_AGREEING:
        return task, found, stage
    floor = 0.05 * task.pair.voxel_size
    led = replace(task, features=feature_term(matches, task.target, task.source, task.pair.frame, floor))
    if led.features is None:
        return task, found, stage
    answer = run_local(led, first)
    if joint_cost(led, answer) < joint_cost(led, found) - 1e-3:
        return led, answer, "global"
    return task, found, stage


def search(task: Task, found: LoopResult, stage: str) -> tuple[LoopResult, str, Tried]:
    """Try poses from shape, wide and then near; keep the answer with the lowest cost on a middle level.

    Returns
    -------
    (LoopResult, str, Tried)
        Answer, its stage, and what all poses led to on a coarser level.
    """
    pair = task.pair
    level = middle_level(pair)
    rough = min(level + 1, len(pair.target) - 1)
    best, best_cost = found, joint_cost(task, found)
    ends: list[LoopResult] = []
    for described, radii in ((level, WIDE), (max(level - 1, 0), NEAR)):
        poses = poses_by_shape(pair.target[described], pair.source[described], radii=radii, n_poses=N_POSES)
        trials = [run_on(task, _start_at(task, A, t), rough, rough, max_iterations=12) for A, t in poses]
        ends += trials
        ranked = sorted((joint_cost(task, trial, rough), k) for k, trial in enumerate(trials))
        for _, k in ranked[:N_FINALISTS]:
            finished = run_on(task, Prior(trials[k].A, trials[k].t), rough, 0)
            cost = joint_cost(task, finished)
            if cost < best_cost - 1e-3:
                best, best_cost, stage = finished, cost, "global"
        if is_sure(task, best):
            break
    tried = Tried(
        pair.source[rough].surface, pair.target[rough].size, partial(joint_cost, task, level=rough), tuple(ends)
    )
    return best, stage, tried


def run_on(task: Task, start: Prior, coarsest: int, finest: int, *, max_iterations: int | None = None) -> LoopResult:
    """Run the loop on some levels, with partners nearby from the first."""
    settings = replace(task.settings, wide_search=False)
    if max_iterations is not None:
        settings = replace(settings, max_iterations=max_iterations)
    return run_levels(
        task.pair.target[finest : coarsest + 1],
        task.pair.source[finest : coarsest + 1],
        task.features,
        start=start,
        prior=task.prior,
        limits=task.limits,
        model=task.model,
        settings=settings,
    )


def scale_of(A: Float64Array) -> Float64Array:
    """Return the lengths of the columns."""
    return np.asarray(np.linalg.norm(A, axis=0))


def middle_level(pair: DensePair) -> int:
    """Return the finest level with at most 2500 elements in the larger scan."""
    for level, (q, p) in enumerate(zip(pair.target, pair.source)):
        if max(len(q.surface), len(p.surface)) <= 2500:
            return level
    return len(pair.target) - 1


def surface_cost(task: Task, found: LoopResult) -> float:
    """Return the robust cost of an answer on a middle level, by the same measure for all answers of a task."""
    return _cost(task, found, middle_level(task.pair))


def _cost(task: Task, found: LoopResult, level: int) -> float:
    """Return the robust cost of an answer on a level: of the scan that fits better, of both where the size is free.

    A part fits into the whole, and its size says which of both it is; a source of free size could shrink onto anything.
    """
    target = task.pair.target[level]
    both = []
    for q, p, A, t in (
        (target, task.pair.source[level], found.A, found.t),
        (task.pair.source[level], target, *inverse(found.A, found.t)),
    ):
        seen = match_surface(
            p.surface, q, A, t, radius=q.size, cutoff=AGREES * q.size, n_threads=task.settings.n_threads
        )
        both.append(seen.cost)
    return min(both) if task.model in ("rigid", "translation") else 0.5 * sum(both)


def inverse(A: Float64Array, t: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the transform back."""
    back = np.linalg.inv(A)
    return np.ascontiguousarray(back), -back @ t
