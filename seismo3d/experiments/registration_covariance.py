"""Is the covariance honest: the normalised squared error of noisy repeats, over its degrees of freedom, is 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import exp_rotation, log_rotation, make_transform, transform_points
from seismo3d.registration.align import align_pairs
from seismo3d.registration.register import register


def hill(rng: np.random.Generator, n: int) -> Float64Array:
    """Return points on a smooth hill of two units' width."""
    u, v = rng.uniform(-1, 1, size=(2, n))
    return np.column_stack([u, v, 0.25 * np.sin(4 * u) * np.cos(3 * v) + 0.1 * u * v])


def corner(rng: np.random.Generator, n: int) -> Float64Array:
    """Return points on the floor and two walls of a room."""
    points = rng.uniform(0, 1, size=(n, 3)) * [2.0, 3.0, 1.5]
    points[np.arange(n), rng.integers(0, 3, n)] = 0.0
    return points


def ellipsoid(rng: np.random.Generator, n: int) -> Float64Array:
    """Return points on an ellipsoid."""
    points = rng.normal(size=(n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * [1.0, 0.8, 0.6]


SHAPES: dict[str, Callable[[np.random.Generator, int], Float64Array]] = {
    "hill": hill,
    "corner": corner,
    "ellipsoid": ellipsoid,
}


def normalised_error(T: Float64Array, covariance: Float64Array, truth: Float64Array) -> float:
    """Return x' C^-1 x over its degrees of freedom, x the perturbation on the left of a rigid motion."""
    off = T @ np.linalg.inv(truth)
    x = np.concatenate([log_rotation(off[:3, :3]), off[:3, 3]])
    return float(x @ np.linalg.solve(covariance, x)) / x.size


def repeat_pairs(*, n_repeats: int, noise: float = 0.01, seed: int = 0) -> float:
    """Return the mean normalised error of the exact solve of noisy plane pairs."""
    rng = np.random.default_rng(seed)
    p, normals = rng.normal(size=(80, 3)) + 5.0, rng.normal(size=(80, 3))
    truth = make_transform(exp_rotation(rng.normal(size=3)), rng.normal(size=3))
    errors = []
    for _ in range(n_repeats):
        q = transform_points(truth, p) + noise * rng.normal(size=p.shape)
        found = align_pairs(q, p, normals=normals)
        errors.append(normalised_error(found.T_target_source, found.covariance, truth))
    return float(np.mean(errors))


def repeat_scans(shape: str, *, n_points: int, noise: float, n_repeats: int, seed: int = 0) -> float:
    """Return the mean normalised error of whole registrations of scans with samples and noise of their own."""
    rng = np.random.default_rng(seed)
    errors = []
    for _ in range(n_repeats):
        truth = make_transform(exp_rotation(0.05 * rng.normal(size=3)), 0.05 * rng.normal(size=3))
        target = transform_points(truth, SHAPES[shape](rng, n_points))
        source = SHAPES[shape](rng, n_points)
        target += noise * rng.normal(size=target.shape)
        source += noise * rng.normal(size=source.shape)
        found = register(target, source, stages=("local",))
        errors.append(normalised_error(found.T_target_source, found.covariance, truth))
    return float(np.mean(errors))


def report(*, n_repeats: int) -> dict[str, float]:
    """Print and return the mean normalised errors."""
    figures = {"given plane pairs": repeat_pairs(n_repeats=n_repeats)}
    print(f"{'given plane pairs':36} {figures['given plane pairs']:6.3f}")
    for shape in SHAPES:
        for n_points, noise in ((5000, 0.003), (20000, 0.002), (20000, 0.004), (20000, 0.01), (20000, 0.015)):
            name = f"{shape}, {n_points} points, noise {noise:g}"
            figures[name] = repeat_scans(shape, n_points=n_points, noise=noise, n_repeats=n_repeats)
            print(f"{name:36} {figures[name]:6.3f}", flush=True)
    return figures
