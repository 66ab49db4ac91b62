"""Find where a SEG-Y file keeps its line numbers and map coordinates, and judge whether it is a cube or a line."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from seismo3d._typing import Int64Array, IntArray
from seismo3d._validate import as_whole_number, told
from seismo3d.errors import FormatError, ParameterError
from seismo3d.geometry.survey import fit_map
from seismo3d.io._segy_grid import TraceGrid, line_axis, line_grid, padding, regular_grid, scanned_grid, take_live
from seismo3d.io._segy_layout import SegyLayout, read_fields

STANDARD = (189, 193)
_USUAL_PAIRS: tuple[tuple[int, int], ...] = (
    *((9, 21), (5, 21), (17, 21), (9, 17), (9, 13), (17, 13), (5, 9), (9, 25), (189, 21), (9, 193)),
    *((181, 185), (221, 225), (225, 229), (229, 233), (233, 237), (197, 201), (213, 217)),
)
_ANY_FIELD = (1, 5, 9, 13, 17, 21, 25, 181, 185, 189, 193, 197, 201, 205, 209, 213, 217, 221, 225, 229, 233, 237)
_OFFSET = 37
_CDP, _SHOT = 21, 9
# traces of a file up to which all headers are read
_SMALL = 60_000
# share of its bins that a grid of line numbers fills at least
_LEAST_SHARE = 0.1
XY_PAIRS = ((181, 185), (73, 77), (81, 85))


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Where the traces lie, and how that was found out.

    Attributes
    ----------
    grid : TraceGrid
        The traces' places.
    is_line : bool
        Whether it is a 2D line.
    how : str
        How the header bytes were found.
    is_sampled : bool
        Whether only a sample of the headers was read.
    line_bytes : (int, int) or None
        Header bytes of inline and crossline numbers; None where there are none.
    notes : tuple of str
        What an interpreter should know.
    """

    grid: TraceGrid
    is_line: bool
    how: str
    line_bytes: tuple[int, int] | None
    is_sampled: bool = False
    notes: tuple[str, ...] = ()


def find_grid(
    layout: SegyLayout, *, inline_byte: int | None = None, crossline_byte: int | None = None, scan_all: bool = True
) -> Found:
    """Find the place of every trace.

    Parameters
    ----------
    layout : SegyLayout
        The file.
    inline_byte, crossline_byte : int, optional
        Header bytes of the line numbers; where neither is given, the standard ones, else the most plausible ones.
    scan_all : bool
        Read every header. If not, a sample is enough where the file is regular.

    Raises
    ------
    FormatError
        If the file holds several traces a bin (not stacked), or the given bytes hold no geometry.
    """
    given = inline_byte is not None or crossline_byte is not None
    pair = (
        STANDARD[0] if inline_byte is None else inline_byte,
        STANDARD[1] if crossline_byte is None else crossline_byte,
    )
    pair = (_as_byte(pair[0], "inline_byte"), _as_byte(pair[1], "crossline_byte"))
    how = "as given" if given else "the standard ones"
    if not scan_all and (grid := regular_grid(layout, *pair)) is not None:
        return Found(grid, False, how, pair, is_sampled=True)
    sample = _Sample.read(layout, pair)
    refuse_prestack(layout, sample, pair)
    verdict = sample.judge(pair)
    if given and verdict == "none":
        raise FormatError(
            f"{layout.path} has no line numbers at bytes {pair[0]} and {pair[1]}: {sample.describe(pair)}. "
            "Name other header bytes."
        )
    if not given and verdict != "cube":
        better = sample.best_pair(verdict)
        if better is not None:
            verdict, how = "cube", f"found by trial (the standard ones, 189 and 193, hold {sample.describe(STANDARD)})"
            pair = better
    if verdict == "torn":
        raise FormatError(
            f"{layout.path} has line numbers {sample.describe(pair)} (bytes {pair[0]} and {pair[1]}), a grid far "
            f"larger than its {layout.n_traces} traces. Some headers are wrong: repair them or name other header bytes."
        )
    if verdict != "cube":
        return _as_line(layout, pair if verdict == "line" else None, how)
    if not scan_all and (grid := regular_grid(layout, *pair)) is not None:
        return Found(grid, False, how, pair, is_sampled=True)
    lines = read_fields(layout, slice(None), list(pair))
    grid = scanned_grid(lines[pair[0]], lines[pair[1]], *pair, path=layout.path)
    if grid.n_duplicates > 0.5 * (grid.n_traces - grid.n_duplicates):
        raise _not_stacked(layout, pair, grid.n_traces / (grid.n_traces - grid.n_duplicates))
    return Found(take_live(grid, layout), False, how, pair, notes=_grid_notes(grid))


