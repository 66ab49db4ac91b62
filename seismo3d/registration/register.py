"""Align any two scans: the local loop first, a global search where it fails, one result with its uncertainty."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import ArrayLike, BoolArray, Float64Array
from seismo3d._validate import as_number, freeze
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.registration import quadratic
from seismo3d.registration.align import as_transform
from seismo3d.registration.certificate import Certificate
from seismo3d.registration.constraints import Constraints, model_number
from seismo3d.registration.dense import DensePair, prepare_pair
from seismo3d.registration.feature_pairs import feature_term
from seismo3d.registration.icp import LoopResult, LoopSettings, draw, run_levels
from seismo3d.registration.initial import poses_by_features
from seismo3d.registration.matching import match_surface, surface_meat
from seismo3d.registration.observability import assess
from seismo3d.registration.polish import polish
from seismo3d.registration.projective import PixelTable, pixel_tables
from seismo3d.registration.raster_matches import match_rasters
from seismo3d.registration.result import Registration
from seismo3d.registration.sensitivity import rematched_form
from seismo3d.registration.shape_matches import poses_by_shape
from seismo3d.registration.solvers import Limits, Prior, solve_form
from seismo3d.registration.terms import FeatureTerm
from seismo3d.scan import Scan, as_scan

CORRESPONDENCES = ("nearest", "projective")
STAGES = ("local", "global", "polish")
LEAST_POINTS = 10
GOOD_OVERLAP = 0.8
"""Overlap from which the local answer is taken without a global search."""
LEAST_OVERLAP = 0.15
"""Overlap below which an answer is a poor fit."""
N_POSES = 24
N_PROBES = 500
N_FINALISTS = 4
LEAST_AGREEING = 6
"""Features that must agree with a pose for it to lead."""
MANY_AGREEING = 20
MOST_AGREE = 0.5
"""Number and share of features that must agree for no other start to be tried."""


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
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


def register(
    target: Scan | ArrayLike | str | Path,
    source: Scan | ArrayLike | str | Path,
    *,
    model: str = "rigid",
    start: ArrayLike | None = None,
    stages: tuple[str, ...] = STAGES,
    matches: Any = None,
    alpha: float | None = None,
    voxel_size: float | None = None,
    constraints: Constraints | None = None,
    settings: LoopSettings | None = None,
    correspondences: str = "nearest",
    n_threads: int | None = None,
) -> Registration:
    r"""Align two scans: find the transform that carries the source onto the target.

    Works in stages. ``local``: the fused loop from the start, coarse to fine, on voxel maps of both scans: nearest
    surface elements, robust weights, the exact solve of the joint error of Eq. (16) of [1]_, Anderson acceleration.
    ``global``, only where the local answer's overlap is not good: poses from matched features, those of
    :func:`seismo3d.match` on the scans' images or volumes where none are given, and from local shape, run through the
    same loop; the best of all answers wins. ``polish``, only where both scans hold the same samples: exact pairs of
    points.

    Parameters
    ----------
    target, source : Scan, array_like, str or Path
        Scans, or what a scan is made from: points (n, 2) or (n, 3), an image, a volume, a point file.
    model : {"rigid", "translation", "similarity", "scaled", "affine"}
        Class of the transform.
    start : array_like of shape (d+1, d+1), optional
        Homogeneous matrix ``T_target_source`` to start from. Default: the identity.
    stages : tuple of str
        Which stages may run.
    matches : (points_target, points_source) or object with these, optional
        Matched features: in the scans' frames, or pixels (column, row) on the images of RGB-D scans. They join the
        loop, and the global stage starts from them.
    alpha : float, optional
        Fixed share of the features in the joint error, 0 to 1. None weighs both terms by their measured variances.
    voxel_size : float, optional
        Edge of the finest voxels, in the scans' units. Default: a fiftieth of the source's root mean square radius,
        larger where points are few.
    constraints : Constraints, optional
        Degrees of freedom that are fixed or bounded, relative to the start.
    settings : LoopSettings, optional
        Settings of the loop; ``alpha`` and ``n_threads`` given here win.
    correspondences : {"nearest", "projective"}
        Partners of the local loop: the nearest surface elements, or what the target's pixels show where the source
        projects to. The latter needs a target from :meth:`Scan.from_rgbd` and a start within a few pixels' reach.
    n_threads : int, optional
        Default: all cores, at most 8. The result does not depend on it.

    Returns
    -------
    Registration
        Not converging, no overlap and a poor fit are states of the result, not errors.

    Raises
    ------
    ShapeError
        If an input has a wrong shape, is empty or holds points that are not finite, or the scans differ in dimension.
    GeometryError
        If a scan has fewer than 10 points, or all its points lie on one line.
    ParameterError
        If a setting has no meaning.

    References
    ----------
    .. [1] The fused registration of features and dense depth that this package implements, Eq. (9)-(16).

    Examples
    --------
    >>> import numpy as np
    >>> from seismo3d.geometry.rotations import make_transform, exp_rotation, transform_points
    >>> rng = np.random.default_rng(0)
    >>> u, v = rng.uniform(-1, 1, size=(2, 4000))
    >>> hill = np.column_stack([u, v, 0.3 * np.sin(4 * u) * np.cos(3 * v)])
    >>> T = make_transform(exp_rotation([0.0, 0.1, 0.2]), [0.1, 0.0, 0.05])
    >>> found = register(transform_points(T, hill), hill)
    >>> found.converged, bool(np.abs(found.T_target_source - T).max() < 1e-6)
    (True, True)
    """
    task, first = _prepare(
        target, source, model, start, stages, matches, alpha, voxel_size, constraints, settings, n_threads
    )
    task = replace(task, tables=_tables(task, correspondences))
    found, stage = _run_local(task, first), "local"
    if "global" in stages and (overlap_of(found) < GOOD_OVERLAP or "local" not in stages):
        task, found, stage = _led_by_rasters(task, first, found, stage)
        if overlap_of(found) < GOOD_OVERLAP or stage == "local":
            found, stage = _search(task, found, stage)
    if "polish" in stages:
        polished = polish(
            task.target.points, task.source.points, task.pair.frame, found, task.model, task.prior, task.limits
        )
        if polished is not None:
            return _assemble(task, replace(found, A=polished[0], t=polished[1]), stage)
    return _assemble(task, found, stage)


def overlap_of(found: LoopResult) -> float:
    """Return the share of source elements that lie on the target at the end of the loop."""
    surface = found.joint.surface
    if surface is None:
        return 1.0
    return float(np.count_nonzero(np.abs(surface.residuals) < found.cutoff)) / len(surface.residuals)


def _prepare(
    target: Scan | ArrayLike | str | Path,
    source: Scan | ArrayLike | str | Path,
    model: str,
    start: ArrayLike | None,
    stages: tuple[str, ...],
    matches: Any,
    alpha: float | None,
    voxel_size: float | None,
    constraints: Constraints | None,
    settings: LoopSettings | None,
    n_threads: int | None,
) -> tuple[_Task, Prior]:
    """Check all inputs and bring both scans into one frame."""
    model_number(model)
    _check_stages(stages)
    q, p = as_scan(target, "target"), as_scan(source, "source")
    if q.dim != p.dim:
        raise ShapeError(f"target has {q.dim} dimensions and source {p.dim}; expected the same.")
    d = p.dim
    if alpha is not None:
        as_number(alpha, "alpha", low=0.0, high=1.0)
        if matches is None:
            raise ParameterError("alpha is given without matches; expected both. Drop alpha, or pass matches.")
    edge = None if voxel_size is None else as_number(voxel_size, "voxel_size", low=0.0, strict=True)
    chosen = settings or LoopSettings()
    threads = chosen.n_threads if n_threads is None and settings is not None else _threads(n_threads)
    chosen = replace(chosen, alpha=chosen.alpha if alpha is None else alpha, n_threads=threads)
    for scan, name in ((q, "target"), (p, "source")):
        if len(scan) < LEAST_POINTS:
            raise GeometryError(
                f"{name} has {len(scan)} points; expected at least {LEAST_POINTS}. Use align_pairs for pairs."
            )
    pair = prepare_pair(
        q,
        p,
        voxel_size=edge,
        n_threads=threads,
        symmetric=chosen.symmetric,
    )
    _check_spread(pair, d)
    features = None
    if matches is not None:
        features = feature_term(matches, q, p, pair.frame, 0.05 * pair.voxel_size)
    T = np.eye(d + 1) if start is None else as_transform(start, "start", d)
    prior = Prior(*pair.frame.enter(T))
    limits = Limits(*(constraints or Constraints()).limits(model, d, pair.frame.size))
    return _Task(q, p, pair, features, prior, limits, model, chosen), prior


def _check_stages(stages: tuple[str, ...]) -> None:
    unknown = [stage for stage in stages if stage not in STAGES]
    if isinstance(stages, str) or unknown or not {"local", "global"} & set(stages):
        raise ParameterError(
            f"stages is {stages!r}; expected a tuple of {', '.join(STAGES)}, with local or global in it."
        )


def _threads(n_threads: int | None) -> int:
    if n_threads is None:
        return min(os.cpu_count() or 1, 8)
    return int(as_number(n_threads, "n_threads", low=1, high=256))


def _check_spread(pair: DensePair, d: int) -> None:
    """Refuse scans in space whose points lie on one line."""
    for levels, name in ((pair.target, "target"), (pair.source, "source")):
        if d == 2:
            continue
        points = levels[-1].surface[:, :3].astype(np.float64)
        points -= points.mean(axis=0)
        squares = np.linalg.eigvalsh(points.T @ points)
        if squares[1] < 1e-10 * squares[2]:
            raise GeometryError(
                f"{name}'s points lie on one line; expected a surface. Use align_pairs with given pairs."
            )


def _run(task: _Task, start: Prior) -> LoopResult:
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


def _tables(task: _Task, correspondences: str) -> list[PixelTable] | None:
    """Return what the target's pixels show, by level, where partners are to come from them."""
    if correspondences not in CORRESPONDENCES:
        raise ParameterError(f"correspondences is {correspondences!r}; expected one of {', '.join(CORRESPONDENCES)}.")
    if correspondences == "nearest":
        return None
    raster = task.target.raster
    tables = None if raster is None else pixel_tables(raster, task.pair.frame, task.pair.target)
    if tables is None:
        raise ParameterError(
            "correspondences is 'projective' and target is no depth image of a camera; expected a scan of "
            "Scan.from_rgbd. Make the target so, or use 'nearest'."
        )
    return tables


