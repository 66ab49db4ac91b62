"""The layer model of a large cube: its volumes stay on disk, and are read where a track runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seismo3d._typing import Progress
from seismo3d.seismic.blocks.layer_solve import last_stride
from seismo3d.seismic.blocks.layer_times import read_times
from seismo3d.seismic.blocks.layering import layer_larger, whole_layers_bytes
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.stored_volume import StoredVolumes
from seismo3d.seismic.blocks.tracing import asks_for_blocks
from seismo3d.seismic.cube_checks import check_cube
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.layer_time import LayerModel, model_layers
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.preparing import describe_volume


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
    check_cube(cube, faults)
    if not asks_for_blocks(cube, memory, folder=folder, scheduler=scheduler, whole_bytes=whole_layers_bytes):
        return model_layers(cube, faults=faults, settings=settings, progress=progress)
    run = layer_larger(
        cube, faults, memory, folder=folder, scheduler=scheduler, settings=settings, progress=progress
    )  # fmt: skip
    return open_layers(run, cube)


def open_layers(run: BlockRun, cube: Any) -> LayerModel:
    """Return the layer model of a finished run."""
    stored = StoredVolumes.of(run, lambda box: read_times(run, box))
    _, unit = describe_volume(cube)
    rejected = run.fact(f"solve_{last_stride(run.settings)}")["rejected"]
    names = ("times", "cuts", "volume", "valid", "live", "spectrum")
    volumes: dict[str, Any] = {name: getattr(stored, name) for name in names}
    level = float(run.fact("survey")["level"])
    return LayerModel(**volumes, sample_unit=unit, rejected=rejected, closure=_closure(run), level=level)


def _closure(run: BlockRun) -> LoopClosure:
    found, counts = run.gather("loops", "by_trace", "shifts"), run.fact("loops")
    n_loops, length = int(counts["counts"].sum()), max(run.settings.lengths)
    if not n_loops:
        return LoopClosure(float("nan"), float("nan"), 0, length, found)
    return LoopClosure(run.fact("loop_medians")["median"], counts["over"] / n_loops, n_loops, length, found)
