"""Where to start when the size is free: the scale that both scans' extents suggest, settled rigidly first.

Far from the answer a free scale runs away: nearest partners on a slope are nearer to a scan that shrinks onto it, or
grows past it. So the source is brought to the size of the target, aligned rigidly at that size, and only then freed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration.chance import Tried
from seismo3d.registration.constraints import Constraints
from seismo3d.registration.dense import prepare_pair
from seismo3d.registration.icp import LoopResult
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.result import SIZE_IS_FREE
from seismo3d.registration.solvers import Limits, Prior
from seismo3d.registration.stages import Task, is_sure, run, run_local, scale_of, search, surface_cost
from seismo3d.scan import Scan

NEARBY = (1.0, 0.97, 1.03)
"""Scales that are settled rigidly, over that of the extents."""
SAME_SCALE = math.log(1.1)
"""Logarithm of the ratio up to which two scales are alike."""
USUAL_RANGE = 10.0
"""Factor up to which a scale that is not bounded may leave those of the start and of the extents, either way."""
GOOD_COST = 0.2
"""Robust cost, of at most 1 and measured both ways, below which a local answer at such a scale is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class _Settled:
    """A source that was brought to a size and aligned rigidly, in a frame, and what the poses tried for it led to."""

    to_size: Float64Array
    T_target_source: Float64Array
    frame: Frame
    tried: Tried

    def stands_out(self, found: LoopResult, frame: Frame) -> bool:
        """Return whether an answer in another frame, of the source as it was, fits better than chance explains."""
        A, t = self.frame.enter(frame.leave(found.A, found.t) @ np.linalg.inv(self.to_size))
        return self.tried.stands_out(replace(found, A=A, t=t))


def led_by_extent(task: Task, found: LoopResult, stage: str) -> tuple[Task, LoopResult, str, bool]:
    """Start again from the scale of both scans' extents where that is another; keep the better of both answers.

    Extent is the median distance from the median point, which far-off points hardly move. Where the scans overlap in
    part the extents mislead, and the cost, measured both ways, keeps the answer that was found before.

    Parameters
    ----------
    task : Task
        Without matches: those tell the scale better.
    found : LoopResult
        Answer of the local stage.
    stage : str
        Its stage.

    Returns
    -------
    (Task, LoopResult, str, bool)
        The task has voxels that suit the scale, if that answer won. The last one says whether it stands out from what
        the poses that were tried at its size led to.
    """
    if task.model not in SIZE_IS_FREE or task.features is not None:
        return task, found, stage, True
    scale = scale_of_extents(task.target, task.source)
    if scale is None:
        return task, found, stage, True
    before = float(np.exp(np.log(np.maximum(scale_of(found.A), 1e-12)).mean()))
    is_near = abs(math.log(scale / before)) < SAME_SCALE
    is_good = is_sure(task, found) and surface_cost(task, found) < GOOD_COST
    if (is_near and is_good) or not _allowed(task, scale):
        return task, found, stage, True
    sized = _bring_to_size(task, scale)
    answer, settled = min(_answers_at_size(task, sized, scale), key=lambda one: surface_cost(sized, one[0]))
    other = _carried(task, sized, found.A, found.t)
    if surface_cost(sized, answer) < surface_cost(sized, replace(found, A=other.A, t=other.t)) - 1e-3:
        return sized, answer, "global", settled.stands_out(answer, sized.pair.frame)
    return task, found, stage, True


def _bring_to_size(task: Task, scale: float) -> Task:
    """Return a task whose target has voxels as fine as the source's are at its true size."""
    settings = task.settings
    pair = prepare_pair(
        task.target,
        task.source,
        voxel_size=None,
        n_threads=settings.n_threads,
        symmetric=settings.symmetric,
        target_scale=scale,
    )
    sized = replace(
        task,
        pair=pair,
        limits=task.limits.in_size(task.pair.frame.size, pair.frame.size, task.model, task.source.dim),
        settings=replace(settings, wide_search=False),
    )
    return replace(sized, prior=_carried(task, sized, task.prior.A, task.prior.t))


