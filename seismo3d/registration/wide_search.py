"""Where the loop starts from afar: elements to look at, and partners at any distance."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration.matching import Pass, match_surface, share_out

PART = 256
"""Elements that a thread searches for at a time."""
NEAR_SHARE = 0.5
"""Share of elements with a partner within half a voxel from which the start counts as near."""
LEAST_HOLD = 0.25
"""Share of what elements hold along each direction that those with a partner must have: a wall of three can be lost."""
LEAST_SPANNED = 0.02
"""Share of the largest hold below which all elements together do not span a direction: there is nothing to lose."""


def draw(surface: Float32Array, most: int) -> Float32Array:
    """Return at most so many elements, every k-th of them."""
    stride = -(-len(surface) // most)
    return surface if stride == 1 else np.ascontiguousarray(surface[::stride])


def is_far(target: VoxelMap, source: Float32Array, A: Float64Array, t: Float64Array) -> bool:
    """Return whether most source elements have no partner within half a voxel."""
    seen = match_surface(source, target, A, t, radius=0.5 * target.size, cutoff=target.size, least_cosine=0.7)
    return seen.matched < NEAR_SHARE


def is_loose(seen: Pass, source: Float32Array, size: float) -> bool:
    """Return whether source elements have lost their hold along some direction in a pass over voxels of a size.

    Where one of three walls lies outside the reach of the search, most elements slide along the other two and have
    partners; that nothing holds across the lost one shows in the normals: those of elements with a partner within half
    a voxel miss a direction that those of all elements span.
    """
    normals = source[:, 4:7].astype(np.float64)
    weights = np.maximum(source[:, 3], 0.0) * source[:, 7]
    lost = np.where(seen.distances2 < (0.5 * size) ** 2, 0.0, weights)
    values, vectors = np.linalg.eigh((normals * weights[:, None]).T @ normals)
    roots = vectors / np.sqrt(np.maximum(values, LEAST_SPANNED * max(values[-1], 1e-300)))
    shares = np.linalg.eigvalsh(roots.T @ (normals * lost[:, None]).T @ normals @ roots)
    return bool(shares[-1] > 1.0 - LEAST_HOLD)


class WideSearch:
    """Nearest elements on the coarsest level at any distance, within a radius that shrinks by schedule.

    Parameters
    ----------
    target : VoxelMap
    source : ndarray of shape (n, 8), float32
    keeps_all : bool
        Take no pair within the radius for an outlier, and set the radius by elements without a near partner alone:
        next to a majority that slides freely, what holds looks like an outlier.
    n_threads : int
        Threads to search on.
    """

    def __init__(self, target: VoxelMap, source: Float32Array, *, keeps_all: bool, n_threads: int = 1) -> None:
        from scipy.spatial import cKDTree

        self._source = source[:, : target.dim].astype(np.float64)
        self._tree: Any = cKDTree(target.surface[:, : target.dim].astype(np.float64))
        self._size = target.size
        self._n_threads = n_threads
        self.keeps_all = keeps_all

    def partners(self, A: Float64Array, t: Float64Array, iteration: int) -> tuple[Int32Array, float]:
        """Return each source element's partner, -1 beyond the radius, and the radius."""
        moved = self._source @ A.T + t
        distances, rows = np.empty(len(moved)), np.empty(len(moved), dtype=np.int32)

        def search(first: int, last: int) -> None:
            some = slice(first * PART, last * PART)
            distances[some], rows[some] = self._tree.query(moved[some])

        share_out(search, -(-len(moved) // PART), self._n_threads)
        off = distances[distances > 0.5 * self._size] if self.keeps_all else distances
        middle = float(np.median(off)) if off.size else 0.0
        radius = max(3.0 * middle, 1.5 * self._size) * 0.95**iteration
        rows[distances > radius] = -1
        return rows, radius
