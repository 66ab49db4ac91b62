"""Fault tracing in blocks, from the first look at the cube to its surfaces."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Progress
from seismo3d.errors import FileAccessError, ParameterError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.blocks.plan import BlockPlan, parse_memory, plan_blocks, whole_cube_bytes
from seismo3d.seismic.blocks.results import make_result, open_result
from seismo3d.seismic.blocks.run import BlockRun, describe_source
from seismo3d.seismic.blocks.scheduling import InThisProcess, OnCluster, Piece, Scheduler
from seismo3d.seismic.blocks.sheets import chosen_faults
from seismo3d.seismic.blocks.stages import STAGES, count_blocks, find_piece, producer
from seismo3d.seismic.blocks.store import DamagedBlock
from seismo3d.seismic.faults import FaultSettings, build_surfaces
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.preparing import describe_volume

# how often one block may be found damaged before the disk is blamed
_MOST_REPAIRS = 3


_MEMORY = "4GB"
# blocks that each worker should have at least, so that none waits long for the others
_BLOCKS_A_WORKER = 4


def asks_for_blocks(cube: Any, memory: int | str | None, *, folder: str | Path | None, scheduler: str | None) -> bool:
    """Tell whether a cube is to be worked on in blocks: it does not fit, or a cluster is asked for.

    Raises
    ------
    ParameterError
        If there is no folder for that, or a folder and nothing that asks for blocks.
    """
    values = cube if hasattr(cube, "dtype") else np.asarray(cube)
    describe_volume(values)
    if memory is None and scheduler is None:
        raise ParameterError("folder is given without memory or scheduler; it is for work in blocks. Add memory.")
    room = parse_memory(_MEMORY if memory is None else memory)
    if values.ndim == 2 or (scheduler is None and whole_cube_bytes(values.shape) <= room):
        return False
    if folder is None:
        raise ParameterError(
            f"cube of shape {tuple(values.shape)} is to be worked on in blocks and folder is not given; expected one "
            "for its results. Give folder, or more memory."
        )
    return True


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
    room = parse_memory(_MEMORY if memory is None else memory)
    shape = (cube.shape[0], cube.shape[1], cube.shape[2])
    if scheduler is None:
        plan = plan_blocks(shape, room, settings)
        return trace_in_blocks(cube, plan, settings, folder=Path(str(folder)), progress=progress)
    with OnCluster(scheduler) as cluster:
        plan = plan_blocks(shape, room, settings, least_blocks=_BLOCKS_A_WORKER * max(2, cluster.n_workers))
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
        worker = _Worker(run, scheduler or InThisProcess(), find_piece(run, cube))
        for stage in STAGES:
            worker.run_stage(stage, progress)
        sheets, throws = chosen_faults(run)
    geometry = SurveyGeometry.from_cube(cube)
    progress("surfaces", 1.0)
    return FaultSet(
        surfaces=build_surfaces(sheets, throws, geometry, sampling),
        likelihood=open_result(run, "likelihood", cube),
        labels=open_result(run, "labels", cube),
        throw=open_result(run, "throw", cube),
        settings={**asdict(settings), "evidence": "semblance"},
    )


def forget_work(folder: Path) -> None:
    """Remove from a run's folder what was needed to go on; the results stay."""
    shutil.rmtree(folder / "work", ignore_errors=True)


class _Worker:
    """Takes a run through its stages, and has blocks that are found damaged computed again."""

    def __init__(self, run: BlockRun, scheduler: Scheduler, piece: Piece) -> None:
        self._run, self._scheduler, self._piece = run, scheduler, piece
        self._repairs: dict[tuple[str, int], int] = {}

    def run_stage(self, stage: str, progress: Progress) -> None:
        """Bring a stage to its end, unless it is there."""
        run, described = self._run, STAGES[stage]
        found = run.knows(stage) or not described.finds
        if (run.knows(f"done_{stage}") and found) or not described.wanted(run):
            return
        progress(described.shown, 0.0)
        described.make(run)
        self._work(stage, progress)
        self._repairing(lambda: described.find(run), again=lambda: self._work(stage, progress))
        run.write_fact(f"done_{stage}")
        # also what was made again since, to repair a block
        run.store.remove(*(name for key in STAGES if run.knows(f"done_{key}") for name in STAGES[key].leaves))

    def _work(self, stage: str, progress: Progress) -> None:
        """Work on the blocks that are not done."""
        run, described = self._run, STAGES[stage]
        n_blocks = count_blocks(run, stage)
        while todo := sorted(set(range(n_blocks)) - run.done(stage)):
            n_done = n_blocks - len(todo)
            for _, damage in self._scheduler.work(run, stage, todo, self._piece if described.reads_input else None):
                if damage is not None:
                    self._repair(damage)
                    continue
                n_done += 1
                progress(described.shown, n_done / n_blocks)

    def _repairing(self, find: Callable[[], None], *, again: Callable[[], None]) -> None:
        """Do something about the whole cube; where it meets a damaged block, have that computed again first."""
        while True:
            try:
                find()
            except DamagedBlock as damage:
                self._repair(damage)
                again()
            else:
                return

    def _repair(self, damage: DamagedBlock) -> None:
        """Compute a damaged block again, and first what that needs."""
        run = self._run
        stage, number = producer(run, damage.name, damage.place)
        self._repairs[stage, number] = self._repairs.get((stage, number), 0) + 1
        if self._repairs[stage, number] > _MOST_REPAIRS:
            raise FileAccessError(
                f"{run.work}: {damage}, again after it was computed anew. Check the disk, or take another folder."
            )
        described = STAGES[stage]
        run.forget_part(stage, number)
        described.make(run)
        piece = self._piece if described.reads_input else None
        while number not in run.done(stage):
            for _, deeper in InThisProcess().work(run, stage, [number], piece):
                if deeper is not None:
                    self._repair(deeper)