def _run_local(task: _Task, start: Prior) -> LoopResult:
    """Run the loop from where most features agree, if many do; else from the start too, and keep the better answer."""
    if task.features is None:
        return _run(task, start)
    reach = _feature_reach(task.pair)
    led: list[LoopResult] = []
    for A, t in poses_by_features(task.features, n_poses=2, reach=reach):
        agree = task.features.agreeing(A, t, 2.0 * reach)
        share = len(agree.target) / len(task.features.target)
        if len(agree.target) < LEAST_AGREEING:
            continue
        with_these = replace(task, features=agree, settings=replace(task.settings, wide_search=False))
        led.append(_run(with_these, Prior(A * _scale_of(task.prior.A), t)))
        if len(agree.target) >= MANY_AGREEING and share >= MOST_AGREE:
            return led[-1]
    return min([*led, _run(task, start)], key=lambda found: _joint_cost(task, found))


def _feature_reach(pair: DensePair) -> float:
    """Return the distance in the frame up to which a feature agrees with a pose."""
    return max(0.05, 1.5 * pair.target[0].size)


def _joint_cost(task: _Task, found: LoopResult) -> float:
    """Return the surfaces' robust cost plus the share of features that disagree."""
    cost = _cost(task, found, _middle_level(task.pair))
    if task.features is None:
        return cost
    agree = task.features.agreeing(found.A, found.t, _feature_reach(task.pair))
    return cost + 1.0 - len(agree.target) / len(task.features.target)


