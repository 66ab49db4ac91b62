"""Sub-pixel refinement of matches: the source patch is moved and sheared until it looks like the target's."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, IntArray
from seismo3d.features import _kernels_refine
from seismo3d.features.pyramid import STEP, ImagePyramid


def _patch_grid(radius: int) -> tuple[Float32Array, Float32Array]:
    """Offsets (n, 2) within a disc, and Gaussian weights (n,) of sum 1."""
    line = np.arange(-radius, radius + 1)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2).astype(np.float32)
    squared = np.square(grid).sum(axis=1)
    grid, squared = grid[squared <= radius**2 + 0.5], squared[squared <= radius**2 + 0.5]
    weight = np.exp(-squared / (2.0 * (0.6 * radius) ** 2))
    return np.ascontiguousarray(grid), (weight / weight.sum()).astype(np.float32)


def refine_matches(
    target: ImagePyramid,
    source: ImagePyramid,
    points_target: Float64Array,
    level: IntArray,
    points_source: Float64Array,
    linear: Float64Array,
    *,
    radius: int = 8,
    n_iterations: int = 8,
    reach: float = 3.0,
    holds_shape: bool = False,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    r"""Refine matches by affine least squares between normalised patches (inverse compositional Gauss-Newton).

    Parameters
    ----------
    target, source : ImagePyramid
        Of both images.
    points_target, points_source : ndarray of shape (n, 2), float64
        Matched places, in full pixels.
    level : ndarray of shape (n,), int
        Pyramid level of each target point.
    linear : ndarray of shape (n, 2, 2), float64
        Linear part of the map from target to source, in full pixels.
    radius : int
        Of the patch, in the target level's pixels.
    n_iterations : int
        At most so many steps.
    reach : float
        A match that moves further than this, in the source level's pixels, is lost.
    holds_shape : bool
        Whether ``linear`` is known and the patch is only moved: a blur of one image passes for a change of size where
        that is free, and draws the place along.

    Returns
    -------
    points_source, linear : ndarray
        Refined; unchanged where lost.
    correlation : ndarray of shape (n,), float64
        Of both patches, weighted; -1 where lost.
    """
    if len(points_target) == 0:
        return points_source.copy(), linear.copy(), np.empty(0)
    ratio = np.sqrt(np.maximum(np.abs(np.linalg.det(linear)), 1e-6))
    wanted = np.rint(level + np.log(ratio) / np.log(STEP)).astype(np.int64)
    level_t = np.clip(level + np.maximum(-wanted, 0), 0, len(target) - 1)
    level_s = np.clip(wanted, 0, len(source) - 1)
    size_t, size_s = target.size[level_t], source.size[level_s]
    local = linear * size_t[:, None, :] / size_s[:, :, None]
    centre = source.to_level(points_source, level_s)
    grid, weight = _patch_grid(radius)
    correlation = _kernels_refine.refine_affine(
        target.values,
        target.layout,
        level_t,
        target.to_level(points_target, level_t),
        source.values,
        source.layout,
        level_s,
        centre,
        local,
        grid,
        weight,
        2 if holds_shape else 6,
        n_iterations,
        reach,
    )
    lost = correlation < 0.0
    points = np.where(lost[:, None], points_source, source.to_image(centre, level_s))
    refined = np.where(lost[:, None, None], linear, local * size_s[:, :, None] / size_t[:, None, :])
    return points, refined, correlation
