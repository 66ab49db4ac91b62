"""Certain sheets followed on in their own plane, along support too weak to be a fault by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d.seismic.linking import Sheet
from seismo3d.seismic.scan import RidgePoints


@dataclass(frozen=True, slots=True)
class ExtendSettings:
    """How far a sheet goes on beyond its strong ridges; lengths in nodes of its grid, unless said otherwise.

    Attributes
    ----------
    strength : float
        Significance from which on a sheet is certain, and followed on.
    weakest : float
        Least support of a ridge that it is followed along.
    width : float
        Width of the Gaussian window whose plane carries the sheet on.
    off_plane : float
        Farthest, in traces, that a ridge may lie off that plane.
    angle_deg : float
        Largest angle between the ridge's plane and it.
    share : float
        Share of the nodes around a new one that must have such a ridge.
    rings : int
        How often a sheet is carried on, by two nodes at a time.
    rim : int
        What ends within so many traces, or grid steps down, of the cube's end goes on to it: crests need both their
        flanks, and are not found there.
    """

    strength: float = 70.0
    weakest: float = 0.2
    width: float = 4.0
    off_plane: float = 1.5
    angle_deg: float = 25.0
    share: float = 0.5
    rings: int = 10
    rim: int = 1


_RING = 2


def extend_sheet(
    sheet: Sheet, ridges: RidgePoints, shape: tuple[int, ...], *, settings: ExtendSettings | None = None
) -> Sheet:
    """Carry a sheet on, ring by ring, along the weak ridges that continue it.

    Support wanes towards a fault's tips, towards the cube's ends, and where another fault cuts it to pieces too small
    to be faults. There a ridge that lies on the plane of a certain fault, and in it, needs less support than one
    anywhere in the cube.

    Parameters
    ----------
    sheet : Sheet
        A certain one.
    ridges : RidgePoints
        Weak and strong ones of the cube, by growing inline as :func:`~seismo3d.seismic.scan.thin` gives them.
    shape : tuple of int
        Shape of the evidence's grid.
    settings : ExtendSettings, optional
        What continues a sheet.

    Returns
    -------
    Sheet
        The same one, if nothing continues it. Where a ring has no ridge, its score is that of the weakest one.
    """
    settings = settings or ExtendSettings()
    spare = _RING * settings.rings
    wide = _padded(sheet, spare)
    found = _beside(wide, ridges, spare, settings)
    w, score = wide.w.astype(np.float64), wide.score.astype(np.float64)
    grown = False
    for _ in range(settings.rings):
        inside = np.isfinite(w)
        ring = ndimage.binary_dilation(inside, np.ones((3, 3), bool), iterations=_RING) & ~inside
        at = (np.nonzero(ring)[0], np.nonzero(ring)[1])
        planes = _local_planes(w, inside, at, settings.width)
        best, height = _continuing(wide, found, at, planes, settings)
        in_cube = _in_cube(wide, at, planes[:, 0], shape)
        new = in_cube & (_share_around(w.shape, at, best > 0.0, in_cube) >= settings.share)
        if not new.any():
            break
        nodes = at[0][new], at[1][new]
        has = best[new] > 0.0
        w[nodes] = np.where(has, 0.5 * (height[new] + planes[new, 0]), planes[new, 0])
        score[nodes] = np.where(has, best[new], settings.weakest)
        grown = True
    grown |= _reach_the_end(wide, w, score, shape, settings)
    return _trimmed(wide, w, score) if grown else sheet


@dataclass(frozen=True, slots=True, eq=False)
class _Beside:
    """Ridges near a sheet, in its grid: node, height, support, unit normal."""

    row: IntArray
    column: IntArray
    height: Float64Array
    score: Float64Array
    normals: Float64Array


def _padded(sheet: Sheet, spare: int) -> Sheet:
    empty = np.nan
    return Sheet(
        sheet.origin, sheet.across, sheet.first_sample - spare * sheet.step, sheet.step, sheet.first_s - spare,
        np.pad(sheet.w, spare, constant_values=empty), np.pad(sheet.score, spare, constant_values=empty),
    )  # fmt: skip


def _trimmed(wide: Sheet, w: Float64Array, score: Float64Array) -> Sheet:
    inside = np.isfinite(w)
    rows, columns = (np.flatnonzero(inside.any(axis=1 - d)) for d in range(2))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return Sheet(
        wide.origin, wide.across, int(wide.first_sample + columns[0] * wide.step), wide.step,
        float(wide.first_s + rows[0]), w[box].astype(np.float32), score[box].astype(np.float32),
    )  # fmt: skip


def _beside(wide: Sheet, ridges: RidgePoints, spare: int, settings: ExtendSettings) -> _Beside:
    """Return the ridges whose nodes lie on the sheet's grid, not much farther across than the sheet does."""
    rows, columns = (a.astype(np.float64) for a in np.nonzero(wide.inside))
    inlines = wide.points(rows, columns, wide.w[wide.inside].astype(np.float64))[:, 0]
    first, last = np.searchsorted(ridges.voxels[:, 0], [inlines.min() - spare, inlines.max() + spare + 1.0])
    part = slice(int(first), int(last))
    away = ridges.positions[part, :2].astype(np.float64) - wide.origin
    row = np.rint(away @ wide.along - wide.first_s).astype(np.int64)
    column = np.rint((ridges.positions[part, 2] - wide.first_sample) / wide.step).astype(np.int64)
    height, score = away @ wide.across, ridges.score[part].astype(np.float64)
    low, high = float(np.nanmin(wide.w)) - spare, float(np.nanmax(wide.w)) + spare
    near = (row >= 0) & (row < wide.w.shape[0]) & (column >= 0) & (column < wide.w.shape[1])
    near &= (height > low) & (height < high) & (score >= settings.weakest)
    planes = ridges.planes[part][near].astype(np.float64)
    normals = planes * np.array([1.0, 1.0, -1.0])
    normals /= np.sqrt((normals**2).sum(axis=1, keepdims=True))
    return _Beside(row[near], column[near], height[near], score[near], normals)


