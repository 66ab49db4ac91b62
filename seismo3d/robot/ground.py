"""From the mapped surface to maps from above: which way is up, where the ground lies, what stands on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array, Int64Array
from seismo3d._validate import as_number
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.robot.mesh import Mesh
from seismo3d.robot.occupancy import FREE, OCCUPIED, UNKNOWN, Occupancy

_FACING_UP = 0.64
"""Cosine of the steepest surface that counts as ground: 50 degrees."""
_UPRIGHT = 0.34
"""Cosine of the largest angle between the first camera's upward axis and up: 70 degrees."""
_LEAST_GROUND = 0.005
"""Share of all surface that ground has at least: what noise has turned upwards has less."""
_AROUND = 4
"""Cells around one whose ground is not known, of which the lowest stands for it."""
UPWARD = (0.0, -1.0, 0.0)
"""Up of a camera that is held upright, in its own axes: right, down, ahead."""
MOST_CELLS = 100_000_000
"""Cells of the largest map from above."""


@dataclass(frozen=True, slots=True, eq=False)
class Facets:
    """Triangles of the surface in map axes: x right, y forward, z up, seen from the first camera.

    Attributes
    ----------
    centres : ndarray of shape (n, 3), float64
    upward : ndarray of shape (n,), float64
        Third component of the unit normal.
    T_world_map : ndarray of shape (4, 4), float64
    """

    centres: Float64Array
    upward: Float64Array
    T_world_map: Float64Array


def find_upright(mesh: Mesh, *, up: ArrayLike = UPWARD) -> Facets:
    """Turn a mesh upright.

    Up is where most of the surface faces among all directions within 70 degrees of the first camera's upward axis; that
    axis itself where hardly any does.

    Parameters
    ----------
    mesh : Mesh
        In the first camera's frame.
    up : array_like of shape (3,)
        The first camera's upward axis, nearly, in its own axes: (0, 1, 0) where it hangs upside down.

    Returns
    -------
    Facets

    Raises
    ------
    GeometryError
        If the mesh is empty.
    ParameterError
        If ``up`` is no direction.
    """
    start = as_up(up)
    if len(mesh.triangles) == 0:
        raise GeometryError("the map holds no surface; expected one. Add frames with depth first.")
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(area, 1e-30)[:, None]
    z = _mode_of(normal, area, start)
    forward = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.95 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, z)
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([right, np.cross(z, right), z])
    return Facets((a + b + c) / 3.0 @ T[:3, :3], normal @ z, T)


def as_up(up: ArrayLike) -> Float64Array:
    """Return a direction as a unit vector, or refuse it."""
    try:
        direction = np.asarray(up, dtype=np.float64)
    except (TypeError, ValueError):
        direction = np.empty(0)
    length = float(np.linalg.norm(direction)) if direction.shape == (3,) else 0.0
    if not 0.0 < length < np.inf:
        raise ParameterError(
            f"up is {up!r}; expected three numbers that are not all zero: up in the first camera's axes (right, down, "
            "ahead), 0, -1, 0 where it is held upright."
        )
    return np.asarray(direction / length)


def make_occupancy(
    mesh: Mesh, *, cell: float = 0.05, clearance: float = 1.5, step: float = 0.12, up: ArrayLike = UPWARD
) -> Occupancy:
    """Return which cells, seen from above, are free, occupied or unknown.

    A cell's ground is the lowest surface in it that faces up. It is occupied where surface lies above the ground around
    it by more than ``step`` and less than ``clearance``, and is not the cell's own ground; free where only ground is;
    unknown where no surface was seen.

    Parameters
    ----------
    mesh : Mesh
    cell : float
        Side of a cell, metres.
    clearance, step : float
        Metres.
    up : array_like of shape (3,)
        As for :func:`find_upright`.

    Returns
    -------
    Occupancy
    """
    as_number(cell, "cell", low=0.0, strict=True)
    facets = find_upright(mesh, up=up)
    place, origin, shape = _cells_of(facets.centres, cell)
    z = facets.centres[:, 2]
    ground = _lowest(place, z, facets.upward, shape, 0.5 * cell)
    standing = z[facets.upward > -_FACING_UP]
    around = _least_around(ground, np.quantile(standing, 0.01) if standing.size else -np.inf)
    above = z - around.ravel()[place]
    own = z < ground.ravel()[place] + step
    blocked = (above > step) & (above < clearance) & ~own
    # a surface without ground under it stands on the ground beside it
    alone = ~np.isfinite(ground.ravel()[place]) & (above < clearance)
    cells = np.full(shape[0] * shape[1], UNKNOWN, dtype=np.uint8)
    cells[np.isfinite(ground).ravel()] = FREE
    many = np.bincount(place[blocked | alone], minlength=cells.size) >= 2
    cells[many] = OCCUPIED
    return Occupancy(cells.reshape(shape), ground.astype(np.float32), cell, origin, facets.T_world_map)


