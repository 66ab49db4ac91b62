"""Answers elsewhere that explain nearly as much as the best one: which is right the scans do not tell.

Parts of a box or of a bare room fit each other at several places. So nearly does much that is not symmetric: a room
with furniture fits itself turned about by its walls, floor and ceiling, and ground with rocks on it, moved along, by
the ground. Two things tell such places from the right one. What lies on itself at both places tells neither, so that
both are compared by what moves along its normals between them. And what lies amid the other scan without a partner
denies a place: the other scan would have shown it, while what lies beside it may just not have been seen.

A start that is given says which place is meant, where one lies much nearer to it than the others do. Scans that share a
part fit there by that part alone, and less than where they lie folded onto each other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration.chance import Tried, apart
from seismo3d.registration.icp import LoopResult
from seismo3d.registration.matching import match_surface
from seismo3d.registration.solvers import Prior
from seismo3d.registration.stages import AGREES, Task, inverse, joint_cost, middle_level, overlap_of, run_on

RIVALS = 0.7
"""Share of what an answer explains, by cost and by overlap, from which one elsewhere leaves open which is right.

On scans of real and of made-up irregular places none that is not denied explains more than 0.61.
"""
TELLING = 0.6
"""The same share, of what moves along its normals between both."""
MOST_DENIED = 0.03
"""Share of both scans by which more may lie amid the other one without a partner than does with the best answer."""
AMID = 1.5
"""Depth in the other scan's convex hull, in voxels, from which an element lies amid it: walls are its border."""
MOST_RIVALS = 4
"""Answers elsewhere that are finished and looked at, best first."""
FITS_AS_WELL, LEAST_SHARED = 0.8, 0.15
"""Share of how well the best answer fits where the scans overlap, and overlap, from which what a start led to may be
meant.
"""
MUCH_NEARER = 0.5
"""Share of the distance from a start to all other answers within which the one that is meant lies."""


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One scan's elements on a level, with their weights, the hull of what the scan shows, and its voxels."""

    elements: VoxelMap
    weights: Float64Array
    hull: Float64Array | None

    @classmethod
    def of(cls, elements: VoxelMap) -> Side:
        """Return a side of elements whose normals have been asked for."""
        quality = np.maximum(elements.surface[:, 3], 0.0).astype(np.float64)
        weights = quality * elements.surface[:, 7]
        return cls(elements, weights / max(float(weights.sum()), 1e-300), _hull(elements, quality > 0.0))


def settle(
    task: Task, found: LoopResult, tried: Tried, local: LoopResult, start: Prior | None
) -> tuple[LoopResult, bool]:
    """Return the answer of a search, and whether it is alone: a start that was given says which of several is meant."""
    sides = _sides(task)
    rivals = rivals_of(task, sides, found, tried)
    if start is None:
        return found, not rivals
    answers = [found, *rivals]
    if local is not found and _fits_as_well(task, sides, local, found):
        answers = [one for one in answers if apart(tried.source, local, one) > tried.reach] + [local]
    if len(answers) == 1:
        return answers[0], True
    meant = meant_by_start(task, start, answers)
    return (found, not rivals) if meant is None else (meant, True)


def rivals_of(task: Task, sides: tuple[Side, Side], found: LoopResult, tried: Tried) -> list[LoopResult]:
    """Return the answers elsewhere that explain nearly as much of the scans as the best one, and are not denied.

    Parameters
    ----------
    task : Task
    sides : (Side, Side)
        Target and source.
    found : LoopResult
        The best answer.
    tried : Tried
        What all poses led to.
    """
    explained, overlap = 1.0 - joint_cost(task, found), overlap_of(found)
    denied = _denied(task, sides, found)
    return [
        other
        for other in _others(task, found, tried)
        if 1.0 - joint_cost(task, other) >= RIVALS * explained
        and overlap_of(other) >= RIVALS * overlap
        and _telling_share(task, sides, found, other) >= TELLING
        and _denied(task, sides, other) <= denied + MOST_DENIED
    ]


def meant_by_start(task: Task, start: Prior, answers: list[LoopResult]) -> LoopResult | None:
    """Return the answer that is much nearer to a start than all others are; None where none is."""
    points = task.pair.source[middle_level(task.pair)].surface[:, : start.t.size].astype(np.float64)
    ways = [points @ (one.A - start.A).T + (one.t - start.t) for one in answers]
    distances = np.array([np.sqrt((way**2).sum(axis=1).mean()) for way in ways])
    first, second = np.argsort(distances)[:2]
    return answers[first] if distances[first] < MUCH_NEARER * distances[second] else None


def _sides(task: Task) -> tuple[Side, Side]:
    level = middle_level(task.pair)
    return Side.of(task.pair.target[level]), Side.of(task.pair.source[level])


