"""Anderson's acceleration of a fixed-point iteration."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float64Array


class Accelerator:
    """Remembers the last steps of an iteration x -> g(x) and extrapolates to where they would end [1]_.

    Parameters
    ----------
    depth : int
        Steps that are remembered; 0 switches it off.

    References
    ----------
    .. [1] D. G. Anderson, Iterative procedures for nonlinear integral equations, J. ACM 12(4), 1965.
       :doi:`10.1145/321296.321305`
    """

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._images: list[Float64Array] = []
        self._steps: list[Float64Array] = []

    def forget(self) -> None:
        """Drop what is remembered."""
        self._images.clear()
        self._steps.clear()

    def extrapolate(self, before: Float64Array, after: Float64Array) -> Float64Array | None:
        """Return the extrapolated iterate after a step from ``before`` to ``after``; None on the first."""
        self._images.append(after)
        self._steps.append(after - before)
        if len(self._steps) > self._depth + 1:
            del self._images[0], self._steps[0]
        if len(self._steps) < 2 or self._depth == 0:
            return None
        step = self._steps[-1]
        changes = np.array([step - other for other in self._steps[:-1]]).T
        size = float((changes**2).sum())
        if size == 0.0:
            return None
        gram = changes.T @ changes + 1e-10 * size * np.eye(changes.shape[1])
        weights = np.linalg.solve(gram, changes.T @ step)
        jump = sum(w * (self._images[-1] - other) for w, other in zip(weights, self._images[:-1]))
        moved = self._images[-1] - jump
        if np.linalg.norm(moved - before) > 10.0 * np.linalg.norm(step):
            return None
        return np.asarray(moved)


class Stall:
    """Notices that the cost has stopped falling: nearest pairs swap to and fro for ever near a solution."""

    def __init__(self) -> None:
        self._best = np.inf
        self._cutoff = 0.0
        self._waited = 0

    def reached(self, cost: float, cutoff: float) -> bool:
        """Return whether four passes have not lowered the cost by a thousandth."""
        if cutoff != self._cutoff or cost < 0.999 * self._best:
            self._best, self._cutoff, self._waited = cost, cutoff, 0
        else:
            self._waited += 1
        return self._waited >= 4
