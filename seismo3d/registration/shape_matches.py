"""Poses of one bare scan against another from local shape, without a start: descriptors, matches, votes."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int64Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration import _kernels_shape as kernels

N_DRAWS = 200_000
MAX_POSES = 20_000
BEST = 3
"""Nearest descriptors that a source element is matched with."""


def poses_by_shape(
    target: VoxelMap, source: VoxelMap, *, radii: tuple[float, float], n_poses: int, seed: int = 0
) -> list[tuple[Float64Array, Float64Array]]:
    """Return the likeliest poses (A, t) of the source, best first, no two alike.

    Parameters
    ----------
    target, source : VoxelMap
        A level of a thousand or a few thousand elements.
    radii : tuple of float
        Of the descriptors, in voxels: what lies farther does not disturb, noise counts for less the more lies within.
    n_poses : int
        Most poses to return.
    seed : int
        Of the draws; the answer is the same for the same seed.

    Returns
    -------
    list of (A, t)
        In the maps' frame; empty where shapes do not tell.
    """
    rows_t, table_t = describe(target, radii)
    rows_s, table_s = describe(source, radii)
    if len(rows_t) < 8 or len(rows_s) < 8:
        return []
    pairs = match_descriptors(table_t, table_s)
    if len(pairs) < 8:
        return []
    q, nq = _columns(target.surface, rows_t[pairs[:, 0]])
    p, np_ = _columns(source.surface, rows_s[pairs[:, 1]])
    rng = np.random.default_rng(seed)
    draws = rng.integers(0, len(pairs), size=(N_DRAWS, 2))
    out = np.empty((MAX_POSES, 12))
    votes = np.zeros(MAX_POSES, dtype=np.int64)
    extent = float(np.linalg.norm(np.ptp(p, axis=0)))
    tolerance = 1.5 * target.size
    found = kernels.poses_from_pairs(q, p, nq, np_, draws, tolerance, 0.08 * extent, target.dim, out, votes)
    return _distinct(out[:found], votes[:found], n_poses, 3.0 * target.size, target.dim)


def describe(level: VoxelMap, radii: tuple[float, float], most: int = 4000) -> tuple[Int64Array, Float32Array]:
    """Return the rows of the elements that lie on a surface, and their descriptors; at most so many elements."""
    from scipy.spatial import cKDTree

    surface = level.surface
    rows = np.flatnonzero(surface[:, 3] > 0.1)
    rows = rows[:: max(1, -(-len(rows) // most))]
    tree: Any = cKDTree(surface[:, :3].astype(np.float64))
    tables = []
    for radius in radii:
        reach = radius * level.size
        near = tree.query_ball_point(surface[rows, :3].astype(np.float64), reach)
        counts = np.array([len(n) for n in near], dtype=np.int64)
        starts = np.concatenate([[0], np.cumsum(counts)])
        flat = np.concatenate([np.asarray(n, dtype=np.int64) for n in near]) if len(near) else np.zeros(0, np.int64)
        table = np.empty((len(rows), kernels.LENGTH), dtype=np.float32)
        kernels.shape_descriptors(surface, rows, starts, flat, reach, table)
        tables.append(table)
    return rows, np.hstack(tables)


def match_descriptors(target: Float32Array, source: Float32Array) -> Int64Array:
    """Return pairs (row of target, row of source): the few nearest of each source row, mutual ones among them first."""
    products = source @ target.T
    distances = (target**2).sum(axis=1)[None, :] - 2.0 * products
    k = min(BEST, target.shape[0])
    near = np.argpartition(distances, k - 1, axis=1)[:, :k]
    back = np.argmin((source**2).sum(axis=1)[:, None] - 2.0 * products, axis=0)
    rows = np.repeat(np.arange(len(source)), k)
    forward = np.stack([near.ravel(), rows], axis=1)
    backward = np.stack([np.arange(len(target)), back], axis=1)
    return np.unique(np.vstack([forward, backward]), axis=0).astype(np.int64)


def _columns(surface: Float32Array, rows: Int64Array) -> tuple[Float64Array, Float64Array]:
    return surface[rows, :3].astype(np.float64), surface[rows, 4:7].astype(np.float64)


def _distinct(
    poses: Float64Array, votes: Int64Array, most: int, distance: float, dim: int
) -> list[tuple[Float64Array, Float64Array]]:
    kept: list[tuple[Float64Array, Float64Array]] = []
    for row in np.argsort(-votes, kind="stable"):
        R, t = poses[row, :9].reshape(3, 3), poses[row, 9:]
        is_new = all(
            np.linalg.norm(t[:dim] - other_t) > distance or np.trace(R[:dim, :dim] @ other.T) < (dim - 0.06)
            for other, other_t in kept
        )
        if is_new:
            kept.append((np.ascontiguousarray(R[:dim, :dim]), t[:dim].copy()))
            if len(kept) == most:
                break
    return kept