def _fits_as_well(task: Task, sides: tuple[Side, Side], local: LoopResult, found: LoopResult) -> bool:
    """Return whether an answer fits where the scans overlap as well as the best one does, and is not denied."""
    if overlap_of(local) < LEAST_SHARED:
        return False
    fits = [_fit(task, sides, one) for one in (local, found)]
    if fits[0] < FITS_AS_WELL * fits[1]:
        return False
    return _denied(task, sides, local) <= _denied(task, sides, found) + MOST_DENIED


def _fit(task: Task, sides: tuple[Side, Side], found: LoopResult) -> float:
    """Return how well those elements of both scans are explained that have a partner."""
    explained = matched = 0.0
    for own, there, ((A, t), _) in _both_ways(sides, found, found):
        shares, lone = _explained(task, own, there, A, t)
        explained += float(own.weights @ shares)
        matched += float(own.weights[~lone].sum())
    return explained / max(matched, 1e-300)


def _others(task: Task, found: LoopResult, tried: Tried) -> Iterator[LoopResult]:
    """Yield the answers elsewhere that may be rivals, finished, each place once."""
    rough = min(middle_level(task.pair) + 1, len(task.pair.target) - 1)
    places = [found]

    def is_new(one: LoopResult) -> bool:
        return all(apart(tried.source, place, one) > tried.reach for place in places)

    least = 1.0 - RIVALS * (1.0 - tried.cost_of(found))
    n_finished = 0
    for cost, one in tried.elsewhere(found):
        if cost > least or n_finished == MOST_RIVALS:
            return
        if not is_new(one):
            continue
        n_finished += 1
        finished = run_on(task, Prior(one.A, one.t), rough, 0)
        is_another = is_new(finished)
        places += [one, finished]
        if is_another:
            yield finished


def _telling_share(task: Task, sides: tuple[Side, Side], found: LoopResult, other: LoopResult) -> float:
    """Return how much another answer explains of what the best one does, of what moves along its normals between."""
    explained = np.zeros(2)
    for own, there, ways in _both_ways(sides, found, other):
        d = ways[0][1].size
        points, normals = own.elements.surface[:, :d].astype(np.float64), own.elements.surface[:, 4 : 4 + d]
        way = points @ (ways[1][0] - ways[0][0]).T + (ways[1][1] - ways[0][1])
        offsets = [np.abs((way * _unit(normals @ A.T)).sum(axis=1)) for A, _ in ways]
        weights = np.where(np.minimum(*offsets) > there.elements.size, own.weights, 0.0)
        explained += [float(weights @ _explained(task, own, there, A, t)[0]) for A, t in ways]
    return float(explained[1] / max(explained[0], 1e-300))


def _explained(task: Task, own: Side, there: Side, A: Float64Array, t: Float64Array) -> tuple[Float64Array, BoolArray]:
    """Return how well each element is explained, one less its robust cost, and which have no partner."""
    size = there.elements.size
    seen = match_surface(
        own.elements.surface, there.elements, A, t,
        radius=size, cutoff=AGREES * size, n_threads=task.settings.n_threads,
    )  # fmt: skip
    shares = np.nan_to_num(np.abs(seen.residuals.astype(np.float64)) / (AGREES * size), nan=1.0)
    return np.maximum(0.0, 1.0 - shares**2) ** 3, np.isnan(seen.residuals)


def _denied(task: Task, sides: tuple[Side, Side], found: LoopResult) -> float:
    """Return the share of both scans that lies amid the other one without a partner."""
    denied = 0.0
    for own, there, ((A, t), _) in _both_ways(sides, found, found):
        points = own.elements.surface[:, : t.size].astype(np.float64) @ A.T + t
        lone = _explained(task, own, there, A, t)[1]
        denied += float(own.weights[lone & _is_amid(points, there.hull, AMID * there.elements.size)].sum())
    return denied


_Way = tuple[Float64Array, Float64Array]


def _both_ways(
    sides: tuple[Side, Side], one: LoopResult, two: LoopResult
) -> Iterator[tuple[Side, Side, tuple[_Way, _Way]]]:
    """Yield each scan, the other, and what brings it there by two answers."""
    yield sides[1], sides[0], ((one.A, one.t), (two.A, two.t))
    yield sides[0], sides[1], (inverse(one.A, one.t), inverse(two.A, two.t))


def _hull(elements: VoxelMap, known: BoolArray) -> Float64Array | None:
    """Return the facets (normal outwards, offset) of the convex hull; None where the elements span none."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull: Any = ConvexHull(elements.surface[known, : elements.dim].astype(np.float64))
    except (QhullError, ValueError):
        return None
    return np.asarray(hull.equations)


def _is_amid(points: Float64Array, hull: Float64Array | None, depth: float) -> BoolArray:
    """Return which points lie a depth inside a convex hull."""
    if hull is None:
        return np.zeros(len(points), dtype=np.bool_)
    return np.asarray((points @ hull[:, :-1].T + hull[:, -1]).max(axis=1) < -depth)


def _unit(vectors: Float64Array) -> Float64Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
