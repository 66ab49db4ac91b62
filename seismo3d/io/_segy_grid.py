"""Which trace of a SEG-Y file lies at which inline and crossline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import BoolArray, Int64Array, IntArray
from seismo3d.errors import FormatError
from seismo3d.geometry.survey import Axis
from seismo3d.io._segy_layout import SegyLayout, read_fields

_N_CHECKED = 512


@dataclass(frozen=True, slots=True, eq=False)
class TraceGrid:
    """The traces of a file on the grid of its line numbers.

    A regular file needs three numbers, ``strides``: trace = origin + a * inline index + b * crossline index. Any other
    needs ``table``, the trace of each bin, and ``bin_of``, the bin of each trace.

    Attributes
    ----------
    inline, crossline : Axis
        Line numbers, ascending.
    inline_byte, crossline_byte : int
        Where the trace headers hold them.
    n_traces : int
        Traces in the file.
    sorting : str
        "inline", "crossline" or "unsorted": what the file runs through line by line.
    strides : (int, int, int) or None
        Of a regular file.
    table : ndarray of shape (n_inlines, n_crosslines), int64, or None
        First trace of each bin, or its first live one, -1 where none is.
    bin_of : ndarray of shape (n_traces,), int64, or None
        Bin number (inline index * n_crosslines + crossline index) of each trace, -1 where it has no place.
    n_duplicates, n_unplaced : int
        Traces whose bin has an earlier trace; traces without line numbers.
    """

    inline: Axis
    crossline: Axis
    inline_byte: int
    crossline_byte: int
    n_traces: int
    sorting: str
    strides: tuple[int, int, int] | None = None
    table: Int64Array | None = None
    bin_of: Int64Array | None = None
    n_duplicates: int = 0
    n_unplaced: int = 0

    @property
    def n_missing(self) -> int:
        """Bins without a trace."""
        return 0 if self.table is None else int((self.table < 0).sum())

    def rows(self, inlines: slice) -> Int64Array:
        """Trace of each bin of some inlines, int64 of shape (k, n_crosslines), -1 where none is."""
        if self.table is not None:
            return self.table[inlines]
        origin, a, b = self.strides or (0, 0, 0)
        i = np.arange(*inlines.indices(self.inline.n), dtype=np.int64)[:, None]
        return origin + a * i + b * np.arange(self.crossline.n, dtype=np.int64)

    def all_rows(self, start: int, stop: int) -> tuple[Int64Array, Int64Array, Int64Array]:
        """Every trace of inlines start to stop - 1, duplicates too: rows in file order, and their bins."""
        n_xl = self.crossline.n
        if self.bin_of is not None:
            rows = np.flatnonzero((self.bin_of >= start * n_xl) & (self.bin_of < stop * n_xl))
            return rows, self.bin_of[rows] // n_xl, self.bin_of[rows] % n_xl
        flat = self.rows(slice(start, stop)).ravel()
        order = np.argsort(flat, kind="stable")
        return flat[order], start + order // n_xl, order % n_xl

    def lines_of(self, rows: IntArray) -> tuple[Int64Array, Int64Array]:
        """Inline and crossline numbers that traces ought to have."""
        n_xl = self.crossline.n
        if self.bin_of is not None:
            i, j = self.bin_of[rows] // n_xl, self.bin_of[rows] % n_xl
        else:
            _, a, b = self.strides or (0, 1, 1)
            slow, fast = max(abs(a), abs(b)), min(abs(a), abs(b))
            along = np.asarray(rows, dtype=np.int64)
            first, second = along // slow, along % slow // fast
            i, j = (first, second) if abs(a) == slow else (second, first)
            i = i if a > 0 else self.inline.n - 1 - i
            j = j if b > 0 else n_xl - 1 - j
        return self.inline.coordinate(i).astype(np.int64), self.crossline.coordinate(j).astype(np.int64)


def regular_grid(layout: SegyLayout, inline_byte: int, crossline_byte: int) -> TraceGrid | None:
    """Derive the grid of a regular file from a few hundred of its headers; None where it is not regular.

    The first line's length is found by bisection; everything else follows, and is checked at both ends and at
    evenly spread traces with a random offset.
    """
    n = layout.n_traces
    if n < 4:
        return None
    ends = read_fields(layout, np.array([0, 1]), [inline_byte, crossline_byte])
    il, xl = ends[inline_byte], ends[crossline_byte]
    if (il[0] == il[1]) == (xl[0] == xl[1]):
        return None
    by_inline = bool(il[0] == il[1])
    slow_byte, fast_byte = (inline_byte, crossline_byte) if by_inline else (crossline_byte, inline_byte)
    slow0, fast0 = (int(il[0]), int(xl[0])) if by_inline else (int(xl[0]), int(il[0]))
    fast_step = int(xl[1] - xl[0]) if by_inline else int(il[1] - il[0])
    n_fast = _first_true(lambda k: int(read_fields(layout, np.array([k]), [slow_byte])[slow_byte][0]) != slow0, n)
    if n_fast is None or n % n_fast:
        return None
    slow_step = int(read_fields(layout, np.array([n_fast]), [slow_byte])[slow_byte][0]) - slow0
    rows = _spread_rows(n, n_fast)
    found = read_fields(layout, rows, [slow_byte, fast_byte])
    slow_ok = found[slow_byte] == slow0 + slow_step * (rows // n_fast)
    fast_ok = found[fast_byte] == fast0 + fast_step * (rows % n_fast)
    if not (slow_ok & fast_ok).all():
        return None
    slow_axis, slow_origin, slow_stride = _ascending(slow0, slow_step, n // n_fast, n_fast)
    fast_axis, fast_origin, fast_stride = _ascending(fast0, fast_step, n_fast, 1)
    origin = slow_origin + fast_origin
    if by_inline:
        axes, strides = (slow_axis, fast_axis), (origin, slow_stride, fast_stride)
    else:
        axes, strides = (fast_axis, slow_axis), (origin, fast_stride, slow_stride)
    sorting = "inline" if by_inline else "crossline"
    return TraceGrid(axes[0], axes[1], inline_byte, crossline_byte, n, sorting, strides=strides)


def scanned_grid(il: IntArray, xl: IntArray, inline_byte: int, crossline_byte: int, *, path: str) -> TraceGrid:
    """Build the grid from the line numbers of every trace.

    The first of several traces in one bin is the bin's; line numbers 0, 0 far from all others are no place.

    Raises
    ------
    FormatError
        If the numbers span a grid that is more than 50 times larger than the file.
    """
    placed = ~padding(il, xl)
    inline, crossline = line_axis(il[placed]), line_axis(xl[placed])
    n_bins = inline.n * crossline.n
    if n_bins > 50 * il.size + 1_000_000:
        raise FormatError(
            f"{path} has line numbers {inline.first:.0f} to {inline.last:.0f} (byte {inline_byte}) and "
            f"{crossline.first:.0f} to {crossline.last:.0f} (byte {crossline_byte}): {n_bins} bins, {il.size} traces. "
            "Some headers are wrong: repair them, or name other header bytes."
        )
    i = np.rint(inline.index(il)).astype(np.int64)
    j = np.rint(crossline.index(xl)).astype(np.int64)
    bin_of = np.where(placed, i * crossline.n + j, -1)
    table = np.full(n_bins, -1, dtype=np.int64)
    rows = np.flatnonzero(placed)[::-1]
    table[bin_of[rows]] = rows  # backwards, so that the first trace of a bin is written last and stays
    n_filled = int((table >= 0).sum())
    return TraceGrid(
        inline,
        crossline,
        inline_byte,
        crossline_byte,
        int(il.size),
        _sorting(il[placed], xl[placed]),
        table=table.reshape(inline.n, crossline.n),
        bin_of=bin_of,
        n_duplicates=int(placed.sum()) - n_filled,
        n_unplaced=int(il.size - placed.sum()),
    )


def take_live(grid: TraceGrid, layout: SegyLayout) -> TraceGrid:
    """Give places whose first trace is dead, all zero, their first live one; only traces of shared places are read."""
    if grid.table is None or grid.bin_of is None or not grid.n_duplicates:
        return grid
    samples = layout.map_traces()["data"]
    table = grid.table.ravel().copy()
    for row in np.flatnonzero((grid.bin_of >= 0) & (table[grid.bin_of] != np.arange(grid.n_traces))):
        place = grid.bin_of[row]
        if samples[row].any() and not samples[table[place]].any():
            table[place] = row
    return replace(grid, table=table.reshape(grid.table.shape))


def line_grid(layout: SegyLayout) -> TraceGrid:
    """Return the grid of a 2D line: traces in file order, as inlines of one trace each."""
    return TraceGrid(Axis(0, 1, layout.n_traces), Axis(0, 1, 1), 0, 0, layout.n_traces, "trace", strides=(0, 1, 1))


def line_axis(numbers: IntArray) -> Axis:
    """Return the ascending axis whose step is the greatest common divisor of all differences."""
    unique = np.unique(numbers)
    step = int(np.gcd.reduce(np.diff(unique))) if unique.size > 1 else 1
    return Axis(float(unique[0]), float(step), int((unique[-1] - unique[0]) // step) + 1)


def padding(il: IntArray, xl: IntArray) -> BoolArray:
    """Tell the traces numbered 0, 0 where that is outside the survey: padding, not a place."""
    null = (il == 0) & (xl == 0)
    if not null.any() or null.all():
        return np.zeros_like(null)
    rest_il, rest_xl = line_axis(il[~null]), line_axis(xl[~null])
    inside = all(axis.first - axis.step <= 0 <= axis.last + axis.step for axis in (rest_il, rest_xl))
    return np.zeros_like(null) if inside else null


def _sorting(il: IntArray, xl: IntArray) -> str:
    for name, slow, fast in (("inline", il, xl), ("crossline", xl, il)):
        changes = np.diff(slow)
        one_way = (changes >= 0).all() or (changes <= 0).all()
        along = np.diff(fast)[changes == 0]
        if one_way and ((along >= 0).all() or (along <= 0).all()):
            return name
    return "unsorted"


def _ascending(first: int, step: int, n: int, stride: int) -> tuple[Axis, int, int]:
    """Turn an axis to ascend: the axis, the place of its first index in the file, the stride along it."""
    if step > 0:
        return Axis(first, step, n), 0, stride
    return Axis(first + step * (n - 1), -step, n), stride * (n - 1), -stride


def _first_true(test: Callable[[int], bool], n: int) -> int | None:
    """First k in 1..n-1 where a test that switches once from False to True is True, in O(log n) calls."""
    low, high = 0, 1
    while high < n and not test(high):
        low, high = high, high * 2
    if high >= n:
        high = n - 1
        if not test(high):
            return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if test(middle) else (middle, high)
    return high


def _spread_rows(n: int, n_fast: int) -> Int64Array:
    """Rows to check: both ends, ends of lines and evenly spread rows with a random offset inside their interval."""
    rng = np.random.default_rng(n)
    edges = np.linspace(0, n, _N_CHECKED + 1)
    spread = (edges[:-1] + rng.random(_N_CHECKED) * np.diff(edges)).astype(np.int64)
    lines = rng.integers(0, n // n_fast, 64)
    return np.unique(np.concatenate([[0, 1, n - 1], spread, lines * n_fast, lines * n_fast + n_fast - 1]))
