"""What chance explains is no answer: unrelated scans, and scans that share a part, seen from anywhere."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from seismo3d.geometry.rotations import exp_rotation, make_transform, rotation_angle, transform_points
from seismo3d.registration.chance import apart
from seismo3d.registration.register import register


def terrain(rng: np.random.Generator, seed: int, shift: float = 0.0) -> np.ndarray:
    """Points on one of many hilly grounds, 12 by 12, from a place on."""
    noise = np.random.default_rng(seed).normal(size=(120, 180))
    height = 36.0 * gaussian_filter(noise, 6)
    xy = rng.uniform(0.0, 12.0, (5000, 2)) + np.array([0.0, shift])
    z = map_coordinates(height, 9.0 * xy.T, order=1)
    return np.column_stack([xy - 6.0, 0.25 * z + 0.01 * rng.normal(size=len(z))])


def outline(rng: np.random.Generator, seed: int) -> np.ndarray:
    shape = 0.15 * np.random.default_rng(seed).normal(size=(6, 2)) / np.arange(1, 7)[:, None]
    angle = rng.uniform(0, 2 * np.pi, 2000)
    waves = np.arange(1, 7)[:, None] * angle
    radius = 1.0 + (shape[:, :1] * np.cos(waves) + shape[:, 1:] * np.sin(waves)).sum(axis=0)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]) + 0.005 * rng.normal(size=(2000, 2))


def ball_and_box(rng: np.random.Generator) -> np.ndarray:
    box = rng.uniform(-1, 1, size=(3000, 3))
    side = rng.integers(0, 3, 3000)
    box[np.arange(3000), side] = np.sign(box[np.arange(3000), side])
    ball = rng.normal(size=(2000, 3))
    return np.vstack(
        [box * [4.0, 3.0, 1.0], 2.0 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + [2.0, 1.0, 2.0]]
    )


@pytest.mark.parametrize("seed", range(3))
def test_unrelated_scans_do_not_converge(rng: np.random.Generator, seed: int) -> None:
    assert register(terrain(rng, seed), ball_and_box(rng)).state == "poor_fit"
    assert register(outline(rng, seed), outline(rng, seed + 10)).state == "poor_fit"


@pytest.mark.parametrize("model", ["rigid", "similarity"])
def test_unrelated_images_do_not_converge(model: str) -> None:
    one, two = (
        255.0 * (gaussian_filter(np.random.default_rng(seed).normal(size=(160, 200)), 3) > 0) for seed in (1, 2)
    )
    found = register(gaussian_filter(one, 1.0), gaussian_filter(two, 1.0), model=model)
    assert found.state == "poor_fit"


@pytest.mark.parametrize("angle", [0.2, 2.5])
def test_scans_that_share_a_part_converge_from_anywhere(rng: np.random.Generator, angle: float) -> None:
    T = make_transform(exp_rotation([0.1, 0.0, angle]), [0.5, -0.2, 0.1])
    for seed in range(3):
        source = terrain(rng, seed, shift=5.0)  # seven twelfths in common
        found = register(transform_points(T, terrain(rng, seed)), source)
        assert found.state == "converged"
        off = np.linalg.inv(T) @ found.T_target_source
        assert rotation_angle(off[:3, :3]) < 0.02


def half_seen_box(rng: np.random.Generator, side: float) -> np.ndarray:
    """The faces of a box that are seen from the front, above, and one side."""
    size = np.array([1.6, 1.2, 0.8])
    points = rng.uniform(-0.5, 0.5, size=(6000, 3))
    axis = rng.choice(3, size=6000, p=[0.2, 0.3, 0.5])
    points[np.arange(6000), axis] = np.array([0.5 * side, 0.5, 0.5])[axis]
    return points * size + 0.003 * rng.normal(size=points.shape)


def half_seen_room(rng: np.random.Generator, side: float) -> np.ndarray:
    """Walls, floor and ceiling of three fifths of a bare room."""
    points = rng.uniform(-0.5, 0.5, size=(12000, 3))
    axis = rng.choice(3, size=12000, p=[0.23, 0.29, 0.48])
    points[np.arange(12000), axis] = np.sign(points[np.arange(12000), axis]) / 2
    points *= [5.0, 4.0, 2.6]
    points += 0.003 * rng.normal(size=points.shape)
    return points[side * points[:, :2] @ [0.8, 0.6] < 0.4]


@pytest.mark.parametrize("half_seen", [half_seen_box, half_seen_room])
def test_parts_of_a_symmetric_shape_do_not_tell_which_they_are(rng: np.random.Generator, half_seen) -> None:
    T = make_transform(exp_rotation([0.0, 0.0, 0.5]), [0.2, -0.1, 0.1])
    found = register(transform_points(T, half_seen(rng, 1.0)), half_seen(rng, -1.0))
    assert found.state == "ambiguous"
    assert not found.converged
    same = register(transform_points(T, half_seen(rng, 1.0)), half_seen(rng, 1.0))
    assert same.converged
    np.testing.assert_allclose(same.T_target_source, T, atol=0.01)


@pytest.mark.parametrize("angle", [0.3, 1.5, 3.0])
def test_what_turns_a_ball_or_turns_a_plane_over_leads_nowhere_else(rng: np.random.Generator, angle: float) -> None:
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre = np.array([3.0, 1.0, 0.0])
    ball = np.column_stack([directions + centre, np.ones(500), directions, np.ones(500)]).astype(np.float32)
    ball[:9, 3], ball[:9, 4:7] = 0.0, [1.0, 0.0, 0.0]  # normals that are not known
    R = exp_rotation(angle * np.array([0.6, 0.0, 0.8]))
    turned = _end(R, centre - R @ centre)
    assert apart(ball, _end(np.eye(3), np.zeros(3)), turned) < 1e-6
    assert apart(ball, _end(np.eye(3), np.zeros(3)), _end(R, np.zeros(3))) > 0.2
    plane = ball.copy()
    plane[:, :3] = rng.uniform(-1, 1, size=(500, 3)) * [1.0, 1.0, 0.0]
    plane[:, 3:7] = [1.0, 0.0, 0.0, 1.0]
    over = _end(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    assert apart(plane, _end(np.eye(3), np.zeros(3)), over) < 1e-6


def _end(A: np.ndarray, t: np.ndarray) -> Any:
    """An answer, as far as its place is asked for."""
    return SimpleNamespace(A=A, t=t)


def test_along_a_plane_there_is_no_elsewhere(rng: np.random.Generator) -> None:
    ground = [np.column_stack([rng.uniform(0, 9, 4000) + x, rng.uniform(0, 6, 4000), np.zeros(4000)]) for x in (0, 5)]
    found = register(ground[0], ground[1])
    assert found.state == "converged"
    assert len(found.unobservable) == 3
