"""Align any two scans: the local loop first, a global search where it fails, one result with its uncertainty."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._settings import as_settings
from seismo3d._typing import ArrayLike
from seismo3d._validate import as_number, as_whole_number, is_among, told
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.registration.conclusion import assemble
from seismo3d.registration.constraints import Constraints, model_number
from seismo3d.registration.dense import DensePair, prepare_pair
from seismo3d.registration.feature_pairs import feature_term
from seismo3d.registration.polish import polish
from seismo3d.registration.projective import PixelTable, pixel_tables
from seismo3d.registration.result import SIZE_IS_FREE, Registration
from seismo3d.registration.rivals import settle
from seismo3d.registration.scale_starts import led_by_extent, usual_scale
from seismo3d.registration.settings import MOST_THREADS, LoopSettings
from seismo3d.registration.solvers import Limits, Prior
from seismo3d.registration.stages import GOOD_OVERLAP, Task, is_sure, led_by_rasters, overlap_of, run_local, search
from seismo3d.registration.start import as_start
from seismo3d.scan import Scan, as_scan

CORRESPONDENCES = ("nearest", "projective")
STAGES = ("local", "global", "polish")
LEAST_POINTS = 10


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
    ``global``, only where the local answer's overlap is not good and few features confirm it: poses from matched
    features, those of :func:`seismo3d.match` on the scans' images or volumes where none are given, and from local
    shape, run through the same loop; the best of all answers wins. Where the size is free and no matches tell it, a
    start at the scale of both scans' extents, settled rigidly first, competes with the local answer. ``polish``, only
    where both scans hold the same samples, or one is a part of the other: exact pairs of points. A few points a hundred
    times as far out as the others are left out, as stray returns are.

    Parameters
    ----------
    target, source : Scan, array_like, str or Path
        Scans, or what a scan is made from: points (n, 2) or (n, 3), an image, a volume, a point file.
    model : {"rigid", "translation", "similarity", "scaled", "affine"}
        Class of the transform.
    start : array_like of shape (d+1, d+1), optional
        Homogeneous matrix ``T_target_source`` to start from. Its linear part, if rounded, is replaced by the nearest
        one of the model. Default: the identity.
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
        Degrees of freedom that are fixed or bounded, relative to the start. A free scale may leave that of the start
        and that of both scans' extents tenfold; an answer that ran to its end is a poor fit.
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
        Not converging, no overlap and a poor fit are states of the result, not errors. Where the global stage has run,
        a poor fit is also what chance explains: the poses that it tried led each somewhere else, and to nearly as good
        an answer. An answer is ambiguous where one of few other places explains nearly as much, as parts of symmetric
        shapes do, and no start was given that lies much nearer to one of them. Without it a fit that overlaps by a
        seventh counts as converged, whatever the scans show.

    Raises
    ------
    ShapeError
        If an input has a wrong shape, is empty or holds points that are not finite, or the scans differ in dimension.
    GeometryError
        If a scan has fewer than 10 points, or all its points lie on one line.
    ParameterError
        If the start is far from the model, or a setting has no meaning.

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
    found, stage, stands_out, is_alone = run_local(task, first), "local", True, True
    if "global" in stages:
        task, found, stage, stands_out = led_by_extent(task, found, stage)
    # what the extents led to was searched for at its size
    if "global" in stages and stage == "local" and (not is_sure(task, found) or "local" not in stages):
        task, found, stage = led_by_rasters(task, first, found, stage)
        if not is_sure(task, found) or stage == "local":
            local, local_stage = found, stage
            best, stage, tried = search(task, local, stage)
            # what a start says is meant fits where scans overlap as well as the best answer, and is no more by chance
            stands_out = tried.stands_out(best) or overlap_of(best) >= GOOD_OVERLAP
            found, is_alone = settle(task, best, tried, local, None if start is None else first)
            stage = local_stage if found is local else stage
    if "polish" in stages:
        polished = polish(
            task.target.points, task.source.points, task.pair.frame, found, task.model, task.prior, task.limits
        )
        if polished is not None:
            return assemble(task, replace(found, A=polished[0], t=polished[1]), stage)
    return assemble(task, found, stage, stands_out=stands_out, is_alone=is_alone)


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
) -> tuple[Task, Prior]:
    """Check all inputs and bring both scans into one frame."""
    model_number(model)
    _check_stages(stages)
    given = as_settings(constraints, Constraints, "constraints")
    q, p = as_scan(target, "target"), as_scan(source, "source")
    if q.dim != p.dim:
        raise ShapeError(f"target has {q.dim} dimensions and source {p.dim}; expected the same.")
    d = p.dim
    if alpha is not None:
        as_number(alpha, "alpha", low=0.0, high=1.0)
        if matches is None:
            raise ParameterError("alpha is given without matches; expected both. Drop alpha, or pass matches.")
    edge = None if voxel_size is None else as_number(voxel_size, "voxel_size", low=0.0, strict=True)
    chosen = as_settings(settings, LoopSettings)
    threads = chosen.n_threads if n_threads is None and settings is not None else _threads(n_threads)
    chosen = replace(chosen, alpha=chosen.alpha if alpha is None else alpha, n_threads=threads)
    for scan, name in ((q, "target"), (p, "source")):
        if len(scan) < LEAST_POINTS:
            raise GeometryError(
                f"{name} has {len(scan)} points; expected at least {LEAST_POINTS}. Use align_pairs for pairs."
            )
    pair = prepare_pair(q, p, voxel_size=edge, n_threads=threads, symmetric=chosen.symmetric)
    _check_spread(pair, d)
    features = None
    if matches is not None:
        features = feature_term(matches, q, p, pair.frame, 0.05 * pair.voxel_size)
    T = np.eye(d + 1) if start is None else as_start(start, "start", d, model)
    prior = Prior(*pair.frame.enter(T))
    usual = usual_scale(q, p, T) if model in SIZE_IS_FREE and given.scale is None else None
    limits = Limits(*given.limits(model, d, pair.frame.size, usual_scale=usual))
    return Task(q, p, pair, features, prior, limits, model, chosen), prior


def _check_stages(stages: tuple[str, ...]) -> None:
    known = isinstance(stages, (tuple, list)) and all(is_among(stage, STAGES) for stage in stages)
    if not known or not {"local", "global"} & set(stages):
        raise ParameterError(
            f"stages is {told(stages)}; expected a tuple of {', '.join(STAGES)}, with local or global in it."
        )


def _threads(n_threads: int | None) -> int:
    if n_threads is None:
        return min(os.cpu_count() or 1, 8)
    return as_whole_number(n_threads, "n_threads", low=1, high=MOST_THREADS)


def _check_spread(pair: DensePair, d: int) -> None:
    """Refuse scans in space whose points lie on one line."""
    for levels, name in ((pair.target, "target"), (pair.source, "source")):
        if d == 2:
            continue
        moments = levels[-1].moments
        points = moments[:, 1:4] / moments[:, :1]  # elements of the surface may have been joined across layers
        points -= points.mean(axis=0)
        squares = np.linalg.eigvalsh(points.T @ points)
        if squares[1] < 1e-10 * squares[2]:
            raise GeometryError(
                f"{name}'s points lie on one line; expected a surface. Use align_pairs with given pairs."
            )


def _tables(task: Task, correspondences: str) -> list[PixelTable] | None:
    """Return what the target's pixels show, by level, where partners are to come from them."""
    if not is_among(correspondences, CORRESPONDENCES):
        raise ParameterError(
            f"correspondences is {told(correspondences)}; expected one of {', '.join(CORRESPONDENCES)}."
        )
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
