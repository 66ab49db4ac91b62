"""Blocks whose slices are registered with the next, and the shifts of each side of their traces."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float32Array
from seismo3d.seismic.blocks.cleaning import read_clean
from seismo3d.seismic.blocks.medians import BlockMedians
from seismo3d.seismic.blocks.order import positive_lines
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.shifts import ShiftField, judge_misfits
from seismo3d.seismic.side_shifts import (
    SideShifts,
    carry_reach,
    carry_sides,
    match_reach,
    match_slices,
)

_KINDS = ("shift", "variance", "misfit")
FIELDS = tuple(f"{kind}{axis}" for axis in range(2) for kind in _KINDS)
"""Arrays of the shifts to the next inline and crossline."""
SIDES = tuple(f"{side}{axis}" for axis in range(2) for side in ("behind", "ahead"))
"""Arrays of the shifts of each side."""


def _read_misfits(run: BlockRun, box: Box) -> list[list[Float32Array]]:
    return [positive_lines(run.store.read(f"misfit{axis}", box)) for axis in range(2)]


USUAL = BlockMedians("register", "usual", "register", _read_misfits)
"""The misfits that registration usually leaves along inlines and crosslines."""


def make_field_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`register` writes to."""
    _make(run, FIELDS)


def make_side_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`carry` writes to."""
    _make(run, SIDES)


def register(run: BlockRun, number: int) -> None:
    """Register a block's slices; their misfits are ratios, not yet judged."""
    settings = run.settings.registration
    box = run.plan.tiling("register").box(number)
    reach = match_reach(settings)
    wide = box.grown((reach, reach), run.plan.shape)
    volume, valid = read_clean(run, wide)
    floor = np.float32(run.fact("dip")["matching"])
    misfits = []
    for found in match_slices(volume, valid, floor=floor, settings=settings, within=box.within(wide)):
        for kind in _KINDS:
            run.store.write(f"{kind}{found.axis}", box, getattr(found, kind))
        misfits.append(positive_lines(found.misfit))
    run.write_part("register", number, USUAL.count(misfits))


def register_facts(run: BlockRun) -> None:
    """Find where the median misfits lie, roughly."""
    run.write_fact("register", **USUAL.locate(run))


def usual_facts(run: BlockRun) -> None:
    """Find the usual misfits."""
    run.write_fact("usual", misfits=USUAL.find(run))


def carry(run: BlockRun, number: int) -> None:
    """Average the shifts of either side of a block's traces."""
    settings = run.settings.registration
    box = run.plan.tiling("carry").box(number)
    reach = carry_reach(settings)
    wide = box.grown((reach, reach), run.plan.shape)
    for axis in range(2):
        shift, variance, misfit = (run.store.read(f"{kind}{axis}", wide) for kind in _KINDS)
        found = ShiftField(axis, 1, shift, variance, misfit)
        judge_misfits(found, run.fact("usual")["misfits"][axis], settings.shifts)
        sides = carry_sides(found, settings=settings, within=box.within(wide))
        run.store.write(f"behind{axis}", box, sides.behind)
        run.store.write(f"ahead{axis}", box, sides.ahead)
    run.write_part("carry", number, {})


def read_sides(run: BlockRun, box: Box) -> list[SideShifts]:
    """Return the shifts of each side of a box's traces, along both axes."""
    step = run.settings.registration.shifts.step
    return [
        SideShifts(run.store.read(f"behind{axis}", box), run.store.read(f"ahead{axis}", box), step) for axis in range(2)
    ]


def _make(run: BlockRun, names: tuple[str, ...]) -> None:
    n0, n1, n2 = run.plan.shape
    for name in names:
        run.store.make(name, (n0, n1, -(-n2 // run.settings.registration.shifts.step)), np.float32)
