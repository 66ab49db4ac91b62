"""The place of a line on its crest: of all paths beside it, the one that gains most for its bends."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float32Array, Float64Array, IntArray
from seismo3d.terrain.tracing import TracedLine

_NODE, _GRAIN = 16, 0.25
"""Cells from node to node of a line that is brought to its crest, and the grain of the moves aside, in cells."""
_TURNS = 4
"""Grains that a line moves aside from node to node at most: some 4 degrees against its smoothed way."""
_BEND_PRICE = 0.5
"""Nodes on a typical crest that a bend by one grain costs: faults are straighter than their worn scarps."""


def snap_line(line: TracedLine, score: Float32Array, *, stiffness: float, reach: float) -> TracedLine:
    """Move a line to the crest of the finest level's score beside it that can be followed with the fewest bends.

    Parameters
    ----------
    line : TracedLine
    score : ndarray of shape (rows, columns), float32
        Of the finest level.
    stiffness : float
        Width, in cells, of the Gaussian that the line is smoothed by first.
    reach : float
        Farthest move, in cells.
    """
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line.places, axis=0), axis=1))])
    at = np.arange(0.0, arc[-1], 1.0)
    if len(at) < 8:
        return line
    places = np.column_stack([_stiff(np.interp(at, arc, line.places[:, k]), stiffness) for k in (0, 1)])
    normals = _normals(places)
    moves = np.arange(-round(reach / _GRAIN), round(reach / _GRAIN) + 1) * _GRAIN
    grid = places[:, None, :] + moves[None, :, None] * normals[:, None, :]
    gain = ndimage.map_coordinates(score, grid.reshape(-1, 2).T, order=1, mode="nearest").reshape(grid.shape[:2])
    first = np.arange(0, len(at), _NODE)
    size = np.diff(np.append(first, len(at)))
    path = _straightest_path(np.add.reduceat(gain.astype(np.float64), first, axis=0) / size[:, None])
    aside = ndimage.gaussian_filter1d(np.interp(at, first + 0.5 * (size - 1), moves[path]), 8.0, mode="nearest")
    return TracedLine(places + aside[:, None] * normals, np.interp(at, arc, line.score), line.kind, line.factor)


def _normals(places: Float64Array) -> Float64Array:
    way = np.gradient(places, axis=0)
    normal = np.column_stack([-way[:, 1], way[:, 0]])
    return np.asarray(normal / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9))


def _stiff(values: Float64Array, width: float) -> Float64Array:
    """Smooth a coordinate along a line; its ends go on as they come."""
    pad = min(len(values) - 1, int(3.0 * width))
    wide = np.pad(values, pad, mode="reflect", reflect_type="odd")
    return np.asarray(ndimage.gaussian_filter1d(wide, width, mode="nearest")[pad : len(wide) - pad])


def _straightest_path(gain: Float64Array) -> IntArray:
    """Return the columns, one a row, whose sum of gains less the price of the bends is the largest of all paths.

    Gains count relative to the best of their row and to that of a typical row, so that no bright patch pulls the line
    to itself. The state is the column and the step that led to it.
    """
    crest = gain.max(axis=1)
    gain = 2.0 * gain / np.maximum(crest + np.median(crest), 1e-12)[:, None]
    steps = np.arange(-_TURNS, _TURNS + 1)
    price = _BEND_PRICE * np.abs(steps[:, None] - steps[None, :])
    columns = np.arange(gain.shape[1])
    came_from = columns[:, None] - steps[None, :]
    inside = (came_from >= 0) & (came_from < len(columns))
    came_from = np.clip(came_from, 0, len(columns) - 1)
    best = np.repeat(gain[0][:, None], len(steps), axis=1)
    before = np.zeros((*gain.shape, len(steps)), np.int64)
    for n in range(1, len(gain)):
        choices = best[:, :, None] - price[None, :, :]
        cheapest = choices.argmax(axis=1)
        worth = np.take_along_axis(choices, cheapest[:, None, :], axis=1)[:, 0]
        which = np.arange(len(steps))
        best = np.where(inside, worth[came_from, which], -np.inf) + gain[n][:, None]
        before[n] = cheapest[came_from, which]
    path = np.empty(len(gain), np.int64)
    column, step = np.unravel_index(int(best.argmax()), best.shape)
    for n in range(len(gain) - 1, -1, -1):
        path[n] = column
        column, step = column - steps[step], before[n, column, step]
    return path
