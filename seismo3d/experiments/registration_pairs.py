"""Real pairs of scans from perturbed starts: how often the answer is the true one."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.experiments.registration_speed import distance_of
from seismo3d.geometry.rotations import exp_rotation, make_transform
from seismo3d.io.points import read_points
from seismo3d.registration.register import register

PAIRS = {
    "lidar_pair": ("lidar_pair/target.ply", "lidar_pair/source.ply"),
    "room": ("room/room_scan1.pcd", "room/room_scan2.pcd"),
    "bunny 0-45": ("bunny/bun000.ply", "bunny/bun045.ply"),
    "bunny 45-90": ("bunny/bun045.ply", "bunny/bun090.ply"),
    "bunny_parts": ("bunny_parts/bunny_part1.xyz", "bunny_parts/bunny_part2.xyz"),
    "car": ("car/car_cloud400.csv", "car/car_cloud401.csv"),
}
LARGEST_ANGLE_DEG = 30.0
ANGLE_LIMIT_DEG = 0.7
SHIFT_LIMIT = 0.01
"""In shares of the scan's size, the diagonal of its box."""


@dataclass(frozen=True, slots=True)
class TrialFigures:
    """Share of right answers of a pair, median time in seconds, and the reference's overlap."""

    pair: str
    n_trials: int
    success: float
    seconds: float
    overlap: float


def run_pair(folder: Path, name: str, *, n_trials: int, seed: int = 0) -> TrialFigures:
    """Register a pair from random starts: turned by up to 30 degrees, shifted by up to half the overlap's size.

    The reference is the answer with the largest overlap among ten starts; starts perturb it.
    """
    target_file, source_file = PAIRS[name]
    target, source = read_points(folder / target_file).points, read_points(folder / source_file).points
    rng = np.random.default_rng(seed)
    size = float(np.linalg.norm(np.ptp(source, axis=0)))
    reference = max((register(target, source, stages=s) for s in (("local",), ("global",))), key=lambda r: r.overlap)
    truth = reference.T_target_source
    overlap_size = _overlap_size(source, reference.inliers)
    right, seconds = [], []
    for _ in range(n_trials):
        start = perturbed(truth, source, overlap_size, rng)
        begin = time.perf_counter()
        found = register(target, source, start=start)
        seconds.append(time.perf_counter() - begin)
        angle, shift = distance_of(found.T_target_source, truth, source)
        right.append(np.degrees(angle) < ANGLE_LIMIT_DEG and shift < SHIFT_LIMIT * size)
    return TrialFigures(name, n_trials, float(np.mean(right)), float(np.median(seconds)), reference.overlap)


def perturbed(truth: Float64Array, source: Float64Array, size: float, rng: np.random.Generator) -> Float64Array:
    """Return the truth turned about the source's centre by up to 30 degrees and shifted by up to half a size."""
    axis, direction = rng.normal(size=(2, 3))
    angle = np.radians(LARGEST_ANGLE_DEG) * rng.uniform()
    turn = exp_rotation(angle * axis / np.linalg.norm(axis))
    centre = truth[:3, :3] @ source.mean(axis=0) + truth[:3, 3]
    shift = 0.5 * size * rng.uniform() * direction / np.linalg.norm(direction)
    return make_transform(turn, centre + shift - turn @ centre) @ truth


def _overlap_size(source: Float64Array, inliers: np.ndarray) -> float:
    """Return the root mean square radius of the part of the source that overlaps."""
    part = source[inliers] if inliers.any() else source
    return float(np.sqrt(((part - part.mean(axis=0)) ** 2).sum(axis=1).mean()))


def report(folder: Path, *, n_trials: int) -> list[TrialFigures]:
    """Print and return the figures of all pairs."""
    rows = []
    print(f"{'pair':12} {'trials':>6} {'success':>8} {'seconds':>8} {'overlap':>8}")
    for name in PAIRS:
        f = run_pair(folder, name, n_trials=n_trials)
        rows.append(f)
        print(f"{f.pair:12} {f.n_trials:6d} {f.success:8.3f} {f.seconds:8.2f} {f.overlap:8.2f}", flush=True)
    return rows
