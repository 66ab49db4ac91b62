"""The matcher for images, step by step."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.features.agreement import count_agreeing, count_apart
from seismo3d.features.cyclic import match_descriptors
from seismo3d.features.descriptors import WindowLayout, describe_points
from seismo3d.features.growth import check_pairs, grow_pairs, polish_pairs, refine_pairs
from seismo3d.features.keypoints import Keypoints, detect_keypoints
from seismo3d.features.pairs import Pairs, best_per_row, no_pairs
from seismo3d.features.pyramid import ImagePyramid, build_pyramid
from seismo3d.features.tilts import tilted_views


@dataclass(frozen=True, slots=True)
class PlanarSettings:
    """How images are matched; the defaults serve photographs, sections and terrain alike.

    Attributes
    ----------
    n_points, n_levels : int
        Points an image and levels of its pyramid, at most.
    tilts : {"auto", "always", "never"}
        Whether to simulate views from the side.
    max_ratio : float
        Of descriptor distances, best to best competitor more than ``apart`` pixels away.
    min_correlation, min_grown : float
        Of refined patches: of first matches, and of those found beside them.
    min_agreeing : int
        Neighbours that must agree with a first match.
    enough : int
        With fewer matches than this, tilts are tried in "auto".
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
    layout: WindowLayout = field(default_factory=WindowLayout)