def _local_planes(w: Float64Array, inside: BoolArray, at: tuple[IntArray, IntArray], width: float) -> Float64Array:
    """Height and slopes, along rows and columns, at nodes beside a sheet: of the plane through it nearby."""
    rows, columns = (n - 0.5 * size for n, size in zip(np.indices(w.shape), w.shape, strict=True))
    weight, filled = inside.astype(np.float64), np.where(inside, w, 0.0)

    def mean(values: Float64Array) -> Float64Array:
        return np.asarray(ndimage.gaussian_filter(values, width, mode="constant", truncate=3.0)[at])

    total = np.maximum(mean(weight), 1e-12)
    r, c, h = mean(weight * rows) / total, mean(weight * columns) / total, mean(filled) / total
    rr = mean(weight * rows**2) / total - r * r + 1e-2
    cc = mean(weight * columns**2) / total - c * c + 1e-2
    rc = mean(weight * rows * columns) / total - r * c
    rh, ch = mean(filled * rows) / total - r * h, mean(filled * columns) / total - c * h
    size = np.maximum(rr * cc - rc * rc, 1e-12)
    along, down = (cc * rh - rc * ch) / size, (rr * ch - rc * rh) / size
    return np.column_stack([h + along * (rows[at] - r) + down * (columns[at] - c), along, down])


def _continuing(
    wide: Sheet, found: _Beside, at: tuple[IntArray, IntArray], planes: Float64Array, settings: ExtendSettings
) -> tuple[Float64Array, Float64Array]:
    """Return, for nodes, the support and the height of the best ridge that lies on their planes; support 0 without."""
    number = np.full(wide.w.shape, -1)
    number[at] = np.arange(len(at[0]))
    place = number[found.row, found.column]
    there = np.flatnonzero(place >= 0)
    place = place[there]
    height, along, down = planes[place].T
    flat = wide.across - along[:, None] * wide.along
    normals = np.column_stack([flat, -down / wide.step])
    cosine = (normals * found.normals[there]).sum(axis=1) / np.sqrt((normals**2).sum(axis=1))
    fits = np.abs(found.height[there] - height) <= settings.off_plane
    fits &= np.abs(cosine) >= np.cos(np.radians(settings.angle_deg))
    there, place = there[fits], place[fits]
    best, heights = np.zeros(len(at[0])), np.zeros(len(at[0]))
    # the best one last: it is what stays
    order = np.argsort(found.score[there], kind="stable")
    best[place[order]] = found.score[there[order]]
    heights[place[order]] = found.height[there[order]]
    return best, heights


def _reach_the_end(
    wide: Sheet, w: Float64Array, score: Float64Array, shape: tuple[int, ...], settings: ExtendSettings
) -> bool:
    """Carry a sheet, in place, on to the end of the cube that it nearly reaches; return whether there was one."""
    inside = np.isfinite(w)
    ring = ndimage.binary_dilation(inside, np.ones((3, 3), bool), iterations=settings.rim) & ~inside
    at = (np.nonzero(ring)[0], np.nonzero(ring)[1])
    height = _local_planes(w, inside, at, settings.width)[:, 0]
    points, last = _in_steps(wide, at, height), np.array(shape) - 1
    near = ((points < settings.rim) | (points > last - settings.rim)) & (last > 0)
    new = _in_cube(wide, at, height, shape) & near.any(axis=1)
    nodes = at[0][new], at[1][new]
    w[nodes], score[nodes] = height[new], settings.weakest
    return bool(new.any())


def _in_steps(wide: Sheet, at: tuple[IntArray, IntArray], height: Float64Array) -> Float64Array:
    """Return (inline, crossline, step of the evidence) of nodes."""
    points = wide.points(at[0].astype(np.float64), at[1].astype(np.float64), height)
    points[:, 2] /= wide.step
    return points


def _in_cube(wide: Sheet, at: tuple[IntArray, IntArray], height: Float64Array, shape: tuple[int, ...]) -> BoolArray:
    points = _in_steps(wide, at, height)
    return np.asarray(((points >= -0.5) & (points <= np.array(shape) - 0.5)).all(axis=1))


def _share_around(
    shape: tuple[int, ...], at: tuple[IntArray, IntArray], has: BoolArray, in_cube: BoolArray
) -> Float64Array:
    """Return, for nodes of a ring, the share of those around them, in the cube, that have a ridge."""
    sums = []
    for values in (has & in_cube, in_cube):
        grid = np.zeros(shape)
        grid[at] = values
        sums.append(ndimage.uniform_filter(grid, 5, mode="constant")[at])
    return np.asarray(sums[0] / np.maximum(sums[1], 1e-9))