def _as_byte(byte: int, name: str) -> int:
    number = as_whole_number(byte, name)
    if not 1 <= number <= 237:
        raise ParameterError(f"{name} is {number}; expected 1 to 237, the first byte of a field in a trace header.")
    return number


def find_coordinates(layout: SegyLayout, *, x_byte: int | None, y_byte: int | None) -> tuple[int, int] | None:
    """Find the bytes of the map coordinates: the given ones, else 181/185, 73/77 or 81/85; None where none vary."""
    if (x_byte is None) != (y_byte is None):
        raise ParameterError(f"x_byte is {told(x_byte)} and y_byte {told(y_byte)}; expected both or neither.")
    if x_byte is not None and y_byte is not None:
        return _as_byte(x_byte, "x_byte"), _as_byte(y_byte, "y_byte")
    rows = np.unique(np.linspace(0, layout.n_traces - 1, min(layout.n_traces, 512)).astype(np.int64))
    for pair in XY_PAIRS:
        values = read_fields(layout, rows, list(pair))
        known = (values[pair[0]] != 0) | (values[pair[1]] != 0)
        varies = any(np.ptp(v[known]) > 0 for v in values.values()) if known.any() else False
        if varies and known.mean() > 0.5:
            return pair
    return None


def refuse_prestack(layout: SegyLayout, sample: _Sample, pair: tuple[int, int]) -> None:
    """Refuse a file with many traces a bin, or many offsets a midpoint."""
    fold = sample.fold(pair)
    if fold >= 1.5 and sample.judge(pair, check_fold=False) == "cube":
        raise _not_stacked(layout, pair, fold)
    if sample.n_offsets > 1 and sample.judge(pair) == "none":
        # the first field that varies numbers the places: midpoints, the lines' own numbers, or shots
        number = next((byte for byte in (_CDP, *reversed(pair), _SHOT) if sample.varies(byte)), None)
        if number is not None and (fold := sample.rows.size / np.unique(sample.fields[number]).size) >= 1.5:
            raise _not_stacked(layout, (number,), fold)


def _not_stacked(layout: SegyLayout, pair: tuple[int, ...], fold: float) -> FormatError:
    where = " and ".join(str(byte) for byte in pair)
    return FormatError(
        f"{layout.path} is not stacked: about {fold:.3g} traces for each place (bytes {where}); expected one. "
        "Stack it, or write one offset or angle to a file of its own."
    )


def _as_line(layout: SegyLayout, pair: tuple[int, int] | None, how: str) -> Found:
    if pair is not None:
        return Found(line_grid(layout), True, f"{how}: one line", pair)
    note = "no inline and crossline numbers that span a grid were found: opened as a 2D line, traces in file order"
    return Found(line_grid(layout), True, "none found", None, notes=(note,))


