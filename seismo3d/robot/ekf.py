r"""Where the robot is between measurements: an extended Kalman filter over pose, velocity and a few landmarks.

The state is the pose of the body :math:`T_{wb}` and its twist :math:`v` (rotation, translation; in the body's frame),
with :math:`\dot T = T v^\wedge` and white acceleration [1]_. Errors of the pose are perturbations on the left, in the
world frame. Landmarks are points of the world; there are never more than a fixed number of them, and those that leave
are marginalised: their rows and columns go. Measurements come in any order of cameras, each at its own time.

References
----------
.. [1] T. D. Barfoot, "State Estimation for Robotics", Cambridge 2017. :doi:`10.1017/9781316671528`
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import BoolArray, Float64Array, Int64Array
from seismo3d.geometry.rotations import adjoint, invert_transform, left_jacobian, log_rotation, skew
from seismo3d.robot import _kernels_twist as kernels
from seismo3d.robot.pose_errors import PoseErrors

_FLOOR = 0.0015**2
"""Variance that a registration has at least, rad^2 and m^2: the map's own errors are not in its covariance."""


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """How a measurement compares with the prediction.

    Attributes
    ----------
    distance : float
        Squared Mahalanobis distance; chi-square with 6 degrees of freedom if all is as modelled.
    accepted : bool
        Whether it passed the gate and entered the state.
    """

    distance: float
    accepted: bool


@dataclass(frozen=True, slots=True, eq=False)
class Glimpses:
    """Landmarks of the state seen by a camera.

    Attributes
    ----------
    index : ndarray of shape (n,), int64
        Rows of the filter's landmarks.
    rays : ndarray of shape (n, 2), float64
        Where each is seen, at depth 1, free of distortion.
    delay : ndarray of shape (n,), float64
        When, less the filter's time, seconds.
    sigma : float
        Standard deviation of the rays.
    """

    index: Int64Array
    rays: Float64Array
    delay: Float64Array
    sigma: float


