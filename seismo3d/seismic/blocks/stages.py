"""The stages of fault tracing in blocks, in their order: what each works on, makes, finds and leaves behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from seismo3d.seismic.blocks import cleaning, evidence, ridges, sheets
from seismo3d.seismic.blocks.run import BlockRun


def _nothing(run: BlockRun) -> None:
    """Do nothing."""


def _always(run: BlockRun) -> bool:  # noqa: ARG001 - the signature of a condition
    return True


def _in_noise(run: BlockRun) -> bool:
    return evidence.last_attempt(run) == "far"


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage.

    Attributes
    ----------
    shown : str
        What progress calls it.
    tiling : str
        Which blocks it works on; "sheets" for one of each sheet, "" for none.
    work : callable
        Works on one block: takes the run and the block's number, and of stages that read it a piece of the input.
    make : callable
        Makes what it writes to.
    find : callable
        Finds what follows from all blocks.
    writes : tuple of str
        Arrays that it writes.
    leaves : tuple of str
        Arrays that are needed no more when it is done.
    wanted : callable
        Tells whether the cube needs it.
    """

    shown: str
    tiling: str
    work: Callable[..., None]
    find: Callable[[BlockRun], None] = _nothing
    make: Callable[[BlockRun], None] = _nothing
    writes: tuple[str, ...] = ()
    leaves: tuple[str, ...] = ()
    wanted: Callable[[BlockRun], bool] = _always

    @property
    def reads_input(self) -> bool:
        """Whether it reads the input itself."""
        return self.tiling == "raw"

    @property
    def finds(self) -> bool:
        """Whether it finds a fact, which has its name."""
        return self.find is not _nothing


def _misfit_stages(attempt: str, wanted: Callable[[BlockRun], bool]) -> dict[str, Stage]:
    return {
        f"misfit_{attempt}": Stage(
            "misfit", "misfit", partial(_attempt, evidence.misfit, attempt),
            find=partial(evidence.misfit_facts, attempt=attempt),
            make=partial(evidence.make_ratio_arrays, attempt=attempt), writes=evidence.ratio_names(attempt),
            leaves=evidence.ratio_names("near") if attempt == "far" else (), wanted=wanted,
        ),
        f"noise_{attempt}": Stage(
            "misfit", "misfit", partial(_attempt, evidence.noise, attempt),
            find=partial(evidence.noise_facts, attempt=attempt), wanted=wanted,
        ),
    }  # fmt: skip


def _attempt(work: Callable[..., None], attempt: str, run: BlockRun, number: int) -> None:
    work(run, number, attempt)


def _no_block(run: BlockRun, number: int) -> None:
    """Do nothing: the stage is about the cube as a whole."""


STAGES: dict[str, Stage] = {
    "survey": Stage("clean", "raw", cleaning.survey, find=cleaning.survey_facts),
    "pairs": Stage("clean", "raw", cleaning.pairs, find=cleaning.pairs_facts),
    "whiten": Stage(
        "clean", "raw", cleaning.whiten, find=cleaning.whiten_facts, make=cleaning.make_clean_arrays,
        writes=("white", "valid"),
    ),
    "dip": Stage(
        "dip", "dip", evidence.dip, find=evidence.dip_facts, make=evidence.make_slope_arrays, writes=("p", "q")
    ),
    **_misfit_stages("near", _always),
    **_misfit_stages("far", _in_noise),
    "moments": Stage("misfit", "evidence", evidence.moments, find=evidence.moments_facts),
    "evidence": Stage(
        "misfit", "evidence", evidence.evidence, find=evidence.evidence_facts, make=evidence.make_evidence_arrays,
        writes=("evidence0", "evidence1", "known"),
        leaves=(*evidence.ratio_names("near"), *evidence.ratio_names("far")),
    ),
    "prior": Stage("misfit", "evidence", evidence.prior, find=evidence.prior_facts),
    "medians": Stage("misfit", "evidence", evidence.medians, find=evidence.medians_facts),
    "scan": Stage(
        "scan", "scan", ridges.scan, make=ridges.make_support_arrays, writes=("score", "orientation"),
        leaves=("evidence0", "evidence1"),
    ),
    "thin": Stage("scan", "draw", ridges.thin, leaves=("score", "orientation", "known")),
    "link": Stage("link", "", _no_block, find=sheets.link_facts),
    "sides": Stage("throw", "draw", sheets.sides, find=sheets.sides_facts, leaves=("white", "valid", "p", "q")),
    "throw": Stage("throw", "sheets", sheets.throw),
    "choice": Stage("surfaces", "", _no_block, find=sheets.choice_facts),
    "draw": Stage("surfaces", "draw", sheets.draw),
}  # fmt: skip


def count_blocks(run: BlockRun, stage: str) -> int:
    """Return how many blocks a stage works on."""
    tiling = STAGES[stage].tiling
    if tiling == "sheets":
        return int(run.fact("link")["n_sheets"])
    return len(run.plan.tiling(tiling)) if tiling else 0


def producer(run: BlockRun, name: str, place: tuple[int, ...]) -> tuple[str, int]:
    """Return which stage makes an array or a record, and in which block a place of it."""
    if name in STAGES:
        return name, place[0]
    stage = next(key for key, value in STAGES.items() if name in value.writes)
    return stage, run.plan.tiling(STAGES[stage].tiling).holding(place[0], place[1])


def find_piece(run: BlockRun, cube: Any) -> Callable[[int], Any]:
    """Return what gives the piece of the input that a block needs."""

    def piece(number: int) -> Any:
        box = cleaning.raw_box(run, number)
        part = cube[box.i0 : box.i1, box.j0 : box.j1]
        return part.data if hasattr(part, "dims") else part

    return piece