def _carried(task: Task, other: Task, A: Float64Array, t: Float64Array) -> Prior:
    """Return a transform of one task's frame in that of another."""
    return Prior(*other.pair.frame.enter(task.pair.frame.leave(A, t)))


def _answers_at_size(task: Task, sized: Task, scale: float) -> list[tuple[LoopResult, _Settled]]:
    """Settle the source rigidly at sizes near a scale, and free the size from there."""
    pair = sized.pair
    finest = replace(sized, pair=replace(pair, target=pair.target[:1], source=pair.source[:1]))
    turn = task.prior.A / scale_of(task.prior.A)
    target_middle, source_middle = _extent(task.target.points)[0], _extent(task.source.points)[0]
    answers = []
    for factor in NEARBY:
        to_size = np.eye(task.source.dim + 1)
        to_size[:-1, :-1] = factor * scale * turn
        to_size[:-1, -1] = target_middle - factor * scale * turn @ source_middle
        settled = _settle_rigidly(task, to_size)
        at_size = Prior(*pair.frame.enter(settled.T_target_source @ to_size))
        # on smooth ground coarse voxels lead away again, and the finest alone may not reach
        answers += [(run(sized, at_size), settled), (run(finest, at_size), settled)]
    return answers


def scale_of_extents(target: Scan, source: Scan) -> float | None:
    """Return the ratio of two scans' extents; None where one has none, as most of its points coincide."""
    extents = [_extent(scan.points)[1] for scan in (target, source)]
    return extents[0] / extents[1] if min(extents) > 0.0 else None


def usual_scale(target: Scan, source: Scan, T_start: Float64Array) -> tuple[float, float]:
    """Return the lowest and highest scale, over that of the start, where none are given.

    The size of a free source may collapse, so that it has bounds; they hold the start and what the extents suggest.
    """
    suggested = scale_of_extents(target, source) or 1.0
    ratios = suggested / scale_of(T_start[:-1, :-1])
    return min(1.0, float(ratios.min())) / USUAL_RANGE, max(1.0, float(ratios.max())) * USUAL_RANGE


def _settle_rigidly(task: Task, to_size: Float64Array) -> _Settled:
    """Align the source, brought to size, with the target rigidly."""
    d = task.source.dim
    points = task.source.points @ to_size[:d, :d].T + to_size[:d, d]
    turn = to_size[:d, :d] / scale_of(to_size[:d, :d])
    normals = None if task.source.normals is None else (task.source.normals @ turn.T).astype(np.float32)
    source = replace(task.source, points=points, normals=normals, features=None, raster=None)
    pair = prepare_pair(
        task.target,
        source,
        voxel_size=None,
        n_threads=task.settings.n_threads,
        symmetric=task.settings.symmetric,
    )
    start = Prior(*pair.frame.enter(np.eye(d + 1)))
    limits = Limits(*Constraints().limits("rigid", d, pair.frame.size))
    rigid = Task(task.target, source, pair, None, start, limits, "rigid", task.settings)
    # smooth ground overlaps itself a little aside: a good overlap does not end the search
    found, _, tried = search(rigid, run_local(rigid, start), "local")
    return _Settled(to_size, pair.frame.leave(found.A, found.t), pair.frame, tried)


def _extent(points: Float64Array) -> tuple[Float64Array, float]:
    """Return the median point, and the median distance from it."""
    middle = np.median(points, axis=0)
    return middle, float(np.median(np.linalg.norm(points - middle, axis=1)))


def _allowed(task: Task, scale: float) -> bool:
    """Return whether the bounds, which are relative to the start, admit a scale."""
    if task.model == "affine":
        return True
    n_scale = 1 if task.model == "similarity" else task.source.dim
    offset = np.log(scale / scale_of(task.prior.A)[:n_scale])
    return bool((offset >= task.limits.low[-n_scale:]).all() and (offset <= task.limits.high[-n_scale:]).all())
