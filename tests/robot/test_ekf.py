from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import adjoint, exp_rotation, invert_transform, make_transform, rotation_angle
from seismo3d.robot.ekf import Glimpses, MotionFilter, exp_motion, log_motion
from seismo3d.robot.pose_errors import PoseErrors


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


def test_a_time_that_no_stamp_tells_of_leaves_the_pose_as_unsure_as_one_that_is_told() -> None:
    told, untold = MotionFilter(0.0, np.eye(4)), MotionFilter(0.0, np.eye(4))
    told.predict(0.1)
    untold.loosen(0.1)
    np.testing.assert_allclose(untold.covariance[:6, :6].diagonal(), told.covariance[:6, :6].diagonal(), rtol=0.01)
    np.testing.assert_array_equal(untold.T_world_body, np.eye(4))
    untold.twist[3] = 2.0
    untold.loosen(0.1)
    assert untold.covariance[3, 3] > 0.2**2  # it may have gone on
    assert untold.time == 0.0


def seen_from(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    local = (points - T[:3, 3]) @ T[:3, :3]
    return np.asarray(local[:, :2] / local[:, 2:])


def test_landmarks_correct_pose_and_velocity_each_at_its_own_time(rng: np.random.Generator) -> None:
    """A camera on a body that moves otherwise than the filter thinks; rows of its image are exposed one by one."""
    T_body_camera = make_transform(exp_rotation([0.1, 0.0, 0.2]), [0.05, 0.0, 0.1])
    points = rng.uniform([-1.0, -1.0, 1.5], [1.0, 1.0, 3.0], (12, 3))
    motion = MotionFilter(0.0, np.eye(4))
    for point in points:
        motion.add_landmark(point, 1e-8 * np.eye(3))
    assert motion.covariance.shape == (48, 48)
    twist = np.array([0.1, -0.4, 0.2, 0.3, -0.1, 0.2])
    for step in range(1, 9):
        motion.predict(step / 30)
        delay = np.linspace(-0.02, 0.02, 12)
        times = step / 30 + delay
        rays = np.array([seen_from(exp_motion(twist * t) @ T_body_camera, p[None])[0] for t, p in zip(times, points)])
        seen = Glimpses(np.arange(12), rays, delay, 1e-3)
        assert motion.sight(seen, T_body_camera, gate=30.0).all()
    exact = exp_motion(twist * 8 / 30)
    assert np.linalg.norm(motion.T_world_body[:3, 3] - exact[:3, 3]) < 0.002
    assert rotation_angle(motion.T_world_body[:3, :3].T @ exact[:3, :3]) < 0.002
    np.testing.assert_allclose(motion.twist, twist, atol=0.05)
    assert np.linalg.eigvalsh(motion.covariance).min() > -1e-12


def test_derivatives_of_a_sighting(rng: np.random.Generator) -> None:
    motion = MotionFilter(0.0, exp_motion(0.3 * rng.normal(size=6)))
    motion.twist = 0.5 * rng.normal(size=6)
    T_body_camera = exp_motion(0.2 * rng.normal(size=6))
    ahead = motion.T_world_body @ T_body_camera @ [0.3, -0.2, 2.0, 1.0]
    motion.add_landmark(ahead[:3], np.eye(3))
    H, expected = motion._expect(0, 0.02, T_body_camera)
    for k in range(15):
        moved = MotionFilter(0.0, motion.T_world_body)
        moved.landmarks, moved.covariance, step = motion.landmarks.copy(), motion.covariance, 1e-6 * np.eye(15)[k]
        moved.T_world_body = exp_motion(step[:6]) @ motion.T_world_body
        moved.twist = motion.twist + step[6:12]
        moved.landmarks[0] += step[12:]
        slope = (moved._expect(0, 0.02, T_body_camera)[1] - expected) / 1e-6
        np.testing.assert_allclose(slope, H[:, k], atol=0.02 * max(1.0, np.abs(H).max()))


def test_a_landmark_that_moved_is_gated_and_can_be_marginalised(rng: np.random.Generator) -> None:
    points = rng.uniform([-1.0, -1.0, 1.5], [1.0, 1.0, 3.0], (6, 3))
    motion = MotionFilter(0.0, np.eye(4))
    for point in points:
        motion.add_landmark(point, 1e-6 * np.eye(3))
    motion.predict(1 / 30)
    rays = seen_from(np.eye(4), points)
    rays[2] += 0.2
    accepted = motion.sight(Glimpses(np.arange(6), rays, np.zeros(6), 2e-3), np.eye(4), gate=9.21)
    assert accepted.tolist() == [True, True, False, True, True, True]
    assert np.linalg.norm(motion.T_world_body[:3, 3]) < 1e-3
    held = motion.covariance[:12, :12].copy()
    motion.drop_landmarks(np.arange(6) == 2)
    np.testing.assert_array_equal(motion.covariance[:12, :12], held)
    assert motion.covariance.shape == (27, 27)
    np.testing.assert_allclose(motion.landmarks, points[[0, 1, 3, 4, 5]], atol=1e-3)


def test_a_landmark_shares_the_error_of_the_pose_that_it_was_seen_from() -> None:
    motion = MotionFilter(0.0, np.eye(4))
    motion.covariance[:6, :6] = np.diag([1e-4, 1e-4, 1e-4, 4e-4, 4e-4, 4e-4])
    motion.add_landmark(np.array([0.0, 0.0, 2.0]), np.zeros((3, 3)))
    # 2 m ahead: turning by 0.01 moves it by 2 cm, beside the 2 cm of the camera itself
    np.testing.assert_allclose(np.diag(motion.covariance)[12:], [8e-4, 8e-4, 4e-4])
    seen = motion.sight(Glimpses(np.array([0]), np.zeros((1, 2)), np.zeros(1), 1e-6), np.eye(4), gate=9.21)
    assert seen.all()
    # what was known of the landmark came from the pose: seeing it again says little of the pose
    np.testing.assert_allclose(np.diag(motion.covariance)[:6], [1e-4] * 3 + [4e-4] * 3, rtol=1e-3)


def test_what_is_blind_in_each_of_many_measurements_is_not_learnt_from_all_of_them() -> None:
    """Along a corridor, whose direction each frame finds a little differently, nothing is known but by the motion."""
    rng = np.random.default_rng(3)
    start = exp_motion(np.array([0.2, -0.4, 0.1, 3.0, -2.0, 1.0]))
    free, walled = MotionFilter(0.0, start), MotionFilter(0.0, start)
    along = start[:3, :3] @ [0.0, 0.0, 1.0]
    for k in range(1, 61):
        free.predict(k / 30.0)
        walled.predict(k / 30.0)
        blind = np.concatenate([np.zeros(3), along + 0.02 * rng.standard_normal(3)])
        off = start.copy()
        off[:3, 3] += 0.1 * along  # of which it says nothing
        walled.update(off, np.eye(6) * 1e-6, gate=None, blind=blind[None] / np.linalg.norm(blind))
    to_body = adjoint(invert_transform(start))
    spreads = [np.sqrt(np.diag(to_body @ f.covariance[:6, :6] @ to_body.T)) for f in (free, walled)]
    assert spreads[1][5] > 0.9 * spreads[0][5] > 0.9
    assert (spreads[1][:5] < 0.1 * spreads[0][:5]).all()
    moved = invert_transform(start) @ walled.T_world_body
    assert np.abs(moved[:3, 3]).max() < 0.1
    assert np.abs(walled.twist).max() < 0.1


def test_a_measurement_blind_to_nothing_is_one_without_that() -> None:
    filters = [MotionFilter(0.0, np.eye(4)) for _ in range(2)]
    for motion, blind in zip(filters, (None, np.empty((0, 6)))):
        motion.predict(0.1)
        motion.update(exp_motion(np.full(6, 0.01)), np.eye(6) * 1e-4, gate=None, blind=blind)
    np.testing.assert_array_equal(filters[0].covariance, filters[1].covariance)
    np.testing.assert_array_equal(filters[0].T_world_body, filters[1].T_world_body)


def test_along_what_is_blind_a_pose_still_hangs_on_what_it_hung_on() -> None:
    motion = MotionFilter(0.0, np.eye(4))
    sure, unsure = 1e-6 * np.eye(6), 0.04 * np.eye(6)
    small, along = 1e-6 * np.eye(6), np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    motion.update(np.eye(4), small, gate=None, of_map=PoseErrors(unsure))
    np.testing.assert_allclose(motion.of_map.covariance, unsure)
    motion.update(np.eye(4), small, gate=None, blind=along, of_map=PoseErrors(sure))
    np.testing.assert_allclose(motion.of_map.covariance, np.diag([1e-6] * 5 + [0.04]), atol=1e-12)
    np.testing.assert_allclose(motion.pose_covariance, motion.covariance[:6, :6] + motion.of_map.covariance)
    motion.update(np.eye(4), small, gate=None, of_map=PoseErrors(sure))
    np.testing.assert_allclose(motion.of_map.covariance, sure)


def test_a_pose_that_is_held_is_as_sure_as_its_measurement_and_where_that_is_blind_as_the_state() -> None:
    motion = MotionFilter(0.0, np.eye(4))
    motion.covariance[:6, :6] = 0.04 * np.eye(6)
    measured, T = 1e-6 * np.eye(6), exp_motion(np.full(6, 0.01))
    motion.hold(T, measured, blind=np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]))
    np.testing.assert_array_equal(motion.T_world_body, T)
    np.testing.assert_allclose(motion.pose_covariance.diagonal()[[0, 1, 2, 3, 4]], 1e-6, rtol=0.1)
    assert motion.pose_covariance[5, 5] == pytest.approx(0.04, rel=0.01)
    motion.hold(T, measured, blind=np.empty((0, 6)))
    np.testing.assert_array_equal(motion.pose_covariance, measured)
    before = motion.pose_covariance
    motion.turn(T)
    np.testing.assert_allclose(motion.pose_covariance, adjoint(T) @ before @ adjoint(T).T)
    motion.predict(0.1)
    assert (motion.pose_covariance.diagonal() > 0.04).all()  # what was foreseen is the state's again