def make_ground(mesh: Mesh, *, cell: float = 0.05, up: ArrayLike = UPWARD) -> Any:
    """Return the mapped ground as an elevation map.

    Parameters
    ----------
    mesh : Mesh
    cell : float
        Side of a cell, metres.
    up : array_like of shape (3,)
        As for :func:`find_upright`.

    Returns
    -------
    DataArray
        As :func:`seismo3d.io.elevation.read_elevation` gives it: rows from far to near; x to the right of the first
        camera, y forward and elevation above it, metres. NaN where no ground was seen. ``attrs["T_world_map"]`` carries
        (x, y, elevation) to the world's frame.
    """
    from seismo3d.io.elevation import make_elevation

    as_number(cell, "cell", low=0.0, strict=True)
    facets = find_upright(mesh, up=up)
    place, (x, y), shape = _cells_of(facets.centres, cell)
    ground = _lowest(place, facets.centres[:, 2], facets.upward, shape, 0.5 * cell)
    transform = (cell, 0.0, x - 0.5 * cell, 0.0, -cell, y + (shape[0] - 0.5) * cell)
    made = make_elevation(ground[::-1], transform)
    made.attrs["T_world_map"] = facets.T_world_map
    return made


def _mode_of(normal: Float64Array, area: Float64Array, start: Float64Array) -> Float64Array:
    """Direction that most of the surface faces, within reach of ``start``: the best of many, then the mean around it.

    The mean may lead away from up: what noise has turned upwards of a wall leads to the wall. Such parts are left out.
    """
    fair = normal @ start > _UPRIGHT
    while fair.any():
        n, w = normal[fair], area[fair]
        tried = n[:: max(1, len(n) // 300)]
        up = best = tried[int(np.argmax(((tried @ n.T) > 0.97) @ w))]
        for _ in range(10):
            near = normal @ up > 0.94
            up = (normal[near] * area[near, None]).sum(axis=0)
            up /= np.linalg.norm(up)
        if up @ start > _UPRIGHT and area[normal @ up > 0.94].sum() > _LEAST_GROUND * area.sum():
            return np.asarray(up)
        fair &= normal @ best < 0.94
    return start


def _cells_of(points: Float64Array, cell: float) -> tuple[Int64Array, tuple[float, float], tuple[int, int]]:
    """Flat cell number of each point, centre of the first cell, rows and columns."""
    index = np.floor(points[:, :2] / cell + 0.5).astype(np.int64)
    low, high = index.min(axis=0), index.max(axis=0)
    columns, rows = (int(v) for v in high - low + 1)
    if columns * rows > MOST_CELLS:
        across, along = columns * cell, rows * cell
        raise ParameterError(
            f"cell is {cell:g} m and the map {across:.3g} by {along:.3g} m, {columns * rows:.2g} cells; expected at "
            f"most {MOST_CELLS:.0e}. Choose a larger cell."
        )
    place = (index[:, 1] - low[1]) * columns + index[:, 0] - low[0]
    return place, (float(low[0] * cell), float(low[1] * cell)), (rows, columns)


def _lowest(
    place: Int64Array, z: Float64Array, upward: Float64Array, shape: tuple[int, int], span: float
) -> Float64Array:
    """Mean height of the lowest surface that faces up in each cell, NaN where there is none."""
    size = shape[0] * shape[1]
    facing = upward > _FACING_UP
    least = np.full(size, np.inf)
    np.minimum.at(least, place[facing], z[facing])
    part = facing & (z < least[place] + span)
    count = np.bincount(place[part], minlength=size)
    total = np.bincount(place[part], z[part], minlength=size)
    return np.where(count >= 2, total / np.maximum(count, 1), np.nan).reshape(shape)


def _least_around(ground: Float64Array, least: float) -> Float64Array:
    """Lowest ground within some cells; the lowest of all where none is near, and ``least`` where there is none."""
    from scipy.ndimage import minimum_filter

    filled = np.where(np.isfinite(ground), ground, np.inf)
    around = minimum_filter(filled, size=2 * _AROUND + 1, mode="nearest")
    known = ground[np.isfinite(ground)]
    return np.where(np.isfinite(around), around, known.min() if known.size else least)
