"""Both scans as voxel maps in one frame, level by level."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import GeometryError
from seismo3d.geometry.voxels import VoxelMap, check_voxel_size, survey, survey_if_finite, voxel_levels
from seismo3d.registration.matching import pool
from seismo3d.registration.quadratic import Frame
from seismo3d.scan import Scan

N_PROBES = 400
LEAST_QUALITY = 0.5
"""Median quality of the normals that the finest level must have."""
FAR = 100.0
"""Distance from the median point, over the median one, of points that are left out."""
MOST_FAR = 0.01
"""Share of the points that may be left out."""
COARSEST = 0.08
"""Least size of the coarsest voxels, in shares of the source's root mean square radius."""


@dataclass(frozen=True, slots=True, eq=False)
class DensePair:
    """Two scans ready to be matched.

    Attributes
    ----------
    frame : Frame
    target, source : list of VoxelMap
        Levels in the frame, finest first; source levels have as many as the target's.
    voxel_size : float
        Edge of the finest voxels in the input's units.
    """

    frame: Frame
    target: list[VoxelMap]
    source: list[VoxelMap]
    voxel_size: float


def prepare_pair(
    target: Scan,
    source: Scan,
    *,
    voxel_size: float | None,
    n_threads: int,
    symmetric: bool,
    target_scale: float = 1.0,
) -> DensePair:
    """Voxelise both scans on as many levels as it takes to reach coarse voxels.

    Parameters
    ----------
    target, source : Scan
    voxel_size : float or None
        Edge of the finest voxels; None takes it from the source's size and number of points.
    n_threads : int
        With more than one the scans are prepared side by side.
    symmetric : bool
        Estimate the source's normals on its finest level too.
    target_scale : float
        Size of the target's voxels over the source's: the scale between both, where it is known.
    """
    d = source.dim
    surveyed = _both(_surveyed, (target, "target"), (source, "source"), n_threads)
    (target, source), tables = zip(*surveyed)
    size = math.sqrt(tables[1][3].sum() / len(source))
    if not size > 0.0:
        raise GeometryError("all source points coincide; expected points that are apart.")
    frame = Frame(tables[1][2], tables[0][2], target_scale * size, target_scale)
    edge = default_voxel_size(len(source), d, size) if voxel_size is None else voxel_size
    for table, scale in zip(tables, (target_scale, 1.0)):
        check_voxel_size(scale * edge, float((table[1] - table[0]).max()))
    n_levels = max(1, math.ceil(math.log2(max(COARSEST * size / edge, 1.0))) + 1)

    def levels(scan: Scan, table: Float64Array, fine: str, scale: float) -> list[VoxelMap]:
        own = scale * size
        return voxel_levels(
            scan.points,
            center=table[2],
            factor=1.0 / own,
            voxel_size=edge / size,
            n_levels=n_levels,
            low=(table[0] - table[2]) / own,
            high=(table[1] - table[2]) / own,
            fine_normals=fine,
            normals=scan.normals,
            weights=scan.weights,
        )

    maps = _both(
        levels,
        (target, tables[0], "asked", target_scale),
        (source, tables[1], "all" if symmetric else "parents", 1.0),
        n_threads,
    )
    if voxel_size is None:
        skip = _too_noisy(maps[0])
        maps = (maps[0][skip:], maps[1][skip:])
        edge *= 2**skip
    return DensePair(frame, maps[0], maps[1], edge)


def _surveyed(scan: Scan, name: str) -> tuple[Scan, Float64Array]:
    """Leave out the few points that lie far off all others, such as stray returns: they would set the voxels' size.

    Far is a hundred times the median distance from the median point. What is not finite is refused. The survey of what
    stays comes with it.
    """
    some = scan.points[:: max(1, len(scan) // N_PROBES)]
    middle = np.median(some, axis=0)
    reach = FAR * float(np.median(np.linalg.norm(some - middle, axis=1)))
    table = survey_if_finite(scan.points)
    if table is None or (reach > 0.0 and ((table[0] < middle - reach) | (table[1] > middle + reach)).any()):
        scan = _without_far(scan, middle, reach)
        table = survey(scan.points, name)
    return scan, table


def _without_far(scan: Scan, middle: Float64Array, reach: float) -> Scan:
    """Leave out the points that lie farther from a place than a reach, where they are few; what is not finite stays."""
    distances = np.linalg.norm(scan.points - middle, axis=1)
    near = ~(np.isfinite(distances) & (distances > reach))
    if not reach > 0.0 or np.count_nonzero(~near) > MOST_FAR * len(scan):
        return scan
    normals, weights = (None if part is None else part[near] for part in (scan.normals, scan.weights))
    return replace(scan, points=scan.points[near], normals=normals, weights=weights)


def _too_noisy(levels: list[VoxelMap]) -> int:
    """Count the finest levels on which noise, next to the voxels' size, spoils the normals; one level always stays."""
    for skip, level in enumerate(levels[:-1]):
        rows = np.arange(0, len(level.keys), max(1, len(level.keys) // N_PROBES))
        if (level.surface[rows, 3] < 0.0).any():
            level.complete(rows)
        spanning = level.surface[rows, 3]
        if np.median(spanning) >= LEAST_QUALITY:
            return skip
    return len(levels) - 1


def default_voxel_size(n_points: int, dim: int, size: float) -> float:
    """Return voxels of a fiftieth of the scan's radius (a hundredth in the plane), larger where points are few."""
    if dim == 2:
        return max(0.01 * size, 8.0 * size / n_points)
    return max(0.02 * size, 3.0 * size / math.sqrt(n_points))


def _both(function: Callable[..., Any], first: tuple[Any, ...], second: tuple[Any, ...], n_threads: int) -> Any:
    """Call a function with two sets of arguments, side by side where there are two threads."""
    if n_threads == 1:
        return function(*first), function(*second)
    other = pool(n_threads - 1).submit(function, *first)
    own = function(*second)
    return other.result(), own
