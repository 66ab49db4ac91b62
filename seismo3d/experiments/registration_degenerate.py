"""Scenes that planes alone do not determine: a plane, a corridor, layers; with features, success of each way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.registration.align import align_pairs
from seismo3d.registration.icp import LoopSettings
from seismo3d.registration.register import register

SCENES = ("plane", "corridor", "layers")
METHODS = ("planes", "features", "in turn", "fused")
FEATURE_NOISE = 0.03
POINT_NOISE = 0.004
N_FEATURES = 40


@dataclass(frozen=True, slots=True)
class SceneFigures:
    """Root mean square displacement of the scene's points from their true place, by method, and directions reported."""

    scene: str
    displacement: dict[str, float]
    n_unobservable: float


def sample(scene: str, rng: np.random.Generator, n: int) -> Float64Array:
    """Return points of a scene of about two units' width."""
    p = rng.uniform(-1, 1, size=(n, 3))
    if scene == "plane":
        p[:, 2] = 0.0
    elif scene == "corridor":
        wall = rng.integers(0, 3, n)
        p[:, 0] *= 2.0
        p[wall == 0, 1], p[wall == 1, 1], p[wall == 2, 2] = -0.5, 0.5, -0.5
        p[wall != 2, 2] *= 0.5
        p[wall == 2, 1] *= 0.5
    else:
        p[:, 2] = 0.4 * rng.integers(-2, 3, n) + 0.05 * p[:, 0]
    return p


def run_scene(scene: str, *, n_repeats: int, seed: int = 0) -> SceneFigures:
    """Align two samples of a scene with noise of their own and a few inexact features."""
    rng = np.random.default_rng(seed)
    squares: dict[str, list[float]] = {m: [] for m in METHODS}
    unobservable = []
    for _ in range(n_repeats):
        T = make_transform(exp_rotation(0.1 * rng.normal(size=3)), 0.15 * rng.normal(size=3))
        target = transform_points(T, sample(scene, rng, 6000)) + POINT_NOISE * rng.normal(size=(6000, 3))
        source = sample(scene, rng, 6000) + POINT_NOISE * rng.normal(size=(6000, 3))
        f = sample(scene, rng, N_FEATURES)
        g = transform_points(T, f) + FEATURE_NOISE * rng.normal(size=f.shape)
        planes = register(target, source, stages=("local",))
        unobservable.append(len(planes.unobservable))
        features = align_pairs(g, f)
        quick = LoopSettings(wide_search=False)
        turn = register(target, source, start=features.T_target_source, stages=("local",), settings=quick)
        both = register(target, source, matches=(g, f), stages=("local",))
        for method, found in zip(METHODS, (planes, features, turn, both)):
            off = transform_points(found.T_target_source, source) - transform_points(T, source)
            squares[method].append(float((off**2).sum(axis=1).mean()))
    displacement = {m: float(np.sqrt(np.mean(squares[m]))) for m in METHODS}
    return SceneFigures(scene, displacement, float(np.mean(unobservable)))


def report(*, n_repeats: int) -> list[SceneFigures]:
    """Print and return the figures of all scenes."""
    rows = []
    print(f"{'scene':10} " + "".join(f"{m:>10}" for m in METHODS) + "  unobservable")
    for scene in SCENES:
        f = run_scene(scene, n_repeats=n_repeats)
        rows.append(f)
        print(f"{scene:10} " + "".join(f"{f.displacement[m]:10.4f}" for m in METHODS) + f"  {f.n_unobservable:.1f}")
    return rows
