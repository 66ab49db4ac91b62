"""Further matches beside good ones: each says where its unmatched neighbours should be, and refinement looks there."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import AnyArray, BoolArray, Float64Array, Int64Array
from seismo3d.features.agreement import N_ASKED, count_agreeing, count_witnesses, keep_distinct, local_misfit
from seismo3d.features.homography import fit_plane, stretch
from seismo3d.features.keypoints import Keypoints
from seismo3d.features.pairs import Pairs
from seismo3d.features.pyramid import ImagePyramid
from seismo3d.features.refinement import refine_matches

# how much refinement may stretch or squeeze a patch beyond what its neighbour predicts
_MAX_CHANGE = 1.4
# which match, from the nearest on, is asked in each round: what was found before helps
_RANKS = (0, 1, 0, 1)
# levels by which a match is refined again at a time
_LEVELS_FINER = 4


def refine_pairs(
    target: ImagePyramid,
    source: ImagePyramid,
    level: AnyArray,
    pairs: Pairs,
    *,
    reach: float = 3.0,
    n_iterations: int = 8,
    holds_shape: bool = False,
) -> Pairs:
    """Refine all matches; ``level`` is the target pyramid's at which each is compared."""
    points, linear, correlation = refine_matches(
        target,
        source,
        pairs.target,
        level,
        pairs.source,
        pairs.linear,
        reach=reach,
        n_iterations=n_iterations,
        holds_shape=holds_shape,
    )
    return Pairs(pairs.row, pairs.target, points, linear, correlation)


def grow_pairs(
    target: ImagePyramid,
    source: ImagePyramid,
    keypoints: Keypoints,
    pairs: Pairs,
    *,
    min_correlation: float,
) -> Pairs:
    """Match further keypoints of the target by the affine maps of their matched neighbours.

    Parameters
    ----------
    target, source : ImagePyramid
        Of both images.
    keypoints : Keypoints
        Of the target.
    pairs : Pairs
        Checked matches; ``row`` refers to ``keypoints``.
    min_correlation : float
        A new match is at least so alike.

    Returns
    -------
    Pairs
        The given ones, then the new ones, unchecked.
    """
    for rank in _RANKS:
        free = np.ones(len(keypoints.points), dtype=np.bool_)
        free[pairs.row[pairs.row >= 0]] = False
        rows = np.flatnonzero(free)
        if rows.size == 0 or len(pairs) == 0:
            break
        points = keypoints.points[rows]
        near = np.asarray(cKDTree(pairs.target).query(points, k=[min(rank + 1, len(pairs))])[1])[:, 0]
        predicted = pairs.source[near] + np.einsum("nij,nj->ni", pairs.linear[near], points - pairs.target[near])
        guess = Pairs(rows, points, predicted, pairs.linear[near], np.zeros(len(rows)))
        found = refine_pairs(target, source, keypoints.level[rows], guess)
        good = (found.correlation >= min_correlation) & (_change_of_shape(guess, found) <= _MAX_CHANGE)
        pairs = pairs.join(found.take(good))
    return pairs


def _change_of_shape(before: Pairs, after: Pairs) -> Float64Array:
    """Largest stretch of the change between two sets of affine maps over its smallest."""
    if len(before) == 0:
        return np.empty(0)
    factors = np.linalg.svd(np.linalg.solve(before.linear, after.linear), compute_uv=False)
    return np.asarray(factors[:, 0] / np.maximum(factors[:, 1], 1e-9))


def polish_pairs(
    target: ImagePyramid,
    source: ImagePyramid,
    keypoints: Keypoints,
    pairs: Pairs,
    *,
    min_correlation: float,
    holds_shape: bool = False,
) -> Pairs:
    """Refine matches found on coarse levels again on finer ones, where the finer patches are alike too."""
    level = keypoints.level[pairs.row].astype(np.int64)
    for _ in range(2):
        finer = np.maximum(level - _LEVELS_FINER, 0)
        rows = np.flatnonzero(finer < level - 1)
        if rows.size == 0:
            break
        pairs, alike = _refine_rows(
            target,
            source,
            pairs,
            rows,
            finer[rows],
            min_correlation,
            reach=1.5,
            n_iterations=4,
            holds_shape=holds_shape,
        )
        level[alike] = finer[alike]
    return pairs


