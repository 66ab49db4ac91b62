"""The stages of work in blocks, in their order: what each works on, makes, finds and leaves behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from seismo3d.seismic.blocks import cleaning, evidence, layer_solve, layer_times, layers, registering, ridges, sheets
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.faults import FaultSettings
from seismo3d.seismic.layer_graph import LayerTimeSettings


def _nothing(run: BlockRun) -> None:
    """Do nothing."""


def _always(run: BlockRun) -> bool:  # noqa: ARG001 - the signature of a condition
    return True


def _counts(run: BlockRun, attempt: str) -> bool:
    return attempt in (name for name, _ in evidence.attempts(run))


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage.

    Attributes
    ----------
    shown : str
        What progress calls it.
    tiling : str
        Which blocks it works on; "sheets" for one of each sheet, "placed" of each where it lies, "surfaces" of each
        surface given, "" for none.
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
    reads_input : bool
        Whether it reads the input itself: a piece of the cube, or a surface.
    forget : callable
        Forgets, of a stage without blocks, what it came to on its way.
    """

    shown: str
    tiling: str
    work: Callable[..., None]
    find: Callable[[BlockRun], None] = _nothing
    make: Callable[[BlockRun], None] = _nothing
    writes: tuple[str, ...] = ()
    leaves: tuple[str, ...] = ()
    wanted: Callable[[BlockRun], bool] = _always
    reads_input: bool = False
    forget: Callable[[BlockRun], None] = _nothing

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


_CLEANING = {
    "survey": Stage("clean", "raw", cleaning.survey, find=cleaning.survey_facts, reads_input=True),
    "strengths": Stage("clean", "raw", cleaning.strengths, find=cleaning.strengths_facts, reads_input=True),
    "pairs": Stage("clean", "raw", cleaning.pairs, find=cleaning.pairs_facts, reads_input=True),
    "whiten": Stage(
        "clean", "raw", cleaning.whiten, find=cleaning.whiten_facts, make=cleaning.make_clean_arrays,
        writes=("white", "valid"), reads_input=True,
    ),
}  # fmt: skip


def _first_misfits() -> dict[str, Stage]:
    return {**_misfit_stages("near", _always), **_misfit_stages("far", partial(_counts, attempt="far"))}


def _registering_stages(wanted: Callable[[BlockRun], bool]) -> dict[str, Stage]:
    return {
        "register": Stage(
            "misfit", "register", registering.register, find=registering.register_facts,
            make=registering.make_field_arrays, writes=registering.FIELDS, wanted=wanted,
        ),
        "usual": Stage("misfit", "register", registering.USUAL.count_near, find=registering.usual_facts, wanted=wanted),
        "carry": Stage(
            "misfit", "carry", registering.carry, make=registering.make_side_arrays, writes=registering.SIDES,
            leaves=registering.FIELDS, wanted=wanted,
        ),
    }  # fmt: skip


def _fault_stages(settings: FaultSettings) -> dict[str, Stage]:
    # what a second way of carrying the sides takes comes after the noise that tells whether it counts
    second = partial(_counts, attempt="second")
    measured = {
        "semblance": _first_misfits(),
        "registration": {**_registering_stages(_always), **_first_misfits()},
        "both": {**_first_misfits(), **_registering_stages(second), **_misfit_stages("second", second)},
    }[settings.evidence]
    return {
        **_CLEANING,
        "dip": Stage(
            "dip", "dip", evidence.dip, find=evidence.dip_facts, make=evidence.make_slope_arrays, writes=("p", "q")
        ),
        **measured,
        "moments": Stage(
            "misfit", "moments", evidence.moments, find=evidence.moments_facts, make=evidence.make_bridged_arrays,
            writes=("bridged0", "bridged1", "known", "present"),
            leaves=(*sum(map(evidence.ratio_names, ("near", "far", "second")), ()), *registering.SIDES),
        ),
        "evidence": Stage(
            "misfit", "evidence", evidence.evidence, find=evidence.evidence_facts, make=evidence.make_evidence_arrays,
            writes=("evidence0", "evidence1"), leaves=("bridged0", "bridged1"),
        ),
        "prior": Stage("misfit", "evidence", evidence.prior, find=evidence.prior_facts),
        "medians": Stage("misfit", "evidence", evidence.PRIOR.count_near, find=evidence.medians_facts),
        "scan": Stage(
            "scan", "scan", ridges.scan, make=ridges.make_support_arrays, writes=("score", "orientation"),
            leaves=("evidence0", "evidence1", "present"),
        ),
        "thin": Stage("scan", "draw", ridges.thin, leaves=("score", "orientation", "known")),
        "link": Stage("link", "", _no_block, find=sheets.link_facts),
        "beside": Stage(
            "throw", "dip", sheets.beside, make=sheets.make_beside_arrays, writes=("beside_p", "beside_q"),
            leaves=("p", "q"),
        ),
        "profiles": Stage("throw", "draw", sheets.profiles, find=sheets.profiles_facts),
        "place": Stage("throw", "sheets", sheets.place, find=sheets.place_facts),
        "sides": Stage(
            "throw", "draw", sheets.sides, find=sheets.sides_facts, leaves=("white", "valid", "beside_p", "beside_q")
        ),
        "throw": Stage("throw", "placed", sheets.throw),
        "choice": Stage("surfaces", "", _no_block, find=sheets.choice_facts),
        "draw": Stage("surfaces", "draw", sheets.draw),
    }  # fmt: skip


