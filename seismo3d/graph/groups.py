"""Groups of strongly linked vertices, for the part of a graph's equations that no solver of single vertices gets at.

What a region of a graph lies off as a whole, held to the rest by few or weak links, is told only after as many steps of
a conjugate gradient method as the region is wide, and more where weights differ by orders. Among groups of vertices it
is told at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array

# each pass joins the vertices two by two
_PASSES = 2
# groups of groups that are few enough for a direct solver
_MOST_DIRECT = 500
# what keeps regions without any link to the rest where they are: a share of what each vertex weighs
_HOLD = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class GroupCorrection:
    """Corrects groups of vertices as a whole.

    By a cycle of algebraic multigrid on the equations of the groups, which are joined pair by pair along the strongest
    links (Y. Notay, "An aggregation-based algebraic multigrid method", Electronic Transactions on Numerical Analysis
    37, 2010); symmetric, so that it may precondition conjugate gradients.

    Attributes
    ----------
    group : ndarray of shape (vertex,), int32
        The group of every vertex.
    n_groups : int
    solver
        Levels of groups, and what solves the equations of the last.
    """

    group: Int32Array
    n_groups: int
    solver: Any

    @classmethod
    def of(cls, first: AnyArray, second: AnyArray, weight: AnyArray, n_vertices: int) -> GroupCorrection:
        """Group the vertices of a graph.

        Parameters
        ----------
        first, second : ndarray of shape (n,), int
            Vertices at the ends of the links.
        weight : ndarray of shape (n,), float
            Their weights, positive.
        n_vertices : int

        Returns
        -------
        GroupCorrection
        """
        from pyamg import MultilevelSolver, pairwise_solver

        ends = np.concatenate([first, second]), np.concatenate([second, first])
        links = sparse.coo_matrix((np.concatenate([-weight, -weight]), ends), shape=(n_vertices,) * 2).tocsr()
        whole = -np.asarray(links.sum(axis=1), np.float64).ravel()
        held = whole * (1 + _HOLD) + _HOLD * max(whole.max(initial=0.0), 1.0) * 1e-3
        matrix = (links + sparse.diags(held)).tocsr()
        levels = pairwise_solver(
            matrix,
            aggregate=("pairwise", {"matchings": _PASSES}),
            presmoother=("gauss_seidel", {"sweep": "forward"}),
            postsmoother=("gauss_seidel", {"sweep": "backward"}),
            max_coarse=_MOST_DIRECT,
            coarse_solver="splu",
        ).levels
        joined = levels[0].P.tocsr() if len(levels) > 1 else sparse.identity(n_vertices, format="csr")
        solver = MultilevelSolver(levels[1:] or levels, coarse_solver="splu")
        return cls(joined.indices.astype(np.int32), joined.shape[1], solver)

    def solve(self, gradient: AnyArray) -> tuple[Float64Array, float]:
        """Return the correction of every group for a gradient by vertex, and the inner product of the two."""
        pulls = np.bincount(self.group, gradient.reshape(-1), self.n_groups).astype(np.float64, copy=False)
        moves = self._cycle(0, pulls)
        return moves, float((pulls * moves).sum())

    def _cycle(self, level: int, pulls: Float64Array) -> Float64Array:
        """Return what one V-cycle from a level on makes of the gradient there.

        The solver's own method asks for norms as well, for which the linear algebra wakes its threads at every step;
        they take the processors from the kernels between two steps.
        """
        at = self.solver.levels[level]
        if level == len(self.solver.levels) - 1:
            return np.asarray(self.solver.coarse_solver(at.A, pulls))
        moves = np.zeros_like(pulls)
        at.presmoother(at.A, moves, pulls)
        moves += at.P @ self._cycle(level + 1, at.R @ (pulls - at.A @ moves))
        at.postsmoother(at.A, moves, pulls)
        return moves

    def add(self, moves: Float64Array, values: Float32Array) -> None:
        """Move the values of every group's vertices, in place."""
        flat = values.reshape(-1)
        flat += moves.astype(np.float32)[self.group]
