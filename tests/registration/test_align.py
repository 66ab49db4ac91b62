"""The exact solve of given pairs: known answers, degeneracy, constraints, covariance, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry.rotations import exp_rotation, log_rotation, make_transform, random_rotation
from seismo3d.registration.align import align_pairs
from seismo3d.registration.constraints import Constraints


def make_linear(model, d, rng):
    R = random_rotation(rng, dim=d)
    factors = {"similarity": 1.3, "scaled": rng.uniform(0.5, 2.0, size=d)}
    if model == "translation":
        return np.eye(d)
    if model == "affine":
        return R + 0.3 * rng.normal(size=(d, d))
    return R * factors.get(model, 1.0)


@pytest.mark.parametrize("planes", [False, True])
@pytest.mark.parametrize("model", ["translation", "rigid", "similarity", "scaled", "affine"])
@pytest.mark.parametrize("d", [2, 3])
def test_exact_pairs_give_back_the_transform(d, model, planes, rng):
    A, t = make_linear(model, d, rng), 20 * rng.normal(size=d)
    p = 3 * rng.normal(size=(60, d)) + 50
    found = align_pairs(p @ A.T + t, p, normals=rng.normal(size=(60, d)) if planes else None, model=model)
    np.testing.assert_allclose(found.T_target_source, make_transform(A, t), atol=1e-9)
    assert found.converged
    assert not found.unobservable
    assert (found.certificate is not None) == (model == "rigid")
    assert model != "rigid" or found.certificate.holds


def test_answer_moves_with_the_frames(rng):
    p, n = rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
    q = p + 0.1 * rng.normal(size=p.shape)
    first = align_pairs(q, p, normals=n).T_target_source
    S = make_transform(random_rotation(rng), 1e4 * rng.normal(size=3))
    moved = align_pairs(q @ S[:3, :3].T + S[:3, 3], p, normals=n @ S[:3, :3].T).T_target_source
    np.testing.assert_allclose(np.linalg.inv(S) @ moved, first, atol=1e-10)


def test_order_of_pairs_does_not_matter(rng):
    p, n = rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
    q = p + 0.1 * rng.normal(size=p.shape)
    order = rng.permutation(40)
    np.testing.assert_allclose(
        align_pairs(q, p, normals=n).T_target_source,
        align_pairs(q[order], p[order], normals=n[order]).T_target_source,
        atol=1e-12,
    )


def test_plane_leaves_three_directions_at_the_prior(rng):
    p = np.column_stack([rng.uniform(-1, 1, size=(100, 2)), np.zeros(100)])
    prior = make_transform(exp_rotation([0.0, 0.0, 0.2]), [0.3, 0.4, 0.0])
    found = align_pairs(p + np.array([0, 0, 0.1]), p, normals=np.tile([0.0, 0, 1], (100, 1)), prior=prior)
    assert len(found.unobservable) == 3
    expected = prior.copy()
    expected[2, 3] = 0.1
    np.testing.assert_allclose(found.T_target_source, expected, atol=1e-9)
    assert np.isinf(found.covariance[2, 2])
    assert np.isfinite(found.covariance[0, 0])
    assert found.information[2, 2] < 1e-6 * found.information[0, 0]


def test_corridor_reports_its_axis(rng):
    n = 200
    p = np.column_stack([rng.uniform(-5, 5, n), np.where(np.arange(n) % 2, 1.0, -1.0), rng.uniform(-1, 1, n)])
    normals = np.tile([0.0, 1.0, 0.0], (n, 1))
    normals[: n // 2] = [0.0, 0.0, 1.0]
    found = align_pairs(p, p, normals=normals)
    assert len(found.unobservable) == 1
    np.testing.assert_allclose(
        np.abs(found.unobservable[0].translation) / np.abs(found.unobservable[0].translation).max(),
        [1, 0, 0],
        atol=1e-6,
    )


def test_collinear_points_report_the_rotation_about_their_line(rng):
    p = np.outer(rng.normal(size=20), [1.0, 2.0, 2.0])
    found = align_pairs(p + np.array([1.0, 0, 0]), p)
    assert len(found.unobservable) == 1
    axis = found.unobservable[0].rotation / np.linalg.norm(found.unobservable[0].rotation)
    np.testing.assert_allclose(np.abs(axis), np.array([1, 2, 2]) / 3, atol=1e-6)
    np.testing.assert_allclose(found.T_target_source, make_transform(np.eye(3), [1, 0, 0]), atol=1e-7)


def test_constraints_fix_and_bound(rng):
    p = rng.normal(size=(60, 3))
    q = p @ exp_rotation([0.1, 0.2, 0.3]).T + [1.0, 2.0, 3.0]
    level = align_pairs(
        q, p, constraints=Constraints(rotation=(0, 0, None), translation=(None, None, 0))
    ).T_target_source
    np.testing.assert_allclose(level[2], [0, 0, 1, 0], atol=1e-9)
    bounded = align_pairs(q, p, constraints=Constraints(rotation=(0.05, None, None)))
    assert log_rotation(bounded.T_target_source[:3, :3])[0] == pytest.approx(0.05, abs=1e-9)
    assert bounded.certificate is None
    grown = align_pairs(1.5 * p, p, model="similarity", constraints=Constraints(scale=(0.9, 1.2)))
    assert grown.scale[0] == pytest.approx(1.2, abs=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 0.02, 30.0, 1e3])
@pytest.mark.parametrize("model", ["similarity", "scaled"])
@pytest.mark.parametrize("d", [2, 3])
def test_any_scale_is_exact(d, model, scale, rng):
    R, p = random_rotation(rng, dim=d), rng.normal(size=(40, d))
    q = scale * p @ R.T + np.arange(d)
    found = align_pairs(q, p, model=model)
    np.testing.assert_allclose(found.T_target_source[:d, :d], scale * R, rtol=1e-9, atol=1e-9 * scale)
    assert not found.at_bounds
    assert not found.unobservable


def test_active_bounds_are_told(rng):
    p = rng.normal(size=(60, 3))
    q = 1.5 * p @ exp_rotation([0.1, 0.2, 0.3]).T + [1.0, 2.0, 3.0]
    bounds = Constraints(rotation=(None, 0.05, None), translation=(None, None, 0), scale=(0.5, 1.2))
    assert align_pairs(q, p, model="similarity", constraints=bounds).at_bounds == ("rotation", "scale")
    wide = Constraints(rotation=(1.0, 1.0, 1.0), scale=(0.5, 2.0))
    assert align_pairs(q, p, model="similarity", constraints=wide).at_bounds == ()


def test_loose_constraints_change_nothing(rng):
    p = rng.normal(size=(60, 3))
    q = p @ exp_rotation([0.1, 0.2, 0.3]).T + 0.05 * rng.normal(size=p.shape)
    loose = Constraints(rotation=(2.0, 2.0, 2.0), translation=(9.0, 9.0, (-9.0, 9.0)))
    np.testing.assert_allclose(
        align_pairs(q, p, constraints=loose).T_target_source, align_pairs(q, p).T_target_source, atol=1e-8
    )


def test_features_settle_what_planes_do_not_see(rng):
    p = np.column_stack([rng.uniform(-1, 1, size=(100, 2)), np.zeros(100)])
    T = make_transform(exp_rotation([0.05, 0.02, 0.4]), [0.5, -0.2, 0.1])
    f = rng.uniform(-1, 1, size=(8, 3))
    normal = np.tile(T[:3, 2], (100, 1))
    found = align_pairs(
        p @ T[:3, :3].T + T[:3, 3],
        p,
        normals=normal,
        features=(f @ T[:3, :3].T + T[:3, 3] + 0.01 * rng.normal(size=f.shape), f),
    )
    assert not found.unobservable
    np.testing.assert_allclose(found.T_target_source, T, atol=0.05)  # five sigma of the features
    assert abs(T[:3, 2] @ (found.T_target_source - T)[:3, 3]) < 1e-3  # the planes hold what they see


def test_fixed_alpha_moves_the_answer_between_the_terms(rng):
    p, f = rng.normal(size=(50, 2)), rng.normal(size=(50, 2))
    shifted = (f + np.array([1.0, 0.0]), f)

    def run(alpha):
        return align_pairs(p, p, features=shifted, alpha=alpha, model="translation").T_target_source[0, 2]

    np.testing.assert_allclose([run(0.0), run(0.25), run(1.0)], [0.0, 0.25, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("d", "model", "planes"),
    [(3, "rigid", True), (2, "rigid", False), (3, "similarity", True), (3, "scaled", False), (2, "affine", True)],
)
def test_covariance_is_honest(d, model, planes, rng):
    A, t = make_linear(model, d, rng), 5 * rng.normal(size=d)
    truth = make_transform(A, t)
    p, n = rng.normal(size=(80, d)) + 5, rng.normal(size=(80, d))
    errors = []
    for _ in range(250):
        q = p @ A.T + t + 0.01 * rng.normal(size=p.shape)
        found = align_pairs(q, p, normals=n if planes else None, model=model, prior=truth)
        x = perturbation(found.T_target_source, truth, model)
        errors.append(x @ np.linalg.solve(found.covariance, x) / x.size)
    assert np.mean(errors) == pytest.approx(1.0, abs=0.2)  # 250 repeats: standard error below 0.04


def perturbation(T, truth, model):
    """The (rotation, translation, scale) on the left that leads from the truth to T."""
    d = T.shape[0] - 1
    if model == "affine":
        D = T @ np.linalg.inv(truth)
        return np.concatenate([(D[:d, :d] - np.eye(d)).ravel(order="F"), D[:d, d]])
    s, s0 = np.linalg.norm(T[:d, :d], axis=0), np.linalg.norm(truth[:d, :d], axis=0)
    turn = log_rotation((T[:d, :d] / s) @ (truth[:d, :d] / s0).T)
    growth = np.log(s / s0)
    whole = exp_rotation(turn) * (np.exp(growth[0]) if model == "similarity" else 1.0)
    n_scale = {"rigid": 0, "similarity": 1, "scaled": d}[model]
    return np.concatenate([turn, T[:d, d] - whole @ truth[:d, d], growth[:n_scale]])


def test_refusals(rng):
    p = rng.normal(size=(10, 3))
    with pytest.raises(ShapeError, match="row by row"):
        align_pairs(p[:5], p)
    with pytest.raises(ShapeError, match="NaN"):
        align_pairs(np.where(p > 1, np.nan, p), np.where(p > 1, np.nan, p))
    with pytest.raises(ShapeError, match="empty"):
        align_pairs(np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(GeometryError, match="at least 3"):
        align_pairs(p[:2], p[:2])
    with pytest.raises(GeometryError, match="coincide"):
        align_pairs(p, np.ones_like(p))
    with pytest.raises(ParameterError, match="expected one of"):
        align_pairs(p, p, model="projective")
    with pytest.raises(ParameterError, match="negative"):
        align_pairs(p, p, weights=-np.ones(10))
    with pytest.raises(ParameterError, match="Drop alpha"):
        align_pairs(p, p, alpha=0.5)
    with pytest.raises(ParameterError, match="feature_weights is given without features"):
        align_pairs(p, p, feature_weights=np.ones(10))
    with pytest.raises(ParameterError, match="homogeneous"):
        align_pairs(p, p, prior=np.diag([1.0, 1, -1, 1]))
    with pytest.raises(ParameterError, match="expected 3"):
        align_pairs(p, p, constraints=Constraints(rotation=(0,)))
