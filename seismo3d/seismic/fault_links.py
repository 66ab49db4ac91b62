"""Edges across faults: the two sides of a surface are one layer where its throw brings them together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._settings import Positive, Steps, StepsOrNone, Width
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array
from seismo3d.graph.scalars import ScalarEdges
from seismo3d.seismic._kernels_cuts import cross_edges, match_sides, read_side
from seismo3d.seismic.fault_motion import go_straight_on
from seismo3d.seismic.faultset import FaultSurface

# places of a grid that are fitted at a time: about a kilobyte each
_PLACES = 100_000
# distance from the nearest vertex up to which a node is on the surface
_ON = 2.3
# variance of a throw, in samples squared, where all of the energy is misfit
_SPREAD = 16.0
# traces off a surface at which the layers are read that an edge across it joins
_CLEAR = 2.5


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """How the two sides of a fault are joined; lengths in traces and samples.

    Attributes
    ----------
    beyond : int in [0, 100]
        How far a surface is carried on beyond its edge, so that nothing leaks past it where it was lost too early.
    near, far : int in [1, 100], [near, 100]
        Traces off the surface between which each side is read.
    along, down : float in (0, 1000]
        Widths of the window over which the sides are matched.
    passes : int in [1, 100]
        Steps of the least-squares fit of the throw.
    least : float in (0, inf)
        Smallest standard deviation of a throw, in samples.
    doubtful : float in (0, inf)
        Misfit ratio that, above twice the cube's usual one, makes a match doubtful: its variance grows from there.
    """

    beyond: StepsOrNone = 6
    near: Steps = 2
    far: Annotated[int, "[near, 100]"] = 5
    along: Width = 6.0
    down: Width = 10.0
    passes: Steps = 6
    least: Positive = 0.3
    doubtful: Positive = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceGrid:
    """A fault surface as a height field over a vertical plane along its mean strike, carried on beyond its edge.

    Attributes
    ----------
    across : ndarray of shape (2,), float64
        Horizontal unit vector into the hanging wall.
    first : (int, int)
        Place along strike, and sample, of the grid's first node; nodes are one apart.
    w : ndarray of shape (rows, samples), float64
        Position across; NaN far off the surface.
    inside : ndarray of the same shape, bool
        Nodes on the surface itself.
    throw : ndarray of the same shape, float64
        In samples, of the nearest place where it is known; NaN where it is known nowhere.
    """

    across: Float64Array
    first: tuple[int, int]
    w: Float64Array
    inside: BoolArray
    throw: Float64Array

    def place(self, rows: AnyArray, samples: AnyArray) -> Float64Array:
        """(inline, crossline, sample) at fractional rows and samples of the grid; NaN off it."""
        filled = np.where(np.isfinite(self.w), self.w, 0.0)
        known = ndimage.map_coordinates(np.isfinite(self.w).astype(np.float64), [rows, samples], order=1, cval=0.0)
        w = ndimage.map_coordinates(filled, [rows, samples], order=1, cval=0.0)
        w = np.where(known > 0.999, w, np.nan)
        along = np.array([-self.across[1], self.across[0]])
        s = np.asarray(rows) + self.first[0]
        flat = s[..., None] * along + w[..., None] * self.across
        return np.concatenate([flat, (np.asarray(samples) + self.first[1])[..., None]], axis=-1)

    def triangulate(self) -> tuple[Float64Array, Int64Array]:
        """(inline, crossline, sample) of every node, NaN off the grid, and two triangles for each of its cells."""
        rows, samples = np.meshgrid(*(np.arange(n) for n in self.w.shape), indexing="ij")
        numbers = np.arange(self.w.size).reshape(self.w.shape)
        a, b, c, d = (n.ravel() for n in (numbers[:-1, :-1], numbers[1:, :-1], numbers[:-1, 1:], numbers[1:, 1:]))
        cells = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
        return self.place(rows.ravel(), samples.ravel()), cells


def grid_surface(surface: FaultSurface, *, beyond: int = 6) -> SurfaceGrid:
    """Lay a surface out on a grid, one node a trace along strike and a sample down, with what lies apart today."""
    vertices, apart = (values.astype(np.float64) for values in (surface.vertices, surface.separation))
    return grid_points(vertices, surface.normals.astype(np.float64), apart, beyond=beyond)


def grid_points(vertices: Float64Array, normals: Float64Array, throw: Float64Array, *, beyond: int) -> SurfaceGrid:
    """Lay points of a surface out on such a grid; normals of shape (n, 3), and throws, NaN where they are not known.

    Beyond its edge the surface goes straight on: planes through the few points there would lead astray.
    """
    normal = normals[:, :2].mean(axis=0)
    across = normal / max(float(np.linalg.norm(normal)), 1e-9)
    along = np.array([-across[1], across[0]])
    s, w, z = vertices[:, :2] @ along, vertices[:, :2] @ across, vertices[:, 2]
    first = (int(np.floor(s.min())) - beyond, int(np.floor(z.min())) - beyond)
    shape = (int(np.ceil(s.max())) + beyond + 1 - first[0], int(np.ceil(z.max())) + beyond + 1 - first[1])
    rows, samples = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij")
    at = np.column_stack([rows.ravel() + first[0], samples.ravel() + first[1]]).astype(np.float64)
    tree = cKDTree(np.column_stack([s, z]))
    height, nearest = np.full(len(at), np.nan), np.empty(len(at))
    for begin in range(0, len(at), _PLACES):
        part = slice(begin, begin + _PLACES)
        found = tree.query(at[part], k=min(16, len(s)))
        distance, near = np.asarray(found[0]), np.asarray(found[1])
        kept = distance[:, 0] <= _ON
        height[part][kept] = _fit_planes(at[part][kept], distance[kept], near[kept], s, w, z)
        nearest[part] = distance[:, 0]
    inside = (nearest <= _ON).reshape(shape)
    straight, _ = go_straight_on(height.reshape(shape), inside)
    carried = np.where(nearest.reshape(shape) <= beyond + 2.0, straight, np.nan)
    known = _nearest_known(throw, np.column_stack([s, z]), at).reshape(shape)
    return SurfaceGrid(across, first, carried, inside, known)


def _fit_planes(
    at: Float64Array, distance: Float64Array, near: AnyArray, s: Float64Array, w: Float64Array, z: Float64Array
) -> Float64Array:
    """Height at places from planes through their nearest vertices."""
    ds, dz = s[near] - at[:, :1], z[near] - at[:, 1:]
    weight = 1.0 / (0.5 + distance**2)
    rows = np.stack([np.ones_like(ds), ds, dz], axis=-1)
    matrix = np.einsum("npi,np,npj->nij", rows, weight, rows) + np.diag([1e-6, 1e-2, 1e-2])
    right = np.einsum("npi,np,np->ni", rows, weight, w[near])
    return np.linalg.solve(matrix, right[..., None])[:, 0, 0]


def _nearest_known(values: Float64Array, places: Float64Array, at: Float64Array) -> Float64Array:
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(at), np.nan)
    _, near = cKDTree(places[known]).query(at)
    return values[known][near]


def cut_grid(grid: SurfaceGrid, cuts: AnyArray) -> None:
    """Set bit `axis` of every voxel between which and the next the surface, carried on beyond its edge, passes."""
    vertices, cells = grid.triangulate()
    cells = cells[np.isfinite(vertices[cells]).all(axis=(1, 2))]
    edges, _ = find_crossings(vertices, np.empty((len(vertices), 0)), cells, cuts.shape)
    axis, voxel = np.divmod(edges, cuts.size)
    np.bitwise_or.at(cuts.reshape(-1), voxel, np.left_shift(1, axis).astype(cuts.dtype))


def find_crossings(
    vertices: Float64Array, values: Float64Array, cells: Int64Array, shape: tuple[int, ...]
) -> tuple[Int64Array, Float64Array]:
    """Find the edges of a grid that triangles cross, and the values there, with the sign of the crossing.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3), float64
        In the grid's indices.
    values : ndarray of shape (n, m), float64
        What is known at them.
    cells : ndarray of shape (k, 3), int64
        Triangles.
    shape : tuple of int
        The grid's.

    Returns
    -------
    edges : ndarray of shape (e,), int64
        ``axis * size + voxel`` for the edge from a voxel to the next along an axis; each once, increasing.
    found : ndarray of shape (e, m), float64
        Of the first triangle that crosses the edge.
    """
    room = 8 * len(cells) + 64
    while True:
        edges, found = np.empty(room, np.int64), np.empty((room, values.shape[1]))
        count = cross_edges(vertices, values, cells, np.array(shape), edges, found)
        if count <= room:
            break
        room = count
    unique, first = np.unique(edges[:count], return_index=True)
    return unique, found[first]


def match_grid(
    grid: SurfaceGrid, volume: Float32Array, valid: BoolArray, nearest: list[Float32Array], *,
    step: int, settings: LinkSettings | None = None,
) -> tuple[Float64Array, Float64Array]:  # fmt: skip
    """Refine the throw of a surface by matching its sides; return it and its variance at every node of the grid."""
    settings = settings or LinkSettings()
    rows, samples = np.meshgrid(*(np.arange(n) for n in grid.w.shape), indexing="ij")
    places = grid.place(rows.ravel(), samples.ravel())
    places = np.where(grid.inside.ravel()[:, None], places, np.nan)
    sides = np.zeros((2, *grid.w.shape), np.float32)
    known = np.zeros((2, *grid.w.shape), np.float32)
    for number, sign in enumerate((-1.0, 1.0)):
        read_side(
            volume,
            valid,
            nearest[0],
            nearest[1],
            step,
            places,
            sign * grid.across,
            settings.near,
            settings.far,
            sides[number].reshape(-1),
            known[number].reshape(-1),
        )
    return match_known(grid, sides, known, settings)


def match_known(
    grid: SurfaceGrid, sides: Float32Array, known: Float32Array, settings: LinkSettings
) -> tuple[Float64Array, Float64Array]:
    """Refine the throw of a surface whose sides are read; arrays of shape (2, rows, samples)."""
    throw = ndimage.gaussian_filter(np.nan_to_num(grid.throw), (settings.along, settings.down))
    sigma = (settings.along, settings.down)
    first = throw.copy()
    for _ in range(settings.passes):
        products = np.zeros((5, *grid.w.shape))
        match_sides(sides, known, throw, products)
        weight, strength, pull, left, energy = (ndimage.gaussian_filter(p, sigma) for p in products)
        move = pull / np.maximum(strength, 1e-12 + 1e-3 * strength.max())
        throw = throw + np.clip(move, -1.0, 1.0)
        throw = ndimage.gaussian_filter(throw, (0.5 * settings.along, 0.5 * settings.down))
        throw = np.clip(throw, first - 5.0, first + 5.0)
    ratio = left / np.maximum(energy, 1e-12)
    variance = settings.least**2 + _SPREAD * np.clip(ratio, 0.0, 1.0) ** 2
    variance[(weight < 0.05) | ~grid.inside] = np.inf
    return throw, variance


def doubt_matches(variance: Float64Array, usual: float, settings: LinkSettings) -> Float64Array:
    """Raise the variances of doubtful matches in a cube with such misfit ratios of its shifts.

    Sides that fit badly are mostly no match at all, but one of another cycle: off by far more than a misfit tells.
    """
    limit = _SPREAD * (settings.doubtful + 2.0 * usual) ** 2
    return np.asarray(variance * (1.0 + (variance / limit) ** 2))


def link_grid(
    grid: SurfaceGrid, throw: Float64Array, variance: Float64Array, nearest: list[Float32Array], breaks: AnyArray, *,
    stride: int, step: int,
) -> ScalarEdges:  # fmt: skip
    """Edges from the footwall to the hanging wall of a surface, one every stride-th row and step-th sample."""
    rows, samples = np.meshgrid(
        np.arange(0, grid.w.shape[0], stride), np.arange(0, grid.w.shape[1], step), indexing="ij"
    )
    down, spread = throw[rows, samples].ravel(), variance[rows, samples].ravel()
    known = np.isfinite(down) & np.isfinite(spread)
    down, spread = down[known], spread[known]
    at_rows: Float64Array = rows.ravel()[known].astype(np.float64)
    at_samples: Float64Array = samples.ravel()[known].astype(np.float64)
    foot = _vertices(grid.place(at_rows, at_samples - 0.5 * down), -_CLEAR * grid.across, nearest, breaks, stride, step)
    hang = _vertices(grid.place(at_rows, at_samples + 0.5 * down), _CLEAR * grid.across, nearest, breaks, stride, step)
    ok = foot[3] & hang[3]
    return ScalarEdges.from_arrays(
        foot[0][ok], hang[0][ok], measured=(foot[2] - hang[2])[ok], variance=spread[ok],
        first_share=foot[1][ok], second_share=hang[1][ok],
    )  # fmt: skip


def _vertices(
    points: Float64Array, away: Float64Array, nearest: list[Float32Array], breaks: AnyArray, stride: int, step: int
) -> tuple[AnyArray, Float64Array, Float64Array, BoolArray]:
    """Vertex, share of the next one and sample of the layers at points, carried along their dips off the surface."""
    n0, n1, m = breaks.shape
    usable: BoolArray = np.asarray(np.isfinite(points).all(axis=1))
    at = np.where(usable[:, None], points, 0.0)
    place = np.rint((at[:, :2] + away) / stride).astype(np.int64) * stride
    usable &= (place >= 0).all(axis=1) & (place < (n0, n1)).all(axis=1)
    place = np.clip(place, 0, ((n0 - 1) // stride * stride, (n1 - 1) // stride * stride))
    i: AnyArray = place[:, 0]
    j: AnyArray = place[:, 1]
    k = np.clip(np.rint(at[:, 2] / step).astype(np.int64), 0, m - 1)
    move = place - at[:, :2]
    # slopes are read on the far side of the trace, away from the surface
    before = np.clip(place - (move < 0), 0, None)
    z = at[:, 2] + move[:, 0] * nearest[0][before[:, 0], j, k] + move[:, 1] * nearest[1][i, before[:, 1], k]
    usable &= (z >= 0) & (z <= (m - 1) * step)
    z = np.clip(z, 0, (m - 1) * step)
    low = np.minimum((z / step).astype(np.int64), m - 2)
    share = z / step - low
    gap = breaks[i, j, low].astype(np.float64)
    share = np.where(gap > 0, np.where(z < low * step + gap - 0.5, 0.0, 1.0), share)
    vertex = ((i // stride) * ((n1 - 1) // stride + 1) + j // stride) * m + low
    return vertex, share, z, usable
