"""Throws: the vertical shift that matches the two sides of a fault, at every place of its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_filters import filter_crosslines, filter_samples, gaussian_taps
from seismo3d.seismic._kernels_throw import (
    bar_far_shifts,
    finish_costs,
    pick_shifts,
    read_sides,
    shift_costs,
    sum_paths,
)
from seismo3d.seismic.linking import Sheet


@dataclass(frozen=True, slots=True)
class ThrowSettings:
    """How the sides are matched; lengths in traces and samples.

    Attributes
    ----------
    near, far : int
        Traces off the surface between which each side is averaged.
    clear : int
        Traces farther off at which their slopes are read.
    longest : int
        Largest throw looked for, either way.
    along_strike, down : float
        Widths of the Gaussian window over which the sides are compared.
    neighbourhood, band : int, float
        Size of the neighbourhood, and how far a throw may lie from its median.
    step, jump : float
        Cost, as a misfit ratio, of a throw that changes by a sample from a place to the next, and by more.
    """

    near: int = 2
    far: int = 4
    clear: int = 8
    longest: int = 48
    along_strike: float = 6.0
    down: float = 12.0
    neighbourhood: int = 100
    band: float = 8.0
    step: float = 0.1
    jump: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class SheetThrow:
    """Throw of one sheet on its grid.

    Attributes
    ----------
    throw : ndarray of the sheet's shape, float32
        Samples, positive where the hanging wall is down; NaN outside the sheet and where a side has no data.
    fit : ndarray of the same shape, float32
        1 where the shifted sides are equal, 0 where they are unrelated.
    hanging_side : int
        1 where the hanging wall lies along the sheet's `across`, else -1.
    """

    throw: Float32Array
    fit: Float32Array
    hanging_side: int


def measure_throw(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    sheet: Sheet,
    *,
    settings: ThrowSettings | None = None,
) -> SheetThrow:
    """Match the two sides of a sheet by a vertical shift that varies smoothly over it.

    Each side is read along the surface, a few traces off and carried to it along its dips. For every shift the squared
    difference of the sides, one moved up and the other down by half of it, is averaged over a window on the surface and
    divided by their energy. Of these costs the cheapest paths along rows and columns are added up (semi-global matching
    [1]_): a throw must fit where it is and change smoothly to where its neighbours are.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, and where there are any.
    slopes : tuple of ndarray
        Reflector slopes along inlines and crosslines.
    sheet : Sheet
        The fault.
    settings : ThrowSettings, optional
        Windows and limits.

    Returns
    -------
    SheetThrow

    References
    ----------
    .. [1] H. Hirschmueller, IEEE TPAMI 30(2), 328-341, 2008. :doi:`10.1109/TPAMI.2007.1166`
    """
    settings = settings or ThrowSettings()
    w = _every_sample(sheet)
    sides, known = np.zeros((2, *w.shape), np.float32), np.zeros((2, *w.shape), np.float32)
    read_sides(
        volume, valid, *slopes, w, sheet.origin, sheet.along, sheet.across, sheet.first_s, sheet.first_sample,
        settings.near, settings.far, settings.clear, sides, known,
    )  # fmt: skip
    cost = _smoothed_costs(sides, known, settings)
    shift, fit = _cheapest(cost, settings)
    trusted = np.isfinite(w) & (known.min(axis=0) > 0)
    bar_far_shifts(cost, _usual(shift, trusted, settings), np.float32(settings.band))
    shift, fit = _cheapest(cost, settings)
    hanging_side = 1 if np.nanmean(np.gradient(sheet.w, axis=1)) >= 0 else -1 if sheet.w.shape[1] > 1 else 1
    # a shift at the end of its range is no match: its place takes the throw of the nearest one that is
    within = np.abs(shift) < cost.shape[2] // 2 - 1
    measured = np.isfinite(w) & (ndimage.uniform_filter(known.min(axis=0), 5) > 0.1) & within
    columns = np.arange(sheet.w.shape[1]) * sheet.step
    throw = _spread(hanging_side * shift, measured)[:, columns]
    throw[~sheet.inside] = np.nan
    return SheetThrow(throw.astype(np.float32), fit[:, columns], hanging_side)


def _every_sample(sheet: Sheet) -> Float32Array:
    """Return the sheet's position at every sample in place of every step-th."""
    n_columns = sheet.w.shape[1]
    if n_columns == 1:
        return sheet.w.copy()
    at = np.arange((n_columns - 1) * sheet.step + 1) / sheet.step
    low = np.minimum(at.astype(np.int64), n_columns - 2)
    share = (at - low).astype(np.float32)
    between = sheet.w[:, low] * (1 - share) + sheet.w[:, low + 1] * share
    return np.where(np.isfinite(between), between, sheet.w[:, np.rint(at).astype(np.int64)]).astype(np.float32)


