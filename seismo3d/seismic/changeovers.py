"""Surfaces that change over from one fault to another where these cross: each part given to the one that it continues.

Where two faults cross at a low angle their ridges run into each other, and a surface that grows along one may go on
along the other, which the rest of that one's ridges then lack. Two smooth surfaces through the points of both tell them
apart again: a part that lies on the other one, and off its own, changes hands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._typing import AnyArray, BoolArray, Float64Array, IntArray
from seismo3d.seismic._kernels_changeovers import fit_most, settle_points
from seismo3d.seismic.sheet_distances import SheetNodes, bounds_of, near_boxes

# distances in traces and samples: where surfaces meet, and how far around there they are looked at
_MEET, _AROUND = 6.0, 45.0
# points of two surfaces that must lie so close, and of each around there; points of a part that changes hands
_LEAST_MET, _LEAST_AROUND, _LEAST_PART = 8, 200, 100
# least and largest angle between two surfaces that can run into each other
_ANGLES_DEG = (12.0, 50.0)
# about so many points of each tell the surfaces, but no surface is told by so few
_TOLD, _LEAST_FIT = 500, 30
# what the square of a bend, of a trace over such a length, counts beside the distances of points
_LENGTH, _RIDGE = 32.0, 0.05
# points farther off both surfaces lie on neither; off one by so much more than off the other they lie on the other
_OFF, _MORE = 4.0, 1.0
# median distances of a part that changes hands: from its own surface at least; from the other at most, and as a share
_OFF_OWN, _ON_OTHER, _SHARE_OFF = 2.5, 1.5, 0.2
# what two surfaces that tell parts apart leave of all points at most, on the mean, and as a share of what they left
_LEFT, _SHARE_LEFT = 0.95, 0.8
# share of a surface's points that lie off it, where it may have changed over, and by how much
_LOOSE, _LOOSE_BY = 0.04, 2.0
# refinements of surfaces, and how often parts are looked for anew
_ROUNDS, _PASSES = 12, 5
# edge of the cells in which points of a part lie side by side
_CELL = 2.0
_NOTHING = np.empty(0, np.int64)


def part_changeovers(positions: AnyArray, members: Sequence[IntArray], *, most: int) -> list[IntArray]:
    """Give parts of surfaces that have changed over to others to the ones that they continue.

    Parameters
    ----------
    positions : ndarray of shape (n, 3)
        (inline, crossline, sample) of points.
    members : sequence of ndarray of shape (m,), int
        Which of them belong to each surface, increasing.
    most : int
        About so many points are held beside those of the two surfaces that are compared.

    Returns
    -------
    list of ndarray of int
        The same of each surface then.
    """
    surfaces = _Surfaces(positions, list(members), most)
    changed, room = set(range(len(members))), [len(own) for own in members]
    for _ in range(_PASSES):
        moves = _find_moves(surfaces, changed)
        changed = set()
        for source, target, part in sorted(moves, key=lambda move: (-len(move[2]), *move[:2])):
            # what grows to twice its size by others' parts is no surface of its own
            if len(part) <= room[target] and not changed & {source, target}:
                surfaces.give(source, target, part)
                room[target] -= len(part)
                changed |= {source, target}
        if not changed:
            break
    return surfaces.members


class _Surfaces:
    """Surfaces of points, looked up by place when they are asked for; the last ones are kept for the next time."""

    def __init__(self, positions: AnyArray, members: list[IntArray], most: int) -> None:
        self.members = members
        self._positions = positions
        self._most = most
        self._kept: dict[int, SheetNodes] = {}
        self.boxes = np.array([bounds_of(self._points(number)) for number in range(len(members))]).reshape(-1, 2, 3)

    def nodes(self, number: int) -> SheetNodes:
        """Return a surface's points."""
        found = self._kept.pop(number, None) or SheetNodes.at(self._points(number))
        while self._kept and sum(len(nodes.points) for nodes in self._kept.values()) > self._most:
            self._kept.pop(next(iter(self._kept)))
        self._kept[number] = found
        return found

    def give(self, source: int, target: int, part: IntArray) -> None:
        """Give some of a surface's points, told by their places among its own, to another."""
        given = self.members[source][part]
        self.members[source] = np.delete(self.members[source], part)
        self.members[target] = np.sort(np.concatenate([self.members[target], given]))
        for number in (source, target):
            self._kept.pop(number, None)
            self.boxes[number] = bounds_of(self._points(number))

    def _points(self, number: int) -> Float64Array:
        return np.asarray(self._positions[self.members[number]], np.float64)


