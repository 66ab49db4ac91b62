"""An image at fractional scale steps, in one buffer that compiled loops can address."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array

STEP = 2.0**0.25
"""Ratio of the pixel sizes of neighbouring levels."""


@dataclass(frozen=True, slots=True, eq=False)
class ImagePyramid:
    """Levels of an image, each smoothed and coarser by the same factor, one after the other in memory.

    Attributes
    ----------
    values : ndarray of shape (n,), float32
        Grey levels of all levels.
    layout : ndarray of shape (n_levels, 3), int64
        Start in ``values``, rows and columns of each level.
    size : ndarray of shape (n_levels, 2), float64
        Pixels of the full image to one of the level's, along x and y.
    valid : tuple of ndarray of bool, optional
        Where each level has data; None where it has everywhere.
    """

    values: Float32Array
    layout: Int64Array
    size: Float64Array
    valid: tuple[BoolArray, ...] | None

    def __len__(self) -> int:
        return len(self.layout)

    def level(self, index: int) -> Float32Array:
        """Return one level as an image, a view of shape (rows, columns)."""
        start, rows, columns = (int(v) for v in self.layout[index])
        return self.values[start : start + rows * columns].reshape(rows, columns)

    def to_level(self, points: Float64Array, index: AnyArray | int) -> Float64Array:
        """Carry points (n, 2) from the full image to levels, one for all or one a point."""
        return (points + 0.5) / self.size[index] - 0.5

    def to_image(self, points: Float64Array, index: AnyArray | int) -> Float64Array:
        """Carry points (n, 2) from levels to the full image."""
        return (points + 0.5) * self.size[index] - 0.5


def build_pyramid(
    image: Float32Array, valid: BoolArray | None, *, n_levels: int, min_size: int = 32, smoothing: float = 1.0
) -> ImagePyramid:
    """Shrink an image in steps of the fourth root of two, averaging over areas, and smooth each level alike.

    Parameters
    ----------
    image : ndarray of shape (rows, columns), float32
        Grey levels, finite.
    valid : ndarray of bool, optional
        Where the image has data. A coarse pixel is valid where all it is made of is.
    n_levels : int
        At most so many levels.
    min_size : int
        No level has a side shorter than this, in pixels, but for the first.
    smoothing : float
        Standard deviation of the Gaussian that smooths each level, in its pixels.

    Returns
    -------
    ImagePyramid
    """
    import cv2

    rows, columns = image.shape
    shapes = [(rows, columns)]
    for k in range(1, n_levels):
        shape = (round(rows / STEP**k), round(columns / STEP**k))
        if min(shape) < min_size:
            break
        shapes.append(shape)
    sizes = np.array([h * w for h, w in shapes], dtype=np.int64)
    layout = np.column_stack([np.concatenate([[0], np.cumsum(sizes)[:-1]]), np.array(shapes)]).astype(np.int64)
    values = np.empty(int(sizes.sum()), dtype=np.float32)
    masks: list[BoolArray] = []
    smooth: list[AnyArray] = []
    for k, (h, w) in enumerate(shapes):
        start = int(layout[k, 0])
        smooth.append(values[start : start + h * w].reshape(h, w))
        finer = image if k == 0 else smooth[k - 4 if k >= 4 else 0]
        coarse = finer if k == 0 else cv2.resize(finer, (w, h), interpolation=cv2.INTER_LINEAR)
        # The finer level is smooth already: only what its smoothing lacks in the coarser pixels is added.
        missing = 1.0 if k == 0 else math.sqrt(1.0 - (finer.shape[1] / w) ** -2.0)
        cv2.GaussianBlur(coarse, (0, 0), smoothing * missing, dst=smooth[k])
        if valid is not None:
            share = cv2.resize(valid.astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
            full = (share > 0.999).astype(np.uint8)
            masks.append(cv2.erode(full, np.ones((3, 3), np.uint8), borderValue=1).astype(np.bool_))
    size = np.array([[columns / w, rows / h] for h, w in shapes])
    return ImagePyramid(values, layout, size, tuple(masks) if valid is not None else None)
