"""Speeds along a path: as fast as the limits allow, from standstill to standstill."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.robot.traversability import RobotLimits


def find_speeds(length: Float64Array, curvature: Float64Array, robot: RobotLimits) -> tuple[Float64Array, Float64Array]:
    """Return the fastest speeds and their times at points along a path.

    Speed is bounded by the robot's own, by lateral acceleration ``speed**2 * curvature`` on both pieces that meet at a
    point, and by what can be reached, and braked, at its acceleration. One pass forwards and one backwards: O(n).

    Parameters
    ----------
    length : ndarray of shape (n,)
        Way to each point, metres, increasing.
    curvature : ndarray of shape (n - 1,)
        Of the pieces between points, one over metres.
    robot : RobotLimits

    Returns
    -------
    speeds, times : ndarray of shape (n,), float64
        Metres a second, and seconds since the start.
    """
    bend = np.zeros(len(length))
    np.maximum.at(bend, np.arange(len(curvature)), np.abs(curvature))
    np.maximum.at(bend, np.arange(1, len(curvature) + 1), np.abs(curvature))
    with np.errstate(divide="ignore"):
        square = np.minimum(robot.max_speed**2, robot.max_lateral_acceleration / bend)
    square[[0, -1]] = 0.0
    gain = 2.0 * robot.max_acceleration * np.diff(length)
    for n in range(1, len(square)):
        square[n] = min(square[n], square[n - 1] + gain[n - 1])
    for n in range(len(square) - 2, -1, -1):
        square[n] = min(square[n], square[n + 1] + gain[n])
    speeds = np.sqrt(square)
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(length) / np.maximum(speeds[1:] + speeds[:-1], 1e-12))])
    return speeds, times
