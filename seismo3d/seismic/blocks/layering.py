"""Layer time of a cube in blocks, from the first look at it to a volume on disk."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Progress
from seismo3d.seismic.blocks.plan import BASE_BYTES, BlockPlan, layer_needs, plan_blocks
from seismo3d.seismic.blocks.results import make_result, open_result
from seismo3d.seismic.blocks.run import BlockRun, describe_source
from seismo3d.seismic.blocks.scheduling import InThisProcess, OnCluster, Piece, Scheduler
from seismo3d.seismic.blocks.stages import find_piece
from seismo3d.seismic.blocks.tracing import BLOCKS_A_WORKER, read_memory
from seismo3d.seismic.blocks.working import Worker
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.section_tracks import THICK


def whole_layers_bytes(shape: tuple[int, ...]) -> int:
    """Return the memory that a cube of this shape, or a section, takes when its layer time is found in one piece."""
    lines = THICK if len(shape) == 2 else 1
    return 80 * lines * int(np.prod(shape, dtype=np.int64)) + BASE_BYTES


def layer_larger(
    cube: Any,
    faults: Any,
    memory: int | str | None,
    *,
    folder: str | Path | None,
    scheduler: str | None,
    settings: LayerTimeSettings,
    progress: Progress,
) -> BlockRun:
    """Find the layer time of a cube that is to be worked on in blocks, and keep it in the folder.

    A finished run of the same input with the same settings is not done again.
    """
    cube = cube if hasattr(cube, "dtype") else np.asarray(cube)
    shape = (cube.shape[0], cube.shape[1], cube.shape[2])
    room, place = read_memory(memory), Path(str(folder))
    if scheduler is None:
        plan = plan_blocks(shape, room, settings, needs=layer_needs)
        return layer_in_blocks(cube, faults, plan, settings, folder=place, progress=progress)
    with OnCluster(scheduler) as cluster:
        least = BLOCKS_A_WORKER * max(2, cluster.n_workers)
        plan = plan_blocks(shape, room, settings, needs=layer_needs, least_blocks=least)
        return layer_in_blocks(cube, faults, plan, settings, folder=place, scheduler=cluster, progress=progress)


def layer_in_blocks(
    cube: Any,
    faults: Any,
    plan: BlockPlan,
    settings: LayerTimeSettings,
    *,
    folder: Path,
    scheduler: Scheduler | None = None,
    progress: Progress,
) -> BlockRun:
    """Find the layer time of a cube in blocks; going on where an earlier run in the folder was stopped.

    Parameters
    ----------
    cube : DataArray or array
        In memory or lazy, of three axes.
    faults : FaultSet or None
        Faults of this cube; only their surfaces are looked at.
    plan : BlockPlan
        The blocks; a run that was begun keeps its own.
    settings : LayerTimeSettings
        Settings of the stages.
    folder : Path
        Gets ``layer_time.zarr`` and, until it is forgotten, what is needed to go on.
    scheduler : Scheduler, optional
        Who works on the blocks; this process without one. The graph is solved by this process.
    progress : callable
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    BlockRun
        Finished.
    """
    surfaces = faults.surfaces if faults is not None else ()
    source = describe_source(cube) | {"faults": hash_surfaces(surfaces)}
    run = BlockRun.begin(folder, plan, settings, source=source, kind="layers")
    with run.lock():
        make_result(run, "layer_time", cube)
        if not run.knows("faults"):
            run.write_fact("faults", n_surfaces=len(surfaces))
        pieces: dict[str, Piece] = {"raw": find_piece(run, cube), "surfaces": lambda number: surfaces[number]}
        Worker(run, scheduler or InThisProcess(), pieces).run_all(progress)
    progress("layers", 1.0)
    return run


def open_layer_time(run: BlockRun, cube: Any) -> Any:
    """Return a finished run's layer time, lazy."""
    return open_result(run, "layer_time", cube)


def hash_surfaces(surfaces: Any) -> str:
    """Return a digest of what layer time takes of faults: their places, normals and separations."""
    digest = hashlib.sha256()
    for surface in surfaces:
        for values in (surface.vertices, surface.normals, surface.separation):
            digest.update(np.ascontiguousarray(values, dtype=np.float32).tobytes())
    return digest.hexdigest()