def test_a_pose_at_another_time_is_as_unsure_as_the_velocity_too() -> None:
    motion = MotionFilter(0.0, np.eye(4))
    np.testing.assert_array_equal(motion.covariance_at(0.0), motion.pose_covariance)
    motion.covariance[6:12, 6:12] = np.diag([0.04] * 3 + [0.01] * 3)
    for delay in (0.03, -0.03):
        spread = np.sqrt(motion.covariance_at(delay).diagonal())
        least = 0.03 * np.repeat([0.2, 0.1], 3)
        most = np.hypot(least, np.repeat([0.4, 0.25], 3) * np.sqrt(0.03**3 / 3.0) + 1e-4)
        assert (spread >= least).all()
        assert (spread <= most).all()


def test_a_change_of_the_world_leaves_the_covariance_in_the_bodys_frame(rng: np.random.Generator) -> None:
    motion = MotionFilter(0.0, exp_motion(rng.normal(size=6)))
    motion.predict(0.3)
    motion.update(motion.T_world_body, np.diag([1e-6, 4e-6, 9e-6, 1e-4, 4e-4, 9e-4]), gate=None)

    def own() -> np.ndarray:
        out = np.eye(12)
        out[:6, :6] = adjoint(invert_transform(motion.T_world_body))
        return np.asarray(out @ motion.covariance @ out.T)

    before = own()
    motion.turn(exp_motion(rng.normal(size=6)))
    np.testing.assert_allclose(own(), before, atol=1e-10)
