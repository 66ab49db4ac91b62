"""The layer model of a large cube: its volumes stay on disk, and are read where a track runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Progress
from seismo3d.seismic.blocks.cleaning import read_clean
from seismo3d.seismic.blocks.layer_solve import last_stride, read_times
from seismo3d.seismic.blocks.layering import layer_larger, whole_layers_bytes
from seismo3d.seismic.blocks.layers import by_box, live_traces
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.tracing import asks_for_blocks
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.layer_time import LayerModel, check_layers_of, model_layers
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.preparing import describe_volume


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


def layers_within(
    cube: Any,
    faults: Any,
    *,
    memory: int | str | None,
    folder: str | Path | None,
    scheduler: str | None,
    settings: LayerTimeSettings,
    progress: Progress,
) -> LayerModel:
    """Return the layer model of a cube: from blocks, its volumes on disk, where it does not fit into the memory.

    Parameters and errors are those of :func:`~seismo3d.layer_time`.
    """
    check_layers_of(cube, faults)
    if not asks_for_blocks(cube, memory, folder=folder, scheduler=scheduler, whole_bytes=whole_layers_bytes):
        return model_layers(cube, faults=faults, settings=settings, progress=progress)
    run = layer_larger(
        cube, faults, memory, folder=folder, scheduler=scheduler, settings=settings, progress=progress
    )  # fmt: skip
    return open_layers(run, cube)


def open_layers(run: BlockRun, cube: Any) -> LayerModel:
    """Return the layer model of a finished run."""
    volumes: dict[str, Any] = {
        "times": StoredVolume(run, lambda box: read_times(run, box)),
        "cuts": StoredVolume(run, lambda box: run.store.read("cuts", box)),
        "volume": StoredVolume(run, lambda box: read_clean(run, box)[0]),
        "valid": StoredVolume(run, lambda box: run.store.read("valid", box)),
    }
    _, unit = describe_volume(cube)
    rejected = run.fact(f"solve_{last_stride(run.settings)}")["rejected"]
    return LayerModel(
        **volumes, live=live_traces(run), sample_unit=unit, rejected=rejected, closure=_closure(run)
    )  # fmt: skip


def _closure(run: BlockRun) -> LoopClosure:
    found, counts = run.gather("loops", "by_trace", "shifts"), run.fact("loops")
    n_loops, length = int(counts["counts"].sum()), max(run.settings.lengths)
    if not n_loops:
        return LoopClosure(float("nan"), float("nan"), 0, length, found)
    return LoopClosure(run.fact("loop_medians")["median"], counts["over"] / n_loops, n_loops, length, found)
