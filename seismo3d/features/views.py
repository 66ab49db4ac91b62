"""An image made ready to be matched: its pyramid, its points and their descriptors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.features.cyclic import Comparison, pick_matches
from seismo3d.features.descriptors import WindowLayout, describe_points
from seismo3d.features.inputs import Grey
from seismo3d.features.keypoints import Keypoints, detect_keypoints
from seismo3d.features.pairs import Pairs
from seismo3d.features.pyramid import ImagePyramid, build_pyramid


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """An image, or a simulated view of it, ready to be matched: A (2, 3) carries the image to the view."""

    pyramid: ImagePyramid
    keypoints: Keypoints
    descriptors: Float32Array
    A: Float64Array


def describe_view(
    image: Grey, *, n_points: int, n_levels: int, layout: WindowLayout, A: Float64Array | None = None
) -> View:
    """Build the pyramid of an image, detect its points and describe them."""
    pyramid = build_pyramid(image.values, image.valid, n_levels=n_levels)
    keypoints = detect_keypoints(pyramid, n_points=n_points)
    return View(pyramid, keypoints, describe_points(pyramid, keypoints, layout), np.eye(2, 3) if A is None else A)


def pick_pairs(
    first: View,
    second: View,
    compared: Comparison,
    *,
    max_ratio: float,
    apart: float,
    allowed: BoolArray | None = None,
) -> Pairs:
    """Match by descriptors, with the rotation and scale that they give; settings as for ``pick_matches``."""
    points_t, points_s = first.keypoints.points, second.keypoints.points
    near = pick_matches(compared, points_t, points_s, max_ratio=max_ratio, apart=apart, allowed=allowed)
    size_t, size_s = (view.pyramid.size[view.keypoints.level, 0] for view in (first, second))
    ratio = size_s[near.source] / size_t[near.target]
    c, s = ratio * np.cos(near.shift), ratio * np.sin(near.shift)
    linear = np.stack([c, s, -s, c], axis=1).reshape(-1, 2, 2)
    return Pairs(near.target, points_t[near.target], points_s[near.source], linear, near.similarity)
