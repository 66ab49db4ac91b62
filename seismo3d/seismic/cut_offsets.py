"""Sheets that other faults cut: carried straight on up to the cut, and offset there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from scipy import ndimage

from seismo3d._settings import Amount, Stiffness, Threshold, Width
from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d.seismic._kernels_cut_offsets import carry_to_places
from seismo3d.seismic._kernels_restore import read_between
from seismo3d.seismic.sheet_distances import are_near, bounds_of
from seismo3d.seismic.sheets import Sheet

# cuts of one sheet at most: their sides are the bits of a number
_MOST = 62
# nodes of a cut, and of a sheet on each of its sides, that there must be at least
_LEAST_LINE, _LEAST_SIDE = 8, 30
# traces off another sheet, of two neighbours together, from which on it does not pass between them
_LEAP = 8.0
# patches beside a cut within which these sides are counted
_BESIDE = 3.0


@dataclass(frozen=True, slots=True)
class CutSettings:
    """When a fault is taken to be offset by another, and how it is carried on up to it; lengths in traces and samples.

    Attributes
    ----------
    blurred : tuple of (float, float) in [0, inf), rising
        Patches of the scan from a cut within which a position tells nothing, as the patch holds both parts; and beyond
        which it tells all.
    along_strike, down : float in (0, 1000]
        Widths of the Gaussian window whose plane carries a part on.
    stiffness : float in [0, 1000000]
        Full nodes of the sheet's mean slope that are added to the window.
    least_weight : float in [0, inf]
        Nodes that must tell a part's position.
    least_offset : float in [0, inf]
        Offset across the sheet, in the mean along a cut, from which on it is one.
    certainty : float in [0, inf]
        How many times its spread along the cut this must be.
    slack : float in [0, inf]
        How much farther a place may lie from where it is carried to than the cut's offset explains.
    gap : float in [0, inf]
        Nodes beside the other sheet within which it still cuts.
    """

    blurred: Annotated[tuple[Amount, Amount], "rising"] = (1.3, 2.1)
    along_strike: Width = 8.0
    down: Width = 14.0
    stiffness: Stiffness = 2.0
    least_weight: Threshold = 6.0
    least_offset: Threshold = 1.5
    certainty: Threshold = 2.0
    slack: Threshold = 0.5
    gap: Threshold = 3.0


def offset_sheets(
    sheets: Sequence[Sheet], *, patch: tuple[float, float], settings: CutSettings | None = None
) -> list[Sheet]:
    """Put the parts of faults that others have cut and moved where they lie up to the cut.

    A patch of the scan that straddles a younger fault holds both parts of an older one, and its best position goes over
    from one part to the other, over two patches or more, where the fault breaks off. So each part is carried to the cut
    by the plane through its places farther away. Where the planes of both parts come to the cut well apart, all along
    it, the places between are taken from them; the younger of two faults, which goes on straight, is left as it is.
    Leftovers, of which many are no faults, cut nothing.

    Parameters
    ----------
    sheets : sequence of Sheet
        All of a cube.
    patch : tuple of (float, float)
        Widths of the scan's patch: traces along strike, samples down the dip.
    settings : CutSettings, optional
        What is a cut, and how parts are carried on.

    Returns
    -------
    list of Sheet
        In their order; the same objects where nothing has cut them.
    """
    settings = settings or CutSettings()
    grids = [_Grid(sheet) for sheet in sheets]
    return [_offset(number, grids, patch, settings) for number in range(len(sheets))]


class _Grid:
    """A sheet, its nodes, and how far places lie from it, which is worked out when first asked for."""

    def __init__(self, sheet: Sheet) -> None:
        self.sheet = sheet
        self.points = sheet.nodes()
        self.bounds = bounds_of(self.points)
        self._filled: tuple[Float64Array, Float64Array] | None = None

    def beside(self, points: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return how far across the sheet, carried on, points lie, and how many nodes beside its own."""
        sheet = self.sheet
        if self._filled is None:
            away, nearest = ndimage.distance_transform_edt(~sheet.inside, return_indices=True)
            self._filled = sheet.w[tuple(nearest)].astype(np.float64), away
        flat = points[:, :2] - sheet.origin
        row, column = flat @ sheet.along - sheet.first_s, (points[:, 2] - sheet.first_sample) / sheet.step
        at = np.clip(row, 0, sheet.w.shape[0] - 1), np.clip(column, 0, sheet.w.shape[1] - 1)
        height, away = (read_between(values, *at) for values in self._filled)
        return flat @ sheet.across - height, away + np.hypot(row - at[0], column - at[1])


@dataclass(frozen=True, slots=True, eq=False)
class _Cut:
    """Where another sheet cuts one: patches from there and the side, at every node, and how far the parts lie apart."""

    patches: Float64Array
    side: BoolArray
    offset: float


