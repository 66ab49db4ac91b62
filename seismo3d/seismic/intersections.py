"""Where fault surfaces meet: the lines in which they cross or end at each other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from seismo3d._typing import AnyArray, BoolArray, Float64Array, Int64Array
from seismo3d._validate import freeze
from seismo3d.geometry.triangles import cut_mesh
from seismo3d.seismic.fault_links import SurfaceGrid, grid_surface
from seismo3d.seismic.faultset import FaultSurface
from seismo3d.seismic.index_frame import IndexFrame

# a surface goes through another where it has this share of its vertices on the thinner side
_THROUGH = 0.2
# vertices this close to the other surface are on neither side of it
_ON = 1.5
# planes are told at vertices this far off the line, in voxels: nearer to it a surface bridges what the other has parted
_OFF_LINE, _AROUND = 10.0, 30.0
# two that both end meet where the sine of the angle between them is more: 30 degrees
_ANGLED = 0.5
# points this close together, in voxels, are neighbours along a line: on a bridge it wavers to and fro within that
_NEIGHBOURS = 8.0
# more points than this are thinned before a line is measured
_MOST_POINTS = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Intersection:
    """The line in which two faults meet.

    Attributes
    ----------
    first, second : int
        Labels of the two, the smaller first.
    points : ndarray of shape (n, 3), float64
        Points of the line in index coordinates.
    segments : ndarray of shape (m, 2), int64
        Pairs of points.
    length : float
        Length of the line, in the unit of the network: from one end to the other, not to and fro where it wavers.
    angle_deg : float
        Mean angle between the two planes on either side of the line, 0 to 90.
    abutting : int
        Label of the one that ends at the other; 0 where they cross, or both end.
    kind : {"cross", "abut", "corner"}
        Both go on beyond the line, one does, or neither.
    """

    first: int
    second: int
    points: Float64Array
    segments: Int64Array
    length: float
    angle_deg: float
    abutting: int
    kind: str


@dataclass(frozen=True, slots=True, eq=False)
class _Meeting:
    """A surface prepared to be met: its grid, its vertices in a tree and how far apart these are, and its triangles.

    Triangles are in the plane of the grid, (m, 3, 2) along strike and down, with their centres in a tree.
    """

    surface: FaultSurface
    grid: SurfaceGrid
    tree: cKDTree
    spacing: float
    triangles: Float64Array
    centres: cKDTree


def find_intersections(
    surfaces: tuple[FaultSurface, ...], *, frame: IndexFrame, reach: int = 4
) -> tuple[Intersection, ...]:
    """Find the lines in which fault surfaces meet.

    A surface is a height field over its strike. The line is where the height of one above the other changes sign. Both
    are carried on by `reach` beyond their edges, so that a fault that was lost just before the one it ends at still
    meets it; two that both end meet where each has its edge within `reach` of the line and lies on one side of it. What
    else lies beyond the edges of both is left out.

    Parameters
    ----------
    surfaces : tuple of FaultSurface
        Faults of a cube.
    frame : IndexFrame
        In which lengths and angles are measured.
    reach : int
        Farthest gap, in traces or samples, over which two faults meet.

    Returns
    -------
    tuple of Intersection
        By first label, then second.
    """
    ready = [_prepare(surface, reach) for surface in surfaces]
    found = []
    for (a, one), (b, other) in combinations(enumerate(ready, start=1), 2):
        if _boxes_meet(one.surface, other.surface, reach):
            line = _meet(one, other, frame, reach)
            if line is not None:
                points, segments, length, angle = line
                through = _goes_through(one, other, points), _goes_through(other, one, points)
                kind = {2: "cross", 1: "abut", 0: "corner"}[sum(through)]
                abutting = (b if through[0] else a) if kind == "abut" else 0
                found.append(Intersection(a, b, freeze(points), freeze(segments), length, angle, abutting, kind))
    return tuple(found)


def _prepare(surface: FaultSurface, reach: int) -> _Meeting:
    vertices = surface.vertices.astype(np.float64)
    corners = vertices[surface.cells]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    grid = grid_surface(surface, beyond=reach)
    triangles = _flatten(grid, vertices)[surface.cells]
    centres = cKDTree(triangles.mean(axis=1))
    return _Meeting(surface, grid, cKDTree(vertices), float(np.median(longest)), triangles, centres)


def _flatten(grid: SurfaceGrid, points: AnyArray) -> Float64Array:
    """Place along strike, and sample, of points of shape (n, 3)."""
    along = np.array([-grid.across[1], grid.across[0]])
    return np.column_stack([points[:, :2] @ along, points[:, 2]])


def _boxes_meet(one: FaultSurface, other: FaultSurface, reach: int) -> bool:
    low = np.maximum(one.vertices.min(axis=0), other.vertices.min(axis=0)) - reach
    high = np.minimum(one.vertices.max(axis=0), other.vertices.max(axis=0)) + reach
    return bool((low <= high).all())


def _meet(
    one: _Meeting, other: _Meeting, frame: IndexFrame, reach: int
) -> tuple[Float64Array, Int64Array, float, float] | None:
    """Points, segments, length and angle of the line in which two surfaces meet; None where they do not."""
    vertices, cells = one.grid.triangulate()
    offset = _height_above(other.grid, vertices)
    cells = cells[np.isfinite(offset[cells]).all(axis=1)]
    cut = cut_mesh(np.column_stack([vertices, np.nan_to_num(offset)]), cells, axis=3, value=0.0)
    if not len(cut.segments):
        return None
    points, segments = cut.points[:, :3], cut.segments
    middle = points[segments].mean(axis=1)
    covered = _covers(one, middle) | _covers(other, middle)
    line = points[np.unique(segments[covered])]
    if not len(line):
        covered = _is_corner(one, other, middle, reach)
    elif not (_goes_through(one, other, line) or _goes_through(other, one, line)):
        covered |= _is_corner(one, other, middle, reach) & (cKDTree(line).query(middle)[0] > reach)
    segments = segments[covered]
    if not len(segments):
        return None
    used, numbers = np.unique(segments, return_inverse=True)
    line = points[used]
    normals = [_normals_beside(meeting, line, frame) for meeting in (one, other)]
    angles = np.degrees(np.arccos(np.clip(np.abs((normals[0] * normals[1]).sum(axis=1)), 0.0, 1.0)))
    return line, numbers.reshape(-1, 2).astype(np.int64), _measure_line(line, frame), float(angles.mean())


def _measure_line(points: Float64Array, frame: IndexFrame) -> float:
    """Length of a line through points in no order: the shortest way between the far ends of each of its parts."""
    points = points[:: -(-len(points) // _MOST_POINTS)]
    pairs = cKDTree(points).query_pairs(_NEIGHBOURS, output_type="ndarray")
    steps = np.linalg.norm(frame.carry(points[pairs[:, 1]] - points[pairs[:, 0]]), axis=1)
    # a step of no length is no edge of a sparse graph
    ways = coo_array((np.maximum(steps, 1e-9), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2).tocsr()
    part = connected_components(ways, directed=False)[1]
    length = 0.0
    for start in np.unique(part, return_index=True)[1]:
        far = dijkstra(ways, directed=False, indices=start)
        end = int(np.where(np.isfinite(far), far, -1.0).argmax())
        way = dijkstra(ways, directed=False, indices=end)
        length += float(way[np.isfinite(way)].max())
    return length


def _normals_beside(meeting: _Meeting, line: Float64Array, frame: IndexFrame) -> Float64Array:
    """Return unit normals of a surface beside places along a line: the median of those around, off the line."""
    off = cKDTree(line).query(meeting.surface.vertices)[0]
    # a surface that reaches less far has its outer half
    kept = off >= min(_OFF_LINE, 0.5 * float(off.max()))
    tree = cKDTree(meeting.surface.vertices[kept])
    normals = frame.normals(meeting.surface.normals[kept])
    places = _some(line)
    around = tree.query_ball_point(places, r=_AROUND)
    nearest = tree.query(places)[1]
    beside = np.stack([np.median(normals[near or [one]], axis=0) for near, one in zip(around, nearest, strict=True)])
    return np.asarray(beside / np.maximum(np.linalg.norm(beside, axis=1, keepdims=True), 1e-30))


def _some(line: Float64Array) -> Float64Array:
    return line[:: max(1, len(line) // 60)]


def _height_above(grid: SurfaceGrid, points: AnyArray) -> Float64Array:
    """How far points lie across a surface's height field; NaN where it does not reach."""
    along = np.array([-grid.across[1], grid.across[0]])
    safe = np.where(np.isfinite(points), points, -1e6)
    rows, samples = safe[:, :2] @ along - grid.first[0], safe[:, 2] - grid.first[1]
    known = ndimage.map_coordinates(np.isfinite(grid.w).astype(np.float64), [rows, samples], order=1, cval=0.0)
    w = ndimage.map_coordinates(np.nan_to_num(grid.w), [rows, samples], order=1, cval=0.0)
    return np.where(known > 0.999, safe[:, :2] @ grid.across - w, np.nan)


