"""Correspondences by projection: where the target is a depth image, the partner is what the pixel shows."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import AXIS_BITS, find
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration.quadratic import Frame
from seismo3d.scan import Raster


@dataclass(frozen=True, slots=True, eq=False)
class PixelTable:
    """The target's surface element that each pixel of its image shows, on one level.

    Attributes
    ----------
    elements : ndarray of shape (rows, columns), int32
        Rows of the level's surface; -1 where a pixel has no depth.
    camera : PinholeCamera
    frame : Frame
    """

    elements: Int32Array
    camera: PinholeCamera
    frame: Frame

    def partners(
        self, source: Float32Array, target: Float32Array, A: Float64Array, t: Float64Array, radius: float
    ) -> Int32Array:
        """Return each source element's partner: what its pixel shows, -1 where that is farther than a radius.

        Parameters
        ----------
        source, target : ndarray of shape (n, 8), float32
            Surface elements, in the registration's frame.
        A, t : ndarray
            The current transform in the frame.
        radius : float
        """
        moved = source[:, :3].astype(np.float64) @ A.T + t
        pixels = self.camera.project(moved * self.frame.size + self.frame.target_center)
        rows, columns = self.elements.shape
        inside = (pixels > -0.5).all(axis=1) & (pixels[:, 0] < columns - 0.5) & (pixels[:, 1] < rows - 0.5)
        out = np.full(len(source), -1, dtype=np.int32)
        column, row = np.rint(pixels[inside]).astype(np.int64).T
        out[inside] = self.elements[row, column]
        hit = np.flatnonzero(out >= 0)
        offsets = target[out[hit], :3] - moved[hit]
        out[hit[(offsets**2).sum(axis=1) > radius * radius]] = -1
        return out


def pixel_tables(raster: Raster, frame: Frame, levels: list[VoxelMap]) -> list[PixelTable] | None:
    """Return the table of each level, finest first; None where the raster is no depth image of a camera."""
    if raster.points is None or raster.camera is None:
        return None
    shape = raster.points.shape[:2]
    elements = np.empty(shape[0] * shape[1], dtype=np.int32)
    finest = levels[0]
    _look_up(
        raster.points.reshape(-1, 3),
        frame.target_center,
        1.0 / frame.size,
        finest.turn,
        finest.origin,
        1.0 / finest.size,
        finest.table_keys,
        finest.table,
        finest.shift,
        elements,
    )
    tables = [PixelTable(elements.reshape(shape), raster.camera, frame)]
    for level in levels[:-1]:
        if level.parents is not None:
            elements = np.where(elements >= 0, level.parents[elements], -1).astype(np.int32)
            tables.append(PixelTable(elements.reshape(shape), raster.camera, frame))
    return tables


@nb.njit(cache=True, nogil=True)
def _look_up(
    points: Float64Array,
    center: Float64Array,
    factor: float,
    turn: Float64Array,
    origin: Float64Array,
    inverse_size: float,
    table_keys: Int64Array,
    table: Int32Array,
    shift: int,
    out: Int32Array,
) -> None:
    """Write the number of the voxel that each point lies in, -1 for NaN and where there is none."""
    for i in range(points.shape[0]):
        out[i] = -1
        p, q, r = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        x = ((turn[0, 0] * p + turn[0, 1] * q + turn[0, 2] * r) * factor - origin[0]) * inverse_size
        y = ((turn[1, 0] * p + turn[1, 1] * q + turn[1, 2] * r) * factor - origin[1]) * inverse_size
        z = ((turn[2, 0] * p + turn[2, 1] * q + turn[2, 2] * r) * factor - origin[2]) * inverse_size
        if x >= 0.0 and y >= 0.0 and z >= 0.0:
            key = (np.int64(x) << (2 * AXIS_BITS)) | (np.int64(y) << AXIS_BITS) | np.int64(z)
            out[i] = find(key, table_keys, table, shift)
