"""Lines that keep to one height where the ground beside them does not: edges of terraces, shores and roads.

A fault cuts the ground on a plane: its trace goes up and down with the ground, as every straight path beside it does.
The edge of a terrace bends so as to stay level. On ground that is level along the line on one side at least, as at the
foot of a range, both look alike, and nothing is said. A valley is level because water keeps to it, and says nothing
either. Faults by chance rise and fall three quarters as much as what lies beside them; edges of terraces a quarter.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.terrain.evidence import SCALE
from seismo3d.terrain.prominence import even_path, paths_beside

_SMOOTH = 12.0
"""Width of the Gaussian along a path, in cells."""
_MOST_LEVEL = 0.6
"""Rise and fall of a line over those of a typical path on its more level side, below which it keeps to a height."""
_LOWEST = 0.1
"""Share of the paths beside that lie lower, below which the line is a valley."""
_ON_MAP = 0.8
_LEAST_PATHS = 3


def follows_contour(z: Float64Array, places: Float64Array) -> bool:
    """Return whether a line rises and falls much less than the paths on both sides of it, and is no valley.

    Parameters
    ----------
    z : ndarray of shape (rows, columns), float64
        Without holes.
    places : ndarray of shape (n, 2), float64
        (row, column).
    """
    path = even_path(places)
    normals, moves = paths_beside(path)
    # the height that an edge keeps to is somewhere on its riser
    own = [_way_of(z, path, normals, move) for move in (-SCALE, 0.0, SCALE)]
    sides = [[_way_of(z, path, normals, move) for move in moves if np.sign(move) == side] for side in (-1.0, 1.0)]
    known = [[way for way in side if np.isfinite(way[0])] for side in sides]
    enough = [np.median([way[0] for way in side]) for side in known if len(side) >= _LEAST_PATHS]
    if not enough or not np.isfinite(own[1][0]):
        return False
    heights = np.array([way[1] for side in known for way in side])
    is_valley = np.mean(heights < own[1][1]) <= _LOWEST
    return not is_valley and float(np.nanmin([way[0] for way in own])) < _MOST_LEVEL * float(min(enough))


def _way_of(z: Float64Array, path: Float64Array, normals: Float64Array, move: float) -> tuple[float, float]:
    """Return rise and fall together, and the mean height, of a path moved aside; NaN where it leaves the map."""
    at = path + move * normals
    inside = ((at >= 0.0) & (at <= np.array(z.shape) - 1.0)).all(axis=1)
    if inside.mean() < _ON_MAP:
        return float("nan"), float("nan")
    heights = ndimage.gaussian_filter1d(
        ndimage.map_coordinates(z, at.T, order=1, mode="nearest"), _SMOOTH, mode="nearest"
    )
    return float(np.abs(np.diff(heights)).sum()), float(heights.mean())
