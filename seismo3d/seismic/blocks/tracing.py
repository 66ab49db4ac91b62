"""Fault tracing in blocks, from the first look at the cube to its surfaces."""

from __future__ import annotations

import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Progress
from seismo3d.errors import ParameterError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.blocks.plan import BlockPlan, parse_memory, plan_blocks, whole_cube_bytes
from seismo3d.seismic.blocks.results import make_result, open_result
from seismo3d.seismic.blocks.run import BlockRun, describe_source
from seismo3d.seismic.blocks.scheduling import InThisProcess, OnCluster, Scheduler
from seismo3d.seismic.blocks.sheets import chosen_faults
from seismo3d.seismic.blocks.stages import find_piece
from seismo3d.seismic.blocks.working import Worker
from seismo3d.seismic.faults import FaultSettings, build_surfaces
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.preparing import describe_volume

_MEMORY = "4GB"
BLOCKS_A_WORKER = 4
"""Blocks that each worker should have at least, so that none waits long for the others."""


def asks_for_blocks(
    cube: Any, memory: int | str | None, *, folder: str | Path | None, scheduler: str | None, whole_bytes: Any = None
) -> bool:
    """Tell whether a cube is to be worked on in blocks: it does not fit, or a cluster is asked for.

    `whole_bytes` gives, for a shape, what it takes in one piece; that of faults without it. Sections are always worked
    on in one piece.

    Raises
    ------
    ParameterError
        If there is no folder for that, or a folder and nothing that asks for blocks; if a section does not fit, or a
        scheduler is given for one.
    """
    values = cube if hasattr(cube, "dtype") else np.asarray(cube)
    describe_volume(values)
    if memory is None and scheduler is None:
        raise ParameterError("folder is given without memory or scheduler; it is for work in blocks. Add memory.")
    room, needed = read_memory(memory), (whole_bytes or whole_cube_bytes)(values.shape)
    if values.ndim == 2:
        _check_section(values.shape, room, needed, scheduler)
        return False
    if scheduler is None and needed <= room:
        return False
    if folder is None:
        raise ParameterError(
            f"cube of shape {tuple(values.shape)} is to be worked on in blocks and folder is not given; expected one "
            "for its results. Give folder, or more memory."
        )
    return True


def _check_section(shape: tuple[int, ...], room: int, needed: int, scheduler: str | None) -> None:
    if scheduler is not None:
        raise ParameterError("scheduler is given for a section; sections are worked on in one piece. Leave it out.")
    if needed > room:
        raise ParameterError(
            f"memory is {room / 1e9:.2g} GB; a section of shape {tuple(shape)} takes {needed / 1e9:.2g} GB, for it is "
            "worked on in one piece. Give more, or a part of the line."
        )


def read_memory(memory: int | str | None) -> int:
    """Return the bytes that a process may take; 4 GB where nothing is said."""
    return parse_memory(_MEMORY if memory is None else memory)


def trace_larger(
    cube: Any,
    memory: int | str | None,
    *,
    folder: str | Path | None,
    scheduler: str | None,
    settings: FaultSettings,
    progress: Progress,
) -> FaultSet:
    """Trace the faults of a cube that :func:`asks_for_blocks`, and keep its result in the folder.

    A finished run of the same input with the same settings is not done again.
    """
    cube = cube if hasattr(cube, "dtype") else np.asarray(cube)
    room = read_memory(memory)
    shape = (cube.shape[0], cube.shape[1], cube.shape[2])
    if scheduler is None:
        plan = plan_blocks(shape, room, settings)
        return trace_in_blocks(cube, plan, settings, folder=Path(str(folder)), progress=progress)
    with OnCluster(scheduler) as cluster:
        plan = plan_blocks(shape, room, settings, least_blocks=BLOCKS_A_WORKER * max(2, cluster.n_workers))
        return trace_in_blocks(cube, plan, settings, folder=Path(str(folder)), scheduler=cluster, progress=progress)


def trace_in_blocks(
    cube: Any,
    plan: BlockPlan,
    settings: FaultSettings,
    *,
    folder: Path,
    scheduler: Scheduler | None = None,
    progress: Progress,
) -> FaultSet:
    """Trace the faults of a cube in blocks; going on where an earlier run in the folder was stopped.

    Parameters
    ----------
    cube : DataArray or array
        In memory or lazy, of three axes.
    plan : BlockPlan
        The blocks; a run that was begun keeps its own.
    settings : FaultSettings
        Settings of the stages.
    folder : Path
        Gets the volumes, as Zarr, and, until all is done, what is needed to go on.
    scheduler : Scheduler, optional
        Who works on the blocks; this process without one.
    progress : callable
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    FaultSet
        Its volumes are read when they are asked for.
    """
    sampling = describe_volume(cube)
    run = BlockRun.begin(folder, plan, settings, source=describe_source(cube))
    with run.lock():
        for name in ("likelihood", "labels", "throw"):
            make_result(run, name, cube)
        Worker(run, scheduler or InThisProcess(), {"raw": find_piece(run, cube)}).run_all(progress)
        sheets, throws, today = chosen_faults(run)
    geometry = SurveyGeometry.from_cube(cube)
    progress("surfaces", 1.0)
    return FaultSet(
        surfaces=build_surfaces(sheets, throws, today, np.shape(cube), geometry, sampling),
        likelihood=open_result(run, "likelihood", cube),
        labels=open_result(run, "labels", cube),
        throw=open_result(run, "throw", cube),
        settings=asdict(settings),
    )


def forget_work(folder: Path) -> None:
    """Remove from a run's folder what was needed to go on; the results stay."""
    shutil.rmtree(folder / "work", ignore_errors=True)
