"""Edges of a graph of scalars: relative measurements between its vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import ArrayLike, Float32Array, Int32Array
from seismo3d.errors import ShapeError


@dataclass(frozen=True, slots=True, eq=False)
class ScalarEdges:
    """Relative measurements: value at the second end minus value at the first.

    An end may lie between two vertices: its value is then ``(1 - share) * x[v] + share * x[v + 1]``.

    Attributes
    ----------
    first, second : ndarray of shape (n,), int32
        Vertices at the ends.
    measured, variance : ndarray of shape (n,), float32
        The difference, and its variance, positive.
    first_share, second_share : ndarray of shape (n,), float32
        Share of the next vertex in an end's value, 0 to 1.
    """

    first: Int32Array
    second: Int32Array
    measured: Float32Array
    variance: Float32Array
    first_share: Float32Array
    second_share: Float32Array

    @classmethod
    def from_arrays(
        cls,
        first: ArrayLike,
        second: ArrayLike,
        *,
        measured: ArrayLike,
        variance: ArrayLike = 1.0,
        first_share: ArrayLike = 0.0,
        second_share: ArrayLike = 0.0,
    ) -> ScalarEdges:
        """Gather edges from arrays or scalars that broadcast to one length.

        Raises
        ------
        ShapeError
            If lengths differ, a variance is not positive, or a measurement is not finite.

        Examples
        --------
        >>> edges = ScalarEdges.from_arrays([0, 1], [1, 2], measured=[1.0, 2.0], variance=0.25)
        >>> edges.variance.tolist()
        [0.25, 0.25]
        """
        numbers = [np.asarray(v, dtype=np.float32) for v in (measured, variance, first_share, second_share)]
        ends = [np.asarray(v, dtype=np.int32) for v in (first, second)]
        try:
            arrays = np.broadcast_arrays(*ends, *numbers)
        except ValueError as error:
            shapes = ", ".join(str(v.shape) for v in (*ends, *numbers))
            raise ShapeError(
                f"edges have arrays of shapes {shapes}; expected one length. Give one row an edge."
            ) from error
        if arrays[0].ndim != 1:
            raise ShapeError(f"edges have arrays of shape {arrays[0].shape}; expected (n,). Give one row an edge.")
        if not (np.isfinite(arrays[2]).all() and (arrays[3] > 0).all()):
            raise ShapeError(
                "edges have measurements that are not finite or variances that are not positive. Drop them."
            )
        return cls(*(np.ascontiguousarray(array) for array in arrays))

    @classmethod
    def none(cls) -> ScalarEdges:
        """Return no edges."""
        return cls.from_arrays([], [], measured=[])

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def join(cls, *parts: ScalarEdges) -> ScalarEdges:
        """Return the edges of all parts, one after the other."""
        names = ("first", "second", "measured", "variance", "first_share", "second_share")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
