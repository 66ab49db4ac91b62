"""What a fault leaves in terrain, at several scales: a step in slope, and a trough or a break at its foot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.terrain._kernels_align import block_means

SCALE = 2.0
"""Width, in cells of its level, of the Gaussian under every derivative."""
REGION = 3.0
"""Width of the regional surface that is taken out, over `SCALE`."""
LEAST_SIDE = 96
"""Rows or columns below which a level is not made."""


@dataclass(frozen=True, slots=True, eq=False)
class TerrainEvidence:
    """Slope and curvature of a map against those of its surroundings, at one level of resolution.

    Attributes
    ----------
    factor : int
        Cells of the map in a cell of this level, along each axis.
    known : ndarray of shape (rows, columns), float32
        1 where the derivatives rest on data, else 0.
    slope : tuple of two ndarrays of that shape, float32
        Along rows and columns: elevation per cell's length, without unit.
    curvature : tuple of three ndarrays of that shape, float32
        Along rows, mixed, and along columns; times twice `SCALE` cells, so that it compares with slope.
    steepness : ndarray of that shape, float32
        Root mean square slope of the wider surroundings.
    """

    factor: int
    known: Float32Array
    slope: tuple[Float32Array, Float32Array]
    curvature: tuple[Float32Array, Float32Array, Float32Array]
    steepness: Float32Array


def square_map(z: Float64Array, steps: tuple[float, float]) -> tuple[Float64Array, tuple[float, float]]:
    """Return the map on square cells, and the stretch of its columns and rows.

    Parameters
    ----------
    z : ndarray of shape (rows, columns), float64
    steps : (float, float)
        Length of a step along the columns' index and along the rows' index, in the unit of the elevations.

    Returns
    -------
    (ndarray, (float, float))
        Elevation over the side of a cell; new places are (column, row) times the stretch.
    """
    side = max(steps)
    stretch = (steps[0] / side, steps[1] / side)
    if min(stretch) > 0.98:
        return z / side, (1.0, 1.0)
    shape = [max(2, round((n - 1) * s) + 1) for n, s in zip(z.shape, stretch[::-1])]
    rows, columns = (np.arange(n) / s for n, s in zip(shape, stretch[::-1]))
    grid = np.meshgrid(np.minimum(rows, z.shape[0] - 1), np.minimum(columns, z.shape[1] - 1), indexing="ij")
    known = np.isfinite(z)
    filled = np.where(known, z, 0.0)
    values = ndimage.map_coordinates(filled, grid, order=1, mode="nearest")
    weight = ndimage.map_coordinates(known.astype(np.float64), grid, order=1, mode="nearest")
    return np.where(weight > 0.5, values / np.maximum(weight, 0.5) / side, np.nan), stretch


def measure_levels(z: Float64Array, n_levels: int, around: float) -> list[TerrainEvidence]:
    """Return the evidence of a map, whose unit is its cell, on levels of halved resolution, finest first.

    Parameters
    ----------
    z : ndarray of shape (rows, columns), float64
        NaN where unknown.
    n_levels : int
        Most levels.
    around : float
        Width, in cells of the level, of the window of the steepness.
    """
    levels = []
    for number in range(n_levels):
        if number:
            shape = (z.shape[0] // 2, z.shape[1] // 2)
            if min(shape) < LEAST_SIDE:
                break
            half = np.empty(shape)
            block_means(z, 2, 2, half)
            z = 0.5 * half
        levels.append(_measure(z, 2**number, around))
    return levels


def _measure(z: Float64Array, factor: int, around: float) -> TerrainEvidence:
    known = np.isfinite(z)
    filled = fill_smoothly(z, known)
    pad = int(np.ceil(4.0 * REGION * SCALE))
    # turned about its edge, a slope goes on as a slope
    wide = np.pad(
        filled - filled.mean(), pad, mode="reflect" if min(z.shape) > pad else "symmetric", reflect_type="odd"
    )
    near = ndimage.gaussian_filter(wide, SCALE)
    rest = near - ndimage.gaussian_filter(wide, REGION * SCALE)
    inner = (slice(pad, -pad), slice(pad, -pad))
    gy, gx = np.gradient(rest)
    hyy, hxy = np.gradient(gy)
    hxx = np.gradient(gx, axis=1)
    sy, sx = (s[inner] for s in np.gradient(near))
    weight = ndimage.gaussian_filter(known.astype(np.float64), SCALE, mode="nearest")
    steep = ndimage.gaussian_filter(np.where(known, sx**2 + sy**2, 0.0), around, mode="nearest")
    share = ndimage.gaussian_filter(known.astype(np.float64), around, mode="nearest")
    unit = 2.0 * SCALE

    def cut(a: Float64Array, scale: float = 1.0) -> Float32Array:
        return np.ascontiguousarray(scale * a[inner], dtype=np.float32)

    return TerrainEvidence(
        factor,
        (weight > 0.7).astype(np.float32),
        (cut(gy), cut(gx)),
        (cut(hyy, unit), cut(hxy, unit), cut(hxx, unit)),
        np.sqrt(steep / np.maximum(share, 1e-6)).astype(np.float32),
    )


def fill_smoothly(z: Float64Array, known: BoolArray) -> Float64Array:
    """Return the map with its holes filled by means over ever wider windows."""
    if known.all():
        return z
    out = np.where(known, z, np.nan)
    sigma = 1.0
    while True:
        weight = ndimage.gaussian_filter(known.astype(np.float64), sigma, mode="nearest")
        mean = ndimage.gaussian_filter(np.where(known, z, 0.0), sigma, mode="nearest") / np.maximum(weight, 1e-12)
        out = np.where(np.isfinite(out), out, np.where(weight > 1e-2, mean, np.nan))
        if np.isfinite(out).all():
            return out
        sigma *= 2.0
        if sigma > 2.0 * max(z.shape):
            return np.where(np.isfinite(out), out, np.nanmean(z))
