"""Sheets: faults as height fields over vertical planes, fitted to the ridge points that belong together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage

from seismo3d._settings import Count, Degrees, Share, Smoothing, Steps, StepsOrNone, Threshold, Width
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic.scan import RidgePoints


@dataclass(frozen=True, slots=True)
class SheetSettings:
    """When points belong to one surface; lengths in traces and samples.

    Attributes
    ----------
    reach : int in [1, 100]
        Steps of the evidence's grid over which neighbours are looked for.
    angle_deg : float in [0, 90]
        Largest angle between the planes of two neighbours.
    off_plane : float in [0, inf]
        Farthest a point may lie off its neighbour's plane.
    turn_deg : float in [0, 90]
        Farthest a surface's plane may turn away from that of its best point.
    fold : float in [0, inf]
        Farthest a point may lie off its surface at the same place; what lies farther belongs to another one.
    fragment : int in [1, 1000000]
        Surfaces of fewer points are not joined to others.
    gap : int in [0, 100]
        Steps of the grid across which two surfaces may be joined.
    contacts : int in [1, 1000000]
        Pairs of points, across the gap, that must agree for that.
    joint_share : float in [0, 1]
        Share of the joined points that must lie on one height field.
    closing : int in [1, 100]
        Gaps in a sheet up to about twice this many grid steps are bridged.
    smoothing : float in [0, 1000]
        Width, in grid steps, of the smoothing of a sheet's position.
    rim : int in [0, 100]
        A sheet that ends within so many traces, or grid steps down, of the cube's end goes on to it: crests need both
        their flanks, and are not found there.
    swing, swing_width : float in [0, inf], (0, 1000]
        Farthest a sheet may swing from its own mean, and the width, in grid steps, of the window of that mean.
    """

    reach: Steps = 2
    angle_deg: Degrees = 25.0
    off_plane: Threshold = 1.4
    turn_deg: Degrees = 30.0
    fold: Threshold = 2.5
    fragment: Count = 20
    gap: StepsOrNone = 5
    contacts: Count = 22
    joint_share: Share = 0.93
    closing: Steps = 5
    smoothing: Smoothing = 2.0
    rim: StepsOrNone = 3
    swing: Threshold = 3.5
    swing_width: Width = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A fault as a height field over a vertical plane along its mean strike.

    A point of it lies at ``origin + s * along + w * across`` in the time slice, where ``along`` and ``across`` are the
    horizontal unit vectors of the mean strike and of its normal.

    Attributes
    ----------
    origin : ndarray of shape (2,), float64
        Inline and crossline of s = 0, w = 0.
    across : ndarray of shape (2,), float64
        Unit horizontal normal of the mean strike.
    first_sample : int
        Sample of the grid's first column.
    step : int
        Samples from one column to the next; rows are one trace apart along s.
    first_s : float
        s of the grid's first row.
    w : ndarray of shape (rows, columns), float32
        Position across; NaN outside the sheet.
    score : ndarray of shape (rows, columns), float32
        Smoothed support, in spreads of the background; NaN outside the sheet.
    leftover : bool
        Whether it was linked from the ridges that certain ones leave over: a fault beside one of these, if at all.
    """

    origin: Float64Array
    across: Float64Array
    first_sample: int
    step: int
    first_s: float
    w: Float32Array
    score: Float32Array
    leftover: bool = False

    @property
    def along(self) -> Float64Array:
        """Unit vector of the mean strike in the time slice."""
        return np.array([-self.across[1], self.across[0]])

    @property
    def inside(self) -> BoolArray:
        """Nodes that belong to the sheet."""
        return np.isfinite(self.w)

    @property
    def area(self) -> float:
        """Size of the sheet's grid: traces along strike times samples."""
        return float(self.inside.sum()) * self.step

    def only(self, inside: BoolArray) -> Sheet:
        """Return the sheet without the nodes that are not among these."""
        empty = np.float32(np.nan)
        return replace(self, w=np.where(inside, self.w, empty), score=np.where(inside, self.score, empty))

    def points(self, rows: Float64Array, columns: Float64Array, w: Float64Array) -> Float64Array:
        """Return (inline, crossline, sample) of grid places; all arguments of shape (n,)."""
        s = self.first_s + rows
        flat = self.origin + s[:, None] * self.along + w[:, None] * self.across
        return np.column_stack([flat, self.first_sample + columns * self.step])

    def nodes(self) -> Float64Array:
        """Return (inline, crossline, sample) of the nodes that belong to the sheet, in the order of the grid."""
        rows, columns = np.nonzero(self.inside)
        heights = self.w[rows, columns].astype(np.float64)
        return self.points(rows.astype(np.float64), columns.astype(np.float64), heights)


