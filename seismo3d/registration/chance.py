"""Agreement that chance explains: an answer beside all that the poses tried for it led to.

The loop lays any scan on any other somehow, and the best of many poses looks like an answer. Of scans that show the
same, the poses gather at the answer, or it fits far better than the others do; of unrelated ones each pose leads
somewhere else, and the best is but the first among many.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array
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

    def stands_out(self, found: LoopResult) -> bool:
        """Return whether an answer, in the search's frame, fits better than chance explains."""
        elsewhere = [self.cost_of(one) for one in self.answers if _apart(self.source, found, one) > self.reach]
        if len(elsewhere) < max(LEAST_ELSEWHERE * len(self.answers), 3):
            return True
        costs = np.log(np.maximum(elsewhere, LEAST_COST))
        own = np.log(max(self.cost_of(found), LEAST_COST))
        return bool(costs.min() - own > LEAST_GAP * costs.std(ddof=1))


def _apart(source: Float32Array, one: LoopResult, two: LoopResult) -> float:
    """Return how far apart two answers put a source's elements along their normals, root mean square."""
    d = one.t.size
    moved = source[:, :d] @ (one.A - two.A).T + (one.t - two.t)
    normals = source[:, 4 : 4 + d] @ one.A.T / np.linalg.norm(one.A, axis=0).mean()
    return float(np.sqrt(np.mean((moved * normals).sum(axis=1) ** 2)))
