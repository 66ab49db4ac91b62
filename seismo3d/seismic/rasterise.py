"""Sheets and ridges drawn into volumes: the voxels that a fault passes through, with its likelihood and throw."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float32Array, Float64Array, Int32Array
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetThrow

# support, in standard deviations of the evidence, at which a fault is as likely as not
_EVEN = 0.6


def to_likelihood(score: Float32Array) -> Float32Array:
    """Turn support into a likelihood from 0 to 1: one half at `_EVEN` standard deviations of the cube's evidence."""
    return (1.0 - np.exp2(-np.maximum(score, 0.0) / np.float32(_EVEN))).astype(np.float32)


def draw_sheets(
    sheets: list[Sheet], throws: list[SheetThrow], shape: tuple[int, ...], *, corner: tuple[int, int] = (0, 0)
) -> tuple[Int32Array, Float32Array]:
    """Draw labels and throws into a block; where surfaces cross, the voxel belongs to the younger, or the likelier.

    The younger of two goes through unbroken; where it is not told which is, their generations are the same.
    """
    labels = np.zeros(shape, np.int32)
    throw_volume = np.full(shape, np.nan, np.float32)
    strongest = np.zeros(shape, np.float32)
    generations = np.zeros(shape, np.int16)
    for number, (sheet, throw) in enumerate(zip(sheets, throws, strict=True), start=1):
        voxels, places = sheet_voxels(sheet, (shape[0], shape[1], shape[2]), corner=corner)
        score = np.maximum(sample_grid(sheet.score, places), 1e-6)
        at = tuple(voxels.T)
        older = generations[at] - throw.generation
        wins = (labels[at] == 0) | (older > 0) | ((older == 0) & (score > strongest[at]))
        at = tuple(voxels[wins].T)
        strongest[at] = score[wins]
        generations[at] = throw.generation
        labels[at] = number
        throw_volume[at] = sample_grid(throw.throw, places[wins])
    return labels, throw_volume


def draw_ridges(
    ridges: RidgePoints, step: int, shape: tuple[int, ...], *, corner: tuple[int, int] = (0, 0)
) -> Float32Array:
    """Put the ridges' likelihood at the voxels nearest to them, at every sample a step of the evidence stands for."""
    likelihood = np.zeros(shape, np.float32)
    value = to_likelihood(ridges.score)
    for k in range(step):
        cotangent = ridges.planes[:, 2]
        at = ridges.positions.copy()
        at[:, :2] += k * cotangent[:, None] * ridges.planes[:, :2]
        at[:, 2] += k
        voxels = np.rint(at).astype(np.int64) - np.array((*corner, 0))
        inside = ((voxels >= 0) & (voxels < np.array(shape))).all(axis=1)
        np.maximum.at(likelihood, tuple(voxels[inside].T), value[inside])
    return likelihood


def sheet_voxels(
    sheet: Sheet, shape: tuple[int, int, int], *, corner: tuple[int, int] = (0, 0)
) -> tuple[Int32Array, Float64Array]:
    """Return the voxels of a block that a sheet passes through, and the grid place (row, column) of each.

    The block's first inline and crossline are the corner's, and voxels are counted from there. The sheet is sampled
    every half trace along strike and every sample down, and every voxel entered is taken once.
    """
    rows, columns, w = _dense_grid(sheet)
    points = sheet.points(rows, columns, w)
    voxels = np.rint(points).astype(np.int32) - np.array((*corner, 0), np.int32)
    inside = ((voxels >= 0) & (voxels < np.array(shape))).all(axis=1)
    voxels, places = voxels[inside], np.column_stack([rows, columns])[inside]
    flat = np.ravel_multi_index(tuple(voxels.T), shape) if len(voxels) else np.empty(0, np.int64)
    _, first = np.unique(flat, return_index=True)
    return voxels[first], places[first]


def sample_grid(grid: Float32Array, places: Float64Array) -> Float32Array:
    """Return the grid's values at fractional places, linearly; NaN beside a NaN node falls back on the nearest node."""
    value = ndimage.map_coordinates(grid, places.T, order=1, mode="nearest")
    missing = ~np.isfinite(value)
    if missing.any():
        nearest = np.rint(places[missing]).astype(np.int64)
        nearest = np.clip(nearest, 0, np.array(grid.shape) - 1)
        value[missing] = grid[tuple(nearest.T)]
    return value.astype(np.float32)


def _dense_grid(sheet: Sheet) -> tuple[Float64Array, Float64Array, Float64Array]:
    n_rows, n_columns = sheet.w.shape
    rows = np.arange(0.0, n_rows - 0.5, 0.5) if n_rows > 1 else np.zeros(1)
    columns = np.arange(0, (n_columns - 1) * sheet.step + 1) / sheet.step
    grid_rows, grid_columns = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    w = sample_grid(sheet.w, np.column_stack([grid_rows, grid_columns])).astype(np.float64)
    known = np.isfinite(w)
    return grid_rows[known], grid_columns[known], w[known]
