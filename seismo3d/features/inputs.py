"""What a user gives the matcher, converted or refused: grey images and volumes with masks."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, BoolArray, Float32Array
from seismo3d.errors import ShapeError

MIN_SIDE = 16
"""Images and volumes with a shorter side have no room for a window."""


_LIMIT = 2000.0
"""Grey levels beyond this, twelve times the spread, are spikes and cut off."""


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
    grid = np.asarray(getattr(raster, "values", raster))
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


def as_grey(grid: AnyArray, mask: ArrayLike | None, name: str) -> tuple[Float32Array, BoolArray | None]:
    """Scale a grid to a spread of 160 grey levels; say where it has data, or None where it has everywhere.

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
    grey : ndarray of float32
        Missing places are filled from the nearest data. All zero if nothing varies.
    valid : ndarray of bool or None

    Raises
    ------
    ShapeError
        If the mask's shape differs from the grid's.
    """
    valid = np.isfinite(grid) if grid.dtype.kind == "f" else None
    if mask is not None:
        given = np.asarray(mask)
        if given.shape != grid.shape:
            raise ShapeError(f"mask of {name} has shape {given.shape}; expected that of {name}, {grid.shape}.")
        valid = given.astype(np.bool_) if valid is None else valid & given.astype(np.bool_)
    if valid is not None and valid.all():
        valid = None
    known = grid if valid is None else grid[valid]
    if known.size == 0:
        return np.zeros(grid.shape, np.float32), valid
    sample = known.ravel()[:: max(1, known.size // 20_000)].astype(np.float64)
    low, high = (float(v) for v in np.percentile(sample, [0.5, 99.5]))
    if high <= low:
        low, high = float(known.min()), float(known.max())
    factor = 160.0 / (high - low) if high > low else 0.0
    if not np.isfinite(factor) or factor == 0.0:
        return np.zeros(grid.shape, np.float32), valid
    centred = grid.astype(np.float64) if grid.dtype == np.float64 else grid.astype(np.float32)
    if valid is not None:
        centred = _filled(centred, valid)
    centred = centred - centred.dtype.type(low)
    centred *= centred.dtype.type(factor)
    return np.clip(centred, -_LIMIT, _LIMIT).astype(np.float32), valid


def _filled(grid: AnyArray, valid: BoolArray) -> AnyArray:
    """Copy the nearest valid value to where there is none."""
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(grid[tuple(nearest)])