def _covers(meeting: _Meeting, points: Float64Array) -> BoolArray:
    """Whether a surface itself, not what it is carried on to, has a triangle at points near it."""
    flat = _flatten(meeting.grid, points)
    near = np.atleast_2d(meeting.centres.query(flat, k=min(12, len(meeting.triangles)))[1].reshape(len(flat), -1))
    a, b, c = (meeting.triangles[near][:, :, k] for k in range(3))
    p = flat[:, None]
    turns = np.stack([_turn(a, b, p), _turn(b, c, p), _turn(c, a, p)])
    inside: BoolArray = np.asarray((turns >= -1e-9).all(axis=0) | (turns <= 1e-9).all(axis=0))
    return np.asarray(inside.any(axis=1))


def _is_corner(one: _Meeting, other: _Meeting, points: Float64Array, reach: int) -> BoolArray:
    """Whether two surfaces that both end do so within reach of points, at an angle: not side by side, or end to end."""
    inside = np.ones(len(points), bool)
    nearest = [meeting.tree.query(points) for meeting in (one, other)]
    first, second = (m.surface.normals[at] for m, (_, at) in zip((one, other), nearest, strict=True))
    line = np.cross(first, second)
    size = np.linalg.norm(line, axis=1)
    line = line / np.maximum(size, 1e-30)[:, None]
    for meeting, (distance, at) in zip((one, other), nearest, strict=True):
        # beyond an end of the line the nearest vertex lies back along it
        beyond = np.abs(((points - meeting.surface.vertices[at]) * line).sum(axis=1))
        inside &= (distance <= reach) & (beyond <= 0.5 * meeting.spacing)
    return np.asarray(inside & (size > _ANGLED))


def _turn(a: Float64Array, b: Float64Array, p: Float64Array) -> Float64Array:
    return np.asarray(
        (b[..., 0] - a[..., 0]) * (p[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (p[..., 0] - a[..., 0])
    )


def _goes_through(one: _Meeting, other: _Meeting, line: Float64Array) -> bool:
    """Whether one surface lies on both sides of the other along most of the line in which they meet."""
    height = _height_above(other.grid, one.surface.vertices.astype(np.float64))
    votes = []
    for near in one.tree.query_ball_point(_some(line), r=3.0 + 3.0 * one.spacing):
        side = height[near]
        above, below = int((side > _ON).sum()), int((side < -_ON).sum())
        if above + below:
            votes.append(min(above, below) >= _THROUGH * max(above, below))
    return bool(votes) and float(np.mean(votes)) >= 0.5
