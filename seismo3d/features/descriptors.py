r"""Histograms of oriented gradients over a central disc and rings of satellite discs.

With ``T`` satellites to a ring and ``T`` bins, a rotation of the image by one satellite carries satellite ``t`` to ``t
+ 1`` and, as directions are taken relative to the satellite's azimuth, leaves its histogram alone: an in-plane
rotation is one cyclic shift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array, Int32Array
from seismo3d.features import _kernels
from seismo3d.features.gradients import quantise_gradients
from seismo3d.features.keypoints import Keypoints
from seismo3d.features.pyramid import ImagePyramid
from seismo3d.features.windows import window_half_widths


@dataclass(frozen=True, slots=True)
class WindowLayout:
    """Where the windows lie: ``rings`` of (ring, disc) radius in pixels, around a disc of radius ``central``."""

    rings: tuple[tuple[float, float], ...] = ((3.5, 2.0), (7.0, 3.0), (10.5, 4.0))
    central: float = 3.0
    n_satellites: int = 16
    n_merged: int = 4


def describe_points(pyramid: ImagePyramid, keypoints: Keypoints, layout: WindowLayout) -> Float32Array:
    """Describe keypoints by the histograms in their windows.

    Parameters
    ----------
    pyramid : ImagePyramid
        Of the image.
    keypoints : Keypoints
        Each is described at its own level.
    layout : WindowLayout
        The windows.

    Returns
    -------
    ndarray of shape (n, n_satellites, d), float32
        Square roots of a histogram of sum 1, so that the dot product of two is their Bhattacharyya coefficient; all
        zero where there is no gradient. A rotation of the image shifts the second axis.
    """
    n, t = len(keypoints.points), layout.n_satellites
    centres, ring, widths, reach = _window_arrays(layout)
    sums = np.zeros((n, len(centres), t), dtype=np.int32)
    local = np.empty((n, 2), dtype=np.float32)
    for k in range(len(pyramid)):
        mine = np.flatnonzero(keypoints.level == k)
        if mine.size == 0:
            continue
        valid = None if pyramid.valid is None else pyramid.valid[k]
        votes = quantise_gradients(pyramid.level(k), valid, n_bins=t)
        local = pyramid.to_level(keypoints.points[mine], k).astype(np.float32)
        part = np.zeros((mine.size, len(centres), t), dtype=np.int32)
        _kernels.describe(*votes, local, centres, ring, widths, reach, t, part)
        sums[mine] = part
    return _normalised(sums, layout)


def _window_arrays(layout: WindowLayout) -> tuple[Float32Array, Int32Array, Int32Array, Int32Array]:
    """Centres (n, 2) and window shape (n,) of all windows; half-widths and reach of each window shape."""
    azimuth = 2.0 * math.pi * np.arange(layout.n_satellites) / layout.n_satellites
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    centres = np.concatenate([np.zeros((1, 2))] + [radius * around for radius, _ in layout.rings]).astype(np.float32)
    ring = np.repeat(np.arange(1, len(layout.rings) + 1), layout.n_satellites)
    shapes = [window_half_widths(r) for r in (layout.central, *(disc for _, disc in layout.rings))]
    widths = np.zeros((len(shapes), max(s.size for s in shapes)), dtype=np.int32)
    for row, shape in zip(widths, shapes):
        row[: shape.size] = shape
    reach = np.array([s.size // 2 for s in shapes], dtype=np.int32)
    return centres, np.concatenate([[0], ring]).astype(np.int32), widths, reach


def _normalised(sums: Int32Array, layout: WindowLayout) -> Float32Array:
    n, t, n_rings = len(sums), layout.n_satellites, len(layout.rings)
    central = sums[:, 0].astype(np.float32)[:, :, None]
    rings = sums[:, 1:].reshape(n, n_rings, t, t).astype(np.float32)
    bins = (np.arange(t)[:, None] + np.arange(t)[None]) % t  # directions relative to the azimuth of satellite t
    relative = rings[:, :, np.arange(t)[:, None], bins]
    width = t // layout.n_merged
    relative = np.roll(relative, width // 2, axis=3).reshape(n, n_rings, t, layout.n_merged, width).sum(axis=4)
    vectors = np.concatenate([central, relative.transpose(0, 2, 1, 3).reshape(n, t, n_rings * layout.n_merged)], axis=2)
    total = vectors.sum(axis=(1, 2), keepdims=True)
    return np.sqrt(np.divide(vectors, total, out=np.zeros_like(vectors), where=total > 0.0))
