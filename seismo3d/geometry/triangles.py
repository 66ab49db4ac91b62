"""Triangulated surfaces and polylines: cut by a plane, join into lines, simplify, measure.

A mesh is ``vertices`` of shape (n, d) and ``cells`` of shape (m, d): triangles in space (d = 3), segments in a plane
(d = 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, Float64Array, Int64Array


@dataclass(frozen=True, slots=True, eq=False)
class MeshCut:
    """Where a plane cuts a triangulated surface.

    Attributes
    ----------
    points : ndarray of shape (k, 3), float64
        The cut points, each on an edge of the surface.
    segments : ndarray of shape (s, 2), int64
        Pairs of points, one a cut triangle.
    edges : ndarray of shape (k, 2), int64
        The two vertices of each point's edge.
    weights : ndarray of shape (k,), float64
        Share of the second vertex in the point.
    """

    points: Float64Array
    segments: Int64Array
    edges: Int64Array
    weights: Float64Array

    def interpolate(self, values: AnyArray) -> Float64Array:
        """Values at the cut points, from values at the vertices; NaN counts only where both ends are NaN."""
        first = np.asarray(values, dtype=np.float64)[self.edges[:, 0]]
        second = np.asarray(values, dtype=np.float64)[self.edges[:, 1]]
        mixed = first * (1.0 - self.weights) + second * self.weights
        return np.where(np.isnan(first), second, np.where(np.isnan(second), first, mixed))


def cut_mesh(vertices: AnyArray, cells: AnyArray, *, axis: int, value: float) -> MeshCut:
    """Cut a triangulated surface by the plane where one coordinate has a value.

    A vertex that lies on the plane counts as above it, so that every cut triangle gives exactly one segment and
    neighbours share their points.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3)
        Points.
    cells : ndarray of shape (m, 3)
        Triangles as rows of vertex numbers.
    axis : int
        The coordinate that is held, 0 to 2.
    value : float
        Its value on the plane.

    Returns
    -------
    MeshCut
        Points and segments; empty where the plane misses the surface.

    Examples
    --------
    >>> import numpy as np
    >>> triangle = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 4.0]])
    >>> cut_mesh(triangle, np.array([[0, 1, 2]]), axis=2, value=2.0).points.tolist()
    [[0.0, 1.0, 2.0], [1.0, 1.0, 2.0]]
    """
    points = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(cells, dtype=np.int64).reshape(-1, 3)
    height = points[:, axis] - value
    above = height >= 0.0
    triangles = triangles[above[triangles].sum(axis=1) % 3 != 0]
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)  # (t, 3, 2): each triangle's edges
    crossed = above[pairs[..., 0]] != above[pairs[..., 1]]
    edges, numbers = np.unique(pairs[crossed], axis=0, return_inverse=True)
    edges = edges.reshape(-1, 2)
    low, high = height[edges[:, 0]], height[edges[:, 1]]
    weights = low / np.where(low == high, 1.0, low - high)
    cut = points[edges[:, 0]] + weights[:, None] * (points[edges[:, 1]] - points[edges[:, 0]])
    cut[:, axis] = value
    return MeshCut(cut, numbers.reshape(-1, 2), edges, weights)


def join_segments(segments: AnyArray) -> list[Int64Array]:
    """Join segments that share ends into polylines.

    Lines end where a point has one segment, or more than two; closed loops repeat their first point at the end.

    Parameters
    ----------
    segments : ndarray of shape (s, 2), int
        Pairs of point numbers.

    Returns
    -------
    list of ndarray, int64
        Point numbers along each line, longest first.

    Examples
    --------
    >>> import numpy as np
    >>> [line.tolist() for line in join_segments(np.array([[2, 1], [0, 1], [2, 3], [7, 8]]))]
    [[0, 1, 2, 3], [7, 8]]
    """
    pairs = [(int(a), int(b)) for a, b in np.asarray(segments).reshape(-1, 2) if a != b]
    at: dict[int, list[int]] = {}
    for number, (a, b) in enumerate(pairs):
        at.setdefault(a, []).append(number)
        at.setdefault(b, []).append(number)
    used: set[int] = set()
    ends = sorted(point for point, touching in at.items() if len(touching) != 2)
    lines = [_walk(start, pairs, at, used) for start in [*ends, *sorted(at)] for _ in at[start]]
    return sorted((np.array(line, dtype=np.int64) for line in lines if len(line) > 1), key=len, reverse=True)


def _walk(start: int, pairs: list[tuple[int, int]], at: dict[int, list[int]], used: set[int]) -> list[int]:
    """Follow unused segments from a point until the line ends."""
    line = [start]
    while True:
        step = next((number for number in at[line[-1]] if number not in used), None)
        if step is None:
            return line
        used.add(step)
        a, b = pairs[step]
        line.append(b if a == line[-1] else a)
        if len(at[line[-1]]) != 2:
            return line


def simplify_line(points: AnyArray, *, tolerance: float) -> Int64Array:
    """Choose the points that keep a polyline within a distance of its course (Douglas and Peucker).

    Parameters
    ----------
    points : ndarray of shape (n, d)
        The line.
    tolerance : float
        Largest distance of a dropped point to the new line, in the points' units.

    Returns
    -------
    ndarray of shape (k,), int64
        Numbers of the points to keep, both ends among them.
    """
    line = np.asarray(points, dtype=np.float64)
    keep = np.zeros(len(line), dtype=bool)
    keep[[0, -1]] = True
    spans = [(0, len(line) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        inner = line[first + 1 : last] - line[first]
        chord = line[last] - line[first]
        along = np.clip(inner @ chord / max(float(chord @ chord), 1e-30), 0.0, 1.0)
        distance = np.linalg.norm(inner - along[:, None] * chord, axis=1)
        worst = int(distance.argmax())
        if distance[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            spans += [(first, middle), (middle, last)]
    return np.flatnonzero(keep)


def measure_cells(vertices: AnyArray, cells: AnyArray) -> Float64Array:
    """Area of each triangle, or length of each segment.

    Parameters
    ----------
    vertices : ndarray of shape (n, d)
        Points in space or in a plane.
    cells : ndarray of shape (m, 2) or (m, 3)
        Segments or triangles.

    Returns
    -------
    ndarray of shape (m,), float64
        Areas or lengths in the points' units.
    """
    corners = np.asarray(vertices, dtype=np.float64)[np.asarray(cells, dtype=np.int64)]
    sides = corners[:, 1:] - corners[:, :1]
    if sides.shape[1] == 1:
        return np.asarray(np.linalg.norm(sides[:, 0], axis=1))
    gram = sides @ sides.transpose(0, 2, 1)
    square = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    return np.asarray(0.5 * np.sqrt(np.maximum(square, 0.0)))


def weigh_vertices(vertices: AnyArray, cells: AnyArray) -> Float64Array:
    """Share of the whole area (or length) that belongs to each vertex; the sum is the area.

    Parameters
    ----------
    vertices : ndarray of shape (n, d)
        Points.
    cells : ndarray of shape (m, 2) or (m, 3)
        Segments or triangles.

    Returns
    -------
    ndarray of shape (n,), float64
        Weights in the units of the area.
    """
    numbers = np.asarray(cells, dtype=np.int64)
    parts = np.repeat(measure_cells(vertices, cells) / numbers.shape[1], numbers.shape[1])
    weights: Float64Array = np.bincount(numbers.ravel(), weights=parts, minlength=len(vertices)).astype(np.float64)
    return weights


def merge_vertices(
    vertices: AnyArray, cells: AnyArray, *, group: AnyArray, size: float
) -> tuple[Int64Array, Int64Array]:
    """Coarsen a mesh: vertices of one group in one box of a grid become one, and cells that collapse are dropped.

    Parameters
    ----------
    vertices : ndarray of shape (n, d)
        Points.
    cells : ndarray of shape (m, d)
        Triangles or segments as rows of vertex numbers.
    group : ndarray of shape (n,), int
        Vertices of different groups are kept apart.
    size : float
        Side of a box.

    Returns
    -------
    merged : ndarray of shape (n,), int64
        Number of the new vertex of each old one.
    cells : ndarray of shape (k, d), int64
        Cells between new vertices.
    """
    boxes = np.floor(np.asarray(vertices, dtype=np.float64) / size).astype(np.int64)
    keys = np.column_stack([np.asarray(group, dtype=np.int64), boxes])
    merged = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)
    corners = merged[np.asarray(cells, dtype=np.int64)]
    ordered = np.sort(corners, axis=1)
    corners = corners[(np.diff(ordered, axis=1) > 0).all(axis=1)]
    return merged, np.asarray(np.unique(corners, axis=0), dtype=np.int64)
