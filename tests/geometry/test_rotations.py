"""Rotations and rigid motions: known answers and inverses."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ShapeError
from seismo3d.geometry import rotations as ro


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-7])
def test_log_undoes_exp_at_every_angle(angle, rng):
    axis = rng.normal(size=3)
    vector = angle * axis / np.linalg.norm(axis)
    R = ro.exp_rotation(vector)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(ro.log_rotation(R), vector, atol=1e-12)


def test_log_undoes_exp_in_the_plane():
    np.testing.assert_allclose(ro.log_rotation(ro.exp_rotation([-2.5])), [-2.5], atol=1e-14)


def test_half_turn_has_angle_pi():
    assert ro.rotation_angle(np.diag([1.0, -1.0, -1.0])) == pytest.approx(np.pi)


def test_nearest_rotation_of_a_reflection_is_a_rotation(rng):
    R = ro.nearest_rotation(np.diag([1.0, 1.0, -1.0]) + 0.1 * rng.normal(size=(3, 3)))
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_quaternion_round_trip(rng):
    R = ro.random_rotation(rng)
    np.testing.assert_allclose(ro.rotation_from_quaternion(ro.quaternion_from_rotation(R)), R, atol=1e-14)


def test_left_jacobian_is_the_derivative_of_exp(rng):
    v, w = rng.normal(size=3), 1e-6 * rng.normal(size=3)
    left = ro.exp_rotation(ro.left_jacobian(v) @ w) @ ro.exp_rotation(v)
    np.testing.assert_allclose(left, ro.exp_rotation(v + w), atol=1e-11)  # second order in 1e-6


def test_inverse_transform_carries_points_back(rng):
    T = ro.make_transform(ro.random_rotation(rng), rng.normal(size=3))
    points = rng.normal(size=(5, 3))
    np.testing.assert_allclose(
        ro.transform_points(ro.invert_transform(T), ro.transform_points(T, points)), points, atol=1e-13
    )


def test_wrong_shapes_are_refused():
    with pytest.raises(ShapeError, match="expected a square matrix"):
        ro.log_rotation(np.zeros((2, 3)))
    with pytest.raises(ShapeError, match="expected 3"):
        ro.exp_rotation(np.zeros(4))
    with pytest.raises(ShapeError, match="four numbers"):
        ro.rotation_from_quaternion([0, 0, 0, 0])
