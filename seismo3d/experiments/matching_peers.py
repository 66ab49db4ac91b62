"""Other matchers, called as their authors would: detect, describe, mutual nearest neighbours, ratio test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import MissingDependencyError

MatchFunction = Callable[[AnyArray, AnyArray], tuple[Float64Array, Float64Array]]
"""Takes target and source images (uint8), gives matched points (n, 2) of each."""

_RATIO = 0.8


def _mutual(first: AnyArray | None, second: AnyArray | None, norm: int) -> AnyArray:
    """Pairs (n, 2) of rows that are each other's nearest neighbour and pass the ratio test."""
    import cv2

    if first is None or second is None or len(first) < 2 or len(second) < 2:
        return np.empty((0, 2), dtype=int)
    matcher = cv2.BFMatcher(norm)
    forth = matcher.knnMatch(first, second, 2)
    back = {m.queryIdx: m.trainIdx for m in matcher.match(second, first)}
    kept = [
        (a.queryIdx, a.trainIdx)
        for a, b in forth
        if a.distance < _RATIO * b.distance and back[a.trainIdx] == a.queryIdx
    ]
    return np.array(kept, dtype=int).reshape(-1, 2)


def opencv_matcher(name: str, n_points: int) -> MatchFunction:
    """SIFT, ORB or AKAZE of OpenCV with at most ``n_points`` keypoints an image."""
    import cv2

    make: Callable[[], Any] = {
        "SIFT": lambda: cv2.SIFT_create(n_points),  # type: ignore[attr-defined]
        "ORB": lambda: cv2.ORB_create(n_points),  # type: ignore[attr-defined]
        "AKAZE": getattr(getattr(cv2, "xfeatures2d", cv2), "AKAZE_create", None) or cv2.AKAZE_create,  # type: ignore[attr-defined]
    }[name]
    norm = cv2.NORM_L2 if name == "SIFT" else cv2.NORM_HAMMING

    def match(target: AnyArray, source: AnyArray) -> tuple[Float64Array, Float64Array]:
        points, descriptors = [], []
        for image in (target, source):
            keypoints, described = make().detectAndCompute(image, None)
            order = np.argsort([-k.response for k in keypoints], kind="stable")[:n_points]
            points.append(np.array([keypoints[i].pt for i in order]).reshape(-1, 2))
            descriptors.append(described[order] if len(order) else None)
        pairs = _mutual(descriptors[0], descriptors[1], norm)
        return points[0][pairs[:, 0]], points[1][pairs[:, 1]]

    return match


def surf_matcher(n_points: int) -> MatchFunction:
    """SURF of mahotas (its orientation is weak: it is not Bay's own)."""
    try:
        from mahotas.features import surf
    except ImportError as error:
        raise MissingDependencyError("mahotas is not installed. Install seismo3d[experiments].") from error
    import cv2

    def match(target: AnyArray, source: AnyArray) -> tuple[Float64Array, Float64Array]:
        found = [surf.surf(image, nr_octaves=4, nr_scales=6, max_points=n_points) for image in (target, source)]
        described = [np.ascontiguousarray(f[:, 6:], dtype=np.float32) for f in found]
        pairs = _mutual(described[0], described[1], cv2.NORM_L2)
        return found[0][pairs[:, 0], 1::-1], found[1][pairs[:, 1], 1::-1]

    return match


def peers(n_points: int) -> dict[str, MatchFunction]:
    """All of them by name."""
    return {
        **{name: opencv_matcher(name, n_points) for name in ("SIFT", "ORB", "AKAZE")},
        "SURF": surf_matcher(n_points),
    }
