"""Certain sheets, and those beside them, followed on in their own plane along support too weak to be a fault itself."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from seismo3d._settings import Degrees, Share, StepsOrNone, Threshold, Width
from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d.seismic._kernels_extending import find_beside, fit_local_planes, follow_planes, lay_on_grid
from seismo3d.seismic.linking import Room
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheet_distances import SheetNodes
from seismo3d.seismic.sheet_measures import strength
from seismo3d.seismic.sheets import Sheet


@dataclass(frozen=True, slots=True)
class ExtendSettings:
    """How far a sheet goes on beyond its strong ridges; lengths in nodes of its grid, unless said otherwise.

    Attributes
    ----------
    strength : float in [0, inf]
        Significance from which on a sheet is certain, and followed on.
    company_strength, gap : float in [0, inf]
        Significance from which on a sheet within `gap`, in traces and samples, of a certain one is followed on too:
        faults come in families, and cut each other up.
    weakest : float in [0, inf]
        Least support of a ridge that it is followed along.
    width : float in (0, 1000]
        Width of the Gaussian window whose plane carries the sheet on.
    off_plane : float in [0, inf]
        Farthest, in traces, that a ridge may lie off that plane.
    angle_deg : float in [0, 90]
        Largest angle between the ridge's plane and it.
    share : float in [0, 1]
        Share of the nodes around a new one that must have such a ridge.
    rings : int in [0, 100]
        How often a sheet is carried on, by two nodes at a time.
    off_sheet : float in [0, inf]
        Farthest, in traces across a sheet, that a ridge in its attitude lies off it and still belongs to it.
    rim : int in [0, 100]
        What ends within so many traces, or grid steps down, of the cube's end goes on to it: crests need both their
        flanks, and are not found there.
    """

    strength: Threshold = 55.0
    company_strength: Threshold = 14.0
    gap: Threshold = 8.0
    weakest: Threshold = 0.15
    width: Width = 4.0
    off_plane: Threshold = 1.5
    angle_deg: Degrees = 25.0
    share: Share = 0.5
    rings: StepsOrNone = 10
    off_sheet: Threshold = 3.0
    rim: StepsOrNone = 1


# nodes that a sheet is carried on by at a time
_RING = 2


def extend_sheets(
    sheets: Sequence[Sheet],
    ridges: RidgePoints,
    shape: tuple[int, ...],
    *,
    settings: ExtendSettings | None = None,
    room: Room | None = None,
) -> list[Sheet]:
    """Carry the certain sheets on, and then those beside them.

    Parameters
    ----------
    sheets : sequence of Sheet
        All of a cube.
    ridges : RidgePoints
        Weak and strong ones of the cube, by growing inline as :func:`~seismo3d.seismic.scan.thin` gives them.
    shape : tuple of int
        Shape of the evidence's grid.
    settings : ExtendSettings, optional
        What is certain, what lies beside it, and what continues a sheet.
    room : Room, optional
        Bound of the memory; given a rest after each sheet.

    Returns
    -------
    list of Sheet
        In their order.
    """
    settings = settings or ExtendSettings()
    found, certain = list(sheets), []

    def carry_on(number: int) -> None:
        found[number] = extend_sheet(found[number], ridges, shape, settings=settings)
        if room is not None:
            room.rest()

    significance = [strength(sheet) for sheet in sheets]
    for number, value in enumerate(significance):
        if value >= settings.strength:
            carry_on(number)
            certain.append(SheetNodes.of(found[number]))
    for number, value in enumerate(significance):
        if settings.company_strength <= value < settings.strength:
            nodes = SheetNodes.of(found[number])
            if any(nodes.touches(other, settings.gap) for other in certain):
                carry_on(number)
    return found


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
        One that is to be followed on.
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
    found = ridges_beside(wide, ridges, spare, settings.weakest)
    w, score = wide.w.astype(np.float64), wide.score.astype(np.float64)
    grown = False
    for _ in range(settings.rings):
        inside = np.isfinite(w)
        ring = ndimage.binary_dilation(inside, np.ones((3, 3), bool), iterations=_RING) & ~inside
        at = (np.nonzero(ring)[0], np.nonzero(ring)[1])
        planes = local_planes(w, inside, at, settings.width)
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
class RidgesBeside:
    """Ridges near a sheet, in its grid: number among all, node, height, support, unit normal."""

    number: IntArray
    row: IntArray
    column: IntArray
    height: Float64Array
    score: Float64Array
    normals: Float64Array


def _padded(sheet: Sheet, spare: int) -> Sheet:
    empty = np.nan
    return replace(
        sheet, first_sample=sheet.first_sample - spare * sheet.step, first_s=sheet.first_s - spare,
        w=np.pad(sheet.w, spare, constant_values=empty), score=np.pad(sheet.score, spare, constant_values=empty),
    )  # fmt: skip


def _trimmed(wide: Sheet, w: Float64Array, score: Float64Array) -> Sheet:
    inside = np.isfinite(w)
    rows, columns = (np.flatnonzero(inside.any(axis=1 - d)) for d in range(2))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return replace(
        wide, first_sample=int(wide.first_sample + columns[0] * wide.step), first_s=float(wide.first_s + rows[0]),
        w=w[box].astype(np.float32), score=score[box].astype(np.float32),
    )  # fmt: skip


def ridges_beside(sheet: Sheet, ridges: RidgePoints, spare: int, weakest: float) -> RidgesBeside:
    """Return the ridges of some support whose nodes lie on a sheet's grid, not much farther across than the sheet does.

    `spare` is how much farther, in traces, that may be.
    """
    inlines = sheet.nodes()[:, 0]
    # not by numpy, which would turn all of them into numbers of the same type as these first
    ends = inlines.min() - spare, inlines.max() + spare + 1.0
    part = slice(*(bisect_left(ridges.voxels[:, 0], end) for end in ends))
    positions, score = ridges.positions[part], ridges.score[part]
    grid = (sheet.origin, sheet.along, sheet.across, sheet.first_s, sheet.first_sample, sheet.step, sheet.w.shape)
    low, high = float(np.nanmin(sheet.w)) - spare, float(np.nanmax(sheet.w)) + spare
    near = find_beside(positions, score, *grid, low, high, weakest)
    row, column, height = lay_on_grid(positions, near, *grid[:-1])
    normals = ridges.planes[part][near].astype(np.float64) * np.array([1.0, 1.0, -1.0])
    normals /= np.sqrt((normals**2).sum(axis=1, keepdims=True))
    return RidgesBeside(near + part.start, row, column, height, score[near].astype(np.float64), normals)


def local_planes(
    w: Float64Array, inside: BoolArray, at: tuple[IntArray, IntArray], width: float, *, spread: float = 1e-2
) -> Float64Array:
    """Return height and slopes, along rows and columns, at nodes of a sheet's grid: of the plane through it nearby.

    `width` is that of the Gaussian window, in nodes; what `spread` adds to it keeps planes level across lines of nodes.
    """
    reach = np.arange(-round(3.0 * width), round(3.0 * width) + 1)
    taps = np.exp(-0.5 * (reach / width) ** 2)
    planes = np.empty((len(at[0]), 3))
    fit_local_planes(w, inside, *at, taps / taps.sum(), spread, planes)
    return planes


def _continuing(
    wide: Sheet, found: RidgesBeside, at: tuple[IntArray, IntArray], planes: Float64Array, settings: ExtendSettings
) -> tuple[Float64Array, Float64Array]:
    """Return, for nodes, the support and the height of the best ridge that lies on their planes; support 0 without."""
    number = np.full(wide.w.shape, -1, np.int32)
    number[at] = np.arange(len(at[0]))
    best, heights = np.zeros(len(at[0])), np.zeros(len(at[0]))
    follow_planes(
        number, planes, wide.along, wide.across, wide.step, found.row, found.column, found.height, found.score,
        found.normals, settings.off_plane, float(np.cos(np.radians(settings.angle_deg))), best, heights,
    )  # fmt: skip
    return best, heights


def _reach_the_end(
    wide: Sheet, w: Float64Array, score: Float64Array, shape: tuple[int, ...], settings: ExtendSettings
) -> bool:
    """Carry a sheet, in place, on to the end of the cube that it nearly reaches; return whether there was one."""
    inside = np.isfinite(w)
    ring = ndimage.binary_dilation(inside, np.ones((3, 3), bool), iterations=settings.rim) & ~inside
    at = (np.nonzero(ring)[0], np.nonzero(ring)[1])
    height = local_planes(w, inside, at, settings.width)[:, 0]
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
