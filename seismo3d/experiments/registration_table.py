"""Table 1 and Figure 3 of the paper: registration of rotated depth frames, accuracy, seconds and error by iteration.

Accuracy is the share of source points that end within twice the spacing of the points (the spacing after thinning,
which all methods share) of their true place; the mean over all frames. Seconds are the mean time of a registration,
from points to transform, features included where they are used.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.experiments.image_matches import match_keypoints
from seismo3d.experiments.rotated_frames import Frame, FramePair, draw_room, read_frames, rotate_frame
from seismo3d.geometry.rotations import make_transform, nearest_rotation, transform_points
from seismo3d.geometry.voxels import downsample_points, estimate_normals
from seismo3d.registration.acceleration import Accelerator
from seismo3d.registration.align import align_pairs
from seismo3d.registration.register import register
from seismo3d.registration.settings import LoopSettings

ANGLES_DEG = (5, 10, 15, 20, 25, 30, 45, 60, 75, 90)
THINNING = 0.02
"""Voxels that all methods thin the points with, in metres."""
REACH = 0.25
"""Largest distance of pairs for the baselines, in metres."""
ROUNDS = 50
DETECTOR = "orb"


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One registration: the answer, its time, and the transforms on the way."""

    T_target_source: Float64Array
    seconds: float
    path: tuple[Float64Array, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Accuracy in percent and seconds by method and angle, and the mean square error by iteration at one angle."""

    angles_deg: tuple[int, ...]
    accuracy: dict[str, list[float]]
    seconds: dict[str, list[float]]
    errors: dict[str, list[list[float]]]
    figure_angle_deg: int


def _points(pair: FramePair) -> tuple[Float64Array, Float64Array]:
    return downsample_points(pair.target.points, THINNING)[0], downsample_points(pair.source.points, THINNING)[0]


def iterate_pairs(target: Float64Array, source: Float64Array, *, depth: int = 0) -> list[Float64Array]:
    """Run point-to-point ICP, with some steps of acceleration; return the transforms on the way."""
    from scipy.spatial import cKDTree

    tree: Any = cKDTree(target)
    T = np.eye(4)
    path = [T]
    memory = Accelerator(depth)
    for _ in range(ROUNDS):
        distances, rows = tree.query(transform_points(T, source))
        close = distances < REACH
        if close.sum() < 10:
            break
        step = align_pairs(target[rows[close]], source[close]).T_target_source
        moved = float(np.abs(step - T).max())
        mixed = memory.extrapolate(T[:3].ravel(), step[:3].ravel())
        T = step
        if mixed is not None:
            A = mixed.reshape(3, 4)
            T = make_transform(nearest_rotation(A[:, :3]), A[:, 3])
        path.append(T)
        if moved < 1e-5:
            break
    return path


def fast_icp(pair: FramePair) -> list[Float64Array]:
    """Point-to-point ICP on a tenth of the points, accelerated."""
    target, source = _points(pair)
    return iterate_pairs(target[::3], source[::10], depth=4)


def point_icp(pair: FramePair) -> list[Float64Array]:
    """Point-to-point ICP on all points."""
    target, source = _points(pair)
    return iterate_pairs(target, source)


def plane_icp(pair: FramePair) -> list[Float64Array]:
    """Point-to-plane ICP on all points: open3d's where it is installed, else nearest neighbours and the exact solve."""
    try:
        import open3d as o3d
    except ImportError:
        return _plane_icp(*_points(pair))
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)) for points in _points(pair)]
    clouds[0].estimate_normals(o3d.geometry.KDTreeSearchParamKNN(12))
    tools = o3d.pipelines.registration
    found = tools.registration_icp(
        clouds[1],
        clouds[0],
        REACH,
        np.eye(4),
        tools.TransformationEstimationPointToPlane(),
        tools.ICPConvergenceCriteria(1e-7, 1e-7, ROUNDS),
    )
    return [np.eye(4), np.asarray(found.transformation)]


def _plane_icp(target: Float64Array, source: Float64Array) -> list[Float64Array]:
    from scipy.spatial import cKDTree

    normals = estimate_normals(target)[0].astype(np.float64)
    tree: Any = cKDTree(target)
    path = [np.eye(4)]
    for _ in range(ROUNDS):
        distances, rows = tree.query(transform_points(path[-1], source))
        close = distances < REACH
        if close.sum() < 10:
            break
        found = align_pairs(target[rows[close]], source[close], normals=normals[rows[close]], prior=path[-1])
        path.append(found.T_target_source)
        if np.abs(path[-1] - path[-2]).max() < 1e-5:
            break
    return path


def planes_alone(pair: FramePair) -> list[Float64Array]:
    """Run our loop on the surfaces alone, from the identity."""
    found = register(pair.target, pair.source, stages=("local",), voxel_size=THINNING)
    return [*found.path, found.T_target_source]


def fused(pair: FramePair, *, alpha: float | None = None) -> list[Float64Array]:
    """Run our loop on features and surfaces at once; the features lead."""
    matches = match_keypoints(pair.image_target, pair.image_source, detector=DETECTOR, n_keypoints=1500)
    found = register(pair.target, pair.source, matches=matches, alpha=alpha, stages=("local",), voxel_size=THINNING)
    return [np.eye(4), *found.path, found.T_target_source]