def _offset(number: int, grids: list[_Grid], patch: tuple[float, float], settings: CutSettings) -> Sheet:
    """Return a sheet with its parts carried to where others cut it."""
    one = grids[number]
    sheet, slopes = one.sheet, _mean_slopes(one.sheet)
    found = (
        _find_cut(one, other, slopes, patch, settings)
        for other in grids
        if other is not one and not other.sheet.leftover
    )
    cuts = [cut for cut in found if cut is not None]
    if not cuts:
        return sheet
    cuts = sorted(cuts, key=lambda cut: -abs(cut.offset))[:_MOST]
    patches = np.stack([cut.patches for cut in cuts])
    nearest = patches.argmin(axis=0)
    sides = np.zeros(sheet.w.shape, np.int64)
    for bit, cut in enumerate(cuts):
        sides |= cut.side.astype(np.int64) << bit
    known = _known(sheet, patches.min(axis=0), settings)
    rows, columns = np.nonzero(sheet.inside & (known < 1.0))
    zone = rows, columns
    carried, weight = _carry(sheet, known, sides, zone, 0, slopes, settings)
    offsets = np.abs([cut.offset for cut in cuts])[nearest[zone]]
    old = sheet.w[zone].astype(np.float64)
    moves = (weight > settings.least_weight) & (np.abs(carried - old) <= 0.75 * offsets + settings.slack)
    w = sheet.w.copy()
    w[zone] = np.where(moves, old + (1.0 - known[zone]) * (carried - old), old)
    return replace(sheet, w=w)


def _find_cut(
    one: _Grid, other: _Grid, slopes: tuple[float, float], patch: tuple[float, float], settings: CutSettings
) -> _Cut | None:
    """Return where another sheet cuts one, if the offset there is told, large enough and much alike along it."""
    sheet = one.sheet
    if not are_near(one.bounds, other.bounds, 2.0):
        return None
    far, beside = np.zeros(sheet.w.shape), np.full(sheet.w.shape, np.inf)
    far[sheet.inside], beside[sheet.inside] = other.beside(one.points)
    side = far > 0.0
    line = _crossing(far, sheet.inside & (beside < settings.gap))
    if line.sum() < _LEAST_LINE:
        return None
    patches = ndimage.distance_transform_edt(~line, sampling=(1.0 / patch[0], sheet.step / patch[1]))
    near = sheet.inside & (patches < _BESIDE)
    if min((near & side).sum(), (near & ~side).sum()) < _LEAST_SIDE:
        return None
    known, (rows, columns) = _known(sheet, patches, settings), np.nonzero(line)
    places = rows, columns
    parts = [_carry(sheet, known, side.astype(np.int64), places, flip, slopes, settings) for flip in (0, 1)]
    told = (parts[0][1] > settings.least_weight) & (parts[1][1] > settings.least_weight)
    if told.sum() < _LEAST_LINE:
        return None
    apart = (np.where(side[places], 1.0, -1.0) * (parts[0][0] - parts[1][0]))[told]
    offset = float(np.median(apart))
    least = max(settings.least_offset, settings.certainty * float(np.median(np.abs(apart - offset))))
    return _Cut(patches, side, offset) if abs(offset) > least else None


def _crossing(far: Float64Array, there: BoolArray) -> BoolArray:
    """Mark the nodes on both sides of where a distance changes its sign from one to the next."""
    line = np.zeros(far.shape, bool)
    for axis in (0, 1):
        low, high = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        changes = ((far[low] > 0.0) != (far[high] > 0.0)) & there[low] & there[high]
        changes &= np.abs(far[low]) + np.abs(far[high]) < _LEAP
        line[low] |= changes
        line[high] |= changes
    return line


def _known(sheet: Sheet, patches: Float64Array, settings: CutSettings) -> Float64Array:
    """Return how much the position of a node tells, 0 to 1, at so many patches from the nearest cut."""
    near, far = settings.blurred
    share = np.clip((patches - near) / (far - near), 0.0, 1.0)
    return np.where(sheet.inside, share * share * (3.0 - 2.0 * share), 0.0)


def _carry(
    sheet: Sheet,
    known: Float64Array,
    sides: IntArray,
    places: tuple[IntArray, IntArray],
    flip: int,
    slopes: tuple[float, float],
    settings: CutSettings,
) -> tuple[Float64Array, Float64Array]:
    """Return the height at places of the plane through the nodes of their side, or the flipped one; and how many."""
    widths = settings.along_strike, settings.down / sheet.step
    taps = [np.exp(-0.5 * (np.arange(-int(2.5 * width), int(2.5 * width) + 1) / width) ** 2) for width in widths]
    stiffness = settings.stiffness * widths[0] ** 2, settings.stiffness * widths[1] ** 2
    height, weight = np.zeros(len(places[0])), np.zeros(len(places[0]))
    carry_to_places(
        np.where(sheet.inside, sheet.w, 0.0).astype(np.float64), known, np.where(known > 0.0, sides, -1), *places,
        sides[places] ^ flip, taps[0], taps[1], slopes, stiffness, height, weight,
    )  # fmt: skip
    return height, weight


def _mean_slopes(sheet: Sheet) -> tuple[float, float]:
    """Return the slopes, along rows and columns, of the plane through all of a sheet."""
    rows, columns = (axis.astype(np.float64) for axis in np.nonzero(sheet.inside))
    if len(rows) < 4:
        return 0.0, 0.0
    design = np.column_stack([np.ones(len(rows)), rows, columns])
    plane = np.linalg.lstsq(design, sheet.w[sheet.inside].astype(np.float64), rcond=None)[0]
    return float(plane[1]), float(plane[2])
