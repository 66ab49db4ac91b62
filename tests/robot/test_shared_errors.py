"""Errors that pixels share, on frames whose pairs, residuals and lens are known."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import adjoint, exp_rotation, make_transform
from seismo3d.registration.align import align_pairs
from seismo3d.robot import _kernels_shared as kernels
from seismo3d.robot.ekf import log_motion
from seismo3d.robot.landmarks import Sightings, View
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.shared_errors import find_shared_errors
from seismo3d.robot.tracking import Located, PlanePairs

LENS = PinholeCamera(260.0, 260.0, 159.5, 119.5, (), 1.0, 320, 240)
BASE = make_transform(exp_rotation([0.02, -0.1, 0.03]), [0.1, -0.05, 0.2])
FRAME = make_transform(exp_rotation([0.05, 0.15, -0.02]), [0.3, 0.1, -0.1])
STRAINS = np.zeros((4, 3, 3))
STRAINS[0], STRAINS[1] = np.eye(3), np.diag([1.0, 1.0, 0.0])
STRAINS[2, 0, 2] = STRAINS[3, 1, 2] = 1.0


def view_at(T: np.ndarray) -> View:
    return View(T, np.empty((0, 0), np.uint8), np.empty((0, 2)), np.empty((0, 3)))


def look_into_a_corner(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of three walls that the frame's camera sees, all over its image, and their normals."""
    pixels = rng.uniform([0.0, 0.0], [319.0, 239.0], (n, 2))
    rays = np.column_stack([LENS.rays(pixels), np.ones(n)]) @ FRAME[:3, :3].T
    walls = FRAME[:3, :3] @ exp_rotation([-0.6, 0.6, 0.2])
    across = rays @ walls
    far = (np.where(across > 0.0, 2.0, -2.0) - FRAME[:3, 3] @ walls) / across
    return FRAME[:3, 3] + far.min(axis=1)[:, None] * rays, -walls[:, far.argmin(axis=1)].T


def locate_pairs(
    points: np.ndarray, normals: np.ndarray, residuals: np.ndarray, *, sigma: float = 0.002, n_marks: int = 0
) -> tuple[Located, Sightings]:
    """What locating a frame by its planes gives, and by landmarks at some of the points, free of error."""
    source = (points - FRAME[:3, 3]) @ FRAME[:3, :3]
    pairs = PlanePairs(
        source, points, normals, np.full(len(points), sigma**-2), residuals, len(points), 1.0, np.empty((6, 0))
    )
    local = source[:n_marks]
    seen = Sightings(
        points[:n_marks], LENS.project(local), local / local[:, 2:], np.tile(np.eye(4), (n_marks, 1, 1)),
        np.zeros(n_marks), np.zeros(n_marks), np.zeros((n_marks, 2), dtype=np.int64),
    )  # fmt: skip
    located = Located(
        FRAME, np.eye(6), len(points), n_marks, 1.0, 1.0, 1.0, True, pairs, np.ones(n_marks), np.empty((0, 6))
    )
    return located, seen


def errors_of(located: Located, seen: Sightings) -> PoseErrors:
    return find_shared_errors(located, seen, [view_at(BASE)], view_at(BASE), LENS)


def test_noise_has_next_to_nothing_in_common_and_what_neighbours_share_is_told(rng: np.random.Generator) -> None:
    """A wave over the image puts a fit off by as much as is told, and noise by far less."""
    points, normals = look_into_a_corner(4000, rng)
    source = (points - FRAME[:3, 3]) @ FRAME[:3, :3]
    told = {"noise": [], "waves": []}  # type: ignore[var-annotated]
    off = []
    for _ in range(30):
        phase, rate = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(3.0, 6.0, 2)
        wave = 0.002 * np.sqrt(2.0) * np.sin(source[:, :2] / source[:, 2:] @ rate * 2.0 + phase)
        for kind, residuals in (("noise", 0.002 * rng.standard_normal(4000)), ("waves", wave)):
            told[kind].append(np.sqrt(np.trace(errors_of(*locate_pairs(points, normals, residuals)).alike)))
        fitted = align_pairs(points, points + wave[:, None] * normals, normals=normals).T_target_source
        off.append(np.linalg.norm(log_motion(fitted)))
    assert np.median(told["noise"]) < 0.2 * np.median(told["waves"])
    assert 0.3 < np.median(off) / np.median(told["waves"]) < 2.0


def test_a_map_too_small_is_off_by_its_share_of_the_way(rng: np.random.Generator) -> None:
    located, seen = locate_pairs(*look_into_a_corner(500, rng), np.zeros(500), n_marks=100)
    by_scale = errors_of(located, seen).by_lens[:, 0]
    np.testing.assert_allclose(by_scale, np.concatenate([np.zeros(3), BASE[:3, 3] - FRAME[:3, 3]]), atol=1e-9)