def in_turn(pair: FramePair) -> list[Float64Array]:
    """Features alone first, surfaces alone from there."""
    from seismo3d.experiments.registration_fusion import register_features

    matches = match_keypoints(pair.image_target, pair.image_source, detector=DETECTOR, n_keypoints=1500)
    first = register_features(pair.target, pair.source, matches).T_target_source
    quick = LoopSettings(wide_search=False)
    found = register(
        pair.target, pair.source, start=first, stages=("local",), voxel_size=THINNING, settings=quick, n_threads=1
    )
    return [np.eye(4), first, *found.path, found.T_target_source]


METHODS: dict[str, Callable[[FramePair], list[Float64Array]]] = {
    "Fast ICP": fast_icp,
    "ICP, point to point": point_icp,
    "ICP, point to plane": plane_icp,
    "surfaces alone": planes_alone,
    "features, then surfaces": in_turn,
    "fusion, alpha 0.5": lambda pair: fused(pair, alpha=0.5),
    "fusion, by variance": fused,
}


def attempt(method: str, pair: FramePair) -> Attempt:
    """Run one method on one pair."""
    start = time.perf_counter()
    path = METHODS[method](pair)
    seconds = time.perf_counter() - start
    return Attempt(path[-1], seconds, tuple(path))


def accuracy(T: Float64Array, pair: FramePair) -> float:
    """Return the share of source points that end within twice the thinned points' spacing of their true place."""
    source = pair.source.points[::20]
    off = np.linalg.norm(transform_points(T, source) - transform_points(pair.T_target_source, source), axis=1)
    return float((off < 2.0 * THINNING).mean())


def mean_square_error(T: Float64Array, pair: FramePair) -> float:
    """Return the mean square distance of the source points from their true places, in square metres."""
    source = pair.source.points[::20]
    return float(
        ((transform_points(T, source) - transform_points(pair.T_target_source, source)) ** 2).sum(axis=1).mean()
    )


def make_table(
    frames: list[Frame], *, angles_deg: tuple[int, ...] = ANGLES_DEG, figure_angle_deg: int = 20, seed: int = 0
) -> Table:
    """Run all methods on all frames at all angles.

    Parameters
    ----------
    frames : list of Frame
    angles_deg : tuple of int
        Rotations between the frames of a pair.
    figure_angle_deg : int
        Angle of the figure; one of ``angles_deg``.
    seed : int
        Of the noise.
    """
    rates: dict[str, list[float]] = {m: [] for m in METHODS}
    seconds: dict[str, list[float]] = {m: [] for m in METHODS}
    errors: dict[str, list[list[float]]] = {m: [] for m in METHODS}
    warm = rotate_frame(frames[0], 3.0, np.random.default_rng(seed))
    for method in METHODS:
        attempt(method, warm)
    for angle in angles_deg:
        pairs = [rotate_frame(f, float(angle), np.random.default_rng([seed, k, angle])) for k, f in enumerate(frames)]
        for method in METHODS:
            tries = [attempt(method, pair) for pair in pairs]
            rates[method].append(100.0 * float(np.mean([accuracy(t.T_target_source, p) for t, p in zip(tries, pairs)])))
            seconds[method].append(float(np.mean([t.seconds for t in tries])))
            if angle == figure_angle_deg:
                errors[method] = [[mean_square_error(T, p) for T in t.path] for t, p in zip(tries, pairs)]
    return Table(angles_deg, rates, seconds, errors, figure_angle_deg)


def load_frames(sequence: Path | None, *, n_frames: int) -> list[Frame]:
    """Return frames of a sequence, or drawn rooms where none is given."""
    if sequence is None:
        return [draw_room(seed=seed) for seed in range(n_frames)]
    return read_frames(sequence, n_frames=n_frames)


def format_table(table: Table) -> str:
    """Return the table as text: accuracy in percent / seconds, a row a method."""
    width = max(len(m) for m in table.accuracy)
    lines = [" " * width + "".join(f"{a:>11d}" for a in table.angles_deg)]
    for method, rates in table.accuracy.items():
        cells = (f"{rate:.0f}/{s:.3f}" for rate, s in zip(rates, table.seconds[method]))
        lines.append(f"{method:{width}}" + "".join(f"{cell:>11}" for cell in cells))
    return "\n".join(lines)


def draw_figure(table: Table, path: Path) -> Path:
    """Draw the mean square error by iteration, the mean over the frames, to an image file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for method, curves in table.errors.items():
        if curves:
            longest = max(len(c) for c in curves)
            filled = np.array([c + [c[-1]] * (longest - len(c)) for c in curves])
            axes.semilogy(np.maximum(filled.mean(axis=0), 1e-12), marker=".", label=method)
    axes.set_xlabel("iteration")
    axes.set_ylabel("mean square error of the points (m²)")
    axes.set_title(f"Rotation by {table.figure_angle_deg} degrees")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
    return path