def _led_by_rasters(task: _Task, first: Prior, found: LoopResult, stage: str) -> tuple[_Task, LoopResult, str]:
    """Match the grids that the scans were made from, where no matches were given; keep them where they lead further."""
    matches = match_rasters(task.target, task.source) if task.features is None else None
    if matches is None or len(matches) < LEAST_AGREEING:
        return task, found, stage
    floor = 0.05 * task.pair.voxel_size
    led = replace(task, features=feature_term(matches, task.target, task.source, task.pair.frame, floor))
    if led.features is None:
        return task, found, stage
    answer = _run_local(led, first)
    if _joint_cost(led, answer) < _joint_cost(led, found) - 1e-3:
        return led, answer, "global"
    return task, found, stage


def _search(task: _Task, found: LoopResult, stage: str) -> tuple[LoopResult, str]:
    """Try poses from features or shape; keep the answer with the lowest cost on a middle level."""
    pair, settings = task.pair, task.settings
    level = _middle_level(pair)
    rough = level + 1 if level + 1 < len(pair.target) else level
    poses: list[tuple[Float64Array, Float64Array]] = []
    poses += poses_by_shape(pair.target[level], pair.source[level], n_poses=N_POSES)
    quick = replace(settings, max_iterations=12, wide_search=False)
    ranked: list[tuple[float, int, LoopResult]] = []
    for A, t in poses:
        trial = run_levels(
            pair.target[rough : rough + 1],
            pair.source[rough : rough + 1],
            task.features,
            start=Prior(A * _scale_of(task.prior.A), t),
            prior=task.prior,
            limits=task.limits,
            model=task.model,
            settings=quick,
        )
        ranked.append((_cost(task, trial, rough), len(ranked), trial))
    ranked.sort(key=lambda item: item[:2])
    best, best_cost = found, _joint_cost(task, found)
    below = replace(settings, wide_search=False)
    for _, _, trial in ranked[:N_FINALISTS]:
        finished = run_levels(
            pair.target[: rough + 1],
            pair.source[: rough + 1],
            task.features,
            start=Prior(trial.A, trial.t),
            prior=task.prior,
            limits=task.limits,
            model=task.model,
            settings=below,
        )
        cost = _joint_cost(task, finished)
        if cost < best_cost - 1e-3:
            best, best_cost, stage = finished, cost, "global"
    return best, stage


