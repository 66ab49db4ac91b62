"""Agreement that chance explains: an answer beside all that the poses tried for it led to.

The loop lays any scan on any other somehow, and the best of many poses looks like an answer. Of scans that show the
same, the poses gather at the answer, or it fits far better than the others do; of unrelated ones each pose leads
somewhere else, and the best is but the first among many. Of shapes that repeat or are symmetric, such as a room
or a box of which each scan shows a part, one of few other places explains nearly as much: they do not tell which is
right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.geometry.rotations import left_jacobian, log_rotation, nearest_rotation, transform_points
from seismo3d.registration.icp import LoopResult

LEAST_GAP = 3.6
"""Least gap from an answer to the best one elsewhere, in standard deviations of the logarithmic costs elsewhere.

The gap on top of many draws is distributed exponentially, with a scale of sqrt(6) / pi standard deviations: one in a
hundred is larger.
"""
LEAST_ELSEWHERE = 0.5
"""Share of the poses that must lead elsewhere for chance to explain an answer."""
LEAST_COST = 1e-3
"""Costs below are alike."""


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """What a search over poses led to.

    Attributes
    ----------
    source : ndarray of shape (n, 8), float32
        Surface elements of the source.
    reach : float
        Answers that put these farther apart along their normals, root mean square, lie elsewhere; along a plane there
        is no elsewhere.
    cost_of : callable
        Returns an answer's cost, in the search's frame.
    answers : tuple of LoopResult
        Where the poses ended.
    """

    source: Float32Array
    reach: float
    cost_of: Callable[[LoopResult], float]
    answers: tuple[LoopResult, ...]

    def elsewhere(self, found: LoopResult) -> list[tuple[float, LoopResult]]:
        """Return the answers that lie elsewhere than one in the search's frame, with their costs, best first."""
        others = [one for one in self.answers if apart(self.source, found, one) > self.reach]
        return sorted(((self.cost_of(one), one) for one in others), key=lambda pair: pair[0])

    def stands_out(self, found: LoopResult) -> bool:
        """Return whether an answer, in the search's frame, fits better than chance explains."""
        elsewhere = [cost for cost, _ in self.elsewhere(found)]
        if len(elsewhere) < max(LEAST_ELSEWHERE * len(self.answers), 3):
            return True
        costs = np.log(np.maximum(elsewhere, LEAST_COST))
        own = np.log(max(self.cost_of(found), LEAST_COST))
        return bool(costs.min() - own > LEAST_GAP * costs.std(ddof=1))


def apart(source: Float32Array, one: LoopResult, two: LoopResult) -> float:
    """Return how far apart two answers put a source's elements along their normals, root mean square.

    It is the less of the offsets and of the motion's own velocities: offsets do not see what turns a plane over, and
    velocities do not see what turns a ball or a cone, however far. Elements count by how sure their normals are.
    """
    d = one.t.size
    points, normals = source[:, :3].astype(np.float64), source[:, 4:7].astype(np.float64)
    size = float(np.linalg.norm(one.A, axis=0).mean())
    between = np.eye(4)
    between[:d, :d] = np.linalg.solve(one.A, two.A)
    between[:d, 3] = np.linalg.solve(one.A, two.t - one.t)
    moves = transform_points(between, points) - points, _velocities(between, points)
    weights = np.maximum(source[:, 3], 0.0).astype(np.float64) * source[:, 7]
    squares = (float(weights @ (move * normals).sum(axis=1) ** 2) for move in moves)
    return size * float(np.sqrt(min(squares) / max(float(weights.sum()), 1e-300)))


def _velocities(T: Float64Array, points: Float64Array) -> Float64Array:
    """Return the velocities of points in the steady screw motion that a transform is the end of, and its stretch."""
    A = T[:3, :3]
    R = nearest_rotation(A)
    turn = log_rotation(R)
    along = np.linalg.solve(left_jacobian(turn), T[:3, 3])
    return np.asarray(np.cross(turn, points) + along + points @ (R.T @ A - np.eye(3)).T)