class MotionFilter:
    """Pose and velocity of the body, and landmarks, with their covariance.

    Parameters
    ----------
    time : float
        Of the first pose, seconds.
    T_world_body : ndarray of shape (4, 4), float64
    turning, moving : float
        Standard deviations of the angular (rad/s^2) and linear (m/s^2) acceleration over a second.

    Attributes
    ----------
    covariance : ndarray of shape (12 + 3 n, 12 + 3 n), float64
        Of the state against the map.
    of_map : PoseErrors
        Of the map where the pose is known by it, against the map's first frame.
    """

    def __init__(self, time: float, T_world_body: Float64Array, *, turning: float = 0.4, moving: float = 0.25) -> None:
        self.time = time
        self.T_world_body = T_world_body.copy()
        self.twist = np.zeros(6)
        self.covariance = np.diag([1e-10] * 6 + [0.5] * 3 + [0.25] * 3)
        self.of_map = PoseErrors()
        self._held: Float64Array | None = None
        self.landmarks = np.empty((0, 3))
        self._noise = np.diag([turning**2] * 3 + [moving**2] * 3)

    @property
    def pose_covariance(self) -> Float64Array:
        """Covariance (6, 6) of the pose against the map's first frame: a perturbation on the left."""
        return self.errors.total

    @property
    def errors(self) -> PoseErrors:
        """Errors of the pose against the map's first frame."""
        own = self.covariance[:6, :6] if self._held is None else self._held
        return replace(self.of_map, covariance=self.of_map.covariance + own)

    def covariance_at(self, delay: float) -> Float64Array:
        """Return the covariance (6, 6) of the pose so many seconds later by the present velocity."""
        turn = adjoint(self.T_world_body) * delay
        moved = self.covariance[6:12, 6:12] + self._noise * (abs(delay) / 3.0)
        return np.asarray(self.pose_covariance + turn @ moved @ turn.T)

    def turn(self, change: Float64Array) -> None:
        """Carry over a change (4, 4) of the world's frame; there must be no landmarks."""
        out = np.eye(12)
        out[:6, :6] = adjoint(change)
        self.T_world_body = change @ self.T_world_body
        self.covariance = out @ self.covariance @ out.T
        self._held = None if self._held is None else out[:6, :6] @ self._held @ out[:6, :6].T

    def pose_at(self, time: float) -> Float64Array:
        """Return the pose at a time by the present velocity; the state stays as it is."""
        return self.T_world_body @ exp_motion(self.twist * (time - self.time))

    def predict(self, time: float) -> None:
        """Move the state to a time; an earlier one moves it back."""
        dt, self._held = time - self.time, None
        self.T_world_body = self.pose_at(time)
        F = np.eye(12)
        F[:6, 6:] = adjoint(self.T_world_body) * dt
        G = np.vstack([F[:6, 6:] * (0.5 * dt), np.eye(6) * dt])
        span = abs(dt)
        P = self.covariance
        P[:12] = F @ P[:12]
        P[:, :12] = P[:, :12] @ F.T
        if span > 0.0:
            P[:12, :12] += G @ self._noise @ G.T / span
        self.time = time

    def loosen(self, span: float) -> None:
        """Know the pose less well by what may have happened in a time (seconds) that no stamp tells of; it stays."""
        turn = adjoint(self.T_world_body) * span
        moved = self.covariance[6:12, 6:12] + np.outer(self.twist, self.twist) + self._noise * (span / 3.0)
        self.covariance[:6, :6] += turn @ moved @ turn.T

    def update(
        self,
        T_world_body: Float64Array,
        covariance: Float64Array,
        *,
        gate: float | None,
        blind: Float64Array | None = None,
        of_map: PoseErrors | None = None,
    ) -> Innovation:
        """Take in a measured pose at the state's time.

        Parameters
        ----------
        T_world_body : ndarray of shape (4, 4), float64
        covariance : ndarray of shape (6, 6), float64
            Of a perturbation on the left, (rotation, translation); infinite along what was not observed.
        gate : float or None
            Largest squared Mahalanobis distance that is accepted; None accepts all.
        blind : ndarray of shape (k, 6), float64, optional
            Perturbations of which the measurement says nothing; the state stays as it is along them.
        of_map : PoseErrors, optional
            Of what the pose was measured against; none by default.

        Returns
        -------
        Innovation
        """
        R = of_measurement(covariance)
        z = log_motion(T_world_body @ invert_transform(self.T_world_body))
        rows, keep = (np.eye(6), None) if blind is None or len(blind) == 0 else self._beside(blind)
        z, R = rows @ z, rows @ R @ rows.T
        distance = float(z @ np.linalg.solve(rows @ self.covariance[:6, :6] @ rows.T + R, z))
        if gate is not None and not distance <= gate:
            return Innovation(distance, accepted=False)
        found = PoseErrors() if of_map is None else of_map
        if keep is not None:
            # along what is blind the pose still hangs on what it was measured against before
            told = keep[:6, :6]
            found = self.of_map.carried(np.eye(6) - told).beyond(found.carried(told))
        self.of_map = found
        self._correct(rows @ np.eye(6, len(self.covariance)), z, R, keep)
        return Innovation(distance, accepted=True)

    def hold(self, T_world_body: Float64Array, covariance: Float64Array, *, blind: Float64Array) -> None:
        """Put the pose where it was measured, all of it: so it fits the map, and is as sure as the measurement.

        Along what is blind (k, 6), and where the covariance (6, 6) is infinite, it is as sure as the state is.
        """
        self.T_world_body = T_world_body
        if not np.isfinite(covariance).all():
            return
        told = self._beside(blind)[1][:6, :6] if len(blind) else np.eye(6)
        untold = np.eye(6) - told
        self._held = told @ covariance @ told.T + untold @ self.covariance[:6, :6] @ untold.T

    def add_landmark(self, point: Float64Array, covariance: Float64Array) -> None:
        """Take a point of the world into the state.

        Parameters
        ----------
        point : ndarray of shape (3,), float64
        covariance : ndarray of shape (3, 3), float64
            Beside the error that it shares with the pose from which it was seen.
        """
        J = np.zeros((3, len(self.covariance)))
        J[:, :3], J[:, 3:6] = -skew(point), np.eye(3)
        across = J @ self.covariance
        corner = across @ J.T + covariance
        self.covariance = np.block([[self.covariance, across.T], [across, corner]])
        self.landmarks = np.vstack([self.landmarks, point])

    def drop_landmarks(self, drop: BoolArray) -> None:
        """Marginalise the landmarks of a mask (n,)."""
        keep = np.concatenate([np.ones(12, dtype=bool), np.repeat(~drop, 3)])
        self.covariance = self.covariance[np.ix_(keep, keep)]
        self.landmarks = self.landmarks[~drop]

    def sight(self, seen: Glimpses, T_body_camera: Float64Array, *, gate: float) -> BoolArray:
        """Take in where a camera sees landmarks of the state, each at its own time.

        Parameters
        ----------
        seen : Glimpses
        T_body_camera : ndarray of shape (4, 4), float64
        gate : float
            Largest squared Mahalanobis distance of a landmark's innovation (2 degrees of freedom) that is accepted.

        Returns
        -------
        ndarray of shape (n,), bool
            Which were accepted.
        """
        rows, misses, accepted = [], [], np.zeros(len(seen.index), dtype=bool)
        R = np.eye(2) * seen.sigma**2
        for k, (index, ray, delay) in enumerate(zip(seen.index, seen.rays, seen.delay)):
            H, expected = self._expect(int(index), float(delay), T_body_camera)
            miss = ray - expected
            (a, b), (_, c) = (H @ self.covariance @ H.T + R).tolist()
            u, v = miss.tolist()
            if (c * u - b * v) * u + (a * v - b * u) * v <= gate * (a * c - b * b):
                accepted[k] = True
                rows.append(H)
                misses.append(miss)
        if rows:
            self._correct(np.concatenate(rows), np.concatenate(misses), np.eye(2 * len(rows)) * seen.sigma**2)
        return accepted

    def _expect(self, index: int, delay: float, T_body_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Where a landmark should be seen at a time, at depth 1, and the derivative (2, n) by the state."""
        T_body = self.pose_at(self.time + delay)
        T = T_body @ T_body_camera
        point = self.landmarks[index]
        R = T[:3, :3].T
        x, y, z = R @ (point - T[:3, 3])
        z = max(z, 0.05)
        project = np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z]]) / z @ R
        H = np.zeros((2, len(self.covariance)))
        H[:, :3], H[:, 3:6] = project @ skew(point), -project
        H[:, 6:12] = H[:, :6] @ adjoint(T_body) * delay
        H[:, 12 + 3 * index : 15 + 3 * index] = project
        return H, np.array([x / z, y / z])

    def _beside(self, blind: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return what a measurement tells that is blind (k, 6): rows (6 - k, 6), and which corrections it may make.

        Neither the pose nor the velocity are corrected along what is blind. What is blind is known but nearly, and from
        frame to frame differently: what each of many frames says beside it would else add up to knowledge of it.
        """
        to_body = adjoint(invert_transform(self.T_world_body))
        own = np.linalg.qr(to_body @ blind.T, mode="complete")[0][:, len(blind) :]
        keep = np.eye(len(self.covariance))
        keep[6:12, 6:12] = own @ own.T
        keep[:6, :6] = adjoint(self.T_world_body) @ keep[6:12, 6:12] @ to_body
        return own.T @ to_body, keep

    def _correct(self, H: Float64Array, miss: Float64Array, R: Float64Array, keep: Float64Array | None = None) -> None:
        """Update the state by a measurement with derivative H and covariance R; ``keep`` says what may be corrected."""
        P = self.covariance
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        if keep is not None:
            K = keep @ K
        move = K @ miss
        self.T_world_body = exp_motion(move[:6]) @ self.T_world_body
        self.twist = self.twist + move[6:12]
        self.landmarks = self.landmarks + move[12:].reshape(-1, 3)
        left = np.eye(len(P)) - K @ H
        P = left @ P @ left.T + K @ R @ K.T
        self.covariance = (P + P.T) / 2


def of_measurement(covariance: Float64Array) -> Float64Array:
    """Return a registration's covariance (6, 6) with the map's own errors; large where it is infinite."""
    known = np.isfinite(np.diag(covariance))
    return np.where(np.isfinite(covariance), covariance, 0.0) + np.diag(np.where(known, _FLOOR, 1e6))


def exp_motion(twist: Float64Array) -> Float64Array:
    """Return the homogeneous matrix of a twist (rotation, translation), of shape (6,)."""
    return np.asarray(kernels.exp_motion(np.ascontiguousarray(twist, dtype=np.float64)))


def log_motion(T: Float64Array) -> Float64Array:
    """Return the twist of a homogeneous matrix; the inverse of :func:`exp_motion`."""
    twist = np.asarray(kernels.log_motion(np.ascontiguousarray(T, dtype=np.float64)))
    if np.isfinite(twist[0]):
        return twist
    turn = log_rotation(T[:3, :3])  # near half a turn, where the axis needs more care
    return np.concatenate([turn, np.linalg.solve(left_jacobian(turn), T[:3, 3])])
