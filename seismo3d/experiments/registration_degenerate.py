"""Scenes that surfaces alone do not determine, seen by a depth camera: a plane, a corridor, layers; each way's success.

Each view has depth with noise that grows with its square, of its own; the camera turns and moves between the views, so
that they overlap in part; matched keypoints have noise in both images, the depth of their pixels, and a quarter of them
are wrong. Features first, then surfaces, leaves what the surfaces do not see where the features put it, with the error
that the depth of the features brought along. At once, the surfaces settle depth first and the features need to tell the
rest only: a conditional estimate in place of a marginal one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.experiments.image_matches import KeypointPairs
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.registration.feature_pairs import feature_term
from seismo3d.registration.initial import poses_by_features
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.register import register
from seismo3d.registration.settings import LoopSettings
from seismo3d.scan import Scan

SCENES = ("plane", "corridor", "layers")
METHODS = ("planes", "features", "in turn", "fused")
DEPTH_NOISE = 0.0025
"""Standard deviation of depth in metres at one metre; it grows with the square of depth."""
PIXEL_NOISE = 0.7
N_FEATURES = 40
WRONG = 0.25
"""Share of wrong matches."""
SIZE = (120, 160)
CAMERA = PinholeCamera(130.0, 130.0, 79.5, 59.5)
FARTHEST = 4.0
RIGHT = 0.02
"""Root mean square displacement of the source's points, in metres, up to which an answer is right."""
POSES: dict[str, tuple[Float64Array, Float64Array]] = {
    "plane": (np.array([-0.75, 0.0, 0.0]), np.array([0.0, -1.2, 0.0])),
    "corridor": (np.array([-0.3, 0.35, 0.0]), np.array([0.0, -1.1, 0.0])),
    "layers": (np.array([-0.8, 0.2, 0.0]), np.array([0.0, -1.6, 0.0])),
}
"""Rotation vector and place of the first camera, in a world whose y axis points down and whose floor is at zero."""


@dataclass(frozen=True, slots=True)
class SceneFigures:
    """Share of right answers and median displacement (metres) by method, and the mean number of directions reported."""

    scene: str
    success: dict[str, float]
    displacement: dict[str, float]
    n_unobservable: float


def cast(scene: str, T_world_camera: Float64Array, pixels: Float64Array) -> Float64Array:
    """Return the depth that pixels (column, row) of a camera see; infinite where they see nothing."""
    rays = np.concatenate([CAMERA.rays(pixels), np.ones((len(pixels), 1))], axis=1) @ T_world_camera[:3, :3].T
    place = T_world_camera[:3, 3]
    depth = np.full(len(rays), np.inf)

    def meet(axis: int, level: float, low: float = -np.inf, high: float = np.inf) -> None:
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (level - place[axis]) / rays[:, axis]
        x = place[0] + along * rays[:, 0]
        hit = (along > 0.1) & (along < depth) & (x >= low) & (x <= high)
        depth[hit] = along[hit]

    meet(1, 0.0)
    if scene == "corridor":
        meet(0, -0.9)
        meet(0, 0.9)
    elif scene == "layers":
        for step, (low, high) in enumerate(((-2.0, -0.7), (-0.4, 0.1), (0.5, 2.0)), 1):
            meet(1, -0.15 * step, low, high)
    return depth


def view(scene: str, T_world_camera: Float64Array, rng: np.random.Generator) -> tuple[Scan, Float64Array]:
    """Return the scan that a camera makes of a scene, and its exact depth image."""
    rows, columns = SIZE
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(np.float64)
    exact = cast(scene, T_world_camera, grid).reshape(SIZE)
    seen = np.where(exact < FARTHEST, exact, 0.0)
    noisy = seen + DEPTH_NOISE * seen**2 * rng.normal(size=SIZE)
    return Scan.from_rgbd(None, noisy, CAMERA), exact


