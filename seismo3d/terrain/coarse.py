"""A first pose of one map on another, far from it: matched features, and the pose on which most of them agree."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.features.matching import match
from seismo3d.registration.align import align_pairs
from seismo3d.registration.feature_pairs import as_pairs
from seismo3d.terrain.fitting import Level, Pose

LONGEST_SIDE = 512
"""Rows or columns that features are matched on, at most."""
LEAST_AGREEING = 5


def match_pose(levels: list[Level], model: str, matches: Any = None) -> Pose | None:
    """Return the pose on which most matched features agree; None where fewer than five do.

    Parameters
    ----------
    levels : list of Level
        Finest first; features are sought on the first that is small enough.
    model : str
        "translation", "rigid" or "similarity".
    matches : optional
        Given pairs of places on the finest level.
    """
    if matches is not None:
        level = levels[0]
        q, p = as_pairs(matches)
        turn, scale = np.zeros(0), np.zeros(0)
    else:
        level = next(
            (made for made in levels if max(*made.target.shape, *made.source.shape) <= LONGEST_SIDE), levels[-1]
        )
        if min(*level.target.shape, *level.source.shape) < 16:
            return None
        found = match(fill_holes(level.target), fill_holes(level.source))
        q, p, turn, scale = found.points_target, found.points_source, found.angle, found.scale
    if len(q) < LEAST_AGREEING:
        return None
    target = (q - level.centre) @ level.steps.T
    back = np.linalg.inv(level.to_source)
    source = p @ back[:2, :2].T + back[:2, 2]
    motion = _agreed(target, source, model, turn, scale, reach=3.0 * level.cell)
    return None if motion is None else Pose(motion)


def fill_holes(z: Float64Array) -> Float64Array:
    """Return the map with single missing cells filled from their neighbours; larger holes stay NaN."""
    known = np.isfinite(z)
    if known.all():
        return z
    weight = ndimage.gaussian_filter(known.astype(np.float64), 1.0, mode="nearest")
    mean = ndimage.gaussian_filter(np.where(known, z, 0.0), 1.0, mode="nearest") / np.maximum(weight, 1e-9)
    return np.where(known, z, np.where(weight > 0.25, mean, np.nan))


def _agreed(
    target: Float64Array, source: Float64Array, model: str, turn: Float64Array, scale: Float64Array, *, reach: float
) -> Float64Array | None:
    """Try the pose of every match, keep the one with most agreeing, and fit it to those."""
    best: BoolArray = np.zeros(len(target), bool)
    for R, row in _hypotheses(target, source, model, turn, scale):
        moved = (source - source[row]) @ R.T + target[row]
        agree = np.linalg.norm(moved - target, axis=1) <= reach
        if agree.sum() > best.sum():
            best = agree
    if best.sum() < LEAST_AGREEING:
        return None
    fitted = align_pairs(target[best], source[best], model=model)
    return np.asarray(fitted.T_target_source)


def _hypotheses(
    target: Float64Array, source: Float64Array, model: str, turn: Float64Array, scale: Float64Array
) -> list[tuple[Float64Array, int]]:
    """Return a linear part and the pair that it is about, for every match, or for pairs of given matches."""
    if model == "translation":
        return [(np.eye(2), row) for row in range(len(target))]
    n = len(target)
    partner = (np.arange(n) + max(1, n // 2)) % n
    out = []
    for row in range(n):
        a, b = target[partner[row]] - target[row], source[partner[row]] - source[row]
        out.append((_turned(np.arctan2(*a[::-1]) - np.arctan2(*b[::-1]), _ratio(a, b, model)), row))
        if len(turn):
            # an angle on the array, x right and y down, is one on the map but for its sense: both are tried
            growth = float(scale[row]) if model == "similarity" else 1.0
            out += [(_turned(sense * float(turn[row]), growth), row) for sense in (1.0, -1.0)]
    return out


def _ratio(a: Float64Array, b: Float64Array, model: str) -> float:
    if model != "similarity":
        return 1.0
    return float(np.linalg.norm(a)) / max(float(np.linalg.norm(b)), 1e-12)


def _turned(angle: float, growth: float) -> Float64Array:
    cosine, sine = growth * np.cos(angle), growth * np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])
