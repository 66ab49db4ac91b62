"""The kernels that find a frame's pose, against plain numpy and known poses."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, invert_transform, make_transform
from seismo3d.registration.robust import TUKEY, robust_scale, tukey_weights
from seismo3d.robot import _kernels_pose as kernels

LENS = np.array([65.0, 65.0, 39.5, 29.5])
ANYWHERE = np.eye(4)
CORNER = np.eye(3), np.array([0.6, 0.5, 2.0])
"""A room's corner: planes n . x = d."""
PLANES, BOTH, RAYS = ((True, False),) * 2, ((True, True),) * 2, ((False, True),) * 2


def seen_corner(T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (60, 80, 3) of the corner as a camera at a pose sees them, in the world."""
    grid = np.stack(np.meshgrid(np.arange(80), np.arange(60)), axis=-1)
    ray = np.concatenate([(grid - LENS[2:]) / LENS[:2], np.ones((60, 80, 1))], axis=2) @ T_world_camera[:3, :3].T
    normals, offsets = CORNER
    with np.errstate(divide="ignore"):
        far = (offsets - normals @ T_world_camera[:3, 3]) / (ray @ normals.T)
    which = np.where(far > 0.0, far, np.inf).argmin(axis=2)
    points = T_world_camera[:3, 3] + np.take_along_axis(far, which[:, :, None], axis=2) * ray
    return points, -normals[which]


def landmarks(T_world_camera: np.ndarray, n: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Points, motions of their rows and rays of ``n`` places that a camera sees; a fifth of the rays are wrong."""
    local = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.ones(n)]) * rng.uniform(1.0, 2.5, (n, 1))
    rays = local / local[:, 2:]
    rays[: n // 5, :2] += 0.2
    points = local @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    return points, np.repeat(np.eye(4)[None], n, axis=0), rays


def fit(start: np.ndarray, truth: np.ndarray, marks: tuple[np.ndarray, ...], uses: object, lead: int = 0) -> tuple:
    """Fit a frame taken at ``truth`` to the corner as it is seen from the origin."""
    points, normals = seen_corner(truth)
    back = invert_transform(truth)
    vertices = (points @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
    own = (normals @ back[:3, :3].T).astype(np.float32)
    seen, facing = (part.astype(np.float32) for part in seen_corner(ANYWHERE))
    return kernels.fit_frame(
        start, vertices, own, (4, 2), seen, facing, ANYWHERE, LENS, (0.2, 0.1, 0.06, 0.04), 8.0, *marks,
        (LENS[0], LENS[1]), uses, (lead, 20, 4.0, False), (1e-3, 1e-6), 20,
    )  # fmt: skip


@pytest.mark.parametrize("n", [1, 2, 7, 8, 1001])
def test_scale_is_the_robust_one(n: int, rng: np.random.Generator) -> None:
    magnitude = np.abs(rng.standard_normal(n))
    assert kernels.scale_of(magnitude) == pytest.approx(robust_scale(magnitude), rel=1e-14)
    assert kernels.scale_of(magnitude[:0]) == 0.0


def test_weights_are_tukeys_over_the_variance(rng: np.random.Generator) -> None:
    residual, sigma = rng.standard_normal(400) * 0.01, rng.uniform(0.002, 0.02, 400)
    weights = np.empty(400)
    spread = kernels.weigh_planes(residual, sigma, 0.5, weights)
    assert spread == pytest.approx(robust_scale(residual / sigma), rel=1e-14)
    expected = 0.5 * tukey_weights(residual / sigma, TUKEY * spread) / (sigma * spread) ** 2
    np.testing.assert_allclose(weights, expected, rtol=1e-12)
    miss = np.abs(rng.standard_normal(400))
    miss[:50] = 80.0
    spread, agreeing = kernels.weigh_misses(miss, weights)
    np.testing.assert_allclose(weights, tukey_weights(miss, TUKEY * spread) / spread**2, rtol=1e-12)
    assert agreeing == np.count_nonzero(weights) <= 350


def test_weights_stop_growing_where_all_fits(rng: np.random.Generator) -> None:
    residual, sigma, weights = 1e-9 * rng.standard_normal(50), np.full(50, 0.01), np.empty(50)
    assert kernels.weigh_planes(residual, sigma, 1.0, weights) < 1e-6
    np.testing.assert_allclose(weights, 1.0 / (0.01 * 0.3) ** 2, rtol=1e-9)


@pytest.mark.parametrize("uses", [PLANES, BOTH, RAYS])
def test_a_frame_is_found_where_it_was_taken(uses: object, rng: np.random.Generator) -> None:
    truth = make_transform(exp_rotation([0.02, -0.03, 0.01]), [0.02, -0.01, 0.03])
    steps, T, form, has_pairs, planes, has_rays, marks = fit(ANYWHERE, truth, landmarks(truth, 100, rng), uses)
    assert steps > 1
    np.testing.assert_allclose(T, truth, atol=2e-6)
    assert (has_pairs, has_rays) == uses[0]  # type: ignore[index]
    if has_pairs:
        source, target, normals, weights, residuals, tried, spread, blind = planes
        assert 0.5 * tried < len(weights) <= tried
        carried = source @ T[:3, :3].T + T[:3, 3]
        np.testing.assert_allclose(residuals, ((carried - target) * normals).sum(axis=1), atol=1e-5)
        assert spread < 0.01
        assert blind.shape == (6, 0)
        assert (weights > 0.0).mean() > 0.9
    if has_rays:
        assert (marks[0][:20] == 0.0).all()
        assert marks[2] == 80 == np.count_nonzero(marks[0])
    # the form has its minimum there
    Q, A, t, source_centre, target_centre, size = form
    z = np.concatenate([A.ravel(order="F"), t, [1.0]])
    np.testing.assert_allclose(A, T[:3, :3], atol=1e-12)
    np.testing.assert_allclose(size * t + target_centre - A @ source_centre, T[:3, 3], atol=1e-12)
    for axis in np.eye(3):
        other = np.concatenate([(exp_rotation(1e-3 * axis) @ A).ravel(order="F"), t, [1.0]])
        assert z @ Q @ z < other @ Q @ other


def test_landmarks_lead_from_afar(rng: np.random.Generator) -> None:
    """From 0.3 rad off planes pair with the wrong walls; landmarks, which are named, do not."""
    truth, far = make_transform(exp_rotation([0.0, 0.02, 0.0]), [0.01, 0.0, 0.0]), np.eye(4)
    far[:3, :3] = exp_rotation([0.1, 0.3, -0.2])
    marks = landmarks(truth, 100, rng)
    led = fit(far, truth, marks, BOTH, lead=2)
    np.testing.assert_allclose(led[1], truth, atol=2e-6)
    alone = fit(far, truth, tuple(part[:0] for part in marks), PLANES)
    assert np.abs(alone[1] - truth).max() > 1e-3


def test_nothing_to_fit_by_is_said(rng: np.random.Generator) -> None:
    few = landmarks(ANYWHERE, kernels.LEAST_RAYS - 1, rng)
    steps, T, _, has_pairs, _, has_rays, _ = fit(ANYWHERE, ANYWHERE, few, RAYS)
    assert (steps, has_pairs, has_rays) == (0, False, False)
    np.testing.assert_array_equal(T, ANYWHERE)
    behind = make_transform(exp_rotation([0.0, np.pi - 0.1, 0.0]), np.zeros(3))
    assert fit(behind, ANYWHERE, few, PLANES)[0] == 0