def fit_sheet(
    ridges: RidgePoints,
    members: IntArray,
    grid: tuple[int, int, int],
    step: int,
    end_score: float,
    settings: SheetSettings,
) -> tuple[Sheet, float]:
    """Fit a height field to the points of one surface that lie on it; return it and their share.

    Parameters
    ----------
    ridges : RidgePoints
        All ridge points.
    members : ndarray of shape (n,), int
        Which of them belong to the surface.
    grid : tuple of int
        Shape of the evidence's grid.
    step : int
        Samples a step of that grid.
    end_score : float
        Support, averaged over the surface nearby, below which the sheet ends.
    settings : SheetSettings
        How gaps are bridged and positions smoothed.
    """
    positions = ridges.positions[members].astype(np.float64)
    weight = np.maximum(ridges.score[members], 1e-3).astype(np.float64)
    across = _mean_normal(ridges.planes[members], weight)
    along = np.array([-across[1], across[0]])
    origin = np.average(positions[:, :2], axis=0, weights=weight)
    s = (positions[:, :2] - origin) @ along
    w = (positions[:, :2] - origin) @ across
    column = np.rint(positions[:, 2] / step).astype(np.int64)
    first_s, first_column = float(np.floor(s.min())) - settings.rim, int(column.min()) - settings.rim
    cells = (np.rint(s - first_s).astype(np.int64), column - first_column)
    shape = (int(cells[0].max()) + 1 + settings.rim, int(cells[1].max()) + 1 + settings.rim)
    on_sheet = np.ones(len(members), bool)
    for _ in range(3):
        height, count = _smoothed(cells, w, weight * on_sheet, shape, settings.smoothing)
        keep = np.abs(w - height[cells]) <= settings.fold
        if keep.sum() < 4 or np.array_equal(keep, on_sheet):
            break
        on_sheet = keep
    score, _ = _smoothed(cells, weight, on_sheet.astype(np.float64), shape, settings.smoothing)
    strong = on_sheet & (score[cells] >= end_score)
    inside = _bridge(cells, strong, shape, settings.closing) & (count > 1e-6)
    inside &= _even(height, inside, settings)
    places = first_s + np.arange(shape[0])[:, None], height, first_column + np.arange(shape[1])[None, :]
    flat = [origin[d] + places[0] * along[d] + places[1] * across[d] for d in range(2)]
    inside |= _to_the_end(inside, (flat[0], flat[1], np.broadcast_to(places[2], shape)), grid, settings.rim)
    rows, columns = (np.flatnonzero(inside.any(axis=1 - d)) for d in range(2))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] if len(rows) else np.s_[:1, :1]
    sheet = Sheet(
        origin, across, (first_column + (box[1].start or 0)) * step, step, first_s + (box[0].start or 0),
        np.where(inside, height, np.nan)[box].astype(np.float32),
        np.where(inside, score, np.nan)[box].astype(np.float32),
    )  # fmt: skip
    return sheet, float(on_sheet.mean())


def _to_the_end(
    inside: BoolArray, places: tuple[Float64Array, Float64Array, IntArray], grid: tuple[int, int, int], rim: int
) -> BoolArray:
    """Mark the nodes beside a sheet between it and an end of the cube that it nearly reaches; places in grid steps."""
    within, near = np.ones(inside.shape, bool), np.zeros(inside.shape, bool)
    for place, n in zip(places, grid, strict=True):
        within &= (place >= -1e-6) & (place <= n - 1 + 1e-6)
        if n > 1:
            near |= (place < rim) | (place > n - 1 - rim)
    return np.asarray(ndimage.binary_dilation(inside, np.ones((3, 3), bool), iterations=rim) & within & near)


