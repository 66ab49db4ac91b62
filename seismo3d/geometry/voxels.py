"""Points on voxel grids: downsampling, surface normals, and maps that find the nearest voxel in constant time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import ArrayLike, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d._validate import as_number, as_points
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry import _kernels_voxel_elements as elements
from seismo3d.geometry import _kernels_voxels as kernels
from seismo3d.geometry._kernels_voxel_keys import AXIS_MASK, make_table
from seismo3d.geometry.rotations import exp_rotation

MARGIN = 4
"""Empty cells kept below the lowest point, so that neighbours have keys too."""
TURN = (0.016, -0.02, 0.025)
"""Rotation vector from the points' axes to the voxels'. Floors and walls along the axes would lie at one and the same
place in all their voxels, and all elements of one would share its error; in voxels that are askew they lie at every."""
LEAST_QUALITY = 0.3
"""Elements of lower quality take their parent's normal where that is better."""
SAME = 0.75
"""Distance along the normal, in voxels, up to which centroids of neighbours belong to one surface."""


@dataclass(frozen=True, slots=True, eq=False)
class VoxelMap:
    """Voxels of one size that hold points, with a surface element each.

    Attributes
    ----------
    surface : ndarray of shape (m, 8), float32
        Rows of (centroid x, y, z, quality, normal x, y, z, weight); quality is 0 where there is no surface, up to
        1, and -1 where it has not been asked for yet: :meth:`complete` fills it in.
    size : float
        Length of a voxel's edge.
    turn : ndarray of shape (3, 3), float64
        Rotation from the points' axes to the voxels'.
    origin : ndarray of shape (3,), float64
        Corner of the voxel with key 0, along the voxels' axes.
    keys, moments, table_keys, table, shift
        The hash table and the moments, see the kernels.
    parents, coarser
        Each voxel's parent on the next coarser level, and that level's surface; None on the coarsest.
    dim : int
        2 or 3; in the plane z is zero.
    """

    surface: Float32Array
    size: float
    turn: Float64Array
    origin: Float64Array
    keys: Int64Array
    moments: Float64Array
    table_keys: Int64Array
    table: Int32Array
    shift: int
    dim: int
    parents: Int32Array | None = None
    coarser: Float32Array | None = None

    def complete(self, rows: Int64Array) -> None:
        """Estimate the normals of some rows from the neighbours, or take the parents' where those span no surface."""
        elements.voxel_normals(
            self.keys, self.moments, self.table_keys, self.table, self.shift, self.dim, rows, self.surface
        )
        if self.parents is not None and self.coarser is not None:
            elements.inherit_normals(self.surface, self.coarser, self.parents, rows, LEAST_QUALITY)
        self.join_layers(rows)

    def join_layers(self, rows: Int64Array) -> None:
        """Put the elements of some rows where all layers of voxels that their surface fills have their centroid."""
        elements.join_layers(
            self.keys,
            self.moments,
            self.table_keys,
            self.table,
            self.shift,
            self.turn,
            SAME * self.size,
            rows,
            self.surface,
        )


