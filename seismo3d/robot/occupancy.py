"""Occupancy: where the ground is free, where something stands, and what nobody has seen."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float32Array, Float64Array
from seismo3d._validate import as_number, as_numbers, as_points, as_real_array, freeze
from seismo3d.errors import FormatError, ParameterError, ShapeError
from seismo3d.geometry.rotations import transform_points
from seismo3d.io.numpy_files import read_npz

FREE, OCCUPIED, UNKNOWN = 0, 1, 2
_ARRAYS = ("cells", "height", "cell", "origin", "T_world_map")


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """A map of square cells seen from above.

    Map axes are x along the columns, y along the rows, z up, in metres: the centre of cell (row, column) lies at
    ``x = origin[0] + column * cell``, ``y = origin[1] + row * cell``.

    Attributes
    ----------
    cells : ndarray of shape (rows, columns), uint8
        0 free, 1 occupied, 2 unknown.
    height : ndarray of shape (rows, columns), float32
        Height of the ground along the map's z, metres, NaN where it is unknown.
    cell : float
        Side of a cell, metres.
    origin : (float, float)
        x and y of the centre of cell (0, 0).
    T_world_map : ndarray of shape (4, 4), float64
        Carries map axes to the world's.
    """

    cells: AnyArray
    height: Float32Array
    cell: float
    origin: tuple[float, float] = (0.0, 0.0)
    T_world_map: Float64Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        cells = as_real_array(self.cells, "cells", ndim=2)
        if not np.isin(cells, (FREE, OCCUPIED, UNKNOWN)).all():
            raise ShapeError("cells holds other values than 0, 1 and 2; expected 0 free, 1 occupied, 2 unknown.")
        height = as_real_array(self.height, "height", ndim=2)
        if height.shape != cells.shape:
            raise ShapeError(f"height has shape {height.shape}; expected that of cells, {cells.shape}.")
        T = np.array(as_real_array(self.T_world_map, "T_world_map", ndim=2), dtype=np.float64)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise ShapeError(f"T_world_map has shape {T.shape}; expected a finite matrix of shape (4, 4).")
        values = {
            "cells": freeze(np.array(cells, dtype=np.uint8)),
            "height": freeze(np.array(height, dtype=np.float32)),
            "cell": as_number(self.cell, "cell", low=0.0, strict=True),
            "origin": as_numbers(self.origin, "origin", n=2),
            "T_world_map": freeze(T),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.cells.shape[0], self.cells.shape[1]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Least and greatest x, least and greatest y of the cells' outer sides, metres."""
        (x, y), (rows, columns), half = self.origin, self.shape, 0.5 * self.cell
        return x - half, x + columns * self.cell - half, y - half, y + rows * self.cell - half

    def rows_columns(self, xy: ArrayLike) -> AnyArray:
        """Return (row, column) of the cells that hold points (n, 2) of the map; they may lie outside it."""
        p = as_points(xy, "xy", dim=2)
        return np.floor((p - self.origin) / self.cell + 0.5).astype(np.int64)[:, ::-1]

    def centres(self, rows_columns: ArrayLike) -> Float64Array:
        """Return x and y of the centres of cells (row, column), of shape (n, 2) both."""
        cells = as_points(rows_columns, "rows_columns", dim=2)
        return np.asarray(cells[:, ::-1] * self.cell + self.origin)

    def in_world(self, xy: ArrayLike) -> Float64Array:
        """Return points (n, 2) of the map, put on its ground, in the world's frame; shape (n, 3), metres.

        Where the ground's height is unknown, the map's median height stands for it.
        """
        p = as_points(xy, "xy", dim=2)
        at = np.clip(self.rows_columns(p), 0, np.array(self.shape) - 1)
        z = self.height[at[:, 0], at[:, 1]].astype(np.float64)
        known = np.isfinite(self.height)
        usual = float(np.median(self.height[known])) if known.any() else 0.0
        return transform_points(self.T_world_map, np.column_stack([p, np.where(np.isfinite(z), z, usual)]))

    def save(self, path: str | Path) -> Path:
        """Write the map as an .npz file of its attributes, without pickle; replaced in one step.

        Raises
        ------
        FileAccessError
            If it cannot be written.
        """
        from seismo3d.io._files import as_path, written_aside

        final = as_path(path)
        with written_aside(final) as aside, aside.open("wb") as file:
            np.savez_compressed(
                file,
                cells=self.cells,
                height=self.height,
                cell=np.float64(self.cell),
                origin=np.array(self.origin, dtype=np.float64),
                T_world_map=self.T_world_map,
            )
        return final

    @classmethod
    def load(cls, path: str | Path) -> Occupancy:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileAccessError
            If the file cannot be read.
        FormatError
            If it is not such a file.
        """
        held = read_npz(path, _ARRAYS)
        cells, height, cell, origin, T = (held[name] for name in _ARRAYS)
        try:
            return cls(cells, height, float(cell), (float(origin[0]), float(origin[1])), T)
        except (ShapeError, ParameterError, ValueError, TypeError, IndexError) as error:
            raise FormatError(f"{Path(path).name} is not an occupancy map: {error}") from error