@pytest.mark.parametrize("n_marks", [0, 200])
@pytest.mark.parametrize("parameter", range(4))
def test_a_pose_moves_with_the_lens_as_told(parameter: int, n_marks: int, rng: np.random.Generator) -> None:
    """Both the map, from the base, and the frame are strained by a little: the best fit of the one to the other."""
    points, normals = look_into_a_corner(600, rng)
    little = 1e-5

    def strained(T: np.ndarray) -> np.ndarray:
        local = (points - T[:3, 3]) @ T[:3, :3]
        return np.asarray((local - little * local @ STRAINS[parameter].T) @ T[:3, :3].T + T[:3, 3])

    located, seen = locate_pairs(points, normals, np.zeros(len(points)), n_marks=n_marks)
    told = errors_of(located, seen).by_lens[:, parameter]
    target, source = strained(BASE), strained(FRAME)
    if n_marks == 0:
        exact = log_motion(align_pairs(target, source, normals=normals).T_target_source) / little
        np.testing.assert_allclose(told, exact, rtol=1e-3, atol=1e-3 * np.abs(exact).max())
        return
    # planes and rays at once, linear in so little
    arms, H, g = points - FRAME[:3, 3], np.zeros((6, 6)), np.zeros(6)
    rows = [(np.concatenate([np.cross(a, n), n]), n @ (p - q), 0.002**-2)
            for a, n, p, q in zip(arms, normals, source, target)]  # fmt: skip
    for a, p, q in zip(arms[:n_marks], source, target):
        local = a @ FRAME[:3, :3]
        for k in range(2):
            across = LENS.fx / local[2] * (FRAME[:3, k] - FRAME[:3, 2] * local[k] / local[2])
            rows.append((np.concatenate([np.cross(a, across), across]), across @ (p - q), 1.0))
    for row, miss, weight in rows:
        H += weight * np.outer(row, row)
        g -= weight * miss * row
    exact = adjoint(make_transform(np.eye(3), FRAME[:3, 3])) @ np.linalg.solve(H, g) / little
    np.testing.assert_allclose(told, exact, rtol=1e-3, atol=1e-3 * np.abs(exact).max())


def test_along_what_is_blind_nothing_is_told(rng: np.random.Generator) -> None:
    points, normals = look_into_a_corner(500, rng)
    located, seen = locate_pairs(points, normals, 0.01 * np.sin(5.0 * points[:, 0]))
    along = np.array([[0.0, 0.0, 0.0, 0.6, 0.0, 0.8]])
    blind = Located(*(along if name == "blind" else getattr(located, name) for name in Located.__slots__))
    errors = errors_of(blind, seen)
    at_camera = errors.moved(make_transform(np.eye(3), -FRAME[:3, 3]))
    np.testing.assert_allclose(along @ at_camera.alike, 0.0, atol=1e-12)
    np.testing.assert_allclose(along @ at_camera.by_lens, 0.0, atol=1e-9)
    assert np.trace(errors.alike) > 0.0


def test_one_wall_without_more_is_not_enough_to_tell() -> None:
    points = np.array([[0.1, 0.0, 2.0], [0.0, 0.1, 2.0], [0.2, 0.1, 2.0]])
    located, seen = locate_pairs(points, np.tile([0.0, 0.0, -1.0], (3, 1)), np.full(3, 0.01))
    errors = errors_of(located, seen)
    assert not errors.alike.any()
    assert not errors.by_lens.any()


def test_the_kernel_gathers_what_plain_arithmetic_does(rng: np.random.Generator) -> None:
    points, normals = look_into_a_corner(40, rng)
    residuals, weights = rng.normal(size=40), rng.uniform(0.5, 2.0, 40)
    weights[3] = 0.0
    source = (points - FRAME[:3, 3]) @ FRAME[:3, :3]
    numbers = np.array([LENS.fx, LENS.fy, LENS.cx, LENS.cy, 320.0, 240.0])
    shifts = np.tile(np.eye(4), (10, 1, 1))
    shifts[:, :3, 3] = 0.01 * rng.normal(size=(10, 3))
    rays, T_views = np.column_stack([rng.uniform(-0.5, 0.5, (10, 2)), np.ones(10)]), np.tile(BASE, (10, 1, 1))
    marks = points[:10].copy(), T_views, shifts, rays, weights[:10]
    H, blocks, own, _ = kernels.gather_shared(FRAME, BASE, (source, normals, weights, residuals), marks, numbers)
    J = np.hstack([np.cross(points - FRAME[:3, 3], normals), normals])
    pulls, places, information = list(weights[:, None] * residuals[:, None] * J), list(source), J.T * weights @ J
    for n in range(10):
        T = FRAME @ shifts[n]
        local = (points[n] - T[:3, 3]) @ T[:3, :3]
        across = LENS.fx / local[2] * (T[:3, :2].T - np.outer(local[:2] / local[2], T[:3, 2]))
        J = np.hstack([np.cross(points[n] - FRAME[:3, 3], across), across])
        pulls.append(weights[n] * (LENS.fx * (rays[n, :2] - local[:2] / local[2])) @ J)
        places.append(rays[n])
        information += weights[n] * J.T @ J
    pixels = np.array([LENS.fx * p[:2] / p[2] + [LENS.cx, LENS.cy] for p in places])
    column, row = np.clip(pixels // 80.0, 0, [3, 2]).astype(int).T
    expected = np.zeros((12, 6))
    np.add.at(expected, row * 4 + column, np.array(pulls))
    np.testing.assert_allclose(H, information)
    np.testing.assert_allclose(blocks, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(own, np.array(pulls).T @ np.array(pulls))