_COMPRESSIONS = (2.0, 3.4)
"""Of simulated views: tilts of 60 and 73 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class _Image:
    """Grey levels, and where there is data; None stands for everywhere."""

    grey: Float32Array
    valid: BoolArray | None


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """An image, or a simulated view of it, ready to be matched: A (2, 3) carries the image to the view."""

    pyramid: ImagePyramid
    keypoints: Keypoints
    descriptors: Float32Array
    A: Float64Array


def match_images(
    target: Float32Array,
    valid_target: BoolArray | None,
    source: Float32Array,
    valid_source: BoolArray | None,
    settings: PlanarSettings,
) -> tuple[Pairs, tuple[int, int]]:
    """Match two grey images.

    Parameters
    ----------
    target, source : ndarray of shape (rows, columns), float32
        A spread of about 160 grey levels.
    valid_target, valid_source : ndarray of bool, optional
        Where they have data.
    settings : PlanarSettings

    Returns
    -------
    pairs : Pairs
        Matches that passed all checks.
    n_points : tuple of int
        Keypoints of target and source.
    """
    one, other = _Image(target, valid_target), _Image(source, valid_source)
    first, second = _both_views(one, other, settings)
    seeds = no_pairs()
    if settings.tilts != "always":
        seeds = _agreeing(_refined(first, second, _first_matches(first, second, settings), settings), settings)
    if settings.tilts == "always" or (settings.tilts == "auto" and len(seeds) < settings.enough):
        seeds = _seeds_by_tilts(first, second, one, other, settings)
    n_points = (len(first.keypoints.points), len(second.keypoints.points))
    if _witnesses(first, seeds) <= settings.min_agreeing:
        return no_pairs(), n_points
    # What is found beside first matches has to be about as alike as they are: noise and change of light are theirs too.
    alike = float(np.clip(np.percentile(seeds.correlation, 20.0), settings.min_correlation, 0.95))
    pairs = grow_pairs(first.pyramid, second.pyramid, first.keypoints, seeds, min_correlation=alike)
    pairs = pairs.take(pairs.row >= 0)
    pairs = polish_pairs(first.pyramid, second.pyramid, first.keypoints, pairs, min_correlation=settings.min_grown)
    pairs = check_pairs(pairs, min_agreeing=settings.min_agreeing + 1, max_misfit=settings.max_misfit)
    return pairs.take(_on_data(pairs, source, valid_source)), n_points


def _view(image: _Image, settings: PlanarSettings, A: Float64Array | None = None) -> _View:
    pyramid = build_pyramid(image.grey, image.valid, n_levels=settings.n_levels)
    keypoints = detect_keypoints(pyramid, n_points=settings.n_points)
    return _View(
        pyramid, keypoints, describe_points(pyramid, keypoints, settings.layout), np.eye(2, 3) if A is None else A
    )


def _both_views(target: _Image, source: _Image, settings: PlanarSettings) -> tuple[_View, _View]:
    """Prepare both images: at the same time where OpenCV may use more than one thread."""
    import cv2

    if cv2.getNumThreads() < 2:
        return _view(target, settings), _view(source, settings)
    with ThreadPoolExecutor(1) as pool:
        later = pool.submit(_view, source, settings)
        return _view(target, settings), later.result()


def _first_matches(first: _View, second: _View, settings: PlanarSettings) -> Pairs:
    """Match by descriptors, with the rotation and scale that they give."""
    near = match_descriptors(
        first.descriptors,
        second.descriptors,
        first.keypoints.points,
        second.keypoints.points,
        max_ratio=settings.max_ratio,
        apart=settings.apart,
    )
    ratio = (
        second.pyramid.size[second.keypoints.level[near.source], 0]
        / first.pyramid.size[first.keypoints.level[near.target], 0]
    )
    c, s = ratio * np.cos(near.shift), ratio * np.sin(near.shift)
    linear = np.stack([c, s, -s, c], axis=1).reshape(-1, 2, 2)
    return Pairs(
        near.target, first.keypoints.points[near.target], second.keypoints.points[near.source], linear, near.similarity
    )


def _refined(first: _View, second: _View, pairs: Pairs, settings: PlanarSettings) -> Pairs:
    refined = refine_pairs(first.pyramid, second.pyramid, first.keypoints.level[pairs.row], pairs)
    return refined.take(refined.correlation >= settings.min_correlation)


def _witnesses(first: _View, pairs: Pairs) -> int:
    """Count matches whose patches, at the coarser of the levels that fit, do not overlap much."""
    order = np.argsort(-pairs.correlation, kind="stable")
    pairs = pairs.take(order)
    shrink = np.sqrt(np.abs(np.linalg.det(pairs.linear)))  # source pixels to a target pixel
    fine = np.maximum(1.0, 1.0 / np.maximum(shrink, 1e-6))  # a source without finer levels is compared on coarser ones
    level = np.where(pairs.row >= 0, first.keypoints.level[pairs.row], 0)
    return count_apart(pairs.target, 6.0 * np.maximum(first.pyramid.size[level, 0], fine))


def _agreeing(pairs: Pairs, settings: PlanarSettings) -> Pairs:
    return pairs.take(count_agreeing(pairs, slack=4.0, growth=0.25) >= settings.min_agreeing)


def _seeds_by_tilts(first: _View, second: _View, target: _Image, source: _Image, settings: PlanarSettings) -> Pairs:
    """First matches between each image and simulated views of the other; steeper ones only where those give few."""
    found = _refined(first, second, _first_matches(first, second, settings), settings)
    seeds = no_pairs()
    for compression in _COMPRESSIONS:
        for tilted in tilted_views(target.grey, target.valid, compression=compression):
            view = _view(_Image(tilted.image, tilted.valid), settings, tilted.A)
            pairs = _to_full(_first_matches(view, second, settings), view.A, np.eye(2, 3))
            hints = refine_pairs(first.pyramid, second.pyramid, view.keypoints.level[pairs.row], pairs)
            hints = hints.take(hints.correlation >= settings.min_correlation)
            found = found.join(hints.with_row(-1))
        for tilted in tilted_views(source.grey, source.valid, compression=compression):
            view = _view(_Image(tilted.image, tilted.valid), settings, tilted.A)
            pairs = _to_full(_first_matches(first, view, settings), np.eye(2, 3), view.A)
            found = found.join(_refined(first, second, pairs, settings))
        seeds = _agreeing(best_per_row(_agreeing(found, settings)), settings)
        if len(seeds) >= 2 * settings.enough:
            break
    return seeds


def _to_full(pairs: Pairs, A_target: Float64Array, A_source: Float64Array) -> Pairs:
    """Carry matches between views back to the full images."""
    back_t, back_s = np.linalg.inv(A_target[:, :2]), np.linalg.inv(A_source[:, :2])
    target = (pairs.target - A_target[:, 2]) @ back_t.T
    source = (pairs.source - A_source[:, 2]) @ back_s.T
    linear = back_s @ pairs.linear @ A_target[:, :2]
    return Pairs(pairs.row, target, source, linear, pairs.correlation)


def _on_data(pairs: Pairs, image: Float32Array, valid: BoolArray | None) -> BoolArray:
    """Say which matches lie on the source's data."""
    last = np.array(image.shape[::-1]) - 1
    inside = ((pairs.source >= 0.0) & (pairs.source <= last)).all(axis=1)
    if valid is None:
        return np.asarray(inside)
    x, y = np.clip(np.rint(pairs.source).astype(np.int64), 0, last).T
    return np.asarray(inside & valid[y, x])
