"""The matcher for images, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.features.agreement import count_agreeing, count_apart
from seismo3d.features.cyclic import Comparison, compare_descriptors
from seismo3d.features.descriptors import WindowLayout
from seismo3d.features.growth import check_pairs, grow_pairs, polish_pairs, refine_pairs
from seismo3d.features.homography import count_on_plane
from seismo3d.features.inputs import Grey
from seismo3d.features.pairs import Pairs, best_per_row, no_pairs
from seismo3d.features.parallax import match_in_depth
from seismo3d.features.planes import settle_on_plane
from seismo3d.features.tilts import tilted_views
from seismo3d.features.views import View, describe_view, pick_pairs


@dataclass(frozen=True, slots=True)
class PlanarSettings:
    """How images are matched; the defaults serve photographs, sections and terrain alike.

    Attributes
    ----------
    n_points, n_levels : int
        Points an image and levels of its pyramid, at most.
    tilts : {"auto", "always", "never"}
        Whether to simulate views from the side.
    max_ratio, apart : float
        Largest ratio of descriptor distances, best to best competitor more than ``apart`` pixels away.
    min_correlation, min_grown : float
        Of refined patches: of first matches, and of those found beside them.
    min_agreeing : int
        Neighbours that must agree with a first match.
    max_misfit : float
        Largest distance of a match from the affine map of its neighbours, in target pixels.
    enough : int
        With fewer matches than this, tilts are tried in "auto".
    plane_share : float
        Where one plane explains so many of the first matches, depth is not considered.
    layout : WindowLayout
        Windows by which a point is described.
    """

    n_points: int = 500
    n_levels: int = 10
    tilts: str = "auto"
    max_ratio: float = 0.9
    apart: float = 6.0
    min_correlation: float = 0.7
    min_grown: float = 0.8
    min_agreeing: int = 3
    max_misfit: float = 2.0
    enough: int = 20
    plane_share: float = 0.8
    layout: WindowLayout = field(default_factory=WindowLayout)


_COMPRESSIONS = (2.0, 3.4)
"""Of simulated views: tilts of 60 and 73 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageFeatures:
    """An image, described: it can be matched to many others."""

    image: Grey
    view: View

    def __len__(self) -> int:
        return len(self.view.keypoints.points)


def describe_image(image: Grey, settings: PlanarSettings) -> ImageFeatures:
    """Detect and describe the points of a grey image with a spread of about 160 grey levels."""
    return ImageFeatures(image, _view(image, settings))


def match_images(target: ImageFeatures, source: ImageFeatures, settings: PlanarSettings) -> Pairs:
    """Match two described images.

    Parameters
    ----------
    target, source : ImageFeatures
        Of both.
    settings : PlanarSettings

    Returns
    -------
    Pairs
        Matches that passed all checks.
    """
    first, second = target.view, source.view
    compared = compare_descriptors(first.descriptors, second.descriptors)
    pairs, enough = no_pairs(), False
    if settings.tilts != "always":
        found = _refined(first, second, _picked(first, second, compared, settings), settings)
        seeds = _agreeing(found, settings)
        pairs, in_depth = _matches_from(first, second, source.image, compared, found, seeds, settings)
        enough = len(pairs if in_depth else seeds) >= settings.enough
    if settings.tilts == "always" or (settings.tilts == "auto" and not enough):
        found, seeds = _seeds_by_tilts(target, source, compared, settings)
        pairs, _ = _matches_from(first, second, source.image, compared, found, seeds, settings)
    return pairs.take(target.image.is_known(pairs.target) & source.image.is_known(pairs.source))


def _matches_from(
    first: View,
    second: View,
    source: Grey,
    compared: Comparison,
    found: Pairs,
    seeds: Pairs,
    settings: PlanarSettings,
) -> tuple[Pairs, bool]:
    """All matches that first ones lead to, by their neighbours or along lines; and whether it was along lines."""
    if _witnesses(first, seeds) <= settings.min_agreeing:
        return no_pairs(), False
    others = no_pairs()
    if count_on_plane(found) < settings.plane_share * len(found):
        others = match_in_depth(
            first,
            second,
            compared,
            found.take(found.row >= 0),
            max_ratio=settings.max_ratio,
            apart=settings.apart,
            min_correlation=settings.min_grown,
        )
    if len(others) > len(found):
        return others, True
    # What is found beside first matches has to be about as alike as they are: noise and change of light are theirs too.
    alike = float(np.clip(np.percentile(seeds.correlation, 20.0), settings.min_correlation, 0.95))
    pairs = grow_pairs(first.pyramid, second.pyramid, first.keypoints, seeds, min_correlation=alike)
    pairs = pairs.take(pairs.row >= 0)
    pairs = polish_pairs(first.pyramid, second.pyramid, first.keypoints, pairs, min_correlation=settings.min_grown)
    reach = _patch_reach(first, pairs)
    pairs = check_pairs(pairs, reach, min_agreeing=settings.min_agreeing + 1, max_misfit=settings.max_misfit)
    if len(others) > len(pairs):
        return others, True
    pairs = settle_on_plane(
        first,
        second,
        source,
        pairs,
        distance=settings.max_misfit,
        share=settings.plane_share,
        min_correlation=settings.min_grown,
    )
    return pairs, False


