"""Traced faults beside an interpreter's sticks: how far apart, what was missed, what is new."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d._validate import as_number, check_list
from seismo3d.errors import GeometryError
from seismo3d.geometry.triangles import weigh_vertices
from seismo3d.io.fault_sticks import FaultStick
from seismo3d.seismic.cube_checks import placing_cube
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.picks import finite_percentile, place_stick

# more than half of a picked fault, or of a traced one, decides
_HALF = 0.5


@dataclass(frozen=True, slots=True)
class PickedFault:
    """One fault of the interpreter, and what was traced there.

    Attributes
    ----------
    name : str
        Its name.
    n_sticks : int
        Number of its sticks.
    median, p90 : float
        Distance from its sticks to the nearest traced surface, in traces and samples; NaN where nothing was traced.
    within : float
        Share of its sticks' length within the tolerance of a traced surface.
    traced_as : int
        Label of the surface that is nearest to most of that share; 0 where the fault was missed.
    """

    name: str
    n_sticks: int
    median: float
    p90: float
    within: float
    traced_as: int


@dataclass(frozen=True, slots=True)
class StickScore:
    """Traced faults against picked sticks.

    Attributes
    ----------
    tolerance : float
        Distance in traces and samples up to which both agree.
    median, p90, within : float
        Distance from the sticks to the nearest surface, and the share of the sticks' length within the tolerance.
    faults : tuple of PickedFault
        One a picked fault.
    missed : tuple of str
        Picked faults of which less than half lies within the tolerance of a surface.
    new : tuple of int
        Labels of surfaces of which less than half lies within the tolerance of a picked fault.
    confirmed : float
        Share of the area of all surfaces that lies within the tolerance of a picked fault.
    outside : float
        Share of the sticks' nodes that lie outside the cube, and do not count.
    elsewhere : tuple of str
        Picked faults of which nothing lies in the cube: they are neither in `faults` nor missed.
    """

    tolerance: float
    median: float
    p90: float
    within: float
    faults: tuple[PickedFault, ...]
    missed: tuple[str, ...]
    new: tuple[int, ...]
    confirmed: float
    outside: float
    elsewhere: tuple[str, ...]


def score_sticks(
    faults: FaultSet, sticks: Sequence[FaultStick], *, cube: Any = None, tolerance: float = 3.0
) -> StickScore:
    """Score traced faults against picked fault sticks.

    Sticks are compared at every voxel of their length. For what is new, the surface between neighbouring sticks of one
    fault counts as picked, so that sticks may lie far apart.

    Parameters
    ----------
    faults : FaultSet
        Faults of a cube.
    sticks : sequence of FaultStick
        From :func:`seismo3d.io.fault_sticks.read_sticks`.
    cube : DataArray, optional
        The cube, for its coordinates. [default: those of ``faults.labels``]
    tolerance : float
        Distance up to which both agree, in traces and samples.

    Returns
    -------
    StickScore

    Raises
    ------
    ShapeError
        If the faults are of a section or another cube.
    GeometryError
        If no stick lies in the cube, or the cube lies elsewhere than the faults.
    ParameterError
        If `faults` is no FaultSet, or `sticks` no list of sticks.
    """
    home = placing_cube(cube, faults)
    check_list(sticks, "sticks", FaultStick)
    limit = as_number(tolerance, "tolerance", low=0.0)
    shape = np.array(np.shape(faults.labels))
    placed = {id(stick): place_stick(stick, home) for stick in sticks}
    nodes = np.concatenate(list(placed.values())) if placed else np.zeros((0, 3))
    outside = 1.0 - float(_inside(nodes, shape).mean()) if len(nodes) else 1.0
    names = list(dict.fromkeys(stick.fault for stick in sticks))
    lines = {name: [_dense_in(placed[id(stick)], shape) for stick in sticks if stick.fault == name] for name in names}
    lines = {name: parts for name, parts in lines.items() if sum(map(len, parts))}
    if not lines:
        raise GeometryError(
            "no stick lies in the cube; expected places, and times or depths, in its own coordinates and unit. Check "
            "the export's coordinate system."
        )
    places = _surface_places(faults)
    rows, distances = [], []
    for name, parts in lines.items():
        distance, label = _nearest(np.concatenate(parts), places)
        rows.append(_picked(name, len(parts), distance, label, limit))
        distances.append(distance)
    picked = np.concatenate([_between(parts) for parts in lines.values()])
    near = _shares_near(faults, picked, limit)
    area = np.array([surface.area for surface in faults.surfaces])
    every = np.concatenate(distances)
    return StickScore(
        limit, *_median_and_p90(every), float((every <= limit).mean()), tuple(rows),
        tuple(row.name for row in rows if row.within < _HALF),
        tuple(label for label, share in enumerate(near, start=1) if share < _HALF),
        float(np.average(near, weights=area)) if len(near) else float("nan"), outside,
        tuple(name for name in names if name not in lines),
    )  # fmt: skip


def _inside(points: Float64Array, shape: Any) -> BoolArray:
    return np.asarray(((points > -0.5) & (points < shape - 0.5)).all(axis=1))


def _dense_in(nodes: Float64Array, shape: Any) -> Float64Array:
    """Points along a polyline, no more than a voxel apart, where it lies in a cube; its nodes may lie anywhere."""
    if len(nodes) < 2:
        return nodes[_inside(nodes, shape)]
    chains: list[list[Float64Array]] = []
    for first, last in pairwise(nodes):
        ends = _clipped(first, last, shape)
        if ends is None:
            continue
        if chains and np.array_equal(chains[-1][-1], ends[0]):
            chains[-1].append(ends[1])
        else:
            chains.append([*ends])
    points = np.concatenate([np.zeros((0, 3)), *(_dense(np.stack(chain)) for chain in chains)])
    return points[_inside(points, shape)]


def _clipped(first: Float64Array, last: Float64Array, shape: Any) -> tuple[Float64Array, Float64Array] | None:
    """Return the ends of the part of a segment that lies in a cube; None where it misses the cube."""
    level = last == first
    if (level & ((first <= -0.5) | (first >= shape - 0.5))).any():
        return None
    way = np.where(level, 1.0, last - first)
    crossed = np.stack([-0.5 - first, shape - 0.5 - first]) / way
    enter = max(0.0, float(np.where(level, 0.0, crossed.min(axis=0)).max()))
    leave = min(1.0, float(np.where(level, 1.0, crossed.max(axis=0)).min()))
    if enter > leave:
        return None
    return first + enter * (last - first), last if leave == 1.0 else first + leave * (last - first)


def _dense(nodes: Float64Array, step: float = 1.0) -> Float64Array:
    """Points along a polyline, no more than a step apart."""
    if len(nodes) < 2:
        return nodes
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1)))
    at = np.linspace(0.0, length[-1], max(2, int(np.ceil(length[-1] / step)) + 1))
    return np.column_stack([np.interp(at, length, column) for column in nodes.T])


def _between(parts: list[Float64Array]) -> Float64Array:
    """Points of the surface between neighbouring sticks of one fault, in the order of their middles along it."""
    parts = [part for part in parts if len(part)]
    middles = np.array([part.mean(axis=0)[:2] for part in parts])
    spread = middles - middles.mean(axis=0)
    along = np.linalg.svd(spread, full_matrices=False)[2][0] if len(parts) > 1 else np.zeros(2)
    order = np.argsort(spread @ along, kind="stable")
    points = list(parts)
    share = np.linspace(0.0, 1.0, 64)
    for a, b in pairwise(order):
        first, second = (
            np.column_stack([np.interp(share, np.linspace(0, 1, len(part)), column) for column in part.T])
            for part in (parts[a], parts[b])
        )
        gap = float(np.linalg.norm(second - first, axis=1).max())
        points += [first + t * (second - first) for t in np.linspace(0, 1, int(np.ceil(gap)) + 1)[1:-1]]
    return np.concatenate(points)


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Vertices and middles of the triangles of all surfaces, with their normals and labels."""

    points: Float64Array
    normals: Float64Array
    labels: IntArray


