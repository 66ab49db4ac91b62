"""A run in blocks taken through its stages; blocks that are found damaged are computed again."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from seismo3d._typing import Progress
from seismo3d.errors import FileAccessError
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.scheduling import InThisProcess, Piece, Scheduler
from seismo3d.seismic.blocks.stages import Stage, count_blocks, producer, stages_of
from seismo3d.seismic.blocks.store import DamagedBlock

# how often one block may be found damaged before the disk is blamed
_MOST_REPAIRS = 3


class Worker:
    """Takes a run through its stages, and has blocks that are found damaged computed again.

    Parameters
    ----------
    run : BlockRun
        The run.
    scheduler : Scheduler
        Who works on the blocks.
    pieces : mapping of str to callable
        What gives the input, by the tiling of the stages that read it.
    """

    def __init__(self, run: BlockRun, scheduler: Scheduler, pieces: Mapping[str, Piece]) -> None:
        self._run, self._scheduler, self._pieces = run, scheduler, pieces
        self._stages = stages_of(run)
        self._repairs: dict[tuple[str, int], int] = {}

    def run_all(self, progress: Progress) -> None:
        """Bring all stages to their end."""
        for stage in self._stages:
            self.run_stage(stage, progress)

    def run_stage(self, stage: str, progress: Progress) -> None:
        """Bring a stage to its end, unless it is there."""
        run, described = self._run, self._stages[stage]
        found = run.knows(stage) or not described.finds
        if (run.knows(f"done_{stage}") and found) or not described.wanted(run):
            return
        progress(described.shown, 0.0)
        described.make(run)
        self._work(stage, progress)
        self._repairing(lambda: described.find(run), again=lambda: self._work(stage, progress))
        run.write_fact(f"done_{stage}")
        # also what was made again since, to repair a block
        run.store.remove(
            *(name for key in self._stages if run.knows(f"done_{key}") for name in self._stages[key].leaves)
        )

    def _piece(self, described: Stage) -> Piece | None:
        return self._pieces[described.tiling] if described.reads_input else None

    def _work(self, stage: str, progress: Progress) -> None:
        """Work on the blocks that are not done."""
        run, described = self._run, self._stages[stage]
        n_blocks = count_blocks(run, stage)
        while todo := sorted(set(range(n_blocks)) - run.done(stage)):
            n_done = n_blocks - len(todo)
            for _, damage in self._scheduler.work(run, stage, todo, self._piece(described)):
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
        described = self._stages[stage]
        if not described.tiling:
            described.forget(run)
            self._repairing(lambda: described.find(run), again=lambda: None)
            return
        run.forget_part(stage, number)
        described.make(run)
        piece = self._piece(described)
        while number not in run.done(stage):
            for _, deeper in InThisProcess().work(run, stage, [number], piece):
                if deeper is not None:
                    self._repair(deeper)
