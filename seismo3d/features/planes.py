"""Matches of one plane: where a homography explains most, it tells the shape of all patches and judges the others.

Refined with a free shape, a patch gets a place as good as its shape: a blur of one image passes for a change of size,
and draws the place along. With the plane's shape held, places have two unknowns instead of six. And layers or textures
that repeat are alike in several places: a match off the plane proves nothing where the plane's own place is alike too,
or cannot be seen.
"""

from __future__ import annotations

import numpy as np

from seismo3d.features.growth import polish_pairs, refine_pairs
from seismo3d.features.homography import carry, fit_plane, is_near
from seismo3d.features.inputs import Grey
from seismo3d.features.pairs import Pairs
from seismo3d.features.views import View


def settle_on_plane(
    first: View, second: View, source: Grey, pairs: Pairs, *, distance: float, share: float, min_correlation: float
) -> Pairs:
    """Refine matches with the shape of the plane that most of them share; drop what it leaves unproved.

    Parameters
    ----------
    first, second : View
        Target and source.
    source : Grey
        The source's grey levels.
    pairs : Pairs
        Checked matches.
    distance : float
        Target pixels within which a match is on the plane.
    share : float
        Matches that must be on it, of all; else nothing is changed.
    min_correlation : float
        Of patches that are alike.

    Returns
    -------
    Pairs
    """
    fitted = fit_plane(pairs, distance)
    if fitted is None or fitted[1].mean() < share:
        return pairs
    H, on_plane = fitted
    places, linear = carry(H, pairs.target)
    start = np.where(on_plane[:, None], pairs.source, places)
    held = Pairs(pairs.row, pairs.target, start, linear, pairs.correlation)
    held = refine_pairs(first.pyramid, second.pyramid, first.keypoints.level[pairs.row], held, holds_shape=True)
    held = polish_pairs(
        first.pyramid, second.pyramid, first.keypoints, held, min_correlation=min_correlation, holds_shape=True
    )
    alike = (held.correlation >= min_correlation) & is_near(held, places, distance)
    settled = Pairs(
        pairs.row,
        pairs.target,
        np.where(alike[:, None], held.source, pairs.source),
        np.where(alike[:, None, None], held.linear, pairs.linear),
        np.where(alike, held.correlation, pairs.correlation),
    )
    return settled.take(on_plane | source.is_known(places))
