"""Beyond the upper and lower end of a sheet: whether layers run on there, and whether its throw can be true then.

A fault that ends within unbroken layers has no throw at its ends, and one that grows from there. So every place of its
hanging wall came from a place of its footwall that lies on it as well. Sides that match only where that leads beyond
the ends were never one: so match the walls of a deep channel, whose fill happens to be like what it cuts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetSides

# how far beyond its ends a sheet is continued, and what next to them does not count: wavelets mix there what lies apart
_BEYOND, _MIXED = 16, 4
# nodes whose slope carries on
_NODES = 8
# share of the places beyond an end that must be known
_KNOWN = 0.35
# samples that a sheet may fall short of its fault's tip, where throws are too small to be seen
_UNSEEN = 4.0
# traces and samples outside the cube that still count as its rim
_OUTSIDE = 0.5


def continue_sheet(sheet: Sheet, n_samples: int) -> Sheet:
    """Continue a sheet straight on beyond its upper and lower end.

    Parameters
    ----------
    sheet : Sheet
        Of any shape; rows with holes at an end are not continued there.
    n_samples : int
        Of the cube, within which the continuation stays.

    Returns
    -------
    Sheet
        What lies beyond the ends, without the sheet itself; its score is 0.
    """
    n_more = _BEYOND // sheet.step
    rows, ends = _straight_ends(sheet)
    column = np.arange(-n_more, sheet.w.shape[1] + n_more)
    w = np.full((len(sheet.w), len(column)), np.nan, np.float32)
    for end in ends:
        ahead = (column - end.column[:, None]) * end.outwards
        w[rows] = np.where((ahead > 0) & (ahead <= n_more), end.height(column), w[rows])
    sample = sheet.first_sample + column * sheet.step
    w[:, (sample < 0) | (sample >= n_samples)] = np.nan
    first_sample = sheet.first_sample - n_more * sheet.step
    score = np.where(np.isfinite(w), np.float32(0.0), np.float32(np.nan))
    return Sheet(sheet.origin, sheet.across, first_sample, sheet.step, sheet.first_s, w, score)


def likeness_beyond(sheet: Sheet, sides: SheetSides) -> float:
    """Tell how alike the unmoved layers on both sides are beyond a sheet's ends.

    Parameters
    ----------
    sheet : Sheet
        The sheet itself.
    sides : SheetSides
        What was read along its continuation from :func:`continue_sheet`.

    Returns
    -------
    float
        1 minus the misfit over the energy, above the sheet or below it: the lesser; 0 where one of them is not known.
    """
    rows, first, last = _ends(sheet.inside)
    ahead = np.arange(sides.both.shape[2]) - _BEYOND // sheet.step * sheet.step
    above = ahead <= first[:, None] * sheet.step - _MIXED
    below = ahead >= last[:, None] * sheet.step + _MIXED
    both, told = sides.both[:, rows], (sides.known[:, rows] > 0.0).all(axis=0)
    return min(_likeness(both, told & end, len(rows)) for end in (above, below))


def _likeness(both: Float32Array, places: BoolArray, n_rows: int) -> float:
    if np.count_nonzero(places) < _KNOWN * n_rows * (_BEYOND - _MIXED):
        return 0.0
    one, other = (side[places].astype(np.float64) for side in both)
    energy = float(np.sum(one * one + other * other))
    return 1.0 - float(np.sum((one - other) ** 2)) / energy if energy > 0.0 else 0.0


def share_out_of_view(sheet: Sheet, throw: Float32Array) -> float:
    """Return the share of a sheet's places whose throw leads beyond its ends."""
    rows, first, last = _ends(sheet.inside)
    spare = _UNSEEN / sheet.step
    source: Float64Array = np.arange(sheet.w.shape[1]) - throw[rows] / sheet.step
    told: BoolArray = np.isfinite(source)
    out = (source < first[:, None] - spare) | (source > last[:, None] + spare)
    return float((out & told).sum()) / max(int(told.sum()), 1)


def share_in_view(sheet: Sheet, throw: Float32Array, shape: tuple[int, ...]) -> float:
    """Return the share of a sheet's places whose throw leads to one within the cube, where the sheet goes straight on.

    The sides of the others cannot match: what lay there is not in the cube.
    """
    rows, ends = _straight_ends(sheet)
    source: Float64Array = np.arange(sheet.w.shape[1]) - throw[rows] / sheet.step
    told = np.isfinite(source)
    out = np.zeros(source.shape, bool)
    foot = sheet.origin + (sheet.first_s + rows)[:, None] * sheet.along
    for end in ends:
        beyond = told & ((source - end.column[:, None]) * end.outwards > 0)
        row, _ = np.nonzero(beyond)
        across = foot[row] + end.height(source)[beyond][:, None] * sheet.across
        places = np.column_stack([across, sheet.first_sample + source[beyond] * sheet.step])
        out[beyond] = ((places < -_OUTSIDE) | (places > np.array(shape) - 1 + _OUTSIDE)).any(axis=1)
    return 1.0 - float(out.sum()) / max(int(told.sum()), 1)


@dataclass(frozen=True, slots=True, eq=False)
class _StraightEnd:
    """One end of a sheet, the upper or the lower: of each of its rows the column, the height there and its slope.

    `outwards` is the direction of columns that leads off the sheet, -1 or 1.
    """

    column: IntArray
    at_end: Float64Array
    slope: Float64Array
    outwards: int

    def height(self, column: AnyArray) -> Float64Array:
        """Return how high rows lie, straight on, at columns of one or of each of them."""
        return np.asarray(self.at_end[:, None] + self.slope[:, None] * (column - self.column[:, None]))


def _straight_ends(sheet: Sheet) -> tuple[IntArray, tuple[_StraightEnd, _StraightEnd]]:
    """Return the rows of a sheet that hold nodes, and how they go on at their ends; NaN where that is not told."""
    rows, first, last = _ends(sheet.inside)
    reach = np.minimum(_NODES - 1, last - first)
    ends = []
    for end, outwards in ((first, -1), (last, 1)):
        inwards = -outwards * reach
        at_end = sheet.w[rows, end].astype(np.float64)
        slope = (sheet.w[rows, end + inwards] - at_end) / np.where(inwards == 0, np.nan, inwards)
        ends.append(_StraightEnd(end, at_end, slope, outwards))
    return rows, (ends[0], ends[1])


def _ends(inside: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the rows of a sheet that hold nodes, and the first and the last column of each."""
    rows = np.flatnonzero(inside.any(axis=1))
    first, behind = inside[rows].argmax(axis=1), inside[rows, ::-1].argmax(axis=1)
    return rows, first, inside.shape[1] - 1 - behind
