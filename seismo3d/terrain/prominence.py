"""How far a line stands out from the lines beside it: the terrain around is the measure of what chance draws."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.terrain.evidence import REGION, SCALE, TerrainEvidence
from seismo3d.terrain.tracing import TracedLine

_BESIDE = 12
"""Paths on each side that a line is compared with."""
_LEAST_PATHS = 6
"""Paths on the map below which a line cannot be judged."""
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


def _prominence(line: TracedLine, evidence: TerrainEvidence) -> float:
    path = _even_path((line.places + 0.5) / evidence.factor - 0.5)
    if len(path) < 4:
        return float("nan")
    way = np.gradient(ndimage.gaussian_filter1d(path, 6.0, axis=0, mode="nearest"), axis=0)
    normals = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    far = 2.0 * REGION * SCALE + REGION * SCALE * np.arange(_BESIDE)
    near = np.arange(-3.0, 4.0)
    beside = _mean_evidence(path, normals, np.concatenate([-far, far]), evidence)
    if len(beside) < _LEAST_PATHS:
        return float("nan")
    own = _mean_evidence(path, normals, near, evidence)
    if len(own) == 0:
        return float("nan")
    chance = np.maximum(np.sqrt((beside**2).mean(axis=0)), 1e-6)
    # a ridge is no trough
    top = np.array([np.abs(own[:, 0]).max(), max(float(own[:, 1].max()), 0.0)])
    return float(np.hypot(*(top / chance)))


def _even_path(places: Float64Array) -> Float64Array:
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    at = np.arange(0.0, arc[-1], 1.0)
    return np.column_stack([np.interp(at, arc, places[:, k]) for k in (0, 1)])


def _mean_evidence(
    path: Float64Array, normals: Float64Array, moves: Float64Array, evidence: TerrainEvidence
) -> Float64Array:
    """Return the mean slope and hollow across moved paths, over the steepness around; without those off the map."""
    ny, nx = normals.T
    hyy, hxy, hxx = evidence.curvature
    out = []
    for move in moves:
        at = (path + move * normals).T
        known = ndimage.map_coordinates(evidence.known, at, order=1, mode="constant", cval=0.0)
        if known.mean() < _ON_MAP:
            continue
        weight = known / np.maximum(ndimage.map_coordinates(evidence.steepness, at, order=1, mode="nearest"), 1e-6)
        sy, sx, cyy, cxy, cxx = (
            ndimage.map_coordinates(part, at, order=1, mode="nearest") for part in (*evidence.slope, hyy, hxy, hxx)
        )
        step = (weight * (ny * sy + nx * sx)).sum() / known.sum()
        trough = (weight * (ny * ny * cyy + 2.0 * ny * nx * cxy + nx * nx * cxx)).sum() / known.sum()
        out.append((step, trough))
    return np.array(out).reshape(-1, 2)
