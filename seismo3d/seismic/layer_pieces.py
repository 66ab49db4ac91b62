"""The volumes of a layer model a part at a time: in one piece from memory, in boxes of traces from disk."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.seismic._kernels_tracks import level_depths, read_waveforms

if TYPE_CHECKING:
    from seismo3d.seismic.layer_time import LayerModel

Place = tuple[slice, slice]
"""Inlines and crosslines of a piece."""


def layer_pieces(layers: LayerModel, *names: str) -> Iterator[tuple[Place, list[AnyArray]]]:
    """Give the pieces of a layer model: where each lies, and what it has of the named volumes.

    Corners of pieces are multiples of eight traces.
    """
    volumes: list[Any] = [getattr(layers, name) for name in names]
    for at in places(layers):
        yield at, [np.asarray(volume[at]) for volume in volumes]


def places(layers: LayerModel) -> list[Place]:
    """Return where the pieces of a layer model lie."""
    return getattr(layers.times, "places", [(slice(None), slice(None))])


def find_levels(layers: LayerModel, target: Float64Array) -> Float64Array:
    """Return the fractional sample at which every trace reaches its target; NaN where it does not, or in a fault."""
    depth = np.empty(target.shape)
    for at, (times, cuts) in layer_pieces(layers, "times", "cuts"):
        level_depths(times, cuts, target[at], depth[at])
    return depth


def read_along(layers: LayerModel, depth: Float64Array, half: int) -> AnyArray:
    """Return the amplitudes from `half` samples above every depth to `half` below; 0 where there are none."""
    waves = np.empty((*depth.shape, 2 * half + 1), np.float32)
    for at, (volume, valid) in layer_pieces(layers, "volume", "valid"):
        read_waveforms(volume, valid, depth[at], half, waves[at])
    return waves