def voxel_levels(
    points: Float64Array,
    *,
    center: Float64Array,
    factor: float,
    voxel_size: float,
    n_levels: int,
    low: Float64Array,
    high: Float64Array,
    fine_normals: str = "all",
    normals: Float32Array | None = None,
    weights: Float64Array | None = None,
) -> list[VoxelMap]:
    """Return voxel maps of points, the finest first, each level with voxels twice as large.

    Parameters
    ----------
    points : ndarray of shape (n, d), float64
        Finite. They become ``(p - center) * factor``; voxels are measured in that frame.
    center : ndarray of shape (d,), float64
    factor : float
    voxel_size : float
        Edge of the finest voxels.
    n_levels : int
    low, high : ndarray of shape (d,), float64
        Lowest and highest coordinates of the points in the frame.
    fine_normals : {"all", "asked", "parents"}
        On the finest level: estimate all normals at once, only when they are asked for, or take those of the parents.
    normals : ndarray of shape (n, d), float32, optional
        Unit normals of the points, of any sign, in place of estimated ones.
    weights : ndarray of shape (n,), float64, optional
        Weights of the points; a voxel's is their mean, less where it holds few points.
    """
    d = points.shape[1]
    coarsest = voxel_size * 2 ** (n_levels - 1)
    origin = np.zeros(3)
    turn = exp_rotation(TURN if d == 3 else (0.0, 0.0, TURN[2]))
    origin[:d] = np.minimum(turn[:d, :d] * low, turn[:d, :d] * high).sum(axis=1) - MARGIN * coarsest
    keys, moments, owner = kernels.voxelise(points, center, factor, turn, origin, 1.0 / voxel_size)
    steps = [(keys, moments)]
    parents: list[Int32Array | None] = []
    for _ in range(1, n_levels):
        keys, moments, parent = kernels.coarsen(keys, moments)
        steps.append((keys, moments))
        parents.append(parent)
    parents.append(None)
    tensors = None if normals is None else _normal_tensors(owner, normals, [len(k) for k, _ in steps], parents)
    sums = None if weights is None else _sum_up(owner, weights, [len(k) for k, _ in steps], parents)
    levels: list[VoxelMap] = []
    for level in range(n_levels - 1, -1, -1):
        keys, moments = steps[level]
        table_keys, table, shift = make_table(keys)
        surface = np.empty((len(keys), 8), dtype=np.float32)
        count = moments[:, 0]  # a voxel that noise put a point or two into says less than the full one beside it
        surface[:, 7] = count / (count + len(points) / len(keys))
        if sums is not None:
            surface[:, 7] *= sums[level] / count
        coarser = levels[0].surface if levels else None
        size = voxel_size * 2**level
        voxels = VoxelMap(
            surface, size, turn, origin, keys, moments, table_keys, table, shift, d, parents[level], coarser
        )  # fmt: skip
        rows = np.arange(len(keys))
        if tensors is not None:
            elements.tensor_normals(moments, tensors[level], d, surface)
            voxels.join_layers(rows)
        elif level or fine_normals == "all" or coarser is None:
            voxels.complete(rows)
        else:
            elements.centroids_only(moments, -1.0 if fine_normals == "asked" else 0.0, surface)
            if fine_normals == "parents" and voxels.parents is not None:
                elements.inherit_normals(surface, coarser, voxels.parents, rows, LEAST_QUALITY)
                voxels.join_layers(rows)
        levels.insert(0, voxels)
    return levels


def _normal_tensors(
    owner: Int32Array, normals: Float32Array, counts: list[int], parents: list[Int32Array | None]
) -> list[Float64Array]:
    """Return, by level, the sums of xx, xy, xz, yy, yz, zz of the normals in each voxel; shape (m, 6)."""
    n = np.zeros((len(normals), 3))
    n[:, : normals.shape[1]] = normals
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    columns = [_sum_up(owner, n[:, a] * n[:, b], counts, parents) for a, b in pairs]
    return [np.stack([column[level] for column in columns], axis=1) for level in range(len(counts))]


def _sum_up(
    owner: Int32Array, values: Float64Array, counts: list[int], parents: list[Int32Array | None]
) -> list[Float64Array]:
    """Return, by level, the sums of the points' values in each voxel."""
    sums = [np.bincount(owner, values, counts[0]).astype(np.float64)]
    for count, parent in zip(counts[1:], parents):
        if parent is not None:
            sums.append(np.bincount(parent, sums[-1], count).astype(np.float64))
    return sums


def survey(points: Float64Array, name: str) -> Float64Array:
    """Return rows (minimum, maximum, mean, sum of squares about it) by axis; refuse points that are not finite."""
    table = survey_if_finite(points)
    if table is None:
        n_bad = int((~np.isfinite(points).all(axis=1)).sum())
        raise ShapeError(
            f"{name} has {n_bad} rows with NaN or infinite values; expected finite points. Drop those rows first."
        )
    return table


