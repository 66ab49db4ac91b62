"""Where the cells of an elevation map lie: array indices <-> map coordinates.

Frame and sign conventions, here once for the whole terrain side:

- Arrays are [row, column]; places in them are (column, row), fractional, whole numbers at the cells' centres.
- Map coordinates are (x, y) in the reference system's own units, mostly metres east and north; elevations in metres.
- ``transform`` holds six numbers (a, b, c, d, e, f) as in GDAL's geotransform, reordered by row:
  ``x = a u + b v + c`` and ``y = d u + e v + f``, where (u, v) is (column, row) counted from the *corner* of the first
  cell, so that its centre is (0.5, 0.5).
- Azimuths are degrees clockwise from north, which is the direction of growing y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import as_array, as_points, as_real_array, freeze, told
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry.reference_systems import WEB_MERCATOR, same_system, short_name, unit_of

METRES_PER_DEGREE = 111_195.0
"""Length of a degree on the sphere of the Earth's mean radius."""
MERCATOR_RADIUS = 6_378_137.0
"""Of the sphere that web maps are drawn from, metres."""


@dataclass(frozen=True, slots=True)
class MapGrid:
    """Shape, place and reference system of an elevation map.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns.
    transform : tuple of six floats
        As above.
    crs : str
        Reference system, as an authority's code ("EPSG:32611") or well-known text; empty where it is not known.
    unit : str
        "metre", "degree", or "cell" where the map has no georeference.
    """

    shape: tuple[int, int]
    transform: tuple[float, float, float, float, float, float]
    crs: str = ""
    unit: str = "cell"

    @classmethod
    def from_elevation(cls, elevation: Any) -> MapGrid:
        """Return the grid of a DataArray as ``read_elevation`` gives it, or of a bare array, whose unit is a cell."""
        shape = np.shape(elevation if hasattr(elevation, "shape") else as_array(elevation, "elevation"))
        if len(shape) != 2:
            raise ShapeError(f"elevation has shape {shape}; expected (rows, columns).")
        attrs = getattr(elevation, "attrs", {})
        rows, columns = int(shape[0]), int(shape[1])
        if "transform" in attrs:
            crs = str(attrs.get("crs") or "")
            unit = str(attrs.get("crs_unit") or unit_of(crs, "elevation"))
            return cls((rows, columns), as_six(attrs["transform"]), crs, unit)
        return cls((rows, columns), (1.0, 0.0, -0.5, 0.0, 1.0, -0.5))

    @property
    def has_place(self) -> bool:
        """Whether the map says where it lies."""
        return self.unit != "cell"

    @property
    def matrix(self) -> Float64Array:
        """Columns: the steps in map units to the next column and to the next row."""
        a, b, _, d, e, _ = self.transform
        return np.array([[a, b], [d, e]])

    @property
    def metres_per_unit(self) -> tuple[float, float]:
        """Metres on the ground in a unit of x and of y at the map's middle; 1 where the unit is a cell."""
        if self.unit != "degree" and self.crs.upper() != WEB_MERCATOR:
            return 1.0, 1.0
        middle = self.to_map([[0.5 * (self.shape[1] - 1), 0.5 * (self.shape[0] - 1)]])[0]
        if self.unit != "degree":
            shrunk = 1.0 / float(np.cosh(middle[1] / MERCATOR_RADIUS))
            return shrunk, shrunk
        return METRES_PER_DEGREE * float(np.cos(np.radians(middle[1]))), METRES_PER_DEGREE

    @property
    def steps_m(self) -> Float64Array:
        """As :attr:`matrix`, in metres (cells where the map has no georeference)."""
        return np.diag(self.metres_per_unit) @ self.matrix

    @property
    def cell_m(self) -> float:
        """Side in metres of a square of a cell's area."""
        return float(np.sqrt(abs(np.linalg.det(self.steps_m))))

    def to_map(self, places: ArrayLike) -> Float64Array:
        """Carry places (column, row) of shape (n, 2) to map coordinates (x, y)."""
        p = as_points(places, "places", dim=2, finite=False)
        _, _, c, _, _, f = self.transform
        return np.asarray((p + 0.5) @ self.matrix.T + np.array([c, f]))

    def to_places(self, points: ArrayLike) -> Float64Array:
        """Carry map coordinates (x, y) of shape (n, 2) to places (column, row)."""
        p = as_points(points, "points", dim=2, finite=False)
        _, _, c, _, _, f = self.transform
        return np.asarray(np.linalg.solve(self.matrix, (p - np.array([c, f])).T).T - 0.5)

    def reduced(self, factor: int) -> MapGrid:
        """Return the grid whose cells are blocks of ``factor`` x ``factor`` cells; incomplete blocks are left out."""
        a, b, c, d, e, f = self.transform
        rows, columns = self.shape
        transform = (a * factor, b * factor, c, d * factor, e * factor, f)
        return MapGrid((rows // factor, columns // factor), transform, self.crs, self.unit)


def as_six(transform: Any) -> tuple[float, float, float, float, float, float]:
    """Return a transform as six numbers, or refuse one that has another length or no area."""
    try:
        numbers = [float(value) for value in (transform if isinstance(transform, Sequence) else list(transform))][:6]
    except (TypeError, ValueError) as error:
        raise ParameterError(f"transform is {told(transform)}; expected six numbers (a, b, c, d, e, f).") from error
    if len(numbers) != 6 or not np.isfinite(numbers).all() or numbers[0] * numbers[4] == numbers[1] * numbers[3]:
        raise ParameterError(f"transform is {numbers}; expected six finite numbers whose cells have an area.")
    a, b, c, d, e, f = numbers
    return a, b, c, d, e, f


def elevation_values(elevation: Any, name: str = "elevation", *, least: int = 8) -> Float64Array:
    """Return elevations as float64 with NaN where there is none, or refuse a map that cannot be worked on.

    Raises
    ------
    ShapeError
        If it has other than two axes, or fewer rows or columns than ``least``.
    GeometryError
        If it holds no elevation at all.
    """
    values = np.asarray(as_real_array(getattr(elevation, "values", elevation), name, ndim=2), dtype=np.float64)
    if min(values.shape) < least:
        raise ShapeError(f"{name} has shape {values.shape}; expected at least {least} rows and columns.")
    attrs = getattr(elevation, "attrs", {})
    nodata = attrs.get("nodata")
    bad = ~np.isfinite(values)
    if nodata is not None and np.isfinite(nodata):
        bad |= values == nodata
    if bad.all():
        raise GeometryError(f"{name} holds no elevation: every cell is nodata. Give a map with data.")
    return np.where(bad, np.nan, values)


def refuse_other_systems(first: MapGrid, second: MapGrid, names: tuple[str, str]) -> None:
    """Refuse two maps of which only one says where it lies, or that lie in different reference systems."""
    if first.has_place != second.has_place:
        lacking, other = names if not first.has_place else names[::-1]
        raise GeometryError(
            f"{lacking} has no georeference and {other} has one; expected both or neither. "
            "Give both a transform, or pass bare arrays."
        )
    if first.crs and second.crs and not same_system(first.crs, second.crs):
        raise GeometryError(
            f"{names[0]} is in {short_name(first.crs)} and {names[1]} in {short_name(second.crs)}; expected one "
            "reference system. Reproject one of them first."
        )


def refuse_apart(first: MapGrid, second: MapGrid, names: tuple[str, str]) -> None:
    """Refuse two maps with a georeference whose extents do not meet."""
    if not (first.has_place and second.has_place):
        return
    low, high = zip(*(_extent(grid) for grid in (first, second)), strict=True)
    if (np.minimum(*high) > np.maximum(*low)).all():
        return
    said = [
        f"{name} covers x {a[0]:.10g} to {b[0]:.10g}, y {a[1]:.10g} to {b[1]:.10g}"
        for name, a, b in zip(names, low, high, strict=True)
    ]
    raise GeometryError(
        f"{names[0]} and {names[1]} have no common area: {said[0]}; {said[1]}. Check their georeference, or pass bare "
        "arrays to align them by their relief alone."
    )


def _extent(grid: MapGrid) -> tuple[Float64Array, Float64Array]:
    rows, columns = grid.shape
    corners = [[x, y] for x in (-0.5, columns - 0.5) for y in (-0.5, rows - 0.5)]
    points = grid.to_map(corners)
    return points.min(axis=0), points.max(axis=0)


def like_map(elevation: Any, values: AnyArray, name: str, *, nodata: float | None = None) -> Any:
    """Return values on the cells of a map in its form: with its place where it is a DataArray, else read-only."""
    if not hasattr(elevation, "dims"):
        return freeze(values)
    made = elevation.copy(data=values).rename(name)
    made.attrs = {**elevation.attrs, "nodata": nodata}
    return made