def _even(height: Float64Array, inside: BoolArray, settings: SheetSettings) -> BoolArray:
    """Mark where a sheet stays near its own wide mean: a fault does not swing from strand to strand and back."""
    rows, columns = np.nonzero(inside)
    if len(rows) < 4:
        return inside
    trend = _plane((rows, columns), height[inside], np.ones(len(rows)))
    rest = np.where(inside, height - trend(*np.indices(inside.shape)), 0.0)
    weight = ndimage.gaussian_filter(inside.astype(np.float64), settings.swing_width, mode="constant")
    mean = ndimage.gaussian_filter(rest, settings.swing_width, mode="constant") / np.maximum(weight, 1e-6)
    return np.asarray(np.abs(rest - mean) <= settings.swing)


def _mean_normal(planes: Float32Array, weight: Float64Array) -> Float64Array:
    """Mean axis of horizontal normals whose signs mean nothing: the mean of the doubled angles, halved."""
    angle = 2.0 * np.arctan2(planes[:, 1].astype(np.float64), planes[:, 0].astype(np.float64))
    mean = 0.5 * np.arctan2((weight * np.sin(angle)).sum(), (weight * np.cos(angle)).sum())
    normal = np.array([np.cos(mean), np.sin(mean)])
    # along an axis exactly: rounding must not carry a section's places off its one trace
    normal[np.abs(normal) < 1e-9] = 0.0
    return normal / np.hypot(*normal)


def _smoothed(
    cells: tuple[IntArray, IntArray], values: Float64Array, weight: Float64Array, shape: tuple[int, int], sigma: float
) -> tuple[Float64Array, Float64Array]:
    """Weighted mean of scattered values on a grid, smoothed over the gaps; and the smoothed weight.

    The mean is taken of what a plane leaves, so that a sheet's rim does not curl.
    """
    size = shape[0] * shape[1]
    flat = cells[0] * shape[1] + cells[1]
    total = np.bincount(flat, weight, size).reshape(shape)
    trend = _plane(cells, values, weight)
    rest = values - trend(cells[0], cells[1])
    summed = np.bincount(flat, weight * rest, size).reshape(shape)
    both = np.stack([total, summed])
    smooth_weight, smooth_sum = ndimage.gaussian_filter(both, (0.0, sigma, sigma), mode="constant")
    wide_weight, wide_sum = ndimage.gaussian_filter(both, (0.0, 3.0 * sigma, 3.0 * sigma), mode="constant")
    # where the narrow window is nearly empty the wide one takes over
    share = 0.02
    mean = (smooth_sum + share * wide_sum) / np.maximum(smooth_weight + share * wide_weight, 1e-12)
    rows, columns = np.indices(shape)
    return np.asarray(mean + trend(rows, columns)), np.asarray(wide_weight, np.float64)


def _plane(
    cells: tuple[IntArray, IntArray], values: AnyArray, weight: Float64Array
) -> Callable[[IntArray, IntArray], Float64Array]:
    """Fit a plane to scattered values; return its height at rows and columns."""
    design = np.column_stack([np.ones(len(values)), cells[0], cells[1]])
    root = np.sqrt(weight)
    solution = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
    return lambda rows, columns: solution[0] + solution[1] * rows + solution[2] * columns


def _bridge(cells: tuple[IntArray, IntArray], on_sheet: BoolArray, shape: tuple[int, int], closing: int) -> BoolArray:
    """Cells that hold points, with the gaps between them closed; specks apart from the main body are kept out."""
    taken = np.zeros(shape, bool)
    taken[cells[0][on_sheet], cells[1][on_sheet]] = True
    disc = np.hypot(*np.mgrid[-closing : closing + 1, -closing : closing + 1]) <= closing
    padded = np.pad(taken, closing).astype(np.uint8)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc.astype(np.uint8))[closing:-closing, closing:-closing]
    around, _ = ndimage.label(np.pad(closed == 0, 1, constant_values=True))
    closed = (around != around[0, 0])[1:-1, 1:-1]  # holes are filled
    if not closed.any():
        return closed
    parts, n_parts = ndimage.label(closed, np.ones((3, 3)))
    if n_parts <= 1:
        return closed
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return parts == sizes.argmax()