def _scale_of(A: Float64Array) -> Float64Array:
    return np.asarray(np.linalg.norm(A, axis=0))


def _middle_level(pair: DensePair) -> int:
    """Return the finest level with at most 2500 elements in the larger scan."""
    for level, (q, p) in enumerate(zip(pair.target, pair.source)):
        if max(len(q.surface), len(p.surface)) <= 2500:
            return level
    return len(pair.target) - 1


def _cost(task: _Task, found: LoopResult, level: int) -> float:
    """Return the robust cost of an answer on a level, by the same measure for all answers."""
    target = task.pair.target[level]
    both = []
    for q, p, A, t in (
        (target, task.pair.source[level], found.A, found.t),
        (task.pair.source[level], target, *_inverse(found.A, found.t)),
    ):
        seen = match_surface(p.surface, q, A, t, radius=q.size, cutoff=0.5 * q.size, n_threads=task.settings.n_threads)
        both.append(seen.cost)
    return min(both)


def _inverse(A: Float64Array, t: Float64Array) -> tuple[Float64Array, Float64Array]:
    back = np.linalg.inv(A)
    return np.ascontiguousarray(back), -back @ t


def _assemble(task: _Task, found: LoopResult, stage: str) -> Registration:
    """Turn the loop's last state into a result in the input's units."""
    frame, joint = task.pair.frame, found.joint
    Q, meat, weight = _bread_and_meat(task, found)
    sure = assess(Q, meat, found.A, found.t, model=task.model, frame=frame, ratio=joint.ratio, limits=task.limits)
    overlap = overlap_of(found)
    surface = joint.surface
    squares = 0.0
    if surface is not None:
        squares = surface.squares / max(surface.weight, 1e-12)
    elif joint.features is not None:
        squares = joint.features.variance
    T = frame.leave(found.A, found.t)
    return Registration(
        T_target_source=freeze(T),
        covariance=freeze(sure.covariance),
        information=freeze(sure.information),
        rmse=math.sqrt(squares) * frame.size,
        overlap=overlap,
        state=_state(found, overlap),
        certificate=_certify(task, found, joint.form, weight),
        unobservable=sure.unobservable,
        model=task.model,
        scale=freeze(_scale_of(found.A)),
        energies=tuple(e * frame.size**2 for e in found.energies),
        path=tuple(frame.leave(A, t) for A, t in found.path),
        stage=stage,
        find_inliers=_inlier_finder(task, found),
    )


