from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, make_transform, rotation_angle
from seismo3d.robot.ekf import MotionFilter, adjoint, exp_motion, log_motion


def test_exp_and_log_are_inverse(rng: np.random.Generator) -> None:
    for scale in (1e-9, 0.1, 0.8):
        twist = scale * rng.normal(size=6)
        np.testing.assert_allclose(log_motion(exp_motion(twist)), twist, atol=1e-9)


def test_adjoint_carries_a_twist_between_frames(rng: np.random.Generator) -> None:
    T, twist = exp_motion(rng.normal(size=6)), 0.3 * rng.normal(size=6)
    np.testing.assert_allclose(T @ exp_motion(twist) @ np.linalg.inv(T), exp_motion(adjoint(T) @ twist), atol=1e-12)


def test_velocity_is_learnt_and_predicts_between_measurements() -> None:
    twist = np.array([0.2, -0.5, 0.3, 0.4, 0.0, -0.2])
    motion = MotionFilter(0.0, np.eye(4))
    for step in range(1, 25):
        motion.predict(step / 30)
        assert motion.update(exp_motion(twist * step / 30), np.eye(6) * 1e-6, gate=None).accepted
    np.testing.assert_allclose(motion.twist, twist, atol=0.01)
    ahead = motion.pose_at(24 / 30 + 0.02)
    exact = exp_motion(twist * (24 / 30 + 0.02))
    assert rotation_angle(ahead[:3, :3].T @ exact[:3, :3]) < 1e-3
    assert motion.time == 24 / 30  # looking ahead changes nothing


def test_measurements_may_come_unevenly_and_late() -> None:
    twist = np.array([0.0, 0.6, 0.0, 0.3, 0.0, 0.0])
    motion = MotionFilter(0.0, np.eye(4))
    for time in (0.03, 0.05, 0.11, 0.12, 0.21, 0.20, 0.30, 0.33, 0.36):  # one is late by 10 ms
        motion.predict(time)
        motion.update(exp_motion(twist * time), np.eye(6) * 1e-6, gate=None)
    np.testing.assert_allclose(motion.twist, twist, atol=0.03)
    assert np.linalg.eigvalsh(motion.covariance).min() > -1e-12


def test_gate_refuses_what_the_motion_cannot_explain() -> None:
    motion = MotionFilter(0.0, np.eye(4))
    for step in range(1, 20):
        motion.predict(step / 30)
        motion.update(np.eye(4), np.eye(6) * 1e-6, gate=None)
    motion.predict(20 / 30)
    before = motion.T_world_body.copy()
    far = make_transform(exp_rotation([0.0, 0.5, 0.0]), [0.4, 0.0, 0.0])
    found = motion.update(far, np.eye(6) * 1e-6, gate=30.0)
    assert not found.accepted
    assert found.distance > 30.0
    np.testing.assert_array_equal(motion.T_world_body, before)


def test_directions_that_were_not_seen_stay_at_the_prediction() -> None:
    motion = MotionFilter(0.0, np.eye(4))
    motion.predict(0.1)
    covariance = np.eye(6) * 1e-6
    covariance[3, 3] = np.inf
    motion.update(make_transform(np.eye(3), [0.05, 0.02, 0.0]), covariance, gate=None)
    assert abs(motion.T_world_body[0, 3]) < 1e-4
    assert motion.T_world_body[1, 3] == pytest.approx(0.02, abs=1e-3)


def test_uncertainty_grows_while_nothing_is_measured() -> None:
    motion = MotionFilter(0.0, np.eye(4))
    spans = []
    for step in range(1, 5):
        motion.predict(step * 0.1)
        spans.append(np.trace(motion.covariance[3:6, 3:6]))
    assert np.all(np.diff(spans) > 0)
