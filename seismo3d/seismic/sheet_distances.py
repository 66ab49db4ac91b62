"""How far sheets lie from each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d.seismic.sheets import Sheet

# edge of the cells that nodes are sorted into
_CELL = 8.0
# every so many nodes are looked at first
_FEW = 32


@dataclass(frozen=True, slots=True, eq=False)
class SheetNodes:
    """The nodes of a sheet, or other points, to be looked up by place.

    Attributes
    ----------
    points : ndarray of shape (n, 3), float64
        (inline, crossline, sample) of each, in the order of the grid.
    bounds : ndarray of shape (2, 3), float64
        Their least and largest.
    tree : cKDTree
        Of the points.
    cells : ndarray of shape (m, 3), float64
        Middle of every cell of the cube that holds some.
    cell : ndarray of shape (n,), int64
        Row of the cells that each lies in.
    """

    points: Float64Array
    bounds: Float64Array
    tree: cKDTree
    cells: Float64Array
    cell: IntArray

    @classmethod
    def of(cls, sheet: Sheet) -> SheetNodes:
        """Look up the nodes of a sheet that has some."""
        return cls.at(sheet.nodes())

    @classmethod
    def at(cls, points: Float64Array) -> SheetNodes:
        """Look up some points."""
        cells, cell = _sort_into_cells(points)
        return cls(points, bounds_of(points), cKDTree(points), cells, cell)

    def are_within(self, other: SheetNodes, distance: float) -> BoolArray:
        """Tell which nodes lie within a distance of those of another; cells that are apart are not searched."""
        found = np.zeros(len(self.points), bool)
        if not are_near(self.bounds, other.bounds, distance):
            return found
        searched = within_box(self.cells, other.bounds, distance + 0.5 * _CELL)
        farthest = distance + 0.5 * np.sqrt(3.0) * _CELL
        searched[searched] = other.tree.query(self.cells[searched], distance_upper_bound=farthest)[0] < np.inf
        if searched.any():
            near = searched[self.cell]
            found[near] = other.tree.query(self.points[near], distance_upper_bound=distance)[0] < np.inf
        return found

    def lie_around(self, other: SheetNodes, distance: float) -> BoolArray:
        """Tell which nodes lie within about a distance of those of another: whole cells, by their middles."""
        return np.asarray(other.tree.query(self.cells, distance_upper_bound=distance)[0] < np.inf)[self.cell]

    def touches(self, other: SheetNodes, distance: float) -> bool:
        """Tell whether any node lies within a distance of those of another."""
        if not are_near(self.bounds, other.bounds, distance):
            return False
        # most that touch do so in many places: a few nodes show it
        few = other.tree.query(self.points[::_FEW], distance_upper_bound=distance)[0] < np.inf
        return bool(few.any() or self.are_within(other, distance).any())


def _sort_into_cells(points: Float64Array) -> tuple[Float64Array, IntArray]:
    """Return the middle of every cell that holds points, and which of them each point lies in."""
    place = np.floor(points / _CELL).astype(np.int64)
    place -= place.min(axis=0)
    size = place.max(axis=0) + 1
    _, first, cell = np.unique(np.ravel_multi_index(tuple(place.T), size), return_index=True, return_inverse=True)
    return _CELL * (np.floor(points[first] / _CELL) + 0.5), cell.astype(np.int64)


def within_box(points: Float64Array, bounds: Float64Array, reach: float) -> BoolArray:
    """Tell which points come within a distance, along every axis, of a box as :func:`bounds_of` gives it."""
    return np.asarray(((points >= bounds[0] - reach) & (points <= bounds[1] + reach)).all(axis=1))


def bounds_of(points: Float64Array) -> Float64Array:
    """Return the least and the largest of every coordinate of points, float64 of shape (2, coordinate)."""
    return np.stack([points.min(axis=0), points.max(axis=0)])


def are_near(one: Float64Array, other: Float64Array, reach: float) -> bool:
    """Tell whether two boxes, as :func:`bounds_of` gives them, come within a distance along every axis."""
    return bool((one[0] <= other[1] + reach).all() and (other[0] <= one[1] + reach).all())


def near_boxes(boxes: Float64Array, box: Float64Array, reach: float) -> list[int]:
    """Return the numbers of those of many boxes, of shape (n, 2, coordinate), for which :func:`are_near` holds."""
    near = (boxes[:, 0] <= box[1] + reach) & (box[0] <= boxes[:, 1] + reach)
    return [int(n) for n in np.flatnonzero(near.all(axis=1))]
