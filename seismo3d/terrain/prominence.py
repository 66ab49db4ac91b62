"""How far a line stands out from the lines beside it: the terrain around is the measure of what chance draws."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.terrain.evidence import REGION, SCALE, TerrainEvidence
from seismo3d.terrain.tracing import TracedLine

_BESIDE = 12
"""Paths on each side that a line is compared with."""
_LEAST_PATHS = 6
"""Paths on the map below which a line cannot be judged."""
_STRIDE = 2.0
"""Cells of the level between the values that a path's mean is taken of: the evidence is smooth over them."""
_ON_MAP = 0.5
"""Share of a path that must lie where evidence is known."""


def measure_prominence(line: TracedLine, levels: list[TerrainEvidence]) -> float:
    """Return a line's mean evidence over that of the same path moved aside, at the level where it stands out most.

    Ridges, valleys, dunes and terraces draw straight pieces by chance, the more of them the longer the texture is
    alike along the strike. The same path laid beside the line, out of reach of its own side lobes, crosses the same
    texture at the same strike: the root mean square of those paths' means is what chance gives *here*. Steps and
    troughs are two such ratios, and their squares are added.

    Parameters
    ----------
    line : TracedLine
        Places on the finest level.
    levels : list of TerrainEvidence

    Returns
    -------
    float
        About the square root of two where there is nothing; NaN where fewer than six paths lie on the map.
    """
    found = [_prominence(line, evidence) for evidence in levels]
    known = [value for value in found if np.isfinite(value)]
    return max(known) if known else float("nan")


def judge_by(levels: list[TerrainEvidence]) -> Callable[[TracedLine], float]:
    """Return a function that gives a line's prominence, 0 where it cannot be told, and remembers it for each line."""

    @cache
    def judge(line: TracedLine) -> float:
        value = measure_prominence(line, levels)
        return value if np.isfinite(value) else 0.0

    return judge


def _prominence(line: TracedLine, evidence: TerrainEvidence) -> float:
    path = even_path((line.places + 0.5) / evidence.factor - 0.5, stride=_STRIDE)
    if len(path) < 4:
        return float("nan")
    normals, far = paths_beside(path, stride=_STRIDE)
    near = np.arange(-3.0, 4.0)
    means = _mean_evidence(path, normals, np.concatenate([near, far]), evidence)
    own, beside = means[: len(near)], means[len(near) :]
    beside = beside[np.isfinite(beside[:, 0])]
    if len(beside) < _LEAST_PATHS or not np.isfinite(own).any():
        return float("nan")
    chance = np.maximum(np.sqrt((beside**2).mean(axis=0)), 1e-6)
    # a ridge is no trough
    top = np.array([np.nanmax(np.abs(own[:, 0])), max(float(np.nanmax(own[:, 1])), 0.0)])
    return float(np.hypot(*(top / chance)))


def even_path(places: Float64Array, *, stride: float = 1.0) -> Float64Array:
    """Return places (row, column) along a path of places (n, 2), a stride of cells apart, from its first one on."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    at = np.arange(0.0, arc[-1], stride)
    return np.column_stack([np.interp(at, arc, places[:, k]) for k in (0, 1)])


def paths_beside(path: Float64Array, *, stride: float = 1.0) -> tuple[Float64Array, Float64Array]:
    """Return a path's unit normals (row, column), and how far along them the paths beside it lie, in cells.

    Parameters
    ----------
    path : ndarray of shape (n, 2), float64
        (row, column).
    stride : float
        Cells from place to place.
    """
    way = np.gradient(ndimage.gaussian_filter1d(path, 6.0 / stride, axis=0, mode="nearest"), axis=0)
    normals = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    far = 2.0 * REGION * SCALE + REGION * SCALE * np.arange(_BESIDE)
    return np.asarray(normals), np.concatenate([-far, far])


def _mean_evidence(
    path: Float64Array, normals: Float64Array, moves: Float64Array, evidence: TerrainEvidence
) -> Float64Array:
    """Return the mean slope and hollow across moved paths, over the steepness around; NaN for those off the map."""
    ny, nx = normals.T
    places = path + moves[:, None, None] * normals
    at = places.reshape(-1, 2).T
    shape = places.shape[:2]
    known = ndimage.map_coordinates(evidence.known, at, order=1, mode="constant", cval=0.0).reshape(shape)
    sy, sx, cyy, cxy, cxx, steepness = (
        ndimage.map_coordinates(part, at, order=1, mode="nearest").reshape(shape)
        for part in (*evidence.slope, *evidence.curvature, evidence.steepness)
    )
    weight = known / np.maximum(steepness, 1e-6)
    step = (weight * (ny * sy + nx * sx)).mean(axis=1)
    trough = (weight * (ny * ny * cyy + 2.0 * ny * nx * cxy + nx * nx * cxx)).mean(axis=1)
    share = known.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        means = np.column_stack([step, trough]) / share[:, None]
    means[share < _ON_MAP] = np.nan
    return np.asarray(means, np.float64)
