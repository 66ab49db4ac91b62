"""Newton's steps: by Cholesky where the curvature is positive, by eigenvectors else, within bounds."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import random_rotation
from seismo3d.registration import _kernels_newton as kernels
from seismo3d.registration import quadratic
from seismo3d.registration.solvers import Limits, Prior, walk

MODELS = {"rigid": 6, "similarity": 7, "scaled": 9}


def problem(rng):
    p = rng.normal(size=(60, 3))
    R, t = random_rotation(rng), rng.normal(size=3)
    q = 1.3 * p @ R.T + t + 0.01 * rng.normal(size=p.shape)
    return quadratic.point_form(q, p, np.full(60, 1 / 60)), R, t


def test_steps_equal_numpy_and_indefinite_curvature_is_refused(rng):
    root = rng.normal(size=(7, 7))
    H, gradient, step = root @ root.T + np.eye(7), rng.normal(size=7), np.zeros(7)
    assert kernels._solve_positive(H, gradient, step)
    np.testing.assert_allclose(step, -np.linalg.solve(H, gradient), rtol=1e-10)
    assert not kernels._solve_positive(H - 2.0 * np.linalg.eigvalsh(H)[3] * np.eye(7), gradient, step)


@pytest.mark.parametrize("model", MODELS)
def test_both_kinds_of_steps_lead_to_the_same_minimum(rng, model):
    Q, R, t = problem(rng)
    free = Limits(np.full(MODELS[model], -np.inf), np.full(MODELS[model], np.inf))
    prior = Prior(np.eye(3), np.zeros(3))
    by_cholesky, by_vectors = (
        walk(Q, R, t, model=model, prior=prior, limits=free, ratio=ratio) for ratio in (1e-12, 1e-7)
    )
    np.testing.assert_allclose(by_cholesky.A, by_vectors.A, atol=1e-9)
    np.testing.assert_allclose(by_cholesky.t, by_vectors.t, atol=1e-9)


def test_bounded_scale_stops_at_its_bound_and_the_rest_is_free(rng):
    Q, R, t = problem(rng)
    limits = Limits(np.full(7, -np.inf), np.full(7, np.inf))
    limits.high[6] = np.log(1.2)
    found = walk(Q, R, t, model="similarity", prior=Prior(np.eye(3), np.zeros(3)), limits=limits, ratio=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.A, axis=0), 1.2, rtol=1e-9)
    np.testing.assert_allclose(found.A / 1.2, R, atol=0.02)