def matched_pixels(
    scene: str, T_world_target: Float64Array, T_world_source: Float64Array, rng: np.random.Generator
) -> KeypointPairs:
    """Return pixels of points that both cameras see, with noise, a share of them matched wrongly."""
    limit = np.array(SIZE[::-1]) - 3.0
    pixels = rng.uniform(2.0, limit, size=(40 * N_FEATURES, 2))
    depth = cast(scene, T_world_source, pixels)
    points = np.concatenate([CAMERA.rays(pixels), np.ones((len(pixels), 1))], axis=1) * depth[:, None]
    near = depth < FARTHEST
    between = np.linalg.inv(T_world_target) @ T_world_source
    moved = transform_points(between, points[near])
    seen = CAMERA.project(moved)
    inside = np.isfinite(seen).all(axis=1) & (seen > 2.0).all(axis=1) & (seen < limit).all(axis=1)
    moved, source, target = moved[inside], pixels[near][inside], seen[inside]
    visible = np.abs(cast(scene, T_world_target, target) - moved[:, 2]) < 0.02
    target, source = target[visible][:N_FEATURES].copy(), source[visible][:N_FEATURES].copy()
    wrong = rng.uniform(size=len(target)) < WRONG
    target[wrong] = rng.uniform(2.0, limit, size=(int(wrong.sum()), 2))
    noise = PIXEL_NOISE * rng.normal(size=(2, *target.shape))
    return KeypointPairs(target + noise[0], source + noise[1])


def features_alone(target: Scan, source: Scan, matches: KeypointPairs) -> Float64Array:
    """Return ``T_target_source`` of the features alone: robust, weighed by their full covariance."""
    frame = Frame.of(target.points, source.points)
    term = feature_term(matches, target, source, frame, 0.01)
    pose = None if term is None else next(poses_by_features(term, n_poses=1, reach=0.1 / frame.size), None)
    return np.eye(4) if pose is None else frame.leave(*pose)


def answers(target: Scan, source: Scan, matches: KeypointPairs) -> tuple[dict[str, Float64Array], int]:
    """Return ``T_target_source`` by each method, and how many directions surfaces report as unseen near the truth."""
    surfaces = register(target, source, stages=("local",))
    features = features_alone(target, source, matches)
    quick = LoopSettings(wide_search=False)
    turn = register(target, source, start=features, stages=("local",), settings=quick)
    both = register(target, source, matches=matches, stages=("local",))
    found = (surfaces.T_target_source, features, turn.T_target_source, both.T_target_source)
    return dict(zip(METHODS, found)), len(turn.unobservable)


def run_scene(scene: str, *, n_repeats: int, seed: int = 0) -> SceneFigures:
    """Align pairs of views of a scene: 0.1 radians and 0.15 metres an axis apart, in the root mean square."""
    rng = np.random.default_rng(seed)
    off: dict[str, list[float]] = {m: [] for m in METHODS}
    unobservable = []
    turn, place = POSES[scene]
    for _ in range(n_repeats):
        T_world_target = make_transform(exp_rotation(turn), place)
        T = make_transform(exp_rotation(0.1 * rng.normal(size=3)), 0.15 * rng.normal(size=3))
        target, _ = view(scene, T_world_target, rng)
        source, _ = view(scene, T_world_target @ T, rng)
        matches = matched_pixels(scene, T_world_target, T_world_target @ T, rng)
        found, n_unseen = answers(target, source, matches)
        unobservable.append(n_unseen)
        truth = transform_points(T, source.points)
        for method, answer in found.items():
            squares = ((transform_points(answer, source.points) - truth) ** 2).sum(axis=1)
            off[method].append(float(np.sqrt(squares.mean())))
    return SceneFigures(
        scene,
        {m: float(np.mean(np.array(off[m]) < RIGHT)) for m in METHODS},
        {m: float(np.median(off[m])) for m in METHODS},
        float(np.mean(unobservable)),
    )


def report(*, n_repeats: int) -> list[SceneFigures]:
    """Print and return the figures of all scenes: success, and in brackets the median displacement."""
    rows = []
    print(f"{'scene':10} " + "".join(f"{m:>18}" for m in METHODS) + "  unobservable")
    for scene in SCENES:
        f = run_scene(scene, n_repeats=n_repeats)
        rows.append(f)
        cells = "".join(f"{f.success[m]:8.2f} ({1e3 * f.displacement[m]:4.1f} mm)" for m in METHODS)
        print(f"{scene:10} {cells}  {f.n_unobservable:.1f}", flush=True)
    return rows
