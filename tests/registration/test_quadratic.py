"""The form equals the sum of squared residuals, in the plane and in space."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import make_transform, random_rotation
from seismo3d.registration.quadratic import Frame, plane_form, point_form, stack


@pytest.fixture(params=[2, 3])
def problem(request, rng):
    d, n = request.param, 9000  # more than two blocks
    A, t = rng.normal(size=(d, d)), rng.normal(size=d)
    return A, t, rng.normal(size=(n, d)), rng.normal(size=(n, d)), rng.normal(size=(n, d)), rng.uniform(size=n)


def test_plane_form_is_the_sum_of_squares(problem):
    A, t, p, q, n, w = problem
    z = stack(A, t)
    residuals = ((p @ A.T + t - q) * n).sum(axis=1)
    assert z @ plane_form(q, p, n, w) @ z == pytest.approx(w @ residuals**2, rel=1e-12)


def test_point_form_is_the_sum_of_squares(problem):
    A, t, p, q, _, w = problem
    z = stack(A, t)
    assert z @ point_form(q, p, w) @ z == pytest.approx(w @ ((p @ A.T + t - q) ** 2).sum(axis=1), rel=1e-12)


def test_point_form_takes_information_matrices(problem, rng):
    A, t, p, q, _, _ = problem
    d = p.shape[1]
    root = rng.normal(size=(len(p), d, d))
    W = root @ root.transpose(0, 2, 1)
    r = p @ A.T + t - q
    z = stack(A, t)
    assert z @ point_form(q, p, W) @ z == pytest.approx(np.einsum("ni,nij,nj->", r, W, r), rel=1e-12)


def test_forms_are_symmetric(problem):
    _, _, p, q, n, w = problem
    for Q in (plane_form(q, p, n, w), point_form(q, p, w)):
        np.testing.assert_allclose(Q, Q.T, rtol=1e-13)  # sums in another order


def test_frame_there_and_back(rng):
    target, source = rng.normal(size=(50, 3)) + 1e6, 3 * rng.normal(size=(60, 3)) - 1e6
    frame = Frame.of(target, source)
    T = make_transform(random_rotation(rng), rng.normal(size=3))
    A, t = frame.enter(T)
    moved = frame.source(source) @ A.T + t
    np.testing.assert_allclose(
        moved, frame.target(source @ T[:3, :3].T + T[:3, 3]), atol=1e-8
    )  # 1e6 x 1e-16 x cancellation
    np.testing.assert_allclose(frame.leave(A, t), T, atol=1e-8)
