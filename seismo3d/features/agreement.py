"""Geometric check of matches by their neighbours: no plane and no single motion, only local smoothness."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from seismo3d._typing import BoolArray, Float64Array, Int64Array
from seismo3d.features import _kernels_agreement
from seismo3d.features.homography import stretch
from seismo3d.features.pairs import Pairs

# places apart from each other at which there are enough: the rest need not be asked
_MANY = 50
# nearest matches that are asked whether they agree with a match, and that a map is fitted to
N_ASKED, _FITTED = 16, 12
# source pixels within which two places are one, and target pixels beyond which they are two
_ONE_PLACE, _TWO_PLACES = 1.0, 3.0


def _neighbours(points: Float64Array, n: int) -> Int64Array:
    """Nearest other points (len, n) of each; -1 where there are fewer."""
    k = min(n + 1, len(points))
    _, found = cKDTree(points).query(points, k=k)
    found = found.reshape(len(points), k)
    return np.where(found == np.arange(len(points))[:, None], -1, found).astype(np.int64)


def count_agreeing(pairs: Pairs, *, slack: float, growth: float) -> Int64Array:
    """Count, for each match, the nearest others that lie where its affine map says, and it where theirs says.

    Parameters
    ----------
    pairs : Pairs
        Matches.
    slack, growth : float
        They may miss by ``slack`` target pixels and this share of their distance.

    Returns
    -------
    ndarray of shape (n,), int64
    """
    if len(pairs) < 2:
        return np.zeros(len(pairs), dtype=np.int64)
    neighbours = _neighbours(pairs.target, N_ASKED)
    return np.asarray(
        _kernels_agreement.count_agreeing(pairs.target, pairs.source, pairs.linear, neighbours, slack, growth)
    )


def local_misfit(pairs: Pairs) -> Float64Array:
    """Distance of each match from where an affine map, fitted robustly to its neighbours, puts it.

    Returns
    -------
    ndarray of shape (n,), float64
        In source pixels; zero where there are fewer than six neighbours.
    """
    if len(pairs) < 7:
        return np.zeros(len(pairs))
    neighbours = _neighbours(pairs.target, _FITTED)
    return np.asarray(_kernels_agreement.local_misfit(pairs.target, pairs.source, neighbours))


def keep_distinct(pairs: Pairs) -> BoolArray:
    """Say which matches to keep so that no two places of the target share one of the source: the better one stays."""
    keep = np.ones(len(pairs), dtype=np.bool_)
    if len(pairs) < 2:
        return keep
    close = cKDTree(pairs.source).query_pairs(_ONE_PLACE, output_type="ndarray")
    for i, j in close[np.lexsort((close[:, 1], close[:, 0]))]:
        if keep[i] and keep[j] and np.square(pairs.target[i] - pairs.target[j]).sum() > _TWO_PLACES**2:
            keep[i if pairs.correlation[i] < pairs.correlation[j] else j] = False
    return keep


def count_apart(points: Float64Array, reach: Float64Array) -> int:
    """Count points of which none lies within the reach of another: patches that overlap are one witness, not two.

    Parameters
    ----------
    points : ndarray of shape (n, 2), float64
        Places; earlier ones are taken first.
    reach : ndarray of shape (n,), float64
        Of each, in the same units.

    Returns
    -------
    int
    """
    free = np.ones(len(points), dtype=np.bool_)
    n_taken = 0
    for k in range(len(points)):
        if free[k]:
            free &= np.square(points - points[k]).sum(axis=1) > np.maximum(reach, reach[k]) ** 2
            n_taken += 1
            if n_taken >= _MANY:
                break
    return n_taken


def count_witnesses(pairs: Pairs, reach: Float64Array, *, slack: float, growth: float) -> Int64Array:
    """Count, for each match, the witnesses of the motion that it is part of: matches that agree, step by step.

    Parameters
    ----------
    pairs : Pairs
        Matches.
    reach : ndarray of shape (n,), float64
        Target pixels within which a match and another are one witness.
    slack, growth : float
        Two agree that lie where each other's affine map says, but for ``slack`` target pixels and this share of their
        distance.

    Returns
    -------
    ndarray of shape (n,), int64
    """
    apart = pairs.target[None] - pairs.target[:, None]
    said = pairs.source[:, None] + np.einsum("nij,nmj->nmi", pairs.linear, apart)
    allowed = (slack + growth * np.linalg.norm(apart, axis=2)) * stretch(pairs)[:, None]
    agree = np.linalg.norm(said - pairs.source[None], axis=2) <= allowed
    _, part = connected_components(agree & agree.T, directed=False)
    counts = [count_apart(pairs.target[part == k], reach[part == k]) for k in range(part.max(initial=-1) + 1)]
    return np.asarray(counts, dtype=np.int64)[part]
