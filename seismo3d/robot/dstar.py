"""D* Lite over cells and motions: plans once, then repairs the plan as costs change and the start moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Int64Array
from seismo3d._validate import as_real_array, freeze
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.robot import _kernels_search as k
from seismo3d.robot.motions import UNIT, Motions

_MOST_COST = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class Repair:
    """What a repair came to.

    Attributes
    ----------
    state : str
        "found", or "no way".
    cost : int
        Of the whole way, in the units of :mod:`seismo3d.robot.motions`; -1 without one.
    expansions : int
        Vertices whose distance was set, with repetition.
    most : int
        Times that one vertex was expanded: 2 at most.
    """

    state: str
    cost: int
    expansions: int
    most: int


class DStarLite:
    r"""Shortest ways to one goal over a grid whose costs change [1]_, the optimised version.

    A plan expands at most all V vertices, each once; a repair each of those whose distance changes at most twice, and
    only those that can lie on a better way than the one found. An expansion looks at B motions of C cells and moves
    vertices in a heap: O(B (C + log V)). So a plan takes O(V B (C + log V)) and a repair with E expansions
    O(E B (C + log V)), E <= 2 V. Memory is O(V): 52 bytes a vertex, two thirds of them taken only as the search
    reaches it.

    Parameters
    ----------
    cost : array_like of shape (rows, columns), int
        Cost of each cell: 0 where it cannot be entered, else 128 to 1048576.
    motions : Motions
        From :func:`~seismo3d.robot.motions.grid_motions` or :func:`~seismo3d.robot.lattice.lattice_motions`.
    start, goal : (int, int, int)
        Row, column and number of the heading; heading -1 for any.

    Attributes
    ----------
    cost : ndarray of shape (rows, columns), int32
        As it is now; change it by :meth:`update` only.

    Raises
    ------
    ShapeError, ParameterError
        If costs, start or goal cannot be.

    Notes
    -----
    Costs are whole numbers, so that the cost found equals a fresh search's, bit by bit.

    References
    ----------
    .. [1] S. Koenig, M. Likhachev, IEEE Transactions on Robotics 21(3), 354-363, 2005. :doi:`10.1109/TRO.2004.838026`

    Examples
    --------
    >>> from seismo3d.robot.motions import grid_motions
    >>> search = DStarLite(np.full((3, 5), 128), grid_motions(), start=(1, 0, -1), goal=(1, 4, -1))
    >>> search.repair().cost == 4 * 408 * 128
    True
    """

    def __init__(
        self, cost: ArrayLike, motions: Motions, *, start: tuple[int, int, int], goal: tuple[int, int, int]
    ) -> None:
        self.cost = _as_cost(cost, "cost", 2)
        self.motions = motions
        self.goal = self._as_place(goal, "goal")
        self.start = self._as_place(start, "start")
        self._offset = 0
        n = len(motions.headings) * self.cost.size
        self._g, self._rhs = np.full(n, k.FAR, dtype=np.int64), np.full(n, k.FAR, dtype=np.int64)
        self._heap, self._keys = np.empty(n + 1, dtype=np.int64), np.empty((n + 1, 2), dtype=np.int64)
        self._place, self._visits, self._seen = (np.zeros(n, dtype=np.int32) for _ in range(3))
        self._state = np.zeros(4, dtype=np.int64)
        headings = range(len(motions.headings)) if self.goal[2] < 0 else (self.goal[2],)
        for heading in headings:
            vertex = (heading * self.cost.shape[0] + self.goal[0]) * self.cost.shape[1] + self.goal[1]
            self._rhs[vertex] = 0
            k.refresh(
                vertex, self._g, self._rhs, self._heap, self._keys, self._place, self._state, self.cost.shape,
                self.start, self._offset, motions.table,
            )  # fmt: skip

    def repair(self) -> Repair:
        """Make the way from the start final: the first time a whole search, later only what changes ask for."""
        vertex, expansions, most = k.repair(
            self._g, self._rhs, self._heap, self._keys, self._place, self._state, self._visits, self.cost, self.start,
            self.goal, self._offset, self.motions.table,
        )  # fmt: skip
        self._first = vertex
        cost = int(self._rhs[vertex])
        found = cost < k.FAR and self.cost[self.start[0], self.start[1]] > 0
        return Repair("found" if found else "no way", cost if found else -1, int(expansions), int(most))

    def update(self, rows_columns: ArrayLike, costs: ArrayLike) -> None:
        """Give cells (row, column), shape (n, 2), new costs, shape (n,); the next :meth:`repair` heeds them."""
        where = np.asarray(rows_columns, dtype=np.int64)
        if where.ndim != 2 or where.shape[1] != 2:
            raise ShapeError(f"rows_columns has shape {where.shape}; expected (n, 2): one cell a row.")
        if not len(where):
            return
        if (where < 0).any() or (where >= self.cost.shape).any():
            raise ParameterError(
                f"rows_columns leaves the map of {self.cost.shape[0]} x {self.cost.shape[1]} cells. "
                "Give cells within it."
            )
        values = _as_cost(costs, "costs", 1)
        if len(values) != len(where):
            raise ShapeError(f"costs has {len(values)} elements; expected {len(where)}, one a cell.")
        k.change_cells(
            np.ascontiguousarray(where), values, self._g, self._rhs, self._heap, self._keys, self._place, self._state,
            self._seen, self.cost, self.start, self.goal, self._offset, self.motions.table,
        )  # fmt: skip

    def move_to(self, start: tuple[int, int, int]) -> None:
        """Go on from another start: the queue's order stays right, by an offset that grows with the way gone."""
        place = self._as_place(start, "start")
        self._offset += int(k.least_cost(place[0] - self.start[0], place[1] - self.start[1], self.motions.table))
        self.start = place

    def route(self) -> tuple[int, Int64Array]:
        """Return the heading's number at the start and the motions' numbers to the goal, after a repair found them."""
        out = np.empty(len(self._g), dtype=np.int64)
        n = k.follow(self._first, self._g, self.cost, self.goal, self.motions.table, out)
        if n < 0:
            raise ParameterError("there is no way to follow: the last repair found none. Check its state first.")
        return int(self._first // self.cost.size), freeze(out[:n].copy())

    def _as_place(self, place: tuple[int, int, int], name: str) -> tuple[int, int, int]:
        row, column, heading = (int(value) for value in place)
        rows, columns = self.cost.shape
        if not (0 <= row < rows and 0 <= column < columns and -1 <= heading < len(self.motions.headings)):
            raise ParameterError(
                f"{name} is {(row, column, heading)}; expected a row below {rows}, a column below {columns}, and a "
                f"heading below {len(self.motions.headings)} or -1 for any."
            )
        return row, column, heading


def _as_cost(values: ArrayLike, name: str, ndim: int) -> AnyArray:
    cost = as_real_array(values, name, ndim=ndim)
    if cost.dtype.kind not in "iu" or ((cost != 0) & ((cost < UNIT) | (cost > _MOST_COST))).any():
        raise ParameterError(
            f"{name} holds values that are no costs; expected whole numbers: 0, or {UNIT} to {_MOST_COST}."
        )
    return np.array(cost, dtype=np.int32)
