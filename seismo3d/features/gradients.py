"""Gradients of an image as integer votes for directions."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.features import _kernels

Votes = tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint16], npt.NDArray[np.uint16]]


def central_differences(image: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return the gradient (x right, y down) of an image by central differences, grey levels per pixel."""
    import cv2

    smooth = np.ascontiguousarray(image, dtype=np.float32)
    kernel = np.array([[-0.5, 0.0, 0.5]], dtype=np.float32)
    gx = cv2.filter2D(smooth, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    gy = cv2.filter2D(smooth, cv2.CV_32F, kernel.T.copy(), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(gx, dtype=np.float32), np.asarray(gy, dtype=np.float32)


def quantise_gradients(image: Float32Array, valid: BoolArray | None, *, n_bins: int) -> Votes:
    """Turn each pixel's gradient into votes for the two nearest of ``n_bins`` directions.

    Parameters
    ----------
    image : ndarray of shape (rows, columns), float32
        Grey levels, about 0 to 255.
    valid : ndarray of bool, optional
        Pixels whose central differences reach an invalid one don't vote; nor do those on the border.
    n_bins : int
        Directions over the full turn, at most 255.

    Returns
    -------
    bins : ndarray of uint8
        The lower of the two bins.
    low, high : ndarray of uint16
        Votes for ``bins`` and for the next one: square root of the magnitude, shared linearly, in steps of 1/256.
    """
    import cv2

    magnitude, angle = cv2.cartToPolar(*central_differences(image))
    mask = np.ones((1, 1), dtype=np.bool_) if valid is None else np.ascontiguousarray(valid)
    return _kernels.quantise(magnitude, angle, mask, n_bins, n_bins / (2.0 * math.pi))
