"""Fault-line valleys: troughs that run straight on across divides, as no river's valley does by itself.

Crushed rock along a fault wears faster: side valleys on both sides of a divide are led along it, and the divide
itself is notched where the fault crosses it. A river's own valley only falls. So a line of hollows is taken for a
fault's where

- it stands out as a hollow from the same path laid beside it, as every lineament must, and by more, as valleys abound;
- it lies lower than the paths beside it, all along: a way across ridges and valleys by turns lies no lower than others;
- its floor is more even than theirs, whose ways go up and down over the ridges;
- its floor rises and falls: it goes on over at least one divide;
- no other runs alike beside it, as troughs between dunes, folds and moraines do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.terrain.assembling import assemble_lines, straight_over
from seismo3d.terrain.evidence import SCALE, TerrainEvidence
from seismo3d.terrain.joining import runs_beside
from seismo3d.terrain.placing import snap_line
from seismo3d.terrain.prominence import judge_by, paths_beside
from seismo3d.terrain.support import LineSupport
from seismo3d.terrain.tracing import TracedLine

if TYPE_CHECKING:
    from seismo3d.terrain.lineament_search import LineamentSettings

_ASIDE = 3
"""Cells on each side of a path among which its floor is the lowest."""
_SMOOTH = 8.0
"""Width of the Gaussian along a floor, in cells, that takes out the steps from cell to cell."""
_MOST_LOWER = 0.1
"""Largest share of the paths beside whose floors lie lower on the mean."""
_LEAST_RETURN = 1.0 / 3.0
"""Rise over fall along a floor, or fall over rise, whichever is smaller, that one across a divide has at least."""
_MOST_UNEVEN = 0.9
"""Largest rise and fall together, over those of a typical path beside."""
_EVENEST = 0.5
"""Unevenness below which a floor counts no more."""
_FABRIC = 90.0
"""Cells aside within which valleys that run alike are one fabric, and those nearer than `_SAME` are one valley."""
_SAME = 12.0
_ON_MAP = 0.8
"""Share of a path beside that must lie on the map."""
_LEAST_PATHS = 6


@dataclass(frozen=True, slots=True)
class Floor:
    """A path's lowest ground against that of the paths beside it.

    Attributes
    ----------
    lower : float
        Share of the paths beside whose floor lies lower on the mean.
    unevenness : float
        Its rise and fall together, over the median of theirs.
    turn_back : float
        Its rise over its fall, or its fall over its rise: 0 for a river, 1 where both ends lie alike.
    """

    lower: float
    unevenness: float
    turn_back: float

    @property
    def crosses_divides(self) -> bool:
        """Whether this is the floor of a valley that goes on over a divide."""
        return self.lower <= _MOST_LOWER and self.unevenness <= _MOST_UNEVEN and self.turn_back >= _LEAST_RETURN


def measure_floor(z: Float64Array, places: Float64Array) -> Floor | None:
    """Return a path's floor against those of the paths beside it; None where fewer than six of them lie on the map.

    Parameters
    ----------
    z : ndarray of shape (rows, columns), float64
        Without holes.
    places : ndarray of shape (n, 2), float64
        (row, column), about a cell apart.
    """
    normals, moves = paths_beside(places)
    own = _floor(z, places)
    others = []
    last = np.array(z.shape) - 1.0
    for move in moves:
        moved = places + move * normals
        if ((moved >= 0.0) & (moved <= last)).all(axis=1).mean() >= _ON_MAP:
            others.append(_floor(z, moved))
    if len(others) < _LEAST_PATHS:
        return None
    ways = np.diff(own)
    rise, fall = float(ways[ways > 0.0].sum()), float(-ways[ways < 0.0].sum())
    typical = float(np.median([np.abs(np.diff(one)).sum() for one in others]))
    return Floor(
        lower=float(np.mean([one.mean() < own.mean() for one in others])),
        unevenness=(rise + fall) / max(typical, 1e-12),
        turn_back=min(rise, fall) / max(rise, fall, 1e-12),
    )


def find_valleys(
    pieces: list[TracedLine],
    hollow: LineSupport,
    z: Float64Array,
    levels: list[TerrainEvidence],
    settings: LineamentSettings,
) -> list[TracedLine]:
    """Join pieces of troughs into lines as long as they stand out, and return those that cross divides.

    Parameters
    ----------
    pieces : list of TracedLine
        Troughs of all levels, rivers among them.
    hollow : LineSupport
        Of troughs, at the finest level.
    z : ndarray of shape (rows, columns), float64
        Without holes, in cells.
    levels : list of TerrainEvidence
    settings : LineamentSettings
    """
    crest, judge = ndimage.gaussian_filter(hollow.score, 2.0 * SCALE), judge_by(levels)
    lines = assemble_lines(
        pieces, crest, score=hollow.score, judge=judge,
        goes_on=lambda line: line.length >= 2.0 * settings.length, settings=settings,
    )  # fmt: skip
    out = []
    for line in lines:
        placed = snap_line(line, crest, stiffness=straight_over(line, settings), reach=3.0 * settings.near)
        made = TracedLine(placed.places, placed.score, "valley", placed.factor)
        if is_valley(made, judge(made), z, settings):
            out.append(made)
    return [line for line in out if not any(_are_alike(line, other) for other in out)]


def _are_alike(line: TracedLine, other: TracedLine) -> bool:
    """Return whether another valley runs alike beside a valley."""
    factor = max(line.factor, other.factor)
    if runs_beside(line, [other], near=_SAME / factor):
        return False
    return runs_beside(line, [other], near=_FABRIC / factor, share=0.5)


def is_valley(line: TracedLine, prominence: float, z: Float64Array, settings: LineamentSettings) -> bool:
    """Return whether a line of hollows is long, stands out, and crosses divides."""
    shortest = settings.least_length * settings.length
    if line.length < shortest:
        return False
    floor = measure_floor(z, line.places)
    if floor is None or not floor.crosses_divides:
        return False
    stands_out = prominence * float(np.sqrt(line.length / shortest))
    if stands_out < settings.least_prominence:
        return False
    return stands_out / max(floor.unevenness, _EVENEST) >= settings.least_valley


def _floor(z: Float64Array, places: Float64Array) -> Float64Array:
    """Return the lowest ground within a few cells of each place, smoothed along the path."""
    normals, _ = paths_beside(places)
    moves = np.arange(-float(_ASIDE), _ASIDE + 1.0)
    at = places[:, None, :] + moves[None, :, None] * normals[:, None, :]
    values = ndimage.map_coordinates(z, at.reshape(-1, 2).T, order=1, mode="nearest").reshape(at.shape[:2])
    return np.asarray(ndimage.gaussian_filter1d(values.min(axis=1), _SMOOTH, mode="nearest"))