def _state(found: LoopResult, overlap: float) -> str:
    surface = found.joint.surface
    if surface is not None and surface.matched * len(surface.residuals) < 6:
        return "no_overlap"
    if not found.settled:
        return "not_converged"
    return "poor_fit" if overlap < LEAST_OVERLAP else "converged"


def _bread_and_meat(task: _Task, found: LoopResult) -> tuple[Float64Array, Float64Array, float]:
    """Return the forms that the sandwich covariance is made of, and the sum of weights of the joint form."""
    joint = found.joint
    surface, features = joint.surface, joint.features
    Q = np.zeros_like(joint.form)
    meat = np.zeros_like(joint.form)
    weight = 0.0
    if surface is not None and surface.weight > 0.0:
        drawn = draw(task.pair.source[0].surface, task.settings.max_elements)
        left = rematched_form(
            surface.form,
            task.pair.target[0],
            draw(drawn, N_PROBES),
            found.A,
            found.t,
            model=task.model,
            cutoff=found.cutoff,
            spread=surface.spread,
        )
        Q += left * (joint.shares[0] * max(surface.slope / surface.weight, 0.2))
        meat += joint.shares[0] ** 2 * surface_meat(surface, drawn, task.pair.target, found.cutoff)
        weight += joint.shares[0] * surface.weight
    if features is not None:
        Q += features.form * joint.shares[1]
        meat += features.form * (joint.shares[1] ** 2 * features.variance)
        weight += joint.shares[1] * features.weight
    return Q, meat, max(weight, 1e-300)


def _certify(task: _Task, found: LoopResult, form: Float64Array, weight: float) -> Certificate | None:
    if task.model != "rigid" or task.limits.bind_motion:
        return None
    Q = form / weight
    best = solve_form(Q, model="rigid", prior=Prior(found.A, found.t), limits=task.limits, ratio=0.0)
    z = quadratic.stack(found.A, found.t)
    if best.gap is None or best.norm is None:
        return None
    gap = best.gap + max(0.0, float(z @ Q @ z) - best.value)
    relative = gap / best.norm
    return Certificate(gap * task.pair.frame.size**2, relative, relative <= 1e-8)


def _inlier_finder(task: _Task, found: LoopResult) -> Callable[[], BoolArray]:
    """Return a function that tells which source points lie on the target."""
    points, frame, target = task.source.points, task.pair.frame, task.pair.target[0]

    def find() -> BoolArray:
        elements = np.zeros((len(points), 8), dtype=np.float32)
        elements[:, : points.shape[1]] = frame.source(points)
        seen = match_surface(elements, target, found.A, found.t, radius=1.5 * target.size, cutoff=found.cutoff)
        return np.asarray(np.abs(seen.residuals) < found.cutoff)

    return find
