"""What a registration concludes from where its loop ended: transform, covariance, certificate, state."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d._validate import freeze
from seismo3d.registration import quadratic
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.certificate import Certificate
from seismo3d.registration.constraints import model_number
from seismo3d.registration.icp import LoopResult
from seismo3d.registration.matching import match_surface, pool, surface_meat
from seismo3d.registration.observability import assess
from seismo3d.registration.result import Registration
from seismo3d.registration.sensitivity import rematched_form
from seismo3d.registration.solvers import Prior, solve_form
from seismo3d.registration.stages import GOOD_OVERLAP, Task, overlap_of, scale_of
from seismo3d.registration.unseen import without
from seismo3d.registration.wide_search import draw

LEAST_OVERLAP = 0.15
"""Overlap below which an answer is a poor fit."""
N_PROBES = 500


def assemble(
    task: Task, found: LoopResult, stage: str, *, stands_out: bool = True, is_alone: bool = True
) -> Registration:
    """Turn the loop's last state into a result in the input's units.

    ``stands_out`` says whether it fits better than chance explains, by what a search over poses found elsewhere;
    ``is_alone``, whether no single answer elsewhere explains nearly as much.
    """
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
    at_bounds = task.limits.reached(task.prior, found.A, found.t, task.model)
    T = frame.leave(found.A, found.t)
    return Registration(
        T_target_source=freeze(T),
        covariance=freeze(sure.covariance),
        information=freeze(sure.information),
        rmse=math.sqrt(squares) * frame.size,
        overlap=overlap,
        state=_state(found, overlap, at_bounds, stands_out=stands_out, is_alone=is_alone),
        certificate=_certify(task, found, joint.form, weight),
        unobservable=sure.unobservable,
        model=task.model,
        scale=freeze(scale_of(T[:-1, :-1])),
        energies=tuple(e * frame.size**2 for e in found.energies),
        path=tuple(frame.leave(A, t) for A, t in found.path),
        at_bounds=at_bounds,
        stage=stage,
        find_inliers=_inlier_finder(task, found),
    )


def _state(found: LoopResult, overlap: float, at_bounds: tuple[str, ...], *, stands_out: bool, is_alone: bool) -> str:
    surface = found.joint.surface
    if surface is not None and surface.matched * len(surface.residuals) < 6:
        return "no_overlap"
    if not found.settled:
        return "not_converged"
    by_chance = not stands_out and overlap < GOOD_OVERLAP
    if by_chance or overlap < LEAST_OVERLAP or "scale" in at_bounds:
        return "poor_fit"
    return "converged" if is_alone else "ambiguous"


def _bread_and_meat(task: Task, found: LoopResult) -> tuple[Float64Array, Float64Array, float]:
    """Return the forms that the sandwich covariance is made of, and the sum of weights of the joint form."""
    joint = found.joint
    surface, features = joint.surface, joint.features
    Q = np.zeros_like(joint.form)
    meat = np.zeros_like(joint.form)
    weight = 0.0
    if surface is not None and surface.weight > 0.0:
        target, n_threads = task.pair.target[0], task.settings.n_threads
        drawn = draw(task.pair.source[0].surface, task.settings.max_elements)
        jacobian = parameter_jacobian(found.A, model_number(task.model))
        own = (surface, drawn, target, found.cutoff, jacobian)
        other = pool(n_threads - 1).submit(surface_meat, *own) if n_threads > 1 else None
        left = rematched_form(
            surface.form,
            target,
            draw(drawn, N_PROBES),
            found.A,
            found.t,
            model=task.model,
            cutoff=found.cutoff,
            spread=surface.spread,
        )
        if joint.unseen is not None and joint.unseen.shape[1]:
            left = without(left, found.A, found.t, task.model, joint.unseen)
        Q += left * (joint.shares[0] * max(surface.slope / surface.weight, 0.2))
        meat += joint.shares[0] ** 2 * (surface_meat(*own) if other is None else other.result())
        weight += joint.shares[0] * surface.weight
    if features is not None:
        Q += features.form * joint.shares[1]
        meat += features.form * (joint.shares[1] ** 2 * features.variance)
        weight += joint.shares[1] * features.weight
    return Q, meat, max(weight, 1e-300)


def _certify(task: Task, found: LoopResult, form: Float64Array, weight: float) -> Certificate | None:
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


def _inlier_finder(task: Task, found: LoopResult) -> Callable[[], BoolArray]:
    """Return a function that tells which source points lie on the target."""
    points, frame, target = task.source.points, task.pair.frame, task.pair.target[0]

    def find() -> BoolArray:
        elements = np.zeros((len(points), 8), dtype=np.float32)
        elements[:, : points.shape[1]] = frame.source(points)
        seen = match_surface(elements, target, found.A, found.t, radius=1.5 * target.size, cutoff=found.cutoff)
        return np.asarray(np.abs(seen.residuals) < found.cutoff)

    return find
