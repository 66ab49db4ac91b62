"""The mapped surface as triangles: marching cubes over the blocks, welded at their seams."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int64Array
from seismo3d.io._files import as_path, written_aside
from seismo3d.robot import _kernels_blocks as blocks

if TYPE_CHECKING:
    from seismo3d.robot.tsdf import SurfaceMap


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A coloured triangle mesh.

    Attributes
    ----------
    points : ndarray of shape (n, 3), float64
        In the world frame, metres.
    triangles : ndarray of shape (m, 3), int64
        Counter-clockwise as seen from the free side.
    colours : ndarray of shape (n, 3), uint8
    """

    points: Float64Array
    triangles: Int64Array
    colours: AnyArray

    def save(self, path: str | Path) -> Path:
        """Write a binary PLY file with colours.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Path
            The file.
        """
        path = as_path(path)
        vertex = np.empty(len(self.points), dtype=[("p", "<f4", 3), ("c", "u1", 3)])
        vertex["p"], vertex["c"] = self.points, self.colours
        face = np.empty(len(self.triangles), dtype=[("n", "u1"), ("v", "<i4", 3)])
        face["n"], face["v"] = 3, self.triangles
        head = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertex)}\nproperty float x\nproperty float y\n"
            "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
            f"element face {len(face)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        with written_aside(path) as aside, aside.open("wb") as file:
            file.write(head.encode("ascii"))
            file.write(vertex.tobytes())
            file.write(face.tobytes())
        return path


def extract_mesh(surface: SurfaceMap, *, least_weight: float = 1.0) -> Mesh:
    """Return the zero level of a map.

    Parameters
    ----------
    surface : SurfaceMap
    least_weight : float
        Voxels that weigh less are left out; 1 is one frontal look from a metre.

    Returns
    -------
    Mesh
        Without triangles where nothing is mapped.
    """
    from skimage.measure import marching_cubes

    points, triangles, colours, count = [], [], [], 0
    for number in range(surface.n_blocks):
        distance, colour = _padded(surface, number, least_weight)
        if not (np.nanmin(distance, initial=1.0) < 0.0 < np.nanmax(distance, initial=-1.0)):
            continue
        known = np.isfinite(distance)
        whole = known[:-1, :-1, :-1].copy()
        for i, j, k in ((0, 0, 1), (0, 1, 0), (0, 1, 1), (1, 0, 0), (1, 0, 1), (1, 1, 0), (1, 1, 1)):
            whole &= known[i : i + 8, j : j + 8, k : k + 8]
        if not whole.any():
            continue
        mask = np.zeros(distance.shape, dtype=bool)
        mask[1:, 1:, 1:] = whole
        try:
            found, faces, _, _ = marching_cubes(
                np.where(known, distance, 1.0), 0.0, mask=mask, gradient_direction="descent"
            )
        except (RuntimeError, ValueError):  # no triangle in the cells that are wholly known
            continue
        at = np.rint(found).astype(np.int64)
        points.append((found + surface.coordinates[number].astype(np.float64) * blocks.SIDE) * surface.voxel_size)
        colours.append(colour[at[:, 0], at[:, 1], at[:, 2]])
        triangles.append(faces.astype(np.int64) + count)
        count += len(found)
    if not points:
        return Mesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), np.empty((0, 3), dtype=np.uint8))
    return _welded(np.concatenate(points), np.concatenate(triangles), np.concatenate(colours), surface.voxel_size)


def _padded(surface: SurfaceMap, number: int, least_weight: float) -> tuple[Float32Array, AnyArray]:
    """Distances (9, 9, 9), NaN where not known, and colours of a block and the first voxels of those that follow."""
    distance = np.full((9, 9, 9), np.nan, dtype=np.float32)
    colour = np.zeros((9, 9, 9, 3), dtype=np.uint8)
    for n in range(8):
        step = np.array([n >> 2, (n >> 1) & 1, n & 1])
        other = surface.block_at(surface.coordinates[number] + step)
        if other < 0:
            continue
        into = tuple(slice(8, 9) if s else slice(0, 8) for s in step)
        take = tuple(slice(0, 1) if s else slice(0, 8) for s in step)
        held, weight = (part.reshape(8, 8, 8)[take] for part in (surface.distances(other), surface.weights(other)))
        distance[into] = np.where(weight >= least_weight, held, np.nan)
        colour[into] = surface.colour[other, :, :3].reshape(8, 8, 8, 3)[take]
    return distance, colour


def _welded(points: Float64Array, triangles: Int64Array, colours: AnyArray, voxel: float) -> Mesh:
    """Join points that neighbouring blocks both have, and drop triangles without area."""
    grid = np.rint(points / (voxel * 1e-3)).astype(np.int64)
    _, first, owner = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    joined = owner.ravel()[triangles]
    flat = (joined[:, 0] == joined[:, 1]) | (joined[:, 1] == joined[:, 2]) | (joined[:, 2] == joined[:, 0])
    return Mesh(points[first], joined[~flat], colours[first])