def _find_moves(surfaces: _Surfaces, changed: set[int]) -> list[tuple[int, int, IntArray]]:
    """Return parts of surfaces that lie on others, as (from, to, places), of pairs one of which has changed."""
    moves = []
    for one in range(len(surfaces.members)):
        for other in near_boxes(surfaces.boxes[:one], surfaces.boxes[one], _MEET):
            pair = _Pair.of(surfaces.nodes(one), surfaces.nodes(other)) if changed & {one, other} else None
            if pair is None:
                continue
            for (source, target), part in zip(((one, other), (other, one)), pair.parts(), strict=True):
                if len(part):
                    moves.append((source, target, part))
    return moves


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """Two surfaces around where they meet, as heights over their mean plane.

    Attributes
    ----------
    surfaces : tuple of SheetNodes
        The whole of each.
    places : tuple of ndarray, int
        Of the points of each among all of its own.
    flat : ndarray of shape (n, 2), float64
        Where the points of the first, then of the second, lie along the plane, about where the surfaces meet.
    height : ndarray of shape (n,), float64
        And across it.
    is_second : ndarray of shape (n,), bool
        Of which they are.
    line : ndarray of shape (2,), float64
        Direction across the line along which they meet.
    """

    surfaces: tuple[SheetNodes, SheetNodes]
    places: tuple[IntArray, IntArray]
    flat: Float64Array
    height: Float64Array
    is_second: BoolArray
    line: Float64Array

    @classmethod
    def of(cls, first: SheetNodes, second: SheetNodes) -> _Pair | None:
        """Lay two surfaces out; None where they do not meet, or not as those that run into each other do."""
        met = first.points[first.are_within(second, _MEET)]
        if len(met) < _LEAST_MET:
            return None
        there = SheetNodes.at(met)
        places = [np.flatnonzero(one.lie_around(there, _AROUND)) for one in (first, second)]
        if min(len(place) for place in places) < _LEAST_AROUND:
            return None
        parts = first.points[places[0]], second.points[places[1]]
        normals = [_principal(_some(part))[2] for part in parts]
        cosine = float((normals[0] * normals[1]).sum())
        if abs(cosine) < np.cos(np.radians(_ANGLES_DEG[1])):
            return None
        across = normals[0] + np.sign(cosine) * normals[1]
        across /= np.sqrt((across**2).sum())
        level = np.cross(across, np.eye(3)[np.argmin(np.abs(across))])
        level /= np.sqrt((level**2).sum())
        frame = np.stack([level, np.cross(across, level), across])
        middle = met.mean(axis=0)
        off = (np.concatenate(parts) - middle) @ frame.T
        line = _principal(((met - middle) @ frame.T)[:, :2])[1]
        is_second = np.arange(len(off)) >= len(parts[0])
        return cls((first, second), (places[0], places[1]), off[:, :2], off[:, 2], is_second, line)

    def parts(self) -> tuple[IntArray, IntArray]:
        """Return the places of the points of each that lie on the other."""
        told = np.concatenate([_some(np.flatnonzero(self.is_second == second)) for second in (False, True)])
        terms, height, own = _terms(self.flat[told]), self.height[told], self.is_second[told]
        if not (_is_loose(terms[~own], height[~own]) or _is_loose(terms[own], height[own])):
            return _NOTHING, _NOTHING
        surfaces = _tell_surfaces(terms, height, own, self.flat[told] @ self.line > 0.0)
        if surfaces is None or _angle_deg(surfaces) < _ANGLES_DEG[0]:
            return _NOTHING, _NOTHING
        off = np.abs(self.height - np.stack([_terms(self.flat) @ factors for factors in surfaces]))
        return self._part(off, second=False), self._part(off[::-1], second=True)

    def _part(self, off: Float64Array, *, second: bool) -> IntArray:
        """Return the places of one surface's points that lie on the other; distances are off its own, then off that."""
        mine = self.is_second == second
        own, other = off[:, mine]
        cell = np.rint(self.flat[mine] / _CELL).astype(np.int64)
        cell -= cell.min(axis=0)
        grid = np.zeros(cell.max(axis=0) + 1, bool)
        moves = (own - other > _MORE) & (other < _OFF)
        grid[tuple(cell[moves].T)] = True
        label = ndimage.label(grid, np.ones((3, 3)))[0][tuple(cell.T)]
        label[~moves] = 0
        is_part = np.zeros(len(label), bool)
        theirs = int((off[1][~mine] < _OFF_OWN).sum())
        for number in range(1, int(label.max()) + 1):
            part = label == number
            if (
                _LEAST_PART <= part.sum() <= min(theirs, len(part) // 2)
                and np.median(own[part]) >= _OFF_OWN
                and np.median(other[part]) <= min(_ON_OTHER, _SHARE_OFF * np.median(own[part]))
            ):
                is_part |= part
        return self._carry_on(is_part, self.surfaces[second], self.places[second]) if is_part.any() else _NOTHING

    @staticmethod
    def _carry_on(is_part: BoolArray, surface: SheetNodes, places: IntArray) -> IntArray:
        """Return the places of a part's points, and of those farther off where surfaces meet that lie nearest to it."""
        far = np.ones(len(surface.points), bool)
        far[places] = False
        beyond = np.flatnonzero(far)
        nearest = cKDTree(surface.points[places]).query(surface.points[beyond])[1]
        return np.sort(np.concatenate([places[is_part], beyond[is_part[nearest]]]))


def _is_loose(terms: Float64Array, height: Float64Array) -> bool:
    """Tell whether a surface has many points that lie off where most of them do."""
    off = fit_most(terms, height, _RIDGE, _ROUNDS)
    return float((off > _LOOSE_BY).mean()) >= _LOOSE


def _tell_surfaces(terms: Float64Array, height: Float64Array, own: BoolArray, beyond: BoolArray) -> Float64Array | None:
    """Return the factors of the two smooth surfaces that leave least of all points, those of the first one first.

    `own` is true of the second surface's points, `beyond` on one side of the line where both meet. Each of the four
    halves may be the other's, or two of them. None where the points lie on no such surfaces, or hardly nearer to them
    than to the ones through the points of each as they are: a surface that winds has no parts of another.
    """
    best, least = None, min(_LEFT, _SHARE_LEFT * _left_as_they_are(terms, height, own))
    for start in (own, own | beyond, own | ~beyond, own & beyond, own & ~beyond, own ^ beyond):
        surfaces, on_second = np.empty((2, terms.shape[1])), start.copy()
        left = settle_points(terms, height, on_second, _RIDGE, _MORE, _OFF, _LEAST_FIT, _ROUNDS, surfaces)
        if left < least:
            swapped = 2 * np.count_nonzero(on_second != own) > len(own)
            best, least = surfaces[::-1] if swapped else surfaces, left
    return best


def _left_as_they_are(terms: Float64Array, height: Float64Array, own: BoolArray) -> float:
    """Return how far points lie from the smooth surface through those of their own, on the mean, and what both bend."""
    surfaces = np.empty((2, terms.shape[1]))
    settle_points(terms, height, own.copy(), _RIDGE, np.inf, np.inf, 1, 1, surfaces)
    off = np.abs(height - np.where(own, terms @ surfaces[1], terms @ surfaces[0]))
    return float(np.minimum(off, _OFF).mean() + _RIDGE * (surfaces[:, 3:] ** 2).sum())


def _angle_deg(surfaces: Float64Array) -> float:
    """Return the angle between two surfaces where they meet."""
    first, second = (np.array([*factors[1:3] / _LENGTH, -1.0]) for factors in surfaces)
    cosine = float((first * second).sum()) / float(np.sqrt((first**2).sum() * (second**2).sum()))
    return float(np.degrees(np.arccos(min(1.0, cosine))))


def _some(values: AnyArray) -> AnyArray:
    """Return every so many of a list, so that there are not too many."""
    return values[:: max(1, len(values) // _TOLD)]


def _principal(points: Float64Array) -> Float64Array:
    """Return the directions in which points spread, most first, as rows."""
    off = points - points.mean(axis=0)
    matrix = np.array([[float((a * b).sum()) for a in off.T] for b in off.T])
    return np.asarray(np.linalg.eigh(matrix)[1][:, ::-1].T)


def _terms(flat: Float64Array) -> Float64Array:
    """Return what a smooth surface is combined of at places along its plane: shape (n, 6)."""
    x, y = flat.T / _LENGTH
    return np.column_stack([np.ones(len(flat)), x, y, x * x, x * y, y * y])
