"""Volumes of a run in blocks that are read from disk where they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float64Array
from seismo3d.seismic.blocks.cleaning import read_clean
from seismo3d.seismic.blocks.layers import by_box, live_traces
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.run import BlockRun


class StoredVolume:
    """A volume of a finished run, read from disk when it is asked for.

    It takes a trace's two indices, two slices, or arrays of the three indices of single samples.

    Parameters
    ----------
    run : BlockRun
        The run.
    read : callable
        Gives a box of the volume.
    """

    def __init__(self, run: BlockRun, read: Callable[[Box], AnyArray]) -> None:
        self._tiling, self._read = run.plan.tiling("fill"), read
        self.shape = run.plan.shape
        self.places = [(slice(box.i0, box.i1), slice(box.j0, box.j1)) for box in self._tiling]

    def __getitem__(self, key: tuple[Any, ...]) -> AnyArray:
        if len(key) == 3:
            return self._read_samples(*key)
        spans = [
            slice(int(part), int(part) + 1) if isinstance(part, int | np.integer) else slice(*part.indices(n)[:2])
            for part, n in zip(key, self.shape[:2], strict=True)
        ]
        found = self._read(Box(spans[0].start, spans[0].stop, spans[1].start, spans[1].stop))
        return found[tuple(0 if isinstance(part, int | np.integer) else slice(None) for part in key)]

    def _read_samples(self, *at: AnyArray) -> AnyArray:
        indices = np.broadcast_arrays(*at)
        i, j, k = (np.asarray(index).ravel() for index in indices)
        found: AnyArray | None = None
        for box, chosen in by_box(self._tiling, np.stack([i, j], axis=1), np.ones(len(i), bool)):
            part = self._read(box)
            if found is None:
                found = np.zeros(len(i), part.dtype)
            found[chosen] = part[i[chosen] - box.i0, j[chosen] - box.j0, k[chosen]]
        return np.zeros(indices[0].shape) if found is None else found.reshape(indices[0].shape)


@dataclass(frozen=True, slots=True, eq=False)
class StoredVolumes:
    """What a layer model has of volumes, on disk, its live traces and the spectrum of its wavelet."""

    times: StoredVolume
    cuts: StoredVolume
    volume: StoredVolume
    valid: StoredVolume
    live: BoolArray
    spectrum: Float64Array | None

    @classmethod
    def of(cls, run: BlockRun, read_times: Callable[[Box], AnyArray]) -> StoredVolumes:
        """Return the volumes of a run; its layer time is read as is said."""
        return cls(
            StoredVolume(run, read_times),
            StoredVolume(run, lambda box: run.store.read("cuts", box)),
            StoredVolume(run, lambda box: read_clean(run, box)[0]),
            StoredVolume(run, lambda box: run.store.read("valid", box)),
            live_traces(run),
            run.fact("pairs").get("spectrum"),
        )
