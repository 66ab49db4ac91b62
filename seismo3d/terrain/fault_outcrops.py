"""Where a cube's faults come to the surface: each carried up its dip to the terrain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_number, freeze
from seismo3d.errors import GeometryError
from seismo3d.geometry.axis import METRES
from seismo3d.geometry.map_grid import MapGrid, elevation_values
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.terrain._kernels_align import bilinear

_LEAST_DIP_DEG = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class Outcrop:
    """The line along which a fault would come to the surface.

    Attributes
    ----------
    surface : int
        Number of the fault's surface, from 0.
    points : ndarray of shape (n, 3), float64
        Map x, y and elevation, along strike.
    distance : ndarray of shape (n,), float64
        Up the dip, from the fault's upper edge to each point, in metres: how far it is extrapolated.
    """

    surface: int
    points: Float64Array
    distance: Float64Array


def outcrops(
    faults: Any, cube: Any, elevation: Any, *, datum: float = 0.0, velocity: float | None = None
) -> tuple[Outcrop, ...]:
    """Carry every fault of a cube up its dip to the terrain.

    The upper edge of a surface is followed along strike; from each place the plane of the surface's upper part is
    continued upwards until it meets the terrain.

    Parameters
    ----------
    faults : FaultSet
        Of `cube`: ``surfaces`` with ``vertices`` in fractional index coordinates.
    cube : DataArray
        With map coordinates in the terrain's reference system, in metres.
    elevation : DataArray
        Terrain with a georeference.
    datum : float
        Elevation at which the cube's depth or time is zero, in metres.
    velocity : float, optional
        Metres a second, for a cube in time: depth is half of it times the two-way time.

    Returns
    -------
    tuple of Outcrop
        Of the surfaces that reach the terrain on the map; those that dip less than 20 degrees are left out.

    Raises
    ------
    GeometryError
        If the cube has no map coordinates in metres, the terrain no georeference in metres, the cube is in time and no
        velocity is given, or the cube lies off the terrain.
    """
    survey, grid = SurveyGeometry.from_cube(cube), MapGrid.from_elevation(elevation)
    if not survey.has_map:
        raise GeometryError(
            "cube has no map coordinates (cdp_x, cdp_y); expected them, to place its faults on the map."
        )
    if grid.unit != "metre":
        raise GeometryError(
            f"elevation's map unit is the {grid.unit}; expected a georeference in metres, as the cube's. Reproject it."
        )
    if survey.length_unit != "m":
        raise GeometryError(
            f"cube's map coordinates are in {survey.length_unit}; expected metres, as the elevation's. Project them."
        )
    scale = _metres_per_unit(survey.unit, velocity)
    z = elevation_values(elevation)
    n0, n1 = np.shape(cube)[:2]
    corners = survey.index_to_map([[i, j, 0.0] for i in (0, n0 - 1) for j in (0, n1 - 1)])[:, :2]
    places = grid.to_places(corners)
    if (places.max(axis=0) < 0).any() or (places.min(axis=0) > np.array(grid.shape[::-1]) - 1).any():
        raise GeometryError("the cube lies off the terrain map; expected a common area. Check their reference systems.")
    out = []
    for number, surface in enumerate(faults.surfaces):
        points = survey.index_to_map(np.asarray(surface.vertices, np.float64))
        points[:, 2] = datum - scale * points[:, 2]
        made = _outcrop(number, points, z, grid)
        if made is not None:
            out.append(made)
    return tuple(out)


def _metres_per_unit(unit: str, velocity: float | None) -> float:
    if unit in METRES:
        return METRES[unit]
    if unit == "ms":
        if velocity is None:
            raise GeometryError("the cube is in time; expected a velocity in metres a second, to carry faults upwards.")
        return 0.5 * as_number(velocity, "velocity", low=0.0, strict=True) / 1000.0
    raise GeometryError(f"the cube's sample unit is {unit!r}; expected ms, m or ft. Give it a time or depth axis.")


def _outcrop(number: int, points: Float64Array, z: Float64Array, grid: MapGrid) -> Outcrop | None:
    upper = points[points[:, 2] >= np.quantile(points[:, 2], 0.5)]
    normal = np.linalg.svd(upper - upper.mean(axis=0), full_matrices=False)[2][2]
    flat = float(np.hypot(*normal[:2]))
    if flat < np.sin(np.radians(_LEAST_DIP_DEG)):
        return None
    strike = np.array([-normal[1], normal[0]]) / flat
    # up the dip: in the plane, and upwards
    up = np.array([-normal[0] * normal[2], -normal[1] * normal[2], flat * flat]) / flat
    edge = _upper_edge(points, strike, grid.cell_m)
    found, lengths = [], []
    for start in edge:
        length = _meet(start, up, z, grid)
        if np.isfinite(length):
            found.append(start + length * up)
            lengths.append(length)
    if len(found) < 2:
        return None
    return Outcrop(number, freeze(np.array(found)), freeze(np.array(lengths)))


def _upper_edge(points: Float64Array, strike: Float64Array, step: float) -> Float64Array:
    """Return the highest point in each step along strike."""
    s = points[:, :2] @ strike
    bins = np.floor((s - s.min()) / step).astype(np.int64)
    order = np.lexsort((-points[:, 2], bins))
    first = np.unique(bins[order], return_index=True)[1]
    return points[order[first]]


def _meet(start: Float64Array, up: Float64Array, z: Float64Array, grid: MapGrid) -> float:
    """Return how far up the dip a point meets the terrain; NaN where it leaves the map first."""
    length = 0.0
    top = float(np.nanmax(z))
    step = 0.5 * grid.cell_m
    before = np.nan
    while True:
        place = start + length * up
        u, v = grid.to_places(place[None, :2])[0]
        ground = bilinear(z, u, v)
        if not np.isfinite(ground):
            return float("nan")
        above = float(place[2] - ground)
        if above >= 0.0:
            # the crossing lies between the last two steps
            share = 0.0 if not np.isfinite(before) else above / (above - before)
            return length - share * step
        if place[2] > top:
            return float("nan")
        before = above
        length += step
