"""What every surface writer takes: a named mesh in map coordinates with properties at its vertices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import ShapeError


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceMesh:
    """A triangulated surface, or a polyline, ready to be written.

    Attributes
    ----------
    name : str
        What the surface is called; blanks become underscores in formats that split at them.
    points : ndarray of shape (n, 3), float64
        x, y, z; z is time or depth and grows downwards.
    cells : ndarray of shape (m, 3) or (m, 2), int
        Triangles, or segments, as rows of point numbers.
    properties : mapping of str to ndarray of shape (n,)
        Values at the points; NaN where not known.
    """

    name: str
    points: AnyArray
    cells: AnyArray
    properties: Mapping[str, AnyArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        points, cells = np.asarray(self.points), np.asarray(self.cells)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ShapeError(f"points of {self.name} have shape {points.shape}; expected (n, 3). Give x, y, z a row.")
        if cells.ndim != 2 or cells.shape[1] not in (2, 3):
            raise ShapeError(f"cells of {self.name} have shape {cells.shape}; expected (m, 2) or (m, 3).")
        if cells.size and (cells.min() < 0 or cells.max() >= len(points)):
            raise ShapeError(
                f"cells of {self.name} name points {cells.min()} to {cells.max()}; there are {len(points)}. "
                "Number the points from 0."
            )
        for name, values in self.properties.items():
            if np.shape(values) != (len(points),):
                raise ShapeError(
                    f"property {name} of {self.name} has shape {np.shape(values)}; expected ({len(points)},)."
                )