def survey_if_finite(points: Float64Array) -> Float64Array | None:
    """Return the rows of a survey; None where points, or the sum of their squares, are not finite."""
    n, d = points.shape
    out = np.empty(4 * d)
    if not kernels.survey(points, out):
        return None
    table = out.reshape(4, d)
    table[2] /= n
    return table


def downsample_points(points: ArrayLike, voxel_size: float) -> tuple[Float64Array, Int32Array]:
    """Replace the points of each voxel by their centroid.

    Parameters
    ----------
    points : array_like of shape (n, d)
        Finite points; d is 2 or 3.
    voxel_size : float
        Edge of a voxel, in the points' units.

    Returns
    -------
    centroids : ndarray of shape (m, d), float64
        In the order in which the voxels are first met.
    owner : ndarray of shape (n,), int32
        The centroid that each point went into.

    Raises
    ------
    ParameterError
        If the voxels are too small for the extent of the points: more than a million along one axis.
    """
    p = as_points(points, "points")
    size = as_number(voxel_size, "voxel_size", low=0.0, strict=True)
    if len(p) == 0:
        raise ShapeError(f"points has shape {p.shape}: it is empty. Give at least one point.")
    table = survey(p, "points")
    check_voxel_size(size, float((table[1] - table[0]).max()))
    d = p.shape[1]
    origin = np.zeros(3)
    origin[:d] = -MARGIN * size
    _, moments, owner = kernels.voxelise(p, table[0], 1.0, np.eye(3), origin, 1.0 / size)
    return moments[:, 1 : 1 + d] / moments[:, :1] + table[0], owner


def check_voxel_size(voxel_size: float, extent: float) -> None:
    """Refuse voxels so small that their numbers overflow."""
    if extent / voxel_size > AXIS_MASK / 4:
        raise ParameterError(
            f"voxel_size is {voxel_size:g} for an extent of {extent:g}; expected at least a millionth of the extent. "
            "Use larger voxels, or drop far outliers."
        )


def estimate_normals(
    points: ArrayLike, *, n_neighbours: int = 12, viewpoint: ArrayLike | None = None
) -> tuple[Float32Array, Float32Array]:
    """Estimate the surface normal at each point from its nearest neighbours.

    Parameters
    ----------
    points : array_like of shape (n, d)
        Finite points; d is 2 or 3.
    n_neighbours : int
        Neighbours to fit a plane (a line, in the plane) to, the point itself among them.
    viewpoint : array_like of shape (d,), optional
        Normals are turned towards it. Without it their signs are arbitrary.

    Returns
    -------
    normals : ndarray of shape (n, d), float32
        Unit vectors.
    thickness : ndarray of shape (n,), float32
        Root mean square distance of the neighbours from the fit, in the points' units.

    Raises
    ------
    GeometryError
        If there are not more than d points.
    """
    from scipy.spatial import cKDTree

    p = as_points(points, "points")
    n, d = p.shape
    if n <= d:
        raise GeometryError(f"there are {n} points; expected more than {d} to estimate normals.")
    k = int(min(max(as_number(n_neighbours, "n_neighbours", low=d + 1), d + 1), n))
    tree: Any = cKDTree(p)
    near = tree.query(p, k=k)[1]
    normals = np.empty((n, d), dtype=np.float32)
    thickness = np.empty(n, dtype=np.float32)
    for start in range(0, n, 65536):
        rows = slice(start, start + 65536)
        offsets = p[near[rows]] - p[near[rows]].mean(axis=1, keepdims=True)
        values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets) / k)
        normals[rows] = vectors[:, :, 0]
        thickness[rows] = np.sqrt(np.maximum(values[:, 0], 0.0))
    if viewpoint is not None:
        towards = np.asarray(viewpoint, dtype=np.float64) - p
        normals[(towards * normals).sum(axis=1) < 0.0] *= -1.0
    return normals, thickness
