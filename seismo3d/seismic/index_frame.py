"""What one step along each axis of a cube is worth: lengths where the cube is in depth on a map, else one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float64Array
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.geometry.triangles import measure_cells


@dataclass(frozen=True, slots=True, eq=False)
class IndexFrame:
    """Linear map from index steps to lengths.

    Attributes
    ----------
    matrix : ndarray of shape (3, 3), float64
        Carries (inline, crossline, sample) steps to (east, north, down) in ``unit``; the identity where the cube is not
        in depth or not on a map, because milliseconds and metres make no length together.
    unit : {"m", "ft", "bin"}
        What lengths are in: the unit of the map; a bin is a trace sideways and a sample down.
    """

    matrix: Float64Array
    unit: str

    @classmethod
    def of(cls, cube: Any) -> IndexFrame:
        """Return the frame of a cube: a DataArray as ``open_cube`` gives it, or a bare array of three axes."""
        return cls.of_survey(SurveyGeometry.from_cube(cube))

    @classmethod
    def of_survey(cls, geometry: SurveyGeometry) -> IndexFrame:
        """Return the frame of a cube that lies there."""
        if geometry.map_fit is None or geometry.depth_scale is None:
            return cls(np.eye(3), "bin")
        matrix = np.zeros((3, 3))
        matrix[:2, :2], matrix[2, 2] = geometry.map_fit.matrix, geometry.depth_scale * geometry.sample.step
        return cls(matrix, geometry.length_unit)

    @property
    def steps(self) -> tuple[float, float, float]:
        """Lengths of one step along each axis."""
        lengths = np.linalg.norm(self.matrix, axis=0)
        return float(lengths[0]), float(lengths[1]), float(lengths[2])

    @property
    def voxel(self) -> float:
        """Volume of a voxel."""
        return float(abs(np.linalg.det(self.matrix)))

    def carry(self, points: AnyArray) -> Float64Array:
        """Positions or steps, of shape (n, 3), in lengths."""
        return np.asarray(points, dtype=np.float64) @ self.matrix.T

    def normals(self, normals: AnyArray) -> Float64Array:
        """Return unit normals of planes that have these normals in index steps, by the inverse transpose: (n, 3)."""
        turned = np.linalg.solve(self.matrix.T, np.asarray(normals, dtype=np.float64).T).T
        return np.asarray(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30))

    def areas(self, vertices: AnyArray, cells: AnyArray) -> Float64Array:
        """Area of each triangle of a mesh in index coordinates."""
        return measure_cells(self.carry(vertices), cells)


def settle_places(places: AnyArray, shape: tuple[int, ...]) -> tuple[AnyArray, BoolArray]:
    """Clip places to a cube's outer traces and samples, and tell which lay in it, half a step beyond these included.

    Parameters
    ----------
    places : ndarray of shape (3, ...)
        Fractional indices.
    shape : tuple of int
        The cube's.

    Returns
    -------
    places : ndarray of the same shape
        Within the outer traces and samples, those outside the cube too.
    inside : ndarray of shape (...), bool
        Whether a place lies in some trace's cell, which reaches half a step to either side of it.
    """
    last = (np.array(shape, dtype=places.dtype) - 1).reshape(-1, *(1,) * (places.ndim - 1))
    settled = np.clip(places, 0, last)
    return settled, np.asarray((np.abs(places - settled) <= 0.5).all(axis=0))
