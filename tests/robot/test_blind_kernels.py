"""What planes do not see, told apart from what the noise of normals feigns: known surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation
from seismo3d.robot import _kernels_blind as kernels

RATIO = 1e-5


def look_at(kind: str, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) about their middle, nearly, and normals of a surface along z."""
    points, normals = rng.uniform(-1.0, 1.0, (n, 3)), np.zeros((n, 3))
    side = rng.integers(0, {"wall": 1, "corridor": 2, "corner": 3}.get(kind, 1), n)
    if kind == "tunnel":
        normals[:, :2] = points[:, :2] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        points[:, :2] = normals[:, :2]
    elif kind == "ball":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        normals = points.copy()
    else:
        normals[np.arange(n), side] = 1.0
        points[np.arange(n), side] = 1.0 if kind == "corner" else rng.choice([-1.0, 1.0], n)
        if kind == "wall":
            points[:, 0] = 0.0
    return points, normals


def waver(normals: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
    turned = normals + size * rng.standard_normal(normals.shape)
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def blind_of(points: np.ndarray, looks: list[np.ndarray], weights: np.ndarray) -> np.ndarray:
    return kernels.blind_motions(*kernels.two_looks(points, *looks, weights), RATIO)


EXPECTED = {
    "wall": [[1, 0, 0, 0, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]],
    "corridor": [[0, 0, 0, 0, 0, 1]],
    "tunnel": [[0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 1]],
    "ball": np.eye(6)[:3],
    "corner": np.zeros((0, 6)),
}


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.2])
@pytest.mark.parametrize("kind", list(EXPECTED))
def test_motions_along_bare_surfaces_are_blind_whatever_the_noise(
    kind: str, noise: float, rng: np.random.Generator
) -> None:
    points, normals = look_at(kind, 1200, rng)
    turn = exp_rotation([0.3, -0.5, 0.2])
    points, looks = points @ turn.T, [waver(normals, noise, rng) @ turn.T for _ in range(2)]
    found = blind_of(points, looks, rng.uniform(0.5, 1.0, 1200))
    expected = np.array(EXPECTED[kind], dtype=float) @ np.kron(np.eye(2), turn).T
    assert found.shape == (6, len(expected))
    np.testing.assert_allclose(found.T @ found, np.eye(len(expected)), atol=1e-12)
    # the same subspace: normals that are off by 0.2 rad turn it by 0.2 rad over the root of their number
    np.testing.assert_allclose(found @ found.T @ expected.T, expected.T, atol=0.03 if noise else 1e-6)


def test_what_both_looks_see_in_the_noise_is_seen(rng: np.random.Generator) -> None:
    """A door's frame, one in fifty points, tells as much as a seventh of what the noise of all feigns."""
    points, normals = look_at("corridor", 4000, rng)
    normals[:80] = [0.0, 0.0, 1.0]
    looks = [waver(normals, 0.15, rng) for _ in range(2)]
    weights = np.ones(4000)
    agreed, noise = kernels.two_looks(points, *looks, weights)
    along = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    assert along @ agreed @ along == pytest.approx(80.0, rel=0.25)
    assert along @ noise @ along == pytest.approx(4000 * 2 * 0.15**2, rel=0.1)
    assert blind_of(points, looks, weights).shape[1] == 0
    # one look alone cannot tell it from a bare corridor with a little more noise
    assert blind_of(points[80:], [look[80:] for look in looks], weights[80:]).shape[1] == 1


def test_information_is_that_of_plain_sums(rng: np.random.Generator) -> None:
    points, one, two = (rng.standard_normal((50, 3)) for _ in range(3))
    weights = rng.uniform(0.0, 1.0, 50) * (rng.random(50) < 0.8)
    agreed, noise = kernels.two_looks(points, one, two, weights)
    a, b = (np.hstack([np.cross(points, normals), normals]) for normals in (one, two))
    cross = (a * weights[:, None]).T @ b
    np.testing.assert_allclose(agreed, (cross + cross.T) / 2.0, atol=1e-12)
    np.testing.assert_allclose(noise, ((a - b) * weights[:, None]).T @ (a - b), atol=1e-12)


def test_nothing_is_seen_of_nothing() -> None:
    np.testing.assert_array_equal(kernels.blind_motions(np.zeros((6, 6)), np.zeros((6, 6)), RATIO), np.eye(6))
