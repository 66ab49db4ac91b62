r"""Views of an image as if seen from the side: they make matches beyond thirty degrees of tilt possible.

Each view is the image compressed along one direction, after a blur that keeps it free of aliasing (Morel and Yu's
simulation, SIAM J. Imaging Sci. 2(2), 2009, with far fewer views).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class TiltedView:
    """A simulated view: its image, where it has data, and the affine map (2, 3) from the original to it, in pixels."""

    image: Float32Array
    valid: BoolArray
    A: Float64Array


def tilted_views(image: Float32Array, valid: BoolArray | None, *, compression: float) -> list[TiltedView]:
    """Simulate views of an image from all around, at one tilt.

    Parameters
    ----------
    image : ndarray of shape (rows, columns), float32
        Grey levels.
    valid : ndarray of bool, optional
        Where it has data.
    compression : float
        1 / cos of the tilt, above 1. Directions are spaced by 90 degrees over the compression.

    Returns
    -------
    list of TiltedView
    """
    n_directions = math.ceil(2.0 * compression)
    return [_tilted(image, valid, compression, math.pi * k / n_directions) for k in range(n_directions)]


def _tilted(image: Float32Array, valid: BoolArray | None, compression: float, direction: float) -> TiltedView:
    import cv2

    rows, columns = image.shape
    c, s = math.cos(direction), math.sin(direction)
    turn = np.array([[c, s], [-s, c]])  # carries the direction of compression to x
    corners = np.array([[0, 0], [columns - 1, 0], [0, rows - 1], [columns - 1, rows - 1]], dtype=float) @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    wide, tall = (math.ceil(v) + 1 for v in high - low)
    to_turned = np.column_stack([turn, -low])
    mask = np.full(image.shape, 255, np.uint8) if valid is None else valid.astype(np.uint8) * np.uint8(255)
    turned = cv2.warpAffine(image, to_turned, (wide, tall), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside = cv2.warpAffine(mask, to_turned, (wide, tall), flags=cv2.INTER_LINEAR, borderValue=0)
    blurred = cv2.GaussianBlur(turned, (0, 0), sigmaX=0.6 * math.sqrt(compression**2 - 1.0), sigmaY=0.01)
    narrow = max(2, round(wide / compression))
    ratio = narrow / wide
    squeeze = np.array([[ratio, 0.0], [0.0, 1.0]])
    shift = np.array([0.5 * ratio - 0.5, 0.0])
    view = cv2.resize(blurred, (narrow, tall), interpolation=cv2.INTER_LINEAR)
    seen = cv2.resize(inside, (narrow, tall), interpolation=cv2.INTER_AREA) > 250
    A = np.column_stack([squeeze @ turn, squeeze @ -low + shift])
    return TiltedView(np.asarray(view, dtype=np.float32), seen, A)
