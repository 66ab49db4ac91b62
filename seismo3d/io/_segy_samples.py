"""Amplitudes of a SEG-Y file as an array that reads what it is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, IntArray
from seismo3d.errors import FormatError
from seismo3d.io._segy_grid import TraceGrid
from seismo3d.io._segy_layout import SegyLayout, header_field, read_fields

_BLOCK_BYTES = 64 * 2**20


def decode(raw: AnyArray, layout: SegyLayout) -> AnyArray:
    """Decode stored samples to amplitudes of type ``layout.dtype``."""
    if layout.format_code != 1:
        return raw.astype(layout.dtype)
    import segyio._segyio  # segyio.tools needs it loaded, and does not load it

    # segyio decodes IBM floats from the big-endian order, in place
    words = np.array(raw, dtype=">u4", order="C")
    return segyio.tools.native(words.view(np.single), format=1, copy=False)


@dataclass(frozen=True, slots=True, eq=False)
class SegyCube:
    """A cube in a SEG-Y file, indexed as an array: ``cube[slice, slice, slice]``; each access opens the file anew.

    Attributes
    ----------
    layout : SegyLayout
        The file.
    grid : TraceGrid
        Which trace lies where.
    check : bool
        Whether to compare the line numbers of every trace that is read with what the grid expects: needed where
        the grid was derived from a sample of the headers.
    """

    layout: SegyLayout
    grid: TraceGrid
    check: bool = False

    @property
    def shape(self) -> tuple[int, int, int]:
        """(inlines, crosslines, samples)."""
        return (self.grid.inline.n, self.grid.crossline.n, self.layout.n_samples)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the amplitudes."""
        return self.layout.dtype

    @property
    def ndim(self) -> int:
        """Always 3."""
        return 3

    def __getitem__(self, key: Any) -> AnyArray:
        (il, xl, samples), rest = as_slices(key, self.shape)
        rows = self.grid.rows(il)[:, xl]
        out = np.full((*rows.shape, len(range(*samples.indices(self.shape[2])))), np.nan, dtype=self.dtype)
        found = rows >= 0
        flat = out.reshape(-1, out.shape[2])
        self._read(rows[found], np.flatnonzero(found), flat, samples)
        return out[rest]

    def _read(self, rows: IntArray, places: IntArray, out: AnyArray, samples: slice) -> None:
        """Read traces in the order in which they lie in the file, a bounded block at a time."""
        traces = self.layout.map_traces()
        order = np.argsort(rows, kind="stable")
        block = max(1, _BLOCK_BYTES // self.layout.trace_bytes)
        for start in range(0, rows.size, block):
            chosen = order[start : start + block]
            part = rows[chosen]
            dense = part[-1] - part[0] == part.size - 1
            records = traces[part[0] : part[-1] + 1] if dense else traces[part]
            if self.check:
                self._check(records["head"], part)
            out[places[chosen]] = decode(records["data"][:, samples], self.layout)

    def _check(self, heads: AnyArray, rows: IntArray) -> None:
        grid, little = self.grid, self.layout.little_endian
        il, xl = (header_field(heads, byte, little_endian=little) for byte in (grid.inline_byte, grid.crossline_byte))
        want_il, want_xl = grid.lines_of(rows)
        wrong = (il != want_il) | (xl != want_xl)
        if wrong.any():
            k = int(np.argmax(wrong))
            raise FormatError(
                f"{self.layout.path}: trace {int(rows[k]) + 1} is at inline {il[k]}, crossline {xl[k]}; expected "
                f"{want_il[k]}, {want_xl[k]} as in a regular file. Open it with scan='full'."
            )


@dataclass(frozen=True, slots=True, eq=False)
class SegyHeaders:
    """A map coordinate of every bin, indexed as an array (inlines, crosslines); NaN where none is known.

    Attributes
    ----------
    layout : SegyLayout
        The file.
    grid : TraceGrid
        Which trace lies where.
    xy_bytes : (int, int)
        Header bytes of x and y.
    column : int
        Which of the two.
    """

    layout: SegyLayout
    grid: TraceGrid
    xy_bytes: tuple[int, int]
    column: int

    @property
    def shape(self) -> tuple[int, int]:
        """(inlines, crosslines)."""
        return (self.grid.inline.n, self.grid.crossline.n)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Always float64."""
        return np.dtype(np.float64)

    @property
    def ndim(self) -> int:
        """Always 2."""
        return 2

    def __getitem__(self, key: Any) -> AnyArray:
        (il, xl), rest = as_slices(key, self.shape)
        rows = self.grid.rows(il)[:, xl]
        found = rows >= 0
        out = np.full(rows.shape, np.nan)
        out[found] = read_places(self.layout, rows[found], self.xy_bytes)[:, self.column]
        return out[rest]


def read_places(layout: SegyLayout, rows: IntArray, xy_bytes: tuple[int, int]) -> AnyArray:
    """Read map coordinates in the file's unit of lengths, shape (n, 2); NaN where both are 0: left empty.

    The scalar in byte 71 multiplies where it is positive, divides where it is negative; 0 is 1.
    """
    fields = read_fields(layout, rows, [*xy_bytes, 71])
    places = np.stack([scale_coordinate(fields[byte], fields[71]) for byte in xy_bytes], axis=1)
    places[(places == 0).all(axis=1)] = np.nan
    return places


def scale_coordinate(values: IntArray, scalar: IntArray) -> AnyArray:
    """Apply the coordinate scalar of the standard."""
    factor = np.where(scalar == 0, 1.0, np.abs(scalar).astype(np.float64))
    return np.where(scalar < 0, values / factor, values * factor)


def as_slices(key: Any, shape: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[Any, ...]]:
    """Split an index into slices that cover it, stepping forwards, and what is left to apply to what they give."""
    keys = key if isinstance(key, tuple) else (key,)
    keys = (*keys, *(slice(None) for _ in range(len(shape) - len(keys))))
    cover: list[slice] = []
    rest: list[Any] = []
    for k, n in zip(keys, shape):
        if isinstance(k, slice) and (k.step is None or k.step > 0):
            cover.append(k)
            rest.append(slice(None))
            continue
        chosen = np.arange(n)[k]
        low, high = (int(chosen.min()), int(chosen.max())) if np.size(chosen) else (0, -1)
        cover.append(slice(low, high + 1))
        rest.append(int(chosen) - low if np.ndim(chosen) == 0 else chosen - low)
    return tuple(cover), tuple(rest)