def _layer_stages(run: BlockRun) -> dict[str, Stage]:
    settings: LayerTimeSettings = run.settings
    fields = layers.field_names(settings)
    before, solving = "", {}
    for stride in settings.strides:
        rounds = range(layer_solve.count_rounds(settings, stride))
        solving[f"solve_{stride}"] = Stage(
            "solve", "", _no_block, find=partial(layer_solve.solve, stride=stride),
            writes=tuple(layer_solve.values_name(stride, n) for n in rounds),
            leaves=(before,) if before else (), forget=partial(layer_solve.forget_rounds, stride=stride),
        )  # fmt: skip
        before = layer_solve.values_name(stride, rounds[-1])
    return {
        **_CLEANING,
        "slopes": Stage(
            "dip", "dip", layers.slopes, find=layers.slopes_facts, make=layers.make_slope_arrays, writes=("p", "q")
        ),
        "grids": Stage("faults", "surfaces", layers.grids, find=layers.grids_facts, reads_input=True),
        "cut": Stage("faults", "fill", layers.cut, make=layers.make_cut_arrays, writes=("cuts", "breaks")),
        "shifts": Stage(
            "shifts", "shifts", layers.shifts, find=layers.shifts_facts, make=layers.make_shift_arrays, writes=fields,
            leaves=("p", "q"),
        ),
        "usual": Stage("shifts", "shifts", layers.USUAL.count_near, find=layers.usual_facts),
        "match": Stage("throw", "surfaces", layers.match),
        "loops": Stage("loops", "shifts", layer_solve.loops, find=layer_solve.loops_facts),
        "loop_medians": Stage("loops", "shifts", layer_solve.LOOPS.count_near, find=layer_solve.loop_medians_facts),
        **solving,
        "datum": Stage("layers", "", _no_block, find=layer_times.datum_facts, leaves=fields),
        "levels": Stage(
            "levels", "", _no_block, find=layer_times.levels_facts, writes=layer_times.level_names(run),
            forget=layer_times.forget_levels,
        ),
        "fill": Stage("layers", "fill", layer_times.fill),
    }  # fmt: skip


def stages_of(run: BlockRun) -> dict[str, Stage]:
    """Return the stages of a run, by name, in their order."""
    return _layer_stages(run) if run.kind == "layers" else _fault_stages(run.settings)


def count_blocks(run: BlockRun, stage: str) -> int:
    """Return how many blocks a stage works on."""
    tiling = stages_of(run)[stage].tiling
    if tiling == "sheets":
        return sheets.count_sheets(run)
    if tiling == "placed":
        return sheets.count_placed(run)
    if tiling == "surfaces":
        return int(run.fact("faults")["n_surfaces"])
    return len(run.plan.tiling(tiling)) if tiling else 0


def producer(run: BlockRun, name: str, place: tuple[int, ...]) -> tuple[str, int]:
    """Return which stage makes an array or a record, and in which block a place of it; 0 of a stage without blocks."""
    stages = stages_of(run)
    if name in stages:
        return name, place[0]
    stage = next(key for key, value in stages.items() if name in value.writes)
    tiling = stages[stage].tiling
    return stage, run.plan.tiling(tiling).holding(place[0], place[1]) if tiling else 0


def find_piece(run: BlockRun, cube: Any) -> Callable[[int], Any]:
    """Return what gives the piece of the input that a block needs."""

    def piece(number: int) -> Any:
        box = cleaning.raw_box(run, number)
        part = cube[box.i0 : box.i1, box.j0 : box.j1]
        return part.data if hasattr(part, "dims") else part

    return piece