def _grid_notes(grid: TraceGrid) -> tuple[str, ...]:
    notes = []
    if grid.n_duplicates:
        notes.append(f"{grid.n_duplicates} duplicate traces: the first live one in the file at each place was taken")
    n_bins = grid.inline.n * grid.crossline.n
    if grid.n_missing > 0.5 * n_bins:
        notes.append(f"{grid.n_missing} of {n_bins} bins have no trace: line numbers may be wrong in some headers")
    if grid.n_unplaced:
        notes.append(f"{grid.n_unplaced} traces numbered inline 0, crossline 0, outside the survey, were left out")
    return tuple(notes)


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """Header fields of all traces of a small file, or of runs of neighbouring traces spread over a large one."""

    rows: Int64Array
    n_traces: int
    fields: dict[int, IntArray]

    @classmethod
    def read(cls, layout: SegyLayout, pair: tuple[int, int]) -> _Sample:
        rows = _sample_rows(layout.n_traces)
        byte_numbers = sorted({*_ANY_FIELD, _OFFSET, *pair, *(byte for xy in XY_PAIRS for byte in xy)})
        return cls(rows, layout.n_traces, read_fields(layout, rows, byte_numbers))

    @property
    def is_whole(self) -> bool:
        return self.rows.size == self.n_traces

    @property
    def n_offsets(self) -> int:
        return int(np.unique(np.abs(self.fields[_OFFSET])).size)

    def varies(self, byte: int) -> bool:
        return bool(np.ptp(self.fields[byte]) > 0)

    def fold(self, pair: tuple[int, int]) -> float:
        """Traces a place: counted in the sample, or, if larger, the file's traces over the bins spanned."""
        a, b = self._numbers(pair)
        counted = a.size / _n_pairs(a, b)
        if self.is_whole:
            return counted
        return max(counted, self.n_traces / (line_axis(a).n * line_axis(b).n))

    def judge(self, pair: tuple[int, int], *, check_fold: bool = True) -> str:
        """Judge two line numbers.

        "cube"; "line": one is constant, the other each trace's own; "torn": a cube, were it not for a few numbers far
        from the others; or "none".
        """
        a, b = self._numbers(pair)
        n_a, n_b, n_pairs = np.unique(a).size, np.unique(b).size, _n_pairs(a, b)
        if min(n_a, n_b) == 1:
            return "line" if self.n_traces == 1 or (n_pairs > 1 and a.size < 1.5 * n_pairs) else "none"
        if n_pairs < (1.5 if self.is_whole else 1.2) * max(n_a, n_b):
            return "none"
        if check_fold and self.fold(pair) >= 1.5:
            return "none"
        return "torn" if self.n_traces < 0.02 * line_axis(a).n * line_axis(b).n else "cube"

    def describe(self, pair: tuple[int, int]) -> str:
        ranges = []
        for byte in pair:
            values = self.fields[byte]
            low, high = int(values.min()), int(values.max())
            ranges.append(f"{low} throughout" if low == high else f"{low} to {high}")
        return f"{ranges[0]}, and {ranges[1]}"

    def best_pair(self, standard: str) -> tuple[int, int] | None:
        """Return the usual pair that spans the fullest grid, else, in a small file, any that spans one without a gap.

        Pairs must agree with the map coordinates, where there are any. `standard` is the verdict on the standard pair:
        where that makes a line, another must span its grid without a gap; where it is torn, coordinates are not tried.
        """
        if self.n_offsets > 1:
            return None
        only_full = standard == "line"
        least = 1.0 if only_full else _LEAST_SHARE
        tried = set(_ANY_FIELD) - ({byte for xy in XY_PAIRS for byte in xy} if standard == "torn" else set())
        shares = {p: self._share(p) for p in _USUAL_PAIRS if tried.issuperset(p) and self.judge(p) == "cube"}
        usual = [pair for pair, share in shares.items() if share >= least and self._fits_map(pair)]
        if usual:
            return max(usual, key=shares.__getitem__)  # the first of equals
        if only_full or not self.is_whole:
            return None
        varying = [byte for byte in _ANY_FIELD if byte in tried and self.varies(byte)]
        # the number that changes less often is the line that the file runs along
        for pair in permutations(varying, 2):
            slow, fast = (int((np.diff(self.fields[byte]) != 0).sum()) for byte in pair)
            if slow <= fast and self.judge(pair) == "cube" and self._share(pair) == 1.0 and self._fits_map(pair):
                return pair
        return None

    def _share(self, pair: tuple[int, int]) -> float:
        """Share of the bins that the numbers span which have a trace."""
        a, b = self._numbers(pair)
        n_traces = _n_pairs(a, b) if self.is_whole else self.n_traces
        return n_traces / (line_axis(a).n * line_axis(b).n)

    def _fits_map(self, pair: tuple[int, int]) -> bool:
        """Whether map coordinates, where there are any, are an affine function of the numbers to a third of a bin."""
        a, b = self._numbers(pair)
        keep = ~padding(self.fields[pair[0]], self.fields[pair[1]])
        for xy_bytes in XY_PAIRS:
            xy = np.stack([self.fields[byte][keep] for byte in xy_bytes], axis=1)
            known = (xy != 0).any(axis=1)
            if set(xy_bytes) & set(pair) or not known.any() or (np.ptp(xy[known], axis=0) == 0).all():
                continue
            ij = np.stack([line_axis(n).index(n) for n in (a, b)], axis=1)
            fit = fit_map(ij[known], xy[known].astype(np.float64))
            if fit is None:
                return False
            along, across = np.hypot(*fit.inline_step), np.hypot(*fit.crossline_step)
            # coordinates along one straight line are those of a 2D line, whatever the numbers say
            is_line = abs(np.linalg.det(fit.matrix)) < 0.05 * along * across
            return not is_line and fit.rms <= min(along, across) / 3
        return True

    def _numbers(self, pair: tuple[int, int]) -> tuple[IntArray, IntArray]:
        """Line numbers of the sample, without padding traces."""
        a, b = self.fields[pair[0]], self.fields[pair[1]]
        keep = ~padding(a, b)
        return a[keep], b[keep]


def _n_pairs(a: IntArray, b: IntArray) -> int:
    span = int(b.max() - b.min()) + 1
    if (int(a.max()) - int(a.min()) + 1) * span < 2**62:
        return int(np.unique((a - a.min()) * span + (b - b.min())).size)
    return int(np.unique(np.stack([a, b], axis=1), axis=0).shape[0])


def _sample_rows(n: int) -> Int64Array:
    """All rows of a small file; runs of 256 neighbours at 64 places of a large one."""
    if n <= _SMALL:
        return np.arange(n, dtype=np.int64)
    starts = np.linspace(0, n - 256, 64).astype(np.int64)
    return np.unique((starts[:, None] + np.arange(256)).ravel())
