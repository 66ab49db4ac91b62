"""Correspondences and sums of one pass over the source, on any number of threads with the same result."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import AXIS_BITS, AXIS_MASK
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration import _kernels_form as form_kernels
from seismo3d.registration import _kernels_match as kernels
from seismo3d.registration import _kernels_pass as pass_kernels
from seismo3d.registration.robust import NORMAL

MOST_UNKNOWN = 0.02
"""Share of partners without a normal yet up to which a pass counts as it is."""
PART = 256
FEWEST_BLOCKS = 8
"""Blocks from which a pass is worth waking other threads for."""
PATCH = 4
LEAST_SHARE = 1e-4
"""Share of the curvature that is added to it: a patch that alone tells of a direction must not count for ever."""
NONE_GIVEN = np.empty(0, dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """What one pass over the source yields.

    Attributes
    ----------
    form : ndarray, float64
        Q of the weighted plane pairs (not divided by the weights).
    weight : float
        Sum of weights.
    cost : float
        Mean robust cost of a source point, 0 to 1; unmatched points cost 1.
    matched : float
        Share of source points with a partner.
    squares : float
        Sum of weighted squared residuals.
    slope : float
        Sum of the slopes of Tukey's influence function, with the elements' own weights.
    spread : float
        Robust standard deviation of the residuals.
    mean_square : float
        Mean square residual of the matched points.
    residuals, distances2 : ndarray of shape (n,), float32
        Signed residual along the normal and squared distance; NaN where there is no partner.
    partners : ndarray of shape (n,), int32
        Row of the target's surface, or -1.
    normals : ndarray of shape (n, 3), float32
        Direction that the residual was measured along.
    """

    form: Float64Array
    weight: float
    cost: float
    matched: float
    squares: float
    slope: float
    spread: float
    mean_square: float
    residuals: Float32Array
    distances2: Float32Array
    partners: Int32Array
    normals: Float32Array


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What passes of the same source elements over the same target have found, so that few need to search again.

    A partner is still the nearest while the element stays in its cell of the voxels and comes no nearer to all others
    than it is to its partner; the triangle inequality tells. Others that had their layers joined since are taken for
    where they were.

    Attributes
    ----------
    cells : ndarray of shape (n,), int64
        Cell that each element lay in when its partner was last searched for; -1 where none was.
    places : ndarray of shape (n, 4), float64
        Where it lay then, and the least distance from there to all target elements around but the partner.
    nearest : ndarray of shape (n,), int32
        The partner, or -1.
    """

    cells: Int64Array
    places: Float64Array
    nearest: Int32Array

    @classmethod
    def of(cls, n: int) -> Memory:
        """Return the empty memory of so many elements."""
        return cls(np.full(n, -1, dtype=np.int64), np.empty((n, 4)), np.empty(n, dtype=np.int32))


NOTHING = Memory.of(0)


@cache
def pool(n_threads: int) -> ThreadPoolExecutor:
    """Return the threads that passes run on; they are kept."""
    return ThreadPoolExecutor(n_threads, thread_name_prefix="seismo3d-register")


def match_surface(
    source: Float32Array,
    target: VoxelMap,
    A: Float64Array,
    t: Float64Array,
    *,
    radius: float,
    cutoff: float,
    least_cosine: float = 0.5,
    symmetric: bool = False,
    n_threads: int = 1,
    given: Int32Array = NONE_GIVEN,
    memory: Memory | None = None,
) -> Pass:
    """Match source elements, moved by (A, t), with the nearest target elements and gather their form.

    Parameters
    ----------
    source : ndarray of shape (n, 8), float32
        Surface elements as in :class:`~seismo3d.geometry.voxels.VoxelMap`, in the registration's frame.
    target : VoxelMap
    A, t : ndarray
        The current transform in the frame.
    radius : float
        Pairs farther apart are not made.
    cutoff : float
        Residual at which Tukey's weight reaches zero.
    least_cosine : float
        Pairs whose normals differ more are not made.
    symmetric : bool
        Measure along the mean of both normals instead of the target's.
    n_threads : int
    given : ndarray of shape (n,), int32
        Known partners; empty to search.
    memory : Memory, optional
        Of passes of the same elements over the same target.
    """
    kept = NOTHING if memory is None else memory
    found = _Found.of(len(source), t.size)
    n_blocks = len(found.sums)

    def run(first: int, last: int) -> None:
        kernels.match_blocks(
            first, last, source, A, t, target.turn, target.origin, 1.0 / target.size, target.table_keys, target.table,
            target.shift, target.surface, given, kept.cells, kept.places, kept.nearest, radius * radius, cutoff,
            least_cosine, symmetric, *found,
        )  # fmt: skip

    for _ in range(2):
        share_out(run, n_blocks, n_threads if n_blocks >= FEWEST_BLOCKS else 1)
        if _complete_partners(target, found, n_threads) <= MOST_UNKNOWN * len(source):
            break
        kept.cells[:] = -1  # elements have moved where layers were joined
    return _sum_up(found, t.size)


