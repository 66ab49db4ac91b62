"""The matching pass against plain numpy, and the pieces of the loop."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.geometry.voxels import voxel_levels
from seismo3d.registration import _kernels_pass as pass_kernels
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.acceleration import Accelerator
from seismo3d.registration.initial import poses_by_features
from seismo3d.registration.matching import PATCH, Memory, match_surface, surface_meat
from seismo3d.registration.quadratic import plane_form
from seismo3d.registration.robust import TUKEY, robust_scale, tukey_weights
from seismo3d.registration.terms import FeatureTerm


def ellipsoid_levels(rng, n, d=3):
    p = rng.normal(size=(n, d))
    p *= np.array([1.0, 0.8, 0.6])[:d] / np.linalg.norm(p, axis=1, keepdims=True)
    return voxel_levels(
        p, center=np.zeros(d), factor=1.0, voxel_size=0.06, n_levels=2, low=p.min(axis=0), high=p.max(axis=0)
    )


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("n_threads", [1, 3])
def test_pass_equals_numpy(d, n_threads, rng):
    target, source = ellipsoid_levels(rng, 20000, d)[0], ellipsoid_levels(rng, 20000, d)[0]
    A = exp_rotation([0.02, 0.01, -0.02]) if d == 3 else exp_rotation([0.02])
    t = np.full(d, 0.01)
    cutoff = 0.03
    found = match_surface(
        source.surface, target, A, t, radius=0.06, cutoff=cutoff, least_cosine=0.0, n_threads=n_threads
    )
    moved = source.surface[:, :d].astype(np.float64) @ A.T + t
    rows = np.flatnonzero(np.isfinite(found.residuals) & (target.surface[found.partners, 3] > 0))
    q = target.surface[found.partners[rows]].astype(np.float64)
    residuals = ((moved[rows] - q[:, :d]) * q[:, 4 : 4 + d]).sum(axis=1)
    np.testing.assert_allclose(found.residuals[rows], residuals, atol=1e-6)
    weights = q[:, 3] * q[:, 7] * source.surface[rows, 7] * tukey_weights(residuals, cutoff)
    form = plane_form(q[:, :d], source.surface[rows, :d].astype(np.float64), q[:, 4 : 4 + d], weights)
    assert rows.size > 0.9 * len(moved)
    if rows.size == np.isfinite(found.residuals).sum():
        np.testing.assert_allclose(found.form, form, rtol=1e-5, atol=1e-6 * np.abs(form).max())
    else:
        np.testing.assert_allclose(found.form, form, atol=0.02 * np.abs(form).max())


def test_pass_does_not_depend_on_threads(rng):
    target, source = ellipsoid_levels(rng, 30000)[0], ellipsoid_levels(rng, 30000)[0]
    runs = [
        match_surface(source.surface, target, np.eye(3), np.zeros(3), radius=0.06, cutoff=0.02, n_threads=n).form
        for n in (1, 2, 5)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])


@pytest.mark.parametrize("d", [2, 3])
def test_remembered_partners_are_those_of_a_new_search(d, rng):
    target, source = ellipsoid_levels(rng, 20000, d)[0], ellipsoid_levels(rng, 20000, d)[0]
    target.surface[:, :3] = target.moments[:, 1:4] / target.moments[:, :1]  # each in its own cell
    memory = Memory.of(len(source.surface))
    kept = []
    for step in (0.0, 0.001, 0.002, -0.004, 0.012, 0.011, 0.3, 0.299):  # voxels are 0.06 wide
        A = exp_rotation([step, -step, 0.5 * step]) * (1.0 + step) if d == 3 else exp_rotation([step]) * (1.0 + step)
        t = np.full(d, step)
        before = memory.places.copy()
        settings = {"radius": 0.09, "cutoff": 0.05, "n_threads": 2}
        found = match_surface(source.surface, target, A, t, memory=memory, **settings)
        fresh = match_surface(source.surface, target, A, t, **settings)
        np.testing.assert_array_equal(found.partners, fresh.partners)
        np.testing.assert_array_equal(found.form, fresh.form)
        kept.append((memory.places == before).all(axis=1).mean())
    assert min(kept[1:3] + kept[5:6] + kept[7:8]) > (0.6 if d == 3 else 0.4)
    assert max(kept[0], kept[6]) < 0.01


def test_memory_ends_where_normals_asked_for_move_elements(rng):
    p = rng.normal(size=(20000, 3)) * [1.0, 1.0, 0.01]
    source, *targets = (
        voxel_levels(
            p,
            center=np.zeros(3),
            factor=1.0,
            voxel_size=0.06,
            n_levels=2,
            low=p.min(axis=0),
            high=p.max(axis=0),
            fine_normals=fine,
        )[0]
        for fine in ("all", "asked", "asked")
    )
    place = {"A": np.eye(3), "t": np.array([0.03, 0.0, 0.02]), "radius": 0.09, "cutoff": 0.05}
    found = match_surface(source.surface, targets[0], memory=Memory.of(len(source.surface)), **place)
    fresh = match_surface(source.surface, targets[1], **place)
    assert (np.abs(targets[0].surface[:, :3] - targets[0].moments[:, 1:4] / targets[0].moments[:, :1]) > 1e-4).any()
    assert (found.partners != fresh.partners).mean() < 1e-3  # joined elements lie where a search may not look
    np.testing.assert_allclose(found.form, fresh.form, atol=1e-3 * np.abs(fresh.form).max())


@pytest.mark.parametrize("n", [1, 2, 3, 8, 1001, 4000])
def test_what_a_pass_leaves_equals_numpy(n, rng):
    residuals = rng.normal(size=n).astype(np.float32) * np.float32(10.0) ** rng.integers(-9, 3, n).astype(np.float32)
    residuals[rng.integers(0, n, n // 3)] = residuals[0]
    partners = rng.integers(-1, 500, n).astype(np.int32)
    lost = rng.uniform(size=n) < 0.3
    lost[0] = False
    residuals[lost] = np.nan
    rows = pass_kernels.rows_asked_for(residuals, partners, 500)
    np.testing.assert_array_equal(rows, np.unique(partners[lost & (partners >= 0)]))
    total, mean_square, middle = pass_kernels.sum_blocks(rng.normal(size=(3, 4)), residuals)
    seen = residuals[~lost]
    assert total.shape == (4,)
    assert mean_square == pytest.approx((seen.astype(np.float64) ** 2).mean())
    assert middle == np.median(np.abs(seen))


def test_a_pass_that_saw_nothing_has_no_scale():
    total, mean_square, middle = pass_kernels.sum_blocks(np.ones((2, 3)), np.full(5, np.nan, dtype=np.float32))
    np.testing.assert_array_equal(total, [2.0, 2.0, 2.0])
    assert (mean_square, middle) == (0.0, 0.0)
    assert pass_kernels.rows_asked_for(np.empty(0, np.float32), np.empty(0, np.int32), 5).size == 0


def test_meat_equals_numpy(rng):
    target, source = ellipsoid_levels(rng, 8000)[0], ellipsoid_levels(rng, 8000)[0]
    A, t, cutoff = exp_rotation([0.02, 0.01, -0.02]), np.full(3, 0.01), 0.03
    seen = match_surface(source.surface, target, A, t, radius=0.06, cutoff=cutoff)
    J = parameter_jacobian(A, 1)
    found = J.T @ surface_meat(seen, source.surface, target, cutoff, J)[:12, :12] @ J
    used = np.flatnonzero(np.abs(seen.residuals) < cutoff)
    partners = target.surface[seen.partners[used]].astype(np.float64)
    places = np.column_stack([source.surface[used, :3].astype(np.float64), np.ones(len(used))])
    rows = np.einsum("ni,nj->nij", places, seen.normals[used]).reshape(len(used), 12) @ J
    quality = np.where(partners[:, 3] > 0, partners[:, 3], source.surface[used, 3])
    weights = quality * partners[:, 7] * source.surface[used, 7] * tukey_weights(seen.residuals[used], cutoff)
    H = rows.T @ (rows * weights[:, None])
    keys = target.keys[seen.partners[used]]
    patches = np.stack([keys >> 42, keys >> 21 & 0x1FFFFF, keys & 0x1FFFFF], axis=1) // PATCH
    owner = np.unique(patches, axis=0, return_inverse=True)[1]
    meat = np.zeros((6, 6))
    for k in range(owner.max() + 1):
        own, w = rows[owner == k], weights[owner == k]
        without = np.eye(6) - own.T @ (own * w[:, None]) @ np.linalg.inv(H)
        score = np.linalg.solve(without, own.T @ (w * seen.residuals[used][owner == k]))
        meat += np.outer(score, score)
    np.testing.assert_allclose(found, meat, atol=0.01 * np.abs(meat).max())  # the curvature has a small share added


def test_tukey_weights_vanish_from_the_cutoff_on():
    np.testing.assert_allclose(tukey_weights(np.array([0.0, 0.5, 1.0, 2.0]), 1.0), [1.0, 0.5625, 0.0, 0.0])


def test_robust_scale_of_a_normal_law(rng):
    r = 0.3 * rng.normal(size=20000)
    r[:4000] = 50.0
    assert robust_scale(r) == pytest.approx(0.3, rel=0.35)  # a fifth of outliers moves the median by a quarter
    assert TUKEY == 4.685


def test_acceleration_solves_a_linear_iteration_in_as_many_steps_as_dimensions(rng):
    M = np.diag([0.9, 0.5, -0.3])
    b = rng.normal(size=3)
    solution = np.linalg.solve(np.eye(3) - M, b)
    memory, x = Accelerator(5), np.zeros(3)
    for _ in range(6):
        after = M @ x + b
        mixed = memory.extrapolate(x, after)
        x = after if mixed is None else mixed
    np.testing.assert_allclose(x, solution, atol=1e-3 * np.abs(solution).max())


@pytest.mark.parametrize("d", [2, 3])
def test_pose_from_matches_with_most_of_them_wrong(d, rng):
    T = make_transform(exp_rotation([1.0, 2.0, -0.5] if d == 3 else [2.0]), rng.normal(size=d))
    p = rng.uniform(-1, 1, size=(150, d))
    q = transform_points(T, p) + 0.003 * rng.normal(size=p.shape)
    q[:90] = rng.uniform(-2, 2, size=(90, d))
    term = FeatureTerm(q, p, np.broadcast_to(np.eye(d), (150, d, d)).copy(), 1e-3)
    A, t = next(poses_by_features(term, n_poses=3, reach=0.03))
    np.testing.assert_allclose(make_transform(A, t), T, atol=0.01)


def test_poses_that_share_the_matches_are_all_given(rng):
    truth = [
        make_transform(exp_rotation(turn), shift)
        for turn, shift in (([0.0, 0.0, 0.4], [0.3, 0.0, 0.0]), ([0.0, 0.9, 0.0], [0.0, -0.5, 0.2]))
    ]
    p = rng.uniform(-1, 1, size=(200, 3))
    q = np.concatenate([transform_points(truth[0], p[:120]), transform_points(truth[1], p[120:])])
    term = FeatureTerm(q, p, np.broadcast_to(np.eye(3), (200, 3, 3)).copy(), 1e-3)
    found = [make_transform(A, t) for A, t in poses_by_features(term, n_poses=2, reach=0.03)]
    assert len(found) == 2
    for T, expected in zip(found, truth):
        np.testing.assert_allclose(T, expected, atol=1e-9)


def test_no_pose_from_matches_that_agree_with_none(rng):
    term = FeatureTerm(
        rng.uniform(-1, 1, (2, 3)), rng.uniform(-1, 1, (2, 3)), np.broadcast_to(np.eye(3), (2, 3, 3)).copy(), 1e-3
    )
    assert list(poses_by_features(term, n_poses=2, reach=0.03)) == []
