r"""Where the robot is between measurements: an extended Kalman filter over pose and velocity.

The state is the pose of the body :math:`T_{wb}` and its twist :math:`v` (rotation, translation; in the body's frame),
with :math:`\dot T = T v^\wedge` and white acceleration [1]_. Errors of the pose are perturbations on the left, in the
world frame. Measurements come in any order of cameras, each at its own time.

References
----------
.. [1] T. D. Barfoot, "State Estimation for Robotics", Cambridge 2017. :doi:`10.1017/9781316671528`
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import exp_rotation, invert_transform, left_jacobian, log_rotation, skew

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


class MotionFilter:
    """Pose and velocity of the body with their covariance.

    Parameters
    ----------
    time : float
        Of the first pose, seconds.
    T_world_body : ndarray of shape (4, 4), float64
    turning, moving : float
        Standard deviations of the angular (rad/s^2) and linear (m/s^2) acceleration over a second.
    """

    def __init__(self, time: float, T_world_body: Float64Array, *, turning: float = 0.4, moving: float = 0.25) -> None:
        self.time = time
        self.T_world_body = T_world_body.copy()
        self.twist = np.zeros(6)
        self.covariance = np.diag([1e-10] * 6 + [0.5] * 3 + [0.25] * 3)
        self._noise = np.diag([turning**2] * 3 + [moving**2] * 3)

    def pose_at(self, time: float) -> Float64Array:
        """Return the pose at a time by the present velocity; the state stays as it is."""
        return self.T_world_body @ exp_motion(self.twist * (time - self.time))

    def predict(self, time: float) -> None:
        """Move the state to a time; an earlier one moves it back."""
        dt = time - self.time
        self.T_world_body = self.pose_at(time)
        F = np.eye(12)
        F[:6, 6:] = adjoint(self.T_world_body) * dt
        G = np.vstack([F[:6, 6:] * (0.5 * dt), np.eye(6) * dt])
        span = abs(dt)
        self.covariance = F @ self.covariance @ F.T
        if span > 0.0:
            self.covariance += G @ self._noise @ G.T / span
        self.time = time

    def update(self, T_world_body: Float64Array, covariance: Float64Array, *, gate: float | None) -> Innovation:
        """Take in a measured pose at the state's time.

        Parameters
        ----------
        T_world_body : ndarray of shape (4, 4), float64
        covariance : ndarray of shape (6, 6), float64
            Of a perturbation on the left, (rotation, translation); infinite along what was not observed.
        gate : float or None
            Largest squared Mahalanobis distance that is accepted; None accepts all.

        Returns
        -------
        Innovation
        """
        R = np.where(np.isfinite(covariance), covariance, 0.0) + np.diag(
            np.where(np.isfinite(np.diag(covariance)), _FLOOR, 1e6)
        )
        z = log_motion(T_world_body @ invert_transform(self.T_world_body))
        S = self.covariance[:6, :6] + R
        distance = float(z @ np.linalg.solve(S, z))
        if gate is not None and not distance <= gate:
            return Innovation(distance, accepted=False)
        K = np.linalg.solve(S, self.covariance[:6, :]).T
        move = K @ z
        self.T_world_body = exp_motion(move[:6]) @ self.T_world_body
        self.twist = self.twist + move[6:]
        keep = np.eye(12)
        keep[:, :6] -= K
        P = keep @ self.covariance @ keep.T + K @ R @ K.T
        self.covariance = (P + P.T) / 2
        return Innovation(distance, accepted=True)


def exp_motion(twist: Float64Array) -> Float64Array:
    """Return the homogeneous matrix of a twist (rotation, translation), of shape (6,)."""
    T = np.eye(4)
    T[:3, :3] = exp_rotation(twist[:3])
    T[:3, 3] = left_jacobian(twist[:3]) @ twist[3:]
    return T


def log_motion(T: Float64Array) -> Float64Array:
    """Return the twist of a homogeneous matrix; the inverse of :func:`exp_motion`."""
    turn = log_rotation(T[:3, :3])
    return np.concatenate([turn, np.linalg.solve(left_jacobian(turn), T[:3, 3])])


def adjoint(T: Float64Array) -> Float64Array:
    """Return the matrix (6, 6) that carries a twist (rotation, translation) from the source to the target frame."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = T[:3, :3]
    out[3:, :3] = skew(T[:3, 3]) @ T[:3, :3]
    return out
