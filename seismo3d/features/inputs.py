"""What a user gives the matcher, converted or refused: grey images and volumes with masks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, BoolArray, Float32Array, Float64Array
from seismo3d._validate import as_array
from seismo3d.errors import ShapeError

MIN_SIDE = 16
"""Images and volumes with a shorter side have no room for a window."""


_LIMIT = 2000.0
"""Grey levels beyond this, twelve times the spread, are spikes and cut off."""

# pixels (standard deviation) of the surroundings that tell what is missing, and share of them that must be known
_SURROUNDINGS, _LEAST_SHARE = 1.0, 0.5


def as_grid(values: Any, name: str) -> AnyArray:
    """Return an image (rows, columns) or a volume (inline, crossline, sample) as an array; colour becomes grey.

    Of a DataArray and of a scan's raster the values are taken.

    Raises
    ------
    ShapeError
        If the elements are no real numbers, the axes are not 2 or 3, or a side is shorter than 16.
    """
    raster = getattr(values, "raster", values)
    if raster is None:
        raise ShapeError(f"{name} is a scan of points alone; expected one made from an image or a volume.")
    grid = as_array(getattr(raster, "values", raster), name)
    if grid.dtype.kind not in "fiub":
        raise ShapeError(f"{name} has elements of type {grid.dtype}; expected real numbers. Convert it first.")
    if grid.ndim == 3 and grid.shape[2] in (3, 4) and min(grid.shape[:2]) >= MIN_SIDE:
        grid = grid[..., :3].astype(np.float32) @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    if grid.ndim not in (2, 3):
        raise ShapeError(f"{name} has shape {grid.shape}; expected an image (rows, columns) or a volume with 3 axes.")
    if min(grid.shape) < MIN_SIDE:
        remedy = (
            " Points are registered with register, not matched." if grid.ndim == 2 and grid.shape[1] in (2, 3) else ""
        )
        raise ShapeError(f"{name} has shape {grid.shape}; expected at least {MIN_SIDE} along each axis.{remedy}")
    return grid


@dataclass(frozen=True, slots=True, eq=False)
class Grey:
    """Grey levels of an image or a volume.

    Attributes
    ----------
    values : ndarray of float32
        Of a spread of 160; zero if nothing varies. Filled where missing.
    known : ndarray of bool, optional
        Where there is data: matches lie there. None stands for everywhere.
    valid : ndarray of bool, optional
        Where grey levels may be compared: on data, and where so little is missing that what lies around tells it.
    """

    values: Float32Array
    known: BoolArray | None = None
    valid: BoolArray | None = None

    def is_known(self, points: Float64Array) -> BoolArray:
        """Say which points of an image (n, 2), (column, row), lie on its data."""
        last = np.array(self.values.shape[::-1]) - 1
        inside = ((points >= 0.0) & (points <= last)).all(axis=1)
        return np.asarray(inside & look_up(self.known, points[:, ::-1]))


def look_up(known: BoolArray | None, index: Float64Array) -> BoolArray:
    """Whether the element nearest to each index (n, d), in the order of the axes, is known; all are where none says."""
    if known is None:
        return np.ones(len(index), dtype=np.bool_)
    at = np.clip(np.rint(index).astype(np.int64), 0, np.array(known.shape) - 1)
    return np.asarray(known[tuple(at.T)])


def as_grey(grid: AnyArray, mask: ArrayLike | None, name: str) -> Grey:
    """Scale a grid to a spread of 160 grey levels, and fill what is missing.

    Parameters
    ----------
    grid : ndarray
        As :func:`as_grid` gives it. NaN and infinite values count as missing.
    mask : array_like of bool, optional
        True where there is data.
    name : str
        For the message.

    Returns
    -------
    Grey

    Raises
    ------
    ShapeError
        If the mask's shape differs from the grid's.
    """
    known = np.isfinite(grid) if grid.dtype.kind == "f" else None
    if mask is not None:
        given = as_array(mask, f"mask of {name}")
        if given.shape != grid.shape:
            raise ShapeError(f"mask of {name} has shape {given.shape}; expected that of {name}, {grid.shape}.")
        known = given.astype(np.bool_) if known is None else known & given.astype(np.bool_)
    if known is not None and known.all():
        known = None
    there = grid if known is None else grid[known]
    if there.size == 0:
        return Grey(np.zeros(grid.shape, np.float32), known, known)
    sample = there.ravel()[:: max(1, there.size // 20_000)].astype(np.float64)
    low, high = (float(v) for v in np.percentile(sample, [0.5, 99.5]))
    if high <= low:
        low, high = float(there.min()), float(there.max())
    factor = 160.0 / (high - low) if high > low else 0.0
    if not np.isfinite(factor) or factor == 0.0:
        return Grey(np.zeros(grid.shape, np.float32), known, known)
    centred = grid.astype(np.float64) if grid.dtype == np.float64 else grid.astype(np.float32)
    centred = centred - centred.dtype.type(low)
    centred *= centred.dtype.type(factor)
    grey = np.clip(centred, -_LIMIT, _LIMIT).astype(np.float32)
    if known is None:
        return Grey(grey)
    filled, valid = _filled(grey, known)
    return Grey(filled, known, valid)


def _filled(grey: Float32Array, known: BoolArray) -> tuple[Float32Array, BoolArray]:
    """Fill what is missing: with the mean of its surroundings where enough of them is known, else with the nearest.

    The second array says where grey levels stand for data: a dead pixel or trace is told by those around it, and
    windows may look at it; a hole is not.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    smooth = partial(gaussian_filter, sigma=_SURROUNDINGS, mode="nearest", truncate=3.0)
    share = smooth(known.astype(np.float32))
    valid = known | (share >= _LEAST_SHARE)
    mean = smooth(np.where(known, grey, np.float32(0.0))) / np.maximum(share, _LEAST_SHARE)
    filled = np.where(known, grey, mean)
    nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(filled[tuple(nearest)]), np.asarray(valid)
