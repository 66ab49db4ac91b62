"""Kernels of rigid motions as twists; see :mod:`seismo3d.robot.ekf`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float64Array


@nb.njit(cache=True, nogil=True, inline="always")
def _series(angle: float) -> tuple[float, float, float]:
    """Return sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3, by their series where a is small."""
    square = angle * angle
    if square < 1e-4:
        return (
            1.0 - square / 6.0 * (1.0 - square / 20.0),
            0.5 - square / 24.0 * (1.0 - square / 30.0),
            1.0 / 6.0 - (square / 120.0 * (1.0 - square / 42.0)),
        )
    sine = math.sin(angle)
    return sine / angle, 2.0 * (math.sin(0.5 * angle) / angle) ** 2, (angle - sine) / (square * angle)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def exp_motion(twist: Float64Array) -> Float64Array:
    """Homogeneous matrix (4, 4) of a twist (rotation, translation)."""
    w, T = twist[:3], np.eye(4)
    a, b, c = _series(math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]))
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    for i in range(3):
        for j in range(3):
            twice = 0.0
            for k in range(3):
                twice += W[i, k] * W[k, j]
            T[i, j] += a * W[i, j] + b * twice
            T[i, 3] += ((1.0 if i == j else 0.0) + b * W[i, j] + c * twice) * twist[3 + j]
    return T


@nb.njit(cache=True, nogil=True, error_model="numpy")
def log_motion(T: Float64Array) -> Float64Array:
    """Twist of a homogeneous matrix whose angle is less than 3 rad; NaN for larger ones."""
    out = np.empty(6)
    x, y, z = 0.5 * (T[2, 1] - T[1, 2]), 0.5 * (T[0, 2] - T[2, 0]), 0.5 * (T[1, 0] - T[0, 1])
    angle = math.atan2(math.sqrt(x * x + y * y + z * z), 0.5 * (T[0, 0] + T[1, 1] + T[2, 2] - 1.0))
    if angle > 3.0:
        out[:] = np.nan
        return out
    a, b, _ = _series(angle)
    x, y, z = x / a, y / a, z / a
    out[0], out[1], out[2] = x, y, z
    # the inverse of the left Jacobian is 1 - W / 2 + (1 - a / 2 b) / angle^2 W^2
    square = angle * angle
    c = (1.0 - 0.5 * a / b) / square if square > 1e-4 else 1.0 / 12.0 + square / 720.0
    t0, t1, t2 = T[0, 3], T[1, 3], T[2, 3]
    u0, u1, u2 = y * t2 - z * t1, z * t0 - x * t2, x * t1 - y * t0
    out[3] = t0 - 0.5 * u0 + c * (y * u2 - z * u1)
    out[4] = t1 - 0.5 * u1 + c * (z * u0 - x * u2)
    out[5] = t2 - 0.5 * u2 + c * (x * u1 - y * u0)
    return out
