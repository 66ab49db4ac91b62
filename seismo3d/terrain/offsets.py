"""Steps between two even grounds, all along a line: water leaves none, whichever way the ground slopes.

What runs down the slope is mostly water's, a valley or a spur between valleys. Either comes back to the height that it
left: across it the ground beyond is as high on one side as on the other, or as uneven as the valley is deep. A fault
that cuts an evenly sloping fan or plain leaves both sides even and of one slope, and one of them higher, everywhere.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.registration.robust import robust_scale
from seismo3d.terrain.prominence import even_path, paths_beside

_BESIDE = 8.0
"""Cells on each side of a line that belong to the step itself."""
_REACH = 48.0
"""Cells on each side up to which the ground is even: flanks of wider valleys are no lines."""
_WINDOW = 24
"""Cells along the line that a profile is the mean of."""
_LEAST_WINDOWS = 3
_LEAST_SHARE = 0.75
"""Share of the profiles whose step is of one sign and stands out from its own ground: a fault dies away at its tips."""
_STANDS_OUT = 4.0
"""Step over the unevenness of the ground on its two sides, at least."""
_MOST_ACROSS = 3.0
"""Slope across the line over that along it, at most: the flanks of a valley are steeper than its floor."""
_STEADY = 2.0
"""Median step over its scatter along the line, at least."""


def parts_even_ground(z: Float64Array, places: Float64Array) -> bool:
    """Return whether the ground is even on both sides of a line and higher on one of them all along.

    Parameters
    ----------
    z : ndarray of shape (rows, columns), float64
        Without holes.
    places : ndarray of shape (n, 2), float64
        (row, column).
    """
    path = even_path(places)
    n_windows = len(path) // _WINDOW
    if n_windows < _LEAST_WINDOWS:
        return False
    normals, _ = paths_beside(path)
    far = np.arange(_BESIDE, _REACH + 1.0)
    moves = np.concatenate([-far[::-1], far])
    across = path[:, None, :] + moves[None, :, None] * normals[:, None, :]
    inside = np.all((across >= 0.0) & (across <= np.array(z.shape) - 1.0), axis=2)
    heights = ndimage.map_coordinates(z, across.reshape(-1, 2).T, order=1, mode="nearest").reshape(inside.shape)
    windows, on_map = (part[: n_windows * _WINDOW].reshape(n_windows, _WINDOW, -1) for part in (heights, inside))
    whole = on_map.all(axis=(1, 2))
    profiles = windows[whole].mean(axis=1)
    if len(profiles) < _LEAST_WINDOWS:
        return False
    # one slope on both sides, a step, and the bend of a valley or of a side that is cut
    design = np.column_stack([np.ones(len(moves)), moves, 0.5 * np.sign(moves), np.abs(moves) / _REACH])
    fitted = np.linalg.lstsq(design, profiles.T, rcond=None)[0]
    steps, bends = fitted[2], np.abs(fitted[3])
    uneven = bends + np.sqrt(((profiles.T - design @ fitted) ** 2).mean(axis=0))
    along = np.polyfit(_WINDOW * np.flatnonzero(whole), profiles.mean(axis=1), 1)[0]
    if np.median(np.abs(fitted[1])) > _MOST_ACROSS * abs(along):
        return False
    middle = float(np.median(steps))
    good = (steps * np.sign(middle) > _STANDS_OUT * uneven).mean() >= _LEAST_SHARE
    return bool(good and abs(middle) >= _STEADY * robust_scale(steps - middle))
