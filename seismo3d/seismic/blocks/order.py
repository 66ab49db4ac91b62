"""Medians of values that lie in many blocks, exactly those of all values together, in two passes of counting."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Int64Array
from seismo3d.seismic._kernels_order import add_high, add_low

_HALF = 1 << 16


def count_high(values: Iterable[Float32Array]) -> Int64Array:
    """Count values by the upper half of their bits, in their order; shape (65536,)."""
    counts = np.zeros(_HALF, np.int64)
    for line in values:
        add_high(_bits(line), counts)
    return counts


def count_low(values: Iterable[Float32Array], high: Int64Array) -> Int64Array:
    """Count values with each of the given upper halves by their lower half; shape (len(high), 65536)."""
    counts = np.zeros((len(high), _HALF), np.int64)
    for line in values:
        for row, upper in enumerate(high):
            add_low(_bits(line), np.uint32(upper), counts[row])
    return counts


def positive_lines(values: Float32Array) -> list[Float32Array]:
    """Return the positive values of every inline."""
    return [line[line > 0] for line in values]


def middle_high(counts: Int64Array) -> Int64Array:
    """Return the upper halves of the two values in the middle, from the counts of all blocks; none of none."""
    return np.array([_place(counts, rank)[0] for rank in _ranks(counts)], np.int64)


def median(counts: Int64Array, low: Int64Array) -> float:
    """Return the median, from the counts by upper half and, for the two in the middle, by lower half; 0 of none."""
    found = []
    for row, rank in enumerate(_ranks(counts)):
        upper, left = _place(counts, rank)
        lower, _ = _place(low[row], left)
        found.append(_value((upper << 16) | lower))
    return float(np.mean(np.array(found, np.float32))) if found else 0.0


def _bits(values: Float32Array) -> AnyArray:
    return np.ascontiguousarray(values).reshape(-1).view(np.uint32)


def _value(key: int) -> np.float32:
    bits = key & 0x7FFFFFFF if key >> 31 else ~key & 0xFFFFFFFF
    return np.float32(np.array([bits], np.uint32).view(np.float32)[0])


def _ranks(counts: Int64Array) -> tuple[int, ...]:
    n = int(counts.sum())
    return ((n - 1) // 2, n // 2) if n else ()


def _place(counts: Int64Array, rank: int) -> tuple[int, int]:
    """Return the bin that holds the value of a rank, and its rank in there."""
    ends = np.cumsum(counts)
    place = int(np.searchsorted(ends, rank, side="right"))
    return place, rank - int(ends[place] - counts[place])
