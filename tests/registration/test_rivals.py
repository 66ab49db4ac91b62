"""Answers elsewhere that leave open which is right, and what tells them from it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.geometry.voxels import VoxelMap, voxel_levels
from seismo3d.registration import rivals
from seismo3d.registration.register import register


def faces(rng: np.random.Generator, low: np.ndarray, high: np.ndarray, n: int, which: str = "xXyYzZ") -> np.ndarray:
    """Points on faces of a box: small letters for the lower ones."""
    sides = high - low
    areas = np.array([sides.prod() / sides["xyz".index(letter.lower())] for letter in which])
    drawn = rng.choice(len(which), size=n, p=areas / areas.sum())
    axes = np.array(["xyz".index(letter.lower()) for letter in which])[drawn]
    points = rng.uniform(size=(n, 3))
    points[np.arange(n), axes] = np.array([float(letter.isupper()) for letter in which])[drawn]
    return low + points * sides


def furnished_room(rng: np.random.Generator, noise: float) -> np.ndarray:
    """A room of 5.6 by 4.1 m with five pieces of furniture."""
    parts = [faces(rng, np.zeros(3), np.array([5.6, 4.1, 2.5]), 9000)]
    for x, y, a, b, h in (
        (0.2, 0.3, 1.2, 0.6, 1.7), (3.4, 0.1, 0.8, 0.9, 0.7), (2.0, 2.6, 1.5, 0.8, 0.8),
        (4.7, 2.4, 0.5, 1.0, 1.9), (0.6, 3.2, 0.7, 0.5, 1.1),
    ):  # fmt: skip
        low = np.array([x, y, 0.0])
        parts.append(faces(rng, low, low + np.array([a, b, h]), 900, "xXyYZ"))
    points = np.vstack(parts)
    return points + noise * rng.normal(size=points.shape)


def part_of_a_room(rng: np.random.Generator, side: float) -> np.ndarray:
    """Walls, floor and ceiling of three quarters of a bare room."""
    points = faces(rng, np.array([-2.5, -2.0, -1.3]), np.array([2.5, 2.0, 1.3]), 12000)
    points += 0.003 * rng.normal(size=points.shape)
    return points[side * points[:, :2] @ [0.6, 0.8] < 1.2]


def voxels(points: np.ndarray) -> VoxelMap:
    """The finest level, of voxels a fifth wide."""
    low, high = points.min(axis=0), points.max(axis=0)
    return voxel_levels(points, center=np.zeros(3), factor=1.0, voxel_size=0.2, n_levels=1, low=low, high=high)[0]


@pytest.mark.parametrize("angle", [2.0, 2.6, 3.1])
def test_a_room_with_furniture_tells_how_it_is_turned(rng: np.random.Generator, angle: float) -> None:
    T = make_transform(exp_rotation([0.0, 0.0, angle]), [1.0, -2.0, 0.3])
    target, source = furnished_room(rng, 0.02), furnished_room(rng, 0.02)
    found = register(transform_points(T, target), source)
    assert found.state == "converged"
    np.testing.assert_allclose(found.T_target_source, T, atol=0.03)


def test_a_start_nearby_says_which_part_of_a_room_is_meant(rng: np.random.Generator) -> None:
    T = make_transform(exp_rotation([0.0, 0.0, 0.5]), [0.2, -0.1, 0.1])
    target, source = transform_points(T, part_of_a_room(rng, 1.0)), part_of_a_room(rng, -1.0)
    assert register(target, source).state == "ambiguous"
    near = make_transform(exp_rotation([0.03, -0.04, 0.05]), [0.1, -0.08, 0.05]) @ T
    found = register(target, source, start=near)
    assert found.state == "converged"
    np.testing.assert_allclose(found.T_target_source, T, atol=0.02)


def test_the_answer_much_nearer_to_a_start_is_meant(rng: np.random.Generator) -> None:
    level = voxels(rng.uniform(-1, 1, size=(500, 3)))
    task: Any = SimpleNamespace(pair=SimpleNamespace(target=[level], source=[level]))

    def end(x: float) -> Any:
        return SimpleNamespace(A=np.eye(3), t=np.array([x, 0.0, 0.0]))

    near, far, farther = end(0.2), end(-0.5), end(3.0)
    assert rivals.meant_by_start(task, end(0.0), [far, near, farther]) is near
    assert rivals.meant_by_start(task, end(-0.1), [far, near, farther]) is None


def test_amid_is_deep_within_the_hull(rng: np.random.Generator) -> None:
    level = voxels(faces(rng, -np.ones(3), np.ones(3), 3000))
    known = np.ones(len(level.surface), dtype=bool)
    hull = rivals._hull(level, known)
    points = np.array([[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.4, 0.0, 0.0], [2.0, 0.0, 0.0]])
    np.testing.assert_array_equal(rivals._is_amid(points, hull, 0.3), [True, False, True, False])
    assert rivals._hull(level, np.zeros(len(level.surface), dtype=bool)) is None
    assert not rivals._is_amid(points, None, 0.0).any()