class _Found(NamedTuple):
    """What the kernel of a pass writes: sums of every block, and what each source element was matched with."""

    sums: Float64Array
    residuals: Float32Array
    distances2: Float32Array
    partners: Int32Array
    normals: Float32Array

    @classmethod
    def of(cls, n: int, d: int) -> _Found:
        """Return room for n elements in d dimensions."""
        return cls(
            sums=np.empty((-(-n // kernels.BLOCK), kernels.n_sums(d))),
            residuals=np.empty(n, dtype=np.float32),
            distances2=np.empty(n, dtype=np.float32),
            partners=np.empty(n, dtype=np.int32),
            normals=np.empty((n, 3), dtype=np.float32),
        )


def _complete_partners(target: VoxelMap, found: _Found, n_threads: int) -> int:
    """Find the normals of partners that have none yet; return how many these are."""
    rows = pass_kernels.rows_asked_for(found.residuals, found.partners, len(target.surface))
    if rows.size:
        parts = -(-len(rows) // PART)
        share_out(lambda a, b: target.complete(rows[a * PART : b * PART]), parts, n_threads)
    return int(rows.size)


def _sum_up(found: _Found, d: int) -> Pass:
    n = len(found.residuals)
    total, mean_square, middle = pass_kernels.sum_blocks(found.sums, found.residuals)
    weight, cost, matched, squares, slope = (float(v) for v in total[-kernels.N_EXTRA :])
    return Pass(
        form=form_kernels.unpack_planes(total[: -kernels.N_EXTRA], d),
        weight=weight,
        cost=cost / n,
        matched=matched / n,
        squares=squares,
        slope=slope,
        spread=NORMAL * middle,
        mean_square=mean_square,
        residuals=found.residuals,
        distances2=found.distances2,
        partners=found.partners,
        normals=found.normals,
    )


def share_out(run: Callable[[int, int], object], n_parts: int, n_threads: int) -> None:
    """Run parts 0 to n_parts - 1 in ranges, one range a thread."""
    if n_threads == 1 or n_parts < 4:
        run(0, n_parts)
        return
    edges = [n_parts * k // n_threads for k in range(n_threads + 1)]
    others = [pool(n_threads - 1).submit(run, a, b) for a, b in pairwise(edges[1:]) if b > a]
    if edges[1] > 0:
        run(edges[0], edges[1])
    for other in others:
        other.result()


def surface_meat(seen: Pass, source: Float32Array, target: VoxelMap, cutoff: float, J: Float64Array) -> Float64Array:
    """Return the covariance of the form's half gradient, from sums of residuals over patches of the target.

    Neighbouring residuals share the noise of target elements and of normals: patches of ``PATCH`` voxels' width are
    taken as independent of each other, single residuals are not.

    Parameters
    ----------
    seen : Pass
    source : ndarray of shape (n, 8), float32
        The elements of that pass.
    target : VoxelMap
    cutoff : float
        Of that pass.
    J : ndarray of shape (d(d+1), m), float64
        From the model's parameters to [vec(A); t].

    Returns
    -------
    ndarray of the form's shape
    """
    clusters = _patches(target, seen.partners)
    n, m = J.shape
    curvature = J.T @ seen.form[:n, :n] @ J
    ridge = LEAST_SHARE * float(np.trace(curvature))
    meat = kernels.clustered_scores(
        source,
        target.surface,
        seen.residuals,
        seen.partners,
        seen.normals,
        cutoff,
        clusters,
        int(clusters.max()) + 1,
        J,
        np.asarray(np.linalg.inv(curvature + ridge * np.eye(m)), dtype=np.float64),
    )
    back = np.linalg.pinv(J)
    out = np.zeros_like(seen.form)
    out[:n, :n] = back.T @ meat @ back
    return out


def _patches(target: VoxelMap, partners: Int32Array) -> Int32Array:
    """Return the number of the patch that each partner lies in; 0 where there is none."""
    keys = target.keys[partners]
    x, y, z = keys >> (2 * AXIS_BITS), (keys >> AXIS_BITS) & AXIS_MASK, keys & AXIS_MASK
    patches = ((x // PATCH) << (2 * AXIS_BITS)) | ((y // PATCH) << AXIS_BITS) | (z // PATCH)
    return np.unique(patches, return_inverse=True)[1].astype(np.int32)
