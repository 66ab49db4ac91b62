"""Where the loop starts from afar: elements to look at, and partners at any distance."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration.matching import match_surface

NEAR_SHARE = 0.5
"""Share of elements with a partner within half a voxel from which the start counts as near."""


def draw(surface: Float32Array, most: int) -> Float32Array:
    """Return at most so many elements, every k-th of them."""
    stride = -(-len(surface) // most)
    return surface if stride == 1 else np.ascontiguousarray(surface[::stride])


def is_far(target: VoxelMap, source: Float32Array, A: Float64Array, t: Float64Array) -> bool:
    """Return whether most source elements have no partner within half a voxel."""
    seen = match_surface(source, target, A, t, radius=0.5 * target.size, cutoff=target.size, least_cosine=0.7)
    return seen.matched < NEAR_SHARE


class WideSearch:
    """Nearest elements on the coarsest level at any distance, within a radius that shrinks by schedule."""

    def __init__(self, target: VoxelMap, source: Float32Array) -> None:
        from scipy.spatial import cKDTree

        self._source = source[:, : target.dim].astype(np.float64)
        self._tree: Any = cKDTree(target.surface[:, : target.dim].astype(np.float64))
        self._size = target.size

    def partners(self, A: Float64Array, t: Float64Array, iteration: int) -> tuple[Int32Array, float]:
        """Return each source element's partner, -1 beyond the radius, and the radius."""
        distances, rows = self._tree.query(self._source @ A.T + t)
        radius = max(3.0 * float(np.median(distances)), 1.5 * self._size) * 0.95**iteration
        rows = rows.astype(np.int32)
        rows[distances > radius] = -1
        return rows, radius
