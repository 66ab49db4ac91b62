"""Motions: the steps that a search may take from cell to cell, and the cells that each sweeps.

Costs are whole numbers, so that sums in any order are equal and a repaired search can be compared exactly with a fresh
one. A cell's cost is 128 at the least, and a motion's is the sum of its cells' costs times their weights; the weights
are its length in each cell, 408 to a cell's side (577 to its diagonal: 577 / 408 is the root of 2 to a millionth).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array, Int64Array
from seismo3d._validate import freeze

UNIT = 128
"""Least cost of a cell that can be entered."""
SIDE, DIAGONAL = 408, 577
"""Weight of a step along a cell's side, and along its diagonal."""


class MotionTable(NamedTuple):
    """Motions as flat arrays for compiled loops, ordered by the heading that they start with.

    Attributes
    ----------
    leaving, entering_first : ndarray of shape (headings + 1,), int64
        Motions of heading k are ``leaving[k]`` to ``leaving[k + 1]``; those that end with it are ``entering`` between
        the same places of ``entering_first``.
    entering : ndarray of shape (motions,), int64
    start, end, rows, columns : ndarray of shape (motions,), int64
        Headings, and the step in rows and columns.
    swept_first : ndarray of shape (motions + 1,), int64
    swept : ndarray of shape (cells, 3), int64
        Row and column from the start's, and weight, of the cells that each motion sweeps.
    floor : ndarray of shape (n, 2), int64
        No motion by (columns, rows) weighs less than the greatest ``floor @ [|columns|, |rows|]``.
    """

    leaving: Int64Array
    entering_first: Int64Array
    entering: Int64Array
    start: Int64Array
    end: Int64Array
    rows: Int64Array
    columns: Int64Array
    swept_first: Int64Array
    swept: AnyArray
    floor: Int64Array


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One step: from the middle of cell (0, 0) to the middle of another.

    Attributes
    ----------
    start, end : int
        Number of the heading before and after.
    rows, columns : int
        The step.
    swept : tuple of (int, int, int)
        Row, column and weight of each cell that it passes through; those of weight 0 must only be free.
    points : ndarray of shape (n, 4), float64
        Along the way: x, y (cells), heading (radians), and the length so far (cells).
    curvature : ndarray of shape (n - 1,), float64
        Of each piece between two points, one over cells, positive to the left.
    """

    start: int
    end: int
    rows: int
    columns: int
    swept: tuple[tuple[int, int, int], ...]
    points: Float64Array
    curvature: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """All motions of one kind of search.

    Attributes
    ----------
    headings : ndarray of shape (k,), float64
        Radians, from 0 up; one of them alone where direction does not matter.
    steps : tuple of Motion
    table : MotionTable
    """

    headings: Float64Array
    steps: tuple[Motion, ...]
    table: MotionTable

    def nearest_heading(self, heading: float) -> int:
        """Return the number of the heading nearest to an angle in radians."""
        return int(np.argmax(np.cos(self.headings - heading)))


def make_motions(headings: Float64Array, steps: list[Motion], floor: ArrayLike) -> Motions:
    """Gather steps into a table; they are ordered by their first heading."""
    steps = sorted(steps, key=lambda step: step.start)
    ints = {name: np.array([getattr(s, name) for s in steps], dtype=np.int64) for name in _INTS}
    bins = np.arange(len(headings) + 1)
    entering = np.argsort(ints["end"], kind="stable")
    swept_first = np.cumsum([0, *(len(step.swept) for step in steps)])
    table = MotionTable(
        np.searchsorted(ints["start"], bins), np.searchsorted(ints["end"][entering], bins), entering,
        ints["start"], ints["end"], ints["rows"], ints["columns"], swept_first,
        np.array([cell for step in steps for cell in step.swept], dtype=np.int64), np.array(floor, dtype=np.int64),
    )  # fmt: skip
    return Motions(freeze(np.array(headings, dtype=np.float64)), tuple(steps), table)


_INTS = ("start", "end", "rows", "columns")


def grid_motions() -> Motions:
    """Make the steps to a cell's eight neighbours, without a heading; diagonally only past free corners.

    Returns
    -------
    Motions
        A straight step costs half of both cells' costs times 408, a diagonal one times 577, and needs both corners
        free.
    """
    steps = []
    for rows in (-1, 0, 1):
        for columns in (-1, 0, 1):
            if rows == columns == 0:
                continue
            weight = DIAGONAL if rows and columns else SIDE
            swept = [(0, 0, weight // 2), (rows, columns, weight - weight // 2)]
            if rows and columns:
                swept += [(rows, 0, 0), (0, columns, 0)]
            heading, length = np.arctan2(rows, columns), float(np.hypot(rows, columns))
            points = np.array([[0.0, 0.0, heading, 0.0], [columns, rows, heading, length]])
            steps.append(Motion(0, 0, rows, columns, tuple(swept), freeze(points), freeze(np.zeros(1))))
    return make_motions(np.zeros(1), steps, [[SIDE, DIAGONAL - SIDE], [DIAGONAL - SIDE, SIDE]])
