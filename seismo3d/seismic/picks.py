"""Existing interpretation on a cube: picks put on its traces, and horizons turned into seeds."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_kind, as_whole_number
from seismo3d.errors import GeometryError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.io.fault_sticks import FaultStick
from seismo3d.io.horizons import HorizonPoints


def place_horizon(horizon: HorizonPoints, cube: Any) -> Float64Array:
    """Carry the points of a horizon to fractional indices of a cube.

    Line numbers decide where the file has them; else x and y, which are taken for line numbers where the cube has no
    map coordinates.

    Parameters
    ----------
    horizon : HorizonPoints
        From :func:`seismo3d.io.horizons.read_horizon`.
    cube : DataArray or ndarray
        The cube.

    Returns
    -------
    ndarray of shape (n, 3), float64
        (inline, crossline, sample); points may lie outside the cube.
    """
    return _place(horizon.points, horizon.lines, cube)


def place_stick(stick: FaultStick, cube: Any) -> Float64Array:
    """Carry the nodes of a stick to fractional indices of a cube; as :func:`place_horizon`, but x and y decide.

    A stick's line numbers may be rounded, x and y are not: the lines decide only where the cube has no map.
    """
    geometry = SurveyGeometry.from_cube(cube)
    if geometry.has_map:
        return geometry.map_to_index(stick.points)
    return _place(stick.points, stick.lines, cube)


def _place(points: Float64Array, lines: Float64Array, cube: Any) -> Float64Array:
    geometry = SurveyGeometry.from_cube(cube)
    placed = geometry.map_to_index(points)
    told = np.isfinite(lines).all(axis=1)
    if told.any():
        placed[told] = geometry.lines_to_index(np.column_stack([lines[told], points[told, 2]]))
    return placed


def grid_horizon(horizon: HorizonPoints, cube: Any) -> Float64Array:
    """Put a horizon on the traces of a cube.

    Parameters
    ----------
    horizon : HorizonPoints
        From :func:`seismo3d.io.horizons.read_horizon`.
    cube : DataArray or ndarray
        The cube.

    Returns
    -------
    ndarray of shape (inline, crossline), float64
        Time or depth in the cube's own unit (sample index of a bare array): the mean of the points nearest to a trace;
        NaN where there is none.

    Raises
    ------
    GeometryError
        If no point lies on a trace of the cube, within its times or depths.
    """
    at = place_horizon(horizon, cube)
    shape = np.shape(cube)
    traces = np.rint(at[:, :2]).astype(np.int64)
    inside = (traces >= 0).all(axis=1) & (traces < shape[:2]).all(axis=1)
    inside &= (at[:, 2] > -0.5) & (at[:, 2] < shape[2] - 0.5)
    if not inside.any():
        raise GeometryError(
            f"no point of {horizon.name} lies in the cube; expected places, and times or depths, in its own "
            "coordinates and unit. Check the export's coordinate system."
        )
    number = np.ravel_multi_index(tuple(traces[inside].T), shape[:2])
    size = shape[0] * shape[1]
    count = np.bincount(number, minlength=size)
    total = np.bincount(number, weights=horizon.points[inside, 2], minlength=size)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(shape[:2])


def horizon_seeds(horizon: HorizonPoints, cube: Any, *, count: int = 25) -> Float64Array:
    """Choose points of a horizon, spread evenly over its area, as the seeds of one track.

    Parameters
    ----------
    horizon : HorizonPoints
        From :func:`seismo3d.io.horizons.read_horizon`.
    cube : DataArray or ndarray
        The cube; traces without data are passed over.
    count : int
        Most points to give.

    Returns
    -------
    ndarray of shape (n, 3), float64
        (inline, crossline, time or depth): an entry of the ``seeds`` of :func:`seismo3d.trace_tracks`.

    Raises
    ------
    GeometryError
        If no point lies on a live trace of the cube.

    Notes
    -----
    The first is the point nearest to the middle of them all; each further one lies farthest from those before it.
    """
    as_kind(horizon, HorizonPoints, "horizon", remedy="Give what read_horizon returned.")
    wanted = as_whole_number(count, "count", low=1)
    grid = grid_horizon(horizon, cube)
    known = np.isfinite(grid)
    if hasattr(cube, "coords") and "live" in cube.coords:
        known &= np.asarray(cube["live"].values, dtype=bool)
    places = np.argwhere(known).astype(np.float64)
    if not len(places):
        raise GeometryError(f"{horizon.name} lies on traces without data alone; expected some live ones.")
    distance = np.linalg.norm(places - places.mean(axis=0), axis=1)
    chosen = [int(distance.argmin())]
    apart = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < min(wanted, len(places)):
        chosen.append(int(apart.argmax()))
        apart = np.minimum(apart, np.linalg.norm(places - places[chosen[-1]], axis=1))
    at = places[chosen].astype(np.int64)
    geometry = SurveyGeometry.from_cube(cube)
    lines = geometry.inline.coordinate(at[:, 0]), geometry.crossline.coordinate(at[:, 1])
    return np.column_stack([*lines, grid[tuple(at.T)]])


def finite_percentile(values: Float64Array, percent: float) -> float:
    """Return a percentile of the finite ones of some distances; NaN where there is none."""
    finite = values[np.isfinite(values)]
    return float(np.percentile(finite, percent)) if len(finite) else float("nan")
