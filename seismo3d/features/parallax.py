"""Matches of a scene in depth, where neighbours may move differently: the lines of epipolar geometry vouch for them."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.features.agreement import keep_distinct
from seismo3d.features.cyclic import Comparison
from seismo3d.features.epipolar import distance_to_lines, fit_epipolar, fits_epipolar, near_lines
from seismo3d.features.growth import grow_pairs, refine_pairs, sharpen_pairs
from seismo3d.features.homography import count_on_plane
from seismo3d.features.pairs import Pairs, no_pairs
from seismo3d.features.views import View, pick_pairs

_MORE = 1.25
"""A scene is in depth where lines explain so many times the matches that one plane does."""
_FEWEST = 15
"""Matches on their lines, at least: seven fix the lines."""
_OFF_LINE = 1.0
"""Largest distance of a match from its line, in pixels."""
_OFF_AFFINE = 0.25
"""Largest misfit of its affine map."""


def match_in_depth(
    first: View,
    second: View,
    compared: Comparison,
    pairs: Pairs,
    *,
    max_ratio: float,
    apart: float,
    min_correlation: float,
) -> Pairs:
    """Match a rigid scene in depth: fit its epipolar geometry, then compare points along lines only.

    Parameters
    ----------
    first, second : View
        Target and source.
    compared : Comparison
        Their descriptors.
    pairs : Pairs
        Refined first matches, wrong ones among them.
    max_ratio, apart : float
        Of descriptor distances, best to best competitor near the line and more than ``apart`` pixels away.
    min_correlation : float
        Of refined patches.

    Returns
    -------
    Pairs
        Matches whose place and affine map fit the lines. Empty where the first matches lie on one plane, or too few
        of them on lines.
    """
    pairs = sharpen_pairs(first.pyramid, second.pyramid, first.keypoints, pairs, min_correlation=min_correlation)
    F = fit_epipolar(pairs)
    if F is None:
        return no_pairs()
    n_on_lines = int((distance_to_lines(F, pairs.target, pairs.source) <= 1.5 * _OFF_LINE).sum())
    if n_on_lines < max(_FEWEST, _MORE * count_on_plane(pairs)):
        return no_pairs()
    for _ in range(2):
        pairs = _along_lines(F, first, second, compared, max_ratio=max_ratio, apart=apart)
        pairs = refine_pairs(first.pyramid, second.pyramid, first.keypoints.level[pairs.row], pairs)
        pairs = pairs.take(pairs.correlation >= min_correlation)
        pairs, F = _sharpened(F, first, second, pairs, min_correlation)
    pairs = grow_pairs(first.pyramid, second.pyramid, first.keypoints, pairs, min_correlation=min_correlation + 0.05)
    pairs, F = _sharpened(F, first, second, pairs, min_correlation)
    pairs = pairs.take(fits_epipolar(F, pairs, distance=_OFF_LINE, max_misfit=_OFF_AFFINE))
    return pairs.take(keep_distinct(pairs))


def _sharpened(
    F: Float64Array, first: View, second: View, pairs: Pairs, min_correlation: float
) -> tuple[Pairs, Float64Array]:
    """Refine matches on finer levels, fit the lines to them anew, and keep those near their lines."""
    pairs = sharpen_pairs(first.pyramid, second.pyramid, first.keypoints, pairs, min_correlation=min_correlation)
    again = fit_epipolar(pairs)
    F = F if again is None else again
    return pairs.take(distance_to_lines(F, pairs.target, pairs.source) <= 1.5 * _OFF_LINE), F


def _along_lines(
    F: Float64Array, first: View, second: View, compared: Comparison, *, max_ratio: float, apart: float
) -> Pairs:
    """Match by descriptors among the points near each other's lines: nearer on finer levels."""
    size_t, size_s = (view.pyramid.size[view.keypoints.level, 0] for view in (first, second))
    limit = 1.5 * _OFF_LINE + np.maximum(size_t[:, None], size_s[None])
    allowed = near_lines(F, first.keypoints.points, second.keypoints.points, limit)
    return pick_pairs(first, second, compared, max_ratio=max_ratio, apart=apart, allowed=allowed)
