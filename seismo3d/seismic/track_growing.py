"""The parts of a layer once they are placed: kept on their own side of faults, and carried on up to them."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, Float64Array, IntArray
from seismo3d.seismic._kernels_growing import grow_layer, part_moved, read_levels
from seismo3d.seismic.layer_pieces import layer_pieces, places
from seismo3d.seismic.layer_time import LayerModel

# farthest that a layer lies from the trace before, in samples
_REACH = 6


def keep_sides(layers: LayerModel, before: Float64Array, after: Float64Array) -> None:
    """Leave out, in place, what was moved past a fault or off the cube; crossings of shape (n, inline, crossline)."""
    for at, (cuts,) in layer_pieces(layers, "cuts"):
        for one, other in zip(before, after, strict=True):
            part_moved(cuts, one[at], other[at])
    last = layers.times.shape[2] - 1
    after[~((after >= -0.5) & (after <= last + 0.5))] = np.nan


def grow_parts(layers: LayerModel, depth: Float64Array, parts: IntArray) -> tuple[Float64Array, IntArray]:
    """Carry every part of a layer on, at the layer time where it was placed, to the traces that it lacks.

    Layer time that is off on one side of a fault lets a layer leave the cube, or end at the fault, too early; what its
    part was moved by tells how far off it is.

    Parameters
    ----------
    layers : LayerModel
        Of the cube.
    depth : ndarray of shape (inline, crossline), float64
        Fractional sample; NaN where there is none.
    parts : ndarray of the same shape, int
        Part that a trace belongs to; -1 where there is none.

    Returns
    -------
    depth, parts : ndarray
        The same with the traces that were reached.
    """
    depth, parts = depth.copy(), parts.copy()
    level, ahead = np.full(depth.shape, np.nan), np.zeros(depth.shape, np.uint8)
    for at, (times, cuts) in layer_pieces(layers, "times", "cuts"):
        read_levels(times, cuts, depth[at], level[at], ahead[at])
    maps = (depth, level, ahead, parts)
    while _grow_once(layers, maps):
        pass
    return depth, parts


def _grow_once(layers: LayerModel, maps: tuple[Float64Array, Float64Array, AnyArray, IntArray]) -> int:
    """Carry a layer on by one trace; return to how many. Pieces that it cannot reach are not read."""
    before = tuple(m.copy() for m in maps)
    known = np.isfinite(before[0])
    wanted = ndimage.binary_dilation(known) & ~known & layers.live
    count = 0
    for at in places(layers):
        if wanted[at].any():
            times, cuts = (np.asarray(volume[at]) for volume in (layers.times, layers.cuts))
            corner = (at[0].start or 0, at[1].start or 0)
            count += grow_layer(times, cuts, corner, wanted, _REACH, before, maps)
    return count