def _smoothed_costs(sides: Float32Array, known: Float32Array, settings: ThrowSettings) -> Float32Array:
    n_rows, n_samples = sides.shape[1:]
    longest = min(settings.longest, max(1, n_samples // 2))
    n_shifts = 2 * longest + 1
    cost, weight = (
        np.empty((n_shifts, n_rows, n_samples), np.float32),
        np.empty((n_shifts, n_rows, n_samples), np.float32),
    )
    shift_costs(sides, known, n_shifts, cost, weight)
    rows, samples = gaussian_taps(settings.along_strike), gaussian_taps(settings.down)
    buffer = np.empty_like(cost)
    for part in (cost, weight):
        filter_samples(part, samples, buffer)
        filter_crosslines(buffer, rows, part)
    square = (sides**2 * known).sum(axis=0)
    n_known = np.maximum(known.sum(axis=0), 1e-3)
    wide = (2 * settings.along_strike, 2 * settings.down)
    energy = 2 * ndimage.gaussian_filter(square, wide) / np.maximum(ndimage.gaussian_filter(n_known, wide), 1e-3)
    energy = np.maximum(energy, 0.02 * max(float(energy.mean()), 1e-12)).astype(np.float32)
    out = np.empty((n_rows, n_samples, n_shifts), np.float32)
    finish_costs(cost, weight, energy, np.float32(1.0), out)
    return out


def _cheapest(cost: Float32Array, settings: ThrowSettings) -> tuple[Float32Array, Float32Array]:
    """Return the shift of the cheapest paths at every place, and its fit."""
    total = np.zeros_like(cost)
    sum_paths(cost, np.float32(settings.step), np.float32(settings.jump), total)
    shift, fit = np.empty(cost.shape[:2], np.float32), np.empty(cost.shape[:2], np.float32)
    pick_shifts(total, cost, shift, fit)
    return shift, fit


def _usual(shift: Float32Array, trusted: BoolArray, settings: ThrowSettings) -> Float32Array:
    """Return the median shift of a wide neighbourhood: it outvotes places that match the wrong reflector."""
    step = 4
    coarse = np.where(trusted, shift, np.nan)[::step, ::step]
    coarse = _spread(coarse.astype(np.float32), np.isfinite(coarse))
    if not np.isfinite(coarse).all():
        return np.zeros_like(shift)
    size = max(3, settings.neighbourhood // step)
    median = ndimage.median_filter(coarse, size=size, mode="nearest")
    rows = np.minimum(np.arange(shift.shape[0]) // step, median.shape[0] - 1)
    columns = np.minimum(np.arange(shift.shape[1]) // step, median.shape[1] - 1)
    return median[np.ix_(rows, columns)].astype(np.float32)


def _spread(values: Float32Array, known: BoolArray) -> Float32Array:
    """Values where known, that of the nearest known place elsewhere; NaN where nothing is known at all."""
    if not known.any():
        return np.full(values.shape, np.nan, np.float32)
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return values[tuple(nearest)]