def _view(image: Grey, settings: PlanarSettings, A: Float64Array | None = None) -> View:
    return describe_view(image, n_points=settings.n_points, n_levels=settings.n_levels, layout=settings.layout, A=A)


def _picked(first: View, second: View, compared: Comparison, settings: PlanarSettings) -> Pairs:
    return pick_pairs(first, second, compared, max_ratio=settings.max_ratio, apart=settings.apart)


def _compared(first: View, second: View, settings: PlanarSettings) -> Pairs:
    return _picked(first, second, compare_descriptors(first.descriptors, second.descriptors), settings)


def _refined(first: View, second: View, pairs: Pairs, settings: PlanarSettings) -> Pairs:
    refined = refine_pairs(first.pyramid, second.pyramid, first.keypoints.level[pairs.row], pairs)
    return refined.take(refined.correlation >= settings.min_correlation)


def _witnesses(first: View, pairs: Pairs) -> int:
    """Count matches whose patches do not overlap much, the most alike first."""
    pairs = pairs.take(np.argsort(-pairs.correlation, kind="stable"))
    return count_apart(pairs.target, _patch_reach(first, pairs))


def _patch_reach(first: View, pairs: Pairs) -> Float64Array:
    """Target pixels within which patches overlap much, at the coarser of the levels that fit."""
    shrink = np.sqrt(np.abs(np.linalg.det(pairs.linear)))  # source pixels to a target pixel
    fine = np.maximum(1.0, 1.0 / np.maximum(shrink, 1e-6))  # a source without finer levels is compared on coarser ones
    level = np.where(pairs.row >= 0, first.keypoints.level[pairs.row], 0)
    return np.asarray(6.0 * np.maximum(first.pyramid.size[level, 0], fine))


def _agreeing(pairs: Pairs, settings: PlanarSettings) -> Pairs:
    return pairs.take(count_agreeing(pairs, slack=4.0, growth=0.25) >= settings.min_agreeing)


def _seeds_by_tilts(
    target: ImageFeatures, source: ImageFeatures, compared: Comparison, settings: PlanarSettings
) -> tuple[Pairs, Pairs]:
    """First matches between each image and simulated views of the other, and those of them that agree.

    Steeper views are only tried where flatter ones give few.
    """
    first, second = target.view, source.view
    found = _refined(first, second, _picked(first, second, compared, settings), settings)
    seeds = no_pairs()
    for compression in _COMPRESSIONS:
        for tilted in tilted_views(target.image.values, target.image.valid, compression=compression):
            view = _view(Grey(tilted.image, tilted.valid, tilted.valid), settings, tilted.A)
            pairs = _to_full(_compared(view, second, settings), view.A, np.eye(2, 3))
            hints = refine_pairs(first.pyramid, second.pyramid, view.keypoints.level[pairs.row], pairs)
            hints = hints.take(hints.correlation >= settings.min_correlation)
            found = found.join(hints.with_row(-1))
        for tilted in tilted_views(source.image.values, source.image.valid, compression=compression):
            view = _view(Grey(tilted.image, tilted.valid, tilted.valid), settings, tilted.A)
            pairs = _to_full(_compared(first, view, settings), np.eye(2, 3), view.A)
            found = found.join(_refined(first, second, pairs, settings))
        seeds = _agreeing(best_per_row(_agreeing(found, settings)), settings)
        if len(seeds) >= 2 * settings.enough:
            break
    return best_per_row(found), seeds


def _to_full(pairs: Pairs, A_target: Float64Array, A_source: Float64Array) -> Pairs:
    """Carry matches between views back to the full images."""
    back_t, back_s = np.linalg.inv(A_target[:, :2]), np.linalg.inv(A_source[:, :2])
    target = (pairs.target - A_target[:, 2]) @ back_t.T
    source = (pairs.source - A_source[:, 2]) @ back_s.T
    linear = back_s @ pairs.linear @ A_target[:, :2]
    return Pairs(pairs.row, target, source, linear, pairs.correlation)