def _surface_places(faults: FaultSet) -> _Places:
    points, normals, labels = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0, np.int64)]
    for label, surface in enumerate(faults.surfaces, start=1):
        for values, parts in ((surface.vertices, points), (surface.normals, normals)):
            nodes = values.astype(np.float64)
            parts += [nodes, nodes[surface.cells].mean(axis=1)]
        labels.append(np.full(len(surface.vertices) + len(surface.cells), label))
    flat = np.concatenate(normals)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    return _Places(np.concatenate(points), flat, np.concatenate(labels))


def _nearest(at: Float64Array, places: _Places) -> tuple[Float64Array, IntArray]:
    """Distance to the nearest surface, and its label; surfaces are level for one voxel around each place of them."""
    if not len(places.points):
        return np.full(len(at), np.inf), np.zeros(len(at), np.int64)
    distance, near = cKDTree(places.points).query(at)
    off = np.abs(((at - places.points[near]) * places.normals[near]).sum(axis=1))
    aside = np.sqrt(np.maximum(np.asarray(distance) ** 2 - off**2, 0.0))
    return np.hypot(off, np.maximum(aside - 1.0, 0.0)), places.labels[near]


def _picked(name: str, n_sticks: int, distance: Float64Array, label: IntArray, limit: float) -> PickedFault:
    near = distance <= limit
    share = float(near.mean())
    traced = int(np.bincount(label[near]).argmax()) if share >= _HALF else 0
    return PickedFault(name, n_sticks, *_median_and_p90(distance), share, traced)


def _median_and_p90(distance: Float64Array) -> tuple[float, float]:
    return finite_percentile(distance, 50.0), finite_percentile(distance, 90.0)


def _shares_near(faults: FaultSet, picked: Float64Array, limit: float) -> Float64Array:
    """Share of the area of each surface within the limit of what was picked."""
    tree = cKDTree(picked)
    shares = []
    for surface in faults.surfaces:
        vertices = surface.vertices.astype(np.float64)
        near = np.isfinite(tree.query(vertices, distance_upper_bound=limit + 1e-9)[0])
        shares.append(float(np.average(near, weights=weigh_vertices(vertices, surface.cells))))
    return np.array(shares)
