"""Corners of a volume, and histograms of gradient directions in spheres around the reflector's normal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int32Array
from seismo3d.features import _kernels_volume

_NO_MASK = np.ones((1, 1, 1), dtype=np.bool_)
# voxels at the sides of a volume where no corner is taken: its spheres would reach beyond
_BORDER = 5
_LEAST_SHARE = 1e-3
"""Of the tensor's trace: with less along the weakest direction, a place is on a flat layer or an edge."""


@dataclass(frozen=True, slots=True)
class SphereLayout:
    """Spheres in a frame whose third axis is the reflector's normal; lengths in voxels.

    ``rings`` are (ring radius, height on the axis), each of ``n_satellites`` spheres; ``mirrored`` tells which ring
    each becomes where the normal is turned round; ``axis`` are heights of spheres on the axis.
    """

    rings: tuple[tuple[float, float], ...] = ((3.5, 0.0), (7.0, 0.0), (5.0, 5.0), (5.0, -5.0))
    mirrored: tuple[int, ...] = (0, 1, 3, 2)
    axis: tuple[float, ...] = (-5.0, 0.0, 5.0)
    radius: float = 3.0
    n_satellites: int = 16
    n_bands: int = 4
    n_merged: int = 4


@dataclass(frozen=True, slots=True, eq=False)
class VolumePoints:
    """Corners (n, 3), frames (n, 3, 3) with the reflector's normal as last column, and strength (n,)."""

    points: Float64Array
    frames: Float64Array
    strength: Float64Array

    def __len__(self) -> int:
        return len(self.points)


def detect_corners(volume: Float32Array, valid: BoolArray | None, *, n_points: int) -> VolumePoints:
    """Find where the structure tensor is large in all directions: where reflectors bend, end or break.

    Parameters
    ----------
    volume : ndarray of shape (ni, nj, nk), float32
        Smoothed amplitudes.
    valid : ndarray of bool, optional
        Where there is data.
    n_points : int
        At most so many, the strongest.

    Returns
    -------
    VolumePoints
        Strongest first.
    """
    tensor = _kernels_volume.halved_tensor(volume, _NO_MASK if valid is None else valid)
    local = np.stack([ndimage.gaussian_filter(t, 1.0, mode="constant", truncate=3.0) for t in tensor])
    strength = _kernels_volume.smallest_eigenvalue(local)
    total = local[0] + local[3] + local[5]
    peak = (strength == ndimage.maximum_filter(strength, size=3)) & (strength > _LEAST_SHARE * total)
    if valid is not None:
        halves = tuple(slice(0, 2 * n, 2) for n in strength.shape)
        peak &= ndimage.binary_erosion(valid[halves], iterations=2, border_value=1)
    margin = math.ceil(_BORDER / 2)
    inner = np.zeros_like(peak)
    inner[margin:-margin, margin:-margin, margin:-margin] = True
    at = np.argwhere(peak & inner)
    order = np.argsort(-strength[tuple(at.T)], kind="stable")[:n_points]
    at = at[order]
    wide = np.stack([ndimage.gaussian_filter(t, 2.0, mode="constant", truncate=2.5) for t in tensor])
    frames = _frames(wide[:, at[:, 0], at[:, 1], at[:, 2]].T.astype(np.float64))
    return VolumePoints(np.asarray(2.0 * at + 0.5, dtype=np.float64), frames, strength[tuple(at.T)].astype(np.float64))


def _frames(tensor: Float64Array) -> Float64Array:
    """Right-handed frames (n, 3, 3) whose last column is the direction of the largest eigenvalue."""
    full = tensor[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    _, vectors = np.linalg.eigh(full)
    normal = vectors[:, :, 2] * np.where(vectors[:, 2:3, 2] < 0.0, -1.0, 1.0)
    first = vectors[:, :, 1]
    return np.stack([first, np.cross(normal, first), normal], axis=2)


def flip_frames(frames: Float64Array) -> Float64Array:
    """Turn frames by half a turn about their first axis: the normal's sign changes."""
    return frames * np.array([1.0, -1.0, -1.0])


def describe_corners(
    volume: Float32Array, valid: BoolArray | None, corners: VolumePoints, layout: SphereLayout
) -> tuple[Float32Array, Float32Array]:
    """Describe corners in their frames, and in the frames with the normal's sign changed.

    Returns
    -------
    descriptors, flipped : ndarray of shape (n, n_satellites, d), float32
        Square roots of histograms of sum 1. A rotation about the normal shifts the second axis. The second array is a
        rearrangement of the first: nothing is added up twice.
    """
    t = layout.n_satellites
    sums = _kernels_volume.describe_spheres(
        volume,
        _NO_MASK if valid is None else valid,
        corners.points,
        corners.frames,
        _centres(layout),
        _sphere(layout.radius),
        layout.n_bands,
        t,
    )
    n_axis = len(layout.axis)
    axis = sums[:, :n_axis]
    rings = sums[:, n_axis:].reshape(len(corners), len(layout.rings), t, layout.n_bands, t)
    back = -np.arange(t) % t
    axis_flipped = axis[:, ::-1, ::-1][..., back]
    rings_flipped = rings[:, list(layout.mirrored)][:, :, back, ::-1][..., back]
    return _normalised(axis, rings, layout), _normalised(axis_flipped, rings_flipped, layout)


def _centres(layout: SphereLayout) -> Float64Array:
    azimuth = 2.0 * math.pi * np.arange(layout.n_satellites) / layout.n_satellites
    on_axis = np.column_stack([np.zeros(len(layout.axis)), np.zeros(len(layout.axis)), layout.axis])
    around = [
        np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth), np.full(azimuth.size, h)]) for r, h in layout.rings
    ]
    return np.concatenate([on_axis, *around])


def _sphere(radius: float) -> Int32Array:
    reach = math.ceil(radius)
    grid = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.square(grid).sum(axis=1) <= radius**2].astype(np.int32)


def _normalised(axis: AnyArray, rings: AnyArray, layout: SphereLayout) -> Float32Array:
    n, n_rings, t, n_bands, _ = rings.shape
    bins = (np.arange(t)[:, None] + np.arange(t)[None]) % t
    relative = rings.transpose(0, 1, 3, 2, 4)[:, :, :, np.arange(t)[:, None], bins]
    width = t // layout.n_merged
    # Bins are merged around the azimuth itself, halves shared at the seams, so that a mirror image stays one.
    doubled = 0.5 * (np.roll(relative, width // 2, axis=4) + np.roll(relative, width // 2 - 1, axis=4))
    merged = doubled.reshape(n, n_rings, n_bands, t, layout.n_merged, width).sum(axis=5)
    ring_part = merged.transpose(0, 3, 1, 2, 4).reshape(n, t, n_rings * n_bands * layout.n_merged)
    axis_part = axis.transpose(0, 3, 1, 2).reshape(n, t, axis.shape[1] * n_bands)
    vectors = np.concatenate([axis_part, ring_part], axis=2).astype(np.float32)
    total = vectors.sum(axis=(1, 2), keepdims=True)
    return np.sqrt(np.divide(vectors, total, out=np.zeros_like(vectors), where=total > 0.0))
