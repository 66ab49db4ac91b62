"""Sheets in blocks: linked from the whole cube's ridges, their sides read and drawn block by block."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic.blocks.evidence import final_noise, thinned_shape
from seismo3d.seismic.blocks.results import write_result
from seismo3d.seismic.blocks.ridges import gather_ridges
from seismo3d.seismic.blocks.room import OnDisk
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.sheet_parts import Around, join_parts, note_blocks, pack, read_parts, rows_near, unpack
from seismo3d.seismic.blocks.slopes import estimate_block
from seismo3d.seismic.choosing import choose_faults
from seismo3d.seismic.doubles import part_doubles
from seismo3d.seismic.faults import find_candidates, finish_throws, largest_first, measure_moving
from seismo3d.seismic.flanks import join_flanks
from seismo3d.seismic.layer_strain import LayerSlopes, join_slopes, sample_slopes
from seismo3d.seismic.placing import place_sheet, read_profile
from seismo3d.seismic.rasterise import draw_sheets
from seismo3d.seismic.sheet_tips import continue_sheet
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import (
    SheetSides,
    SheetThrow,
    farther_off,
    gather_sides,
    mask_sheets,
)

# rows of a sheet around a block, so that what is interpolated there does not see the cut
_SPARE_ROWS = 4


def link_facts(run: BlockRun) -> None:
    """Link the whole cube's ridges into sheets that may be faults."""
    ratio, _ = final_noise(run)
    room = OnDisk(run.work / "ridges")
    strong, weak = gather_ridges(run, room)
    sheets = find_candidates(strong, weak, thinned_shape(run), ratio, run.settings, room=room)
    room.remove()
    run.write_fact("link", n_sheets=len(sheets), **pack("sheet", sheets))


def make_beside_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`beside` writes to."""
    for name in ("beside_p", "beside_q"):
        run.store.make(name, run.plan.shape, np.float32)


def beside(run: BlockRun, number: int) -> None:
    """Estimate a block's slopes without what lies on the sheets."""
    box = run.plan.tiling("dip").box(number)
    sheets, width = linked_sheets(run), run.settings.throw.beside
    _, valid, slopes = estimate_block(
        run, box, leave_out=lambda valid, corner: mask_sheets(sheets, valid, beside=width, corner=corner)
    )
    for name, slope in zip(("beside_p", "beside_q"), slopes, strict=True):
        run.store.write(name, box, slope)
    layers = sample_slopes(slopes, valid, sheets, run.plan.shape, corner=(box.i0, box.j0))
    run.write_part("beside", number, {"points": layers.points, "slopes": layers.slopes}, meta=layers.voxels)


def _joined_slopes(run: BlockRun) -> LayerSlopes:
    """Return the slopes that were kept of all blocks."""
    parts = (run.read_part("beside", number) for number in range(len(run.plan.tiling("dip"))))
    return join_slopes([LayerSlopes(found["points"], found["slopes"], voxels) for found, voxels in parts])


def profiles(run: BlockRun, number: int) -> None:
    """Read the traces on both sides of every sheet where it passes through a block."""
    settings = run.settings

    def read(around: Around, _place: int, part: Sheet, w: Float32Array) -> tuple[Float32Array, BoolArray]:
        return read_profile(
            around.volume, around.valid, around.slopes, part, throw=settings.throw, settings=settings.place, w=w,
            corner=around.corner,
        )  # fmt: skip

    read_parts(run, "profiles", number, linked_sheets(run), read)


def profiles_facts(run: BlockRun) -> None:
    """Note which blocks each sheet passes through."""
    note_blocks(run, "profiles", count_sheets(run))


def place(run: BlockRun, number: int) -> None:
    """Move a sheet to where the layers on its two sides break."""
    sheet, settings = linked_sheets(run)[number], run.settings.place
    values, known = join_parts(run, "profiles", sheet, number, 2 * settings.reach + 1)
    run.write_part("place", number, pack("sheet", [place_sheet(sheet, values, known, settings=settings)]))


def place_facts(run: BlockRun) -> None:
    """Gather the sheets where they lie, one of two that are flanks of one fault."""
    parts = [run.read_part("place", number)[0] for number in range(count_sheets(run))]
    sheets = [unpack("sheet", part, Sheet)[0] for part in parts]
    if 1 not in run.plan.shape[:2]:
        sheets = join_flanks(sheets, run.settings.choice, settings=run.settings.flank)
    run.write_fact("place", n_sheets=len(sheets), **pack("sheet", sheets))


def sides(run: BlockRun, number: int) -> None:
    """Read both sides of every sheet, of its continuation beyond its ends, and close to it, in a block."""
    settings, sheets = run.settings.throw, placed_sheets(run)
    beyond = [continue_sheet(sheet, run.plan.shape[2]) for sheet in sheets]

    def read(around: Around, place: int, part: Sheet, w: Float32Array) -> tuple[Float32Array, BoolArray]:
        close = place >= 2 * len(sheets)
        off = farther_off(sheets[place % len(sheets)], settings, close=close)
        both, known, tilts = gather_sides(
            around.volume, around.valid, around.slopes, part, settings=settings, w=w, off=off, corner=around.corner
        )
        return np.concatenate([both, tilts]), np.concatenate([known, known]) > 0.0

    read_parts(run, "sides", number, [*sheets, *beyond, *sheets], read)


