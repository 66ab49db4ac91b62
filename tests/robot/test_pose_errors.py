"""Kinds of errors, and how each adds up."""

from __future__ import annotations

import numpy as np

from seismo3d.geometry.rotations import adjoint
from seismo3d.robot.ekf import exp_motion
from seismo3d.robot.pose_errors import PoseErrors, add_alike, differ_alike


def test_of_what_goes_the_same_way_standard_deviations_add() -> None:
    one, other = np.array([3.0, 1.0, 0.5]), np.array([4.0, 0.0, 0.25])
    total = add_alike(np.diag(one**2), np.diag(other**2))
    np.testing.assert_allclose(np.diag(total), (one + other) ** 2, rtol=1e-4)
    np.testing.assert_allclose(differ_alike(total, np.diag(one**2)), np.diag(other**2), atol=1e-3)
    nothing = np.zeros((3, 3))
    np.testing.assert_array_equal(add_alike(nothing, total), total)
    np.testing.assert_allclose(differ_alike(total, nothing), total)


def test_the_sum_is_the_same_in_every_frame(rng: np.random.Generator) -> None:
    roots, turn = rng.normal(size=(2, 6, 6)), adjoint(exp_motion(rng.normal(size=6)))
    one, other = (root @ root.T for root in roots)
    after = add_alike(turn @ one @ turn.T, turn @ other @ turn.T)
    np.testing.assert_allclose(after, turn @ add_alike(one, other) @ turn.T, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(add_alike(one, other), add_alike(other, one), rtol=1e-5, atol=1e-6)


def test_each_kind_of_error_adds_up_in_its_own_manner() -> None:
    step = PoseErrors(1e-6 * np.eye(6), 1e-6 * np.eye(6), np.ones((6, 4)))
    way = PoseErrors()
    for _ in range(9):
        way = way.beyond(step)
    np.testing.assert_allclose(way.covariance, 9e-6 * np.eye(6))  # three times as far after nine steps
    np.testing.assert_allclose(way.alike, 81e-6 * np.eye(6), rtol=1e-4, atol=1e-9)  # nine times
    np.testing.assert_array_equal(way.by_lens, np.full((6, 4), 9.0))
    np.testing.assert_allclose(way.total, way.covariance + way.alike)
