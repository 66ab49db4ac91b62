"""Matches under construction: which keypoint, where to, by which affine map, how alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, Float64Array, Int64Array


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Rows of matches between two images.

    Attributes
    ----------
    row : ndarray of shape (n,), int64
        Of the target's keypoint; -1 where the match only says how its neighbourhood moves.
    target, source : ndarray of shape (n, 2), float64
        Places, in full pixels.
    linear : ndarray of shape (n, 2, 2), float64
        Linear part of the map from target to source around the match.
    correlation : ndarray of shape (n,), float64
        Of both patches.
    """

    row: Int64Array
    target: Float64Array
    source: Float64Array
    linear: Float64Array
    correlation: Float64Array

    def __len__(self) -> int:
        return len(self.row)

    def take(self, which: AnyArray) -> Pairs:
        """Return the rows that a mask or an index array names."""
        return Pairs(
            self.row[which], self.target[which], self.source[which], self.linear[which], self.correlation[which]
        )

    def join(self, other: Pairs) -> Pairs:
        """Return these rows, then the other's."""
        return Pairs(
            np.concatenate([self.row, other.row]),
            np.concatenate([self.target, other.target]),
            np.concatenate([self.source, other.source]),
            np.concatenate([self.linear, other.linear]),
            np.concatenate([self.correlation, other.correlation]),
        )

    def with_row(self, row: int) -> Pairs:
        """Return the same matches, all with the given row."""
        return Pairs(np.full_like(self.row, row), self.target, self.source, self.linear, self.correlation)


def no_pairs() -> Pairs:
    """Return zero rows."""
    return Pairs(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))


def best_per_row(pairs: Pairs) -> Pairs:
    """Keep, of several matches of one keypoint, the one with the highest correlation; all of row -1."""
    order = np.lexsort((-pairs.correlation, pairs.row))
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = pairs.row[order][1:] != pairs.row[order][:-1]
    return pairs.take(order[first | (pairs.row[order] < 0)])