def sides_facts(run: BlockRun) -> None:
    """Note which blocks each of them passes through."""
    note_blocks(run, "sides", 3 * count_placed(run))


def throw(run: BlockRun, number: int) -> None:
    """Find the throw of a sheet, and where it ends."""
    sheet = placed_sheets(run)[number]
    ratio, _ = final_noise(run)
    sides = _joined_sides(run, sheet, number)
    beyond = _joined_sides(run, continue_sheet(sheet, run.plan.shape[2]), number + count_placed(run))
    moving, measured = measure_moving(sheet, sides, beyond, run.plan.shape, ratio, run.settings)
    run.write_part("throw", number, {**pack("sheet", [moving]), **pack("throw", [measured])})


def _joined_sides(run: BlockRun, sheet: Sheet, number: int) -> SheetSides:
    """Return both sides of a sheet."""
    values, known = join_parts(run, "sides", sheet, number, 4)
    return SheetSides(values[:2], known[:2].astype(np.float32), values[2:])


def choice_facts(run: BlockRun) -> None:
    """Choose the sheets that are faults, each place of one once, and measure what they threw when they moved."""
    moving, is_section = [], 1 in run.plan.shape[:2]
    for number in range(count_placed(run)):
        part, _ = run.read_part("throw", number)
        moving.append((unpack("sheet", part, Sheet)[0], unpack("throw", part, SheetThrow)[0]))
    numbers, candidates = choose_faults(moving, run.settings.choice.for_size(run.plan.shape)), placed_sheets(run)
    sheets, today = [moving[number][0] for number in numbers], [moving[number][1] for number in numbers]
    today, throws = finish_throws(
        sheets, today,
        lambda n: _joined_sides(run, candidates[numbers[n]], numbers[n] + 2 * count_placed(run)), _joined_slopes(run),
        run.settings, is_section=is_section,
    )  # fmt: skip
    if not is_section:
        sheets, throws, today = part_doubles(sheets, throws, today, run.settings.choice)
    sheets, throws, today = largest_first(sheets, throws, today, run.plan.shape)
    run.write_fact("choice", **pack("sheet", sheets), **pack("throw", throws), **pack("today", today))


def chosen_faults(run: BlockRun) -> tuple[list[Sheet], list[SheetThrow], list[SheetThrow]]:
    """Return the sheets that are faults, their throws when they moved, and what lies apart today."""
    throws, today = (unpack(name, run.fact("choice"), SheetThrow) for name in ("throw", "today"))
    return unpack("sheet", run.fact("choice"), Sheet), throws, today


def count_sheets(run: BlockRun) -> int:
    """Return how many sheets may be faults, as they were linked."""
    return int(run.fact("link")["n_sheets"])


def count_placed(run: BlockRun) -> int:
    """Return how many of them there are where they lie."""
    return int(run.fact("place")["n_sheets"])


def linked_sheets(run: BlockRun) -> list[Sheet]:
    """Return the sheets that may be faults, as they were linked."""
    return unpack("sheet", run.fact("link"), Sheet)


def placed_sheets(run: BlockRun) -> list[Sheet]:
    """Return the sheets that may be faults, each where the layers on its two sides break."""
    return unpack("sheet", run.fact("place"), Sheet)


def draw(run: BlockRun, number: int) -> None:
    """Draw the faults into a block."""
    box = run.plan.tiling("draw").box(number)
    sheets, throws, _ = chosen_faults(run)
    drawn: list[tuple[Sheet, SheetThrow]] = []
    for sheet, measured in zip(sheets, throws, strict=True):
        rows = rows_near(sheet, box, run.plan.shape)
        # nodes halfway between two rows round to the even one: a cut must not change which is even
        first = 0 if rows is None else max(0, rows[0] - _SPARE_ROWS) // 2 * 2
        last = 1 if rows is None else rows[1] + _SPARE_ROWS
        cut = slice(first, last)
        emptied = np.full_like(sheet.w[cut], np.nan) if rows is None else sheet.w[cut]
        drawn.append(
            (
                replace(sheet, first_s=sheet.first_s + first, w=emptied, score=sheet.score[cut]),
                replace(measured, throw=measured.throw[cut], fit=measured.fit[cut]),
            )
        )
    labels, thrown = draw_sheets(
        [sheet for sheet, _ in drawn], [measured for _, measured in drawn], (*box.shape, run.plan.shape[2]),
        corner=(box.i0, box.j0),
    )  # fmt: skip
    write_result(run, "labels", box, labels)
    write_result(run, "throw", box, thrown)
    run.write_part("draw", number, {})