def sharpen_pairs(
    target: ImagePyramid, source: ImagePyramid, keypoints: Keypoints, pairs: Pairs, *, min_correlation: float
) -> Pairs:
    """Refine all matches on ever finer levels, as far as the patches are alike there.

    Where depth changes from one pixel to the next, a coarse patch says how its larger part moves; a fine one, how its
    middle does.
    """
    level = keypoints.level[pairs.row].astype(np.int64)
    for n_finer in (2, 4, 8):
        finer = np.maximum(level - n_finer, 0)
        rows = np.flatnonzero((level > 0) | (n_finer == 8))  # what is finest already takes more steps there, once
        pairs, alike = _refine_rows(target, source, pairs, rows, finer[rows], min_correlation)
        level[alike] = finer[alike]
    return pairs


def _refine_rows(
    target: ImagePyramid,
    source: ImagePyramid,
    pairs: Pairs,
    rows: Int64Array,
    level: Int64Array,
    min_correlation: float,
    *,
    reach: float = 3.0,
    n_iterations: int = 8,
    holds_shape: bool = False,
) -> tuple[Pairs, Int64Array]:
    """Return all matches, those of some rows refined where the patches are alike then, and which rows these are."""
    some = pairs.take(rows)
    again = refine_pairs(target, source, level, some, reach=reach, n_iterations=n_iterations, holds_shape=holds_shape)
    good = again.correlation >= min_correlation
    rows, again = rows[good], again.take(good)
    points, linear, correlation = pairs.source.copy(), pairs.linear.copy(), pairs.correlation.copy()
    points[rows], linear[rows], correlation[rows] = again.source, again.linear, again.correlation
    return Pairs(pairs.row, pairs.target, points, linear, correlation), rows


def check_pairs(pairs: Pairs, reach: Float64Array, *, min_agreeing: int, max_misfit: float) -> Pairs:
    """Keep matches that their neighbours agree with, more closely so off the plane that most of a scene may be.

    Parameters
    ----------
    pairs : Pairs
        Matches.
    reach : ndarray of shape (n,), float64
        Target pixels within which a match and another are one witness: their patches overlap. Layers and textures that
        repeat are alike all over one patch; matches off the plane need as many witnesses as agreeing neighbours.
    min_agreeing : int
        At least so many neighbours, and a quarter of those asked, agree.
    max_misfit : float
        Largest distance from the neighbours' own affine map and, on a plane, from its homography; target pixels.

    Returns
    -------
    Pairs
    """
    agreed = _agreed(pairs, min_agreeing, 0.25, slack=2.0, growth=0.1) & keep_distinct(pairs)
    pairs, reach = pairs.take(agreed), reach[agreed]
    even = local_misfit(pairs) <= max_misfit * stretch(pairs)
    pairs, reach = pairs.take(even), reach[even]
    off = _off_plane(pairs, max_misfit)
    if off.any():
        strict = _agreed(pairs, min_agreeing, 0.5, slack=1.0, growth=0.04) & (
            local_misfit(pairs) <= 0.4 * max_misfit * stretch(pairs)
        )
        rows = np.flatnonzero(off & strict)
        vouched = count_witnesses(pairs.take(rows), reach[rows], slack=2.0, growth=0.1) >= min_agreeing
        off[rows[vouched]] = False
        pairs = pairs.take(~off)
    return pairs


def _agreed(pairs: Pairs, min_agreeing: int, share: float, *, slack: float, growth: float) -> BoolArray:
    n_asked = min(N_ASKED, max(len(pairs) - 1, 0))
    return np.asarray(count_agreeing(pairs, slack=slack, growth=growth) >= max(min_agreeing, share * n_asked))


def _off_plane(pairs: Pairs, distance: float) -> BoolArray:
    """Say which matches are off the homography that most follow; none where there is no such."""
    fitted = fit_plane(pairs, distance)
    if fitted is None or fitted[1].mean() < 0.75:
        return np.zeros(len(pairs), dtype=np.bool_)
    return np.asarray(~fitted[1])
