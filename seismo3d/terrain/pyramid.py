"""Two maps on levels of halved resolution, with everything that a fit needs of each."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import GeometryError
from seismo3d.geometry.map_grid import MapGrid
from seismo3d.terrain._kernels_align import block_means
from seismo3d.terrain.fitting import Level, measure_slopes

LEAST_SIDE = 24
"""Rows or columns below which a map is not halved again."""


def make_levels(target: Float64Array, here: MapGrid, source: Float64Array, there: MapGrid) -> list[Level]:
    """Return the levels of a pair, finest first; the finer map is first brought near the other's cell size.

    Parameters
    ----------
    target, source : ndarray of shape (rows, columns), float64
        Elevations, NaN where unknown.
    here, there : MapGrid
        Where they lie.
    """
    ratio = here.cell_m / there.cell_m
    if ratio >= 1.5:
        source, there = reduce_map(source, there, round(ratio))
    elif ratio <= 1.0 / 1.5:
        target, here = reduce_map(target, here, round(1.0 / ratio))
    middle = (0.5 * (here.shape[1] - 1), 0.5 * (here.shape[0] - 1))
    origin = here.to_map([middle])[0]
    levels = []
    while True:
        levels.append(_make_level(target, here, source, there, origin))
        if min(*target.shape, *source.shape) < 2 * LEAST_SIDE:
            return levels
        target, here = reduce_map(target, here, 2)
        source, there = reduce_map(source, there, 2)


def reduce_map(z: Float64Array, grid: MapGrid, factor: int) -> tuple[Float64Array, MapGrid]:
    """Return the means of blocks of cells and their grid; a block of which less than a quarter is known is unknown."""
    made = grid.reduced(factor)
    if min(made.shape) < 4:
        raise GeometryError(
            f"a map of {grid.shape} cells covers fewer than 4 x 4 cells of the other map; expected maps of like extent."
        )
    out = np.empty(made.shape)
    block_means(z, factor, max(1, factor * factor // 4), out)
    return out, made


def _make_level(
    target: Float64Array, here: MapGrid, source: Float64Array, there: MapGrid, origin: Float64Array
) -> Level:
    steps = here.steps_m
    gx, gy = measure_slopes(target, steps)
    centre = here.to_places([origin])[0]
    metres = np.array(here.metres_per_unit)
    corners = there.to_places(origin + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) / metres)
    to_source = np.eye(3)
    to_source[:2] = np.column_stack([corners[1] - corners[0], corners[2] - corners[0], corners[0]])
    half = 0.5 * max(here.shape) * here.cell_m
    return Level(target, gx, gy, source, steps, centre, to_source, half)
