"""Matched keypoints of two images by OpenCV's detectors: features whose places the experiments take as given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_number
from seismo3d.errors import ParameterError
from seismo3d.scan import one_channel

DETECTORS = ("sift", "orb")


@dataclass(frozen=True, slots=True, eq=False)
class KeypointPairs:
    """Matched keypoints.

    Attributes
    ----------
    points_target, points_source : ndarray of shape (k, 2), float64
        (column, row) in pixels, row ``i`` of one matches row ``i`` of the other.
    """

    points_target: Float64Array
    points_source: Float64Array


def match_keypoints(
    target: ArrayLike, source: ArrayLike, *, detector: str = "sift", ratio: float = 0.85, n_keypoints: int = 2000
) -> KeypointPairs:
    """Match the keypoints of two images: mutual nearest descriptors that pass the ratio test.

    Parameters
    ----------
    target, source : array_like of shape (rows, columns[, channels])
        Values of type uint8 are taken as they are, others are stretched from their 1st to their 99th percentile.
    detector : {"sift", "orb"}
    ratio : float
        A match is kept where its distance is below this share of the second nearest's.
    n_keypoints : int
        Most keypoints an image.

    Returns
    -------
    KeypointPairs
        Perhaps empty.
    """
    import cv2 as cv2_module

    cv2: Any = cv2_module  # its stubs lag behind
    if detector not in DETECTORS:
        raise ParameterError(f"detector is {detector!r}; expected one of {', '.join(DETECTORS)}.")
    as_number(ratio, "ratio", low=0.0, high=1.0)
    n = int(as_number(n_keypoints, "n_keypoints", low=1))
    finder = {
        "sift": lambda: cv2.SIFT_create(nfeatures=n, contrastThreshold=0.02),
        "orb": lambda: cv2.ORB_create(nfeatures=n),
    }[detector]()
    found = [finder.detectAndCompute(_as_bytes(image), None) for image in (target, source)]
    (keys_q, table_q), (keys_p, table_p) = found
    if table_q is None or table_p is None or len(keys_q) < 2 or len(keys_p) < 2:
        return KeypointPairs(np.zeros((0, 2)), np.zeros((0, 2)))
    matcher = cv2.BFMatcher(cv2.NORM_L2 if detector == "sift" else cv2.NORM_HAMMING)
    pairs = matcher.knnMatch(table_p, table_q, k=2)
    clear = [first for first, second in pairs if first.distance < ratio * second.distance]
    if not clear:
        return KeypointPairs(np.zeros((0, 2)), np.zeros((0, 2)))
    back = matcher.match(table_q[[m.trainIdx for m in clear]], table_p)
    kept = [(m.trainIdx, m.queryIdx) for m, other in zip(clear, back) if other.trainIdx == m.queryIdx]
    q = np.array([keys_q[a].pt for a, _ in kept], dtype=np.float64).reshape(-1, 2)
    p = np.array([keys_p[b].pt for _, b in kept], dtype=np.float64).reshape(-1, 2)
    return KeypointPairs(q, p)


def _as_bytes(image: ArrayLike) -> np.ndarray:
    values = np.asarray(image)
    if values.dtype == np.uint8 and values.ndim == 2:
        return np.ascontiguousarray(values)
    grey = one_channel(image)
    if values.dtype == np.uint8:
        return np.ascontiguousarray(np.rint(grey).astype(np.uint8))
    low, high = np.nanpercentile(grey, [1, 99])
    stretched = np.clip((np.nan_to_num(grey, nan=low) - low) / max(high - low, 1e-12), 0.0, 1.0)
    return np.ascontiguousarray(np.rint(255 * stretched).astype(np.uint8))
