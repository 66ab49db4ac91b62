"""The plane that most matches of two images may lie on."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.features.pairs import Pairs

# matches from which on a plane is fitted to them
_FEWEST = 12
# source pixels within which a match counts as on the plane that most may lie on
_ON_PLANE = 2.0


def count_on_plane(pairs: Pairs) -> int:
    """Count the matches that one homography explains."""
    found = _find_plane(pairs, _ON_PLANE, maxIters=2000, confidence=0.999)
    return 0 if found is None else int(found[1].sum())


def fit_plane(pairs: Pairs, distance: float) -> tuple[Float64Array, BoolArray] | None:
    """Fit a homography from target to source to most matches; None where they are few or none fits.

    Returns
    -------
    H : ndarray of shape (3, 3), float64
    on_plane : ndarray of shape (n,), bool
        Which matches lie within a distance of it, in target pixels.
    """
    import cv2

    sampled = _find_plane(pairs, distance, maxIters=500, confidence=0.99)
    if sampled is None:
        return None
    found, agree = sampled
    best, _ = cv2.findHomography(pairs.target[agree], pairs.source[agree])
    H = np.asarray(found if best is None else best, dtype=np.float64)
    if not np.isfinite(H).all():
        return None
    return H, is_near(pairs, carry(H, pairs.target)[0], distance)


def _find_plane(
    pairs: Pairs, distance: float, *, maxIters: int, confidence: float
) -> tuple[Float64Array, BoolArray] | None:
    """Sample a homography that explains most matches, and say which; None where they are few or none does."""
    import cv2

    if len(pairs) < _FEWEST:
        return None
    found, inlier = cv2.findHomography(
        pairs.target, pairs.source, cv2.USAC_DEFAULT, distance, maxIters=maxIters, confidence=confidence
    )
    return None if found is None else (np.asarray(found), inlier.ravel().astype(np.bool_))


def carry(H: Float64Array, points: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Carry points (n, 2) by a homography, with its linear part (n, 2, 2) around each."""
    carried = np.column_stack([points, np.ones(len(points))]) @ H.T
    places = carried[:, :2] / carried[:, 2:]
    linear = (H[None, :2, :2] - places[:, :, None] * H[None, 2:, :2]) / carried[:, 2, None, None]
    return places, linear


def is_near(pairs: Pairs, places: Float64Array, distance: float) -> BoolArray:
    """Say which matches lie within a distance, in target pixels, of given places in the source."""
    return np.asarray(np.linalg.norm(pairs.source - places, axis=1) <= distance * stretch(pairs))


def stretch(pairs: Pairs) -> Float64Array:
    """Source pixels to a target pixel, at each match; at least one."""
    return np.asarray(np.sqrt(np.maximum(np.abs(np.linalg.det(pairs.linear)), 1.0)))
