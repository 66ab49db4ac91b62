"""The volumes of a layer model a part at a time: in one piece from memory, in boxes of traces from disk."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array
from seismo3d.seismic._kernels_tracks import cross_levels, read_layers, read_runs

CROSSINGS = 3
"""How often a trace may cross one layer."""

Place = tuple[slice, slice]
"""Inlines and crosslines of a piece."""
Waves = tuple[Float32Array, Float32Array]
"""Amplitudes of shape (inline, crossline, 2 half + 1), and where they are known."""


class LayerVolumes(Protocol):
    """What is read piece by piece: the volumes of a :class:`~seismo3d.seismic.layer_time.LayerModel`."""

    @property
    def times(self) -> Any:
        """Layer time, in samples."""

    @property
    def cuts(self) -> Any:
        """Where faults pass between voxels."""

    @property
    def volume(self) -> Any:
        """Amplitudes."""

    @property
    def valid(self) -> Any:
        """Where there are any."""

    @property
    def live(self) -> BoolArray:
        """Traces with data."""

    @property
    def spectrum(self) -> Float64Array | None:
        """Amplitude spectrum of the wavelet."""


def layer_pieces(layers: LayerVolumes, *names: str) -> Iterator[tuple[Place, list[AnyArray]]]:
    """Give the pieces of a layer model: where each lies, and what it has of the named volumes.

    Corners of pieces are multiples of eight traces.
    """
    volumes: list[Any] = [getattr(layers, name) for name in names]
    for at in places(layers):
        yield at, [np.asarray(volume[at]) for volume in volumes]


def places(layers: LayerVolumes) -> list[Place]:
    """Return where the pieces of a layer model lie."""
    return getattr(layers.times, "places", [(slice(None), slice(None))])


def neighbours(axis: int) -> tuple[Place, Place]:
    """Return where a map has the traces that have a next one along an axis, and where it has these next ones."""
    first, second = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
    return (first, second) if axis == 0 else (first[::-1], second[::-1])


def find_levels(layers: LayerVolumes, target: Float64Array, beyond: float) -> Float64Array:
    """Return the fractional samples, from above, at which every live trace reaches its target; NaN for those it lacks.

    The first axis holds the `CROSSINGS` of a trace. They may lie up to `beyond` samples off the cube.
    """
    crossings = np.empty((CROSSINGS, *target.shape))
    for at, (times, cuts) in layer_pieces(layers, "times", "cuts"):
        cross_levels(times, cuts, target[at], np.float32(beyond), crossings[(slice(None), *at)])
    crossings[:, ~layers.live] = np.nan
    return crossings


def read_around(layers: LayerVolumes, depth: Float64Array, half: int, *, clear: int = 0) -> Waves:
    """Return the amplitudes up to `half` samples from every depth, and 1 where there are any, on its side of faults.

    Within `clear` samples of a fault none count.
    """
    waves, known = _room(depth, half)
    for at, (volume, valid, cuts) in layer_pieces(layers, "volume", "valid", "cuts"):
        read_runs(volume, valid, cuts, depth[at], half, clear, waves[at], known[at])
    return waves, known


def read_along(layers: LayerVolumes, depth: Float64Array, half: int) -> Waves:
    """Return the same at every unit of layer time up to `half` before and after every depth's."""
    waves, known = _room(depth, half)
    for at, (volume, valid, times, cuts) in layer_pieces(layers, "volume", "valid", "times", "cuts"):
        read_layers(volume, valid, times, cuts, depth[at], half, waves[at], known[at])
    return waves, known


def _room(depth: Float64Array, half: int) -> Waves:
    return np.empty((*depth.shape, 2 * half + 1), np.float32), np.empty((*depth.shape, 2 * half + 1), np.float32)
