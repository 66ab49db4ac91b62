"""Sub-volumes displaced by known rigid motions, with noise: how well their matches give the motion back."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from seismo3d._typing import AnyArray, Float32Array, Float64Array
from seismo3d.features.inputs import Grey
from seismo3d.features.matching import match
from seismo3d.features.poses import fit_pose
from seismo3d.features.solid import SolidSettings, describe_solid

KINDS = ("clean", "folded", "small_throws", "crossing", "low_dips", "channels")
_MARGIN = 24


@dataclass(frozen=True, slots=True)
class Trial:
    """One pair: matches kept, those within three voxels of the truth, errors of the pose fitted to all."""

    name: str
    kept: int
    correct: int
    angle_error_deg: float
    shift_error: float


def displaced_pair(
    earth: AnyArray, size: int, R: Float64Array, shift: Float64Array, noise: float, rng: np.random.Generator
) -> tuple[Float32Array, Float32Array, Float64Array]:
    """Cut a sub-volume, and the same place turned and shifted; noise, a share of the signal's deviation, on both.

    Returns
    -------
    target, source : ndarray of shape (size, size, size), float32
    t : ndarray of shape (3,)
        ``x_target = R x_source + t``.
    """
    corner = (np.array(earth.shape) - size) // 2
    middle = np.full(3, (size - 1) / 2.0)
    t = middle + shift - R @ middle
    target = earth[tuple(slice(int(c), int(c) + size) for c in corner)].astype(np.float32)
    grid = np.stack(np.meshgrid(*[np.arange(size)] * 3, indexing="ij")).reshape(3, -1).astype(float)
    source = ndimage.map_coordinates(earth, R @ grid + (t + corner)[:, None], order=3, mode="nearest")
    sigma = noise * float(target.std())
    first = target + rng.normal(0.0, sigma, target.shape).astype(np.float32)
    second = source.reshape(target.shape).astype(np.float32) + rng.normal(0.0, sigma, target.shape).astype(np.float32)
    return first, second, t


def run_trial(name: str, earth: AnyArray, *, size: int, max_angle_deg: float, noise: float, seed: int) -> Trial:
    """Displace a sub-volume at random, match, and compare."""
    rng = np.random.default_rng([seed, 7])
    axis = rng.normal(size=3)
    turn = np.radians(rng.uniform(0.0, max_angle_deg)) * axis / np.linalg.norm(axis)
    R = np.asarray(Rotation.from_rotvec(turn).as_matrix())
    target, source, t = displaced_pair(earth, size, R, rng.uniform(-8.0, 8.0, 3), noise, rng)
    found = match(target, source)
    if len(found) < 3:
        return Trial(name, len(found), 0, float("inf"), float("inf"))
    misfit = np.linalg.norm(found.points_source @ R.T + t - found.points_target, axis=1)
    pose = fit_pose(found.points_target, found.points_source)
    middle = np.full((1, 3), (size - 1) / 2.0)
    angle = np.degrees(Rotation.from_matrix(pose.R.T @ R).magnitude())
    shift = np.linalg.norm(pose.to_target(middle)[0] - (R @ middle[0] + t))
    return Trial(name, len(found), int((misfit < 3.0).sum()), float(angle), float(shift))


def synthetic_trials(
    n_trials: int, *, size: int = 96, max_angle_deg: float = 180.0, noise: float = 0.5
) -> Iterator[Trial]:
    """Trials on synthetic cubes, ten displacements of each, kinds in turn."""
    from seismo3d.synthetic import fault_cube

    earth: AnyArray = np.empty(0)
    kind = ""
    for k in range(n_trials):
        if k % 10 == 0:
            kind = KINDS[k // 10 % len(KINDS)]
            earth = fault_cube(kind, seed=500 + k // 10, shape=(size + 2 * _MARGIN,) * 3).signal
        yield run_trial(kind, earth, size=size, max_angle_deg=max_angle_deg, noise=noise, seed=k)


def real_trials(
    name: str, cube: AnyArray, n_trials: int, *, size: int = 96, max_angle_deg: float = 180.0
) -> Iterator[Trial]:
    """Trials on places of a cube drawn at random, noise at half the signal added."""
    values = np.asarray(cube, dtype=np.float32)
    size = min(size, min(values.shape) - 16)
    wide = [min(size + 2 * _MARGIN, n) for n in values.shape]
    for k in range(n_trials):
        rng = np.random.default_rng([k, 11])
        corner = [int(rng.integers(0, n - w + 1)) for n, w in zip(values.shape, wide)]
        place = values[tuple(slice(c, c + w) for c, w in zip(corner, wide))]
        yield run_trial(name, place, size=size, max_angle_deg=max_angle_deg, noise=0.5, seed=k)


def share_within(trials: list[Trial], *, angle_deg: float, shift: float) -> float:
    """Share of trials whose pose is within both."""
    return float(np.mean([t.angle_error_deg <= angle_deg and t.shift_error <= shift for t in trials]))


def describing_cost(*, size: int = 128, n_points: int = 300, n_repeats: int = 5) -> tuple[float, int]:
    """CPU time of describing points of a cube over that of ``gaussian_filter(cube, 4)``; and their number."""
    from seismo3d.synthetic import fault_cube

    cube = np.asarray(fault_cube("crossing", seed=3, shape=(size,) * 3).seismic)
    settings = SolidSettings(n_points=n_points)
    n_found = len(describe_solid(Grey(cube), settings))
    ratios = []
    for _ in range(n_repeats):
        start = time.process_time()
        ndimage.gaussian_filter(cube, 4)
        middle = time.process_time()
        describe_solid(Grey(cube), settings)
        ratios.append((time.process_time() - middle) / (middle - start))
    return float(np.median(ratios)), n_found
