"""Sheets in blocks: linked from the whole cube's ridges, their sides read and drawn block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, IntArray
from seismo3d.seismic.blocks.cleaning import read_clean
from seismo3d.seismic.blocks.evidence import final_noise, thinned_shape
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.results import write_result
from seismo3d.seismic.blocks.ridges import gather_ridges, least_scores
from seismo3d.seismic.blocks.room import OnDisk
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.slopes import estimate_block
from seismo3d.seismic.choosing import choose_faults, end_where_still
from seismo3d.seismic.faults import draw_sheets, find_candidates, finish_throws
from seismo3d.seismic.linking import Sheet
from seismo3d.seismic.placing import place_sheet, read_profile
from seismo3d.seismic.throw import (
    SheetThrow,
    every_sample,
    farther_off,
    gather_sides,
    mask_sheets,
    match_sides,
    side_reach,
)

# rows of a sheet around a block, so that what is interpolated there does not see the cut
_SPARE_ROWS = 4


def link_facts(run: BlockRun) -> None:
    """Link the whole cube's ridges into sheets that may be faults."""
    ratio, _ = final_noise(run)
    room = OnDisk(run.work / "ridges")
    strong, weak = (gather_ridges(run, room, least) for least in least_scores(run))
    sheets = find_candidates(strong, weak, thinned_shape(run), ratio, run.settings, room=room)
    room.remove()
    run.write_fact("link", n_sheets=len(sheets), **_packed("sheet", sheets))


def make_beside_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`beside` writes to."""
    for name in ("beside_p", "beside_q"):
        run.store.make(name, run.plan.shape, np.float32)


def beside(run: BlockRun, number: int) -> None:
    """Estimate a block's slopes without what lies on the sheets."""
    box = run.plan.tiling("dip").box(number)
    sheets, width = run_sheets(run), run.settings.throw.beside
    _, _, slopes = estimate_block(
        run, box, leave_out=lambda valid, corner: mask_sheets(sheets, valid, beside=width, corner=corner)
    )
    for name, slope in zip(("beside_p", "beside_q"), slopes, strict=True):
        run.store.write(name, box, slope)
    run.write_part("beside", number, {})


def sides(run: BlockRun, number: int) -> None:
    """Read both sides of every sheet where it passes through a block."""
    settings, sheets = run.settings.throw, run_sheets(run)

    def read(around: _Around, place: int, part: Sheet, w: Float32Array) -> tuple[Float32Array, BoolArray]:
        off = farther_off(sheets[place], settings)
        both, known = gather_sides(
            around.volume, around.valid, around.slopes, part, settings=settings, w=w, off=off, corner=around.corner
        )
        return both, known > 0.0

    _read_parts(run, "sides", number, sheets, read)


def profiles(run: BlockRun, number: int) -> None:
    """Read the traces on both sides of every fault where it passes through a block."""
    settings = run.settings

    def read(around: _Around, _place: int, part: Sheet, w: Float32Array) -> tuple[Float32Array, BoolArray]:
        return read_profile(
            around.volume, around.valid, around.slopes, part, throw=settings.throw, settings=settings.place, w=w,
            corner=around.corner,
        )  # fmt: skip

    _read_parts(run, "profiles", number, _unpacked("sheet", run.fact("choice"), Sheet), read)


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """What lies in and around a block."""

    volume: Float32Array
    valid: BoolArray
    slopes: tuple[Float32Array, Float32Array]
    corner: tuple[int, int]


def _read_parts(
    run: BlockRun,
    stage: str,
    number: int,
    sheets: list[Sheet],
    read: Callable[[_Around, int, Sheet, Float32Array], tuple[Float32Array, BoolArray]],
) -> None:
    """Leave behind what is read, and where it is known, along every sheet where it passes through a block."""
    box = run.plan.tiling("draw").box(number)
    wide = box.grown((side_reach(run.settings.throw),) * 2, run.plan.shape)
    arrays: dict[str, AnyArray] = {}
    around: _Around | None = None
    for place, sheet in enumerate(sheets):
        found = _cut(sheet, box, run.plan.shape)
        if found is None:
            continue
        part, w, rows, columns = found
        if around is None:
            slopes = run.store.read("beside_p", wide), run.store.read("beside_q", wide)
            around = _Around(*read_clean(run, wide), slopes, (wide.i0, wide.j0))
        values, known = read(around, place, part, w)
        arrays |= {f"{place}.at": np.array([rows, columns]), f"{place}.values": values, f"{place}.known": known}
    run.write_part(stage, number, arrays)


def sides_facts(run: BlockRun) -> None:
    """Note which blocks each sheet passes through."""
    _note_blocks(run, "sides", int(run.fact("link")["n_sheets"]))


def profiles_facts(run: BlockRun) -> None:
    """Note which blocks each fault passes through."""
    _note_blocks(run, "profiles", count_faults(run))


def _note_blocks(run: BlockRun, stage: str, n_sheets: int) -> None:
    found: list[list[int]] = [[] for _ in range(n_sheets)]
    for number in range(len(run.plan.tiling("draw"))):
        for place in run.list_part(stage, number, "at"):
            found[int(place)].append(number)
    run.write_fact(stage, blocks=found)


def throw(run: BlockRun, number: int) -> None:
    """Find the throw of a sheet, and where it ends."""
    sheet = run_sheets(run)[number]
    both, known = _joined_sides(run, sheet, number)
    measured = match_sides(sheet, both, known, settings=run.settings.throw)
    ratio, _ = final_noise(run)
    ended = end_where_still(sheet, measured, run.settings.choice, noise=ratio)
    run.write_part("throw", number, {**_packed("sheet", [ended[0]]), **_packed("throw", [ended[1]])})


def _joined(run: BlockRun, stage: str, sheet: Sheet, number: int, n_traces: int) -> tuple[Float32Array, BoolArray]:
    """Return what was read along a sheet, and where it is known, from the blocks that it passes through."""
    shape = (n_traces, *every_sample(sheet).shape)
    values, known = np.zeros(shape, np.float32), np.zeros(shape, bool)
    for block in run.fact(stage)["blocks"][number]:
        part, _ = run.read_part(stage, block, prefix=f"{number}.")
        (row, column), read = part[f"{number}.at"], part[f"{number}.known"]
        at = np.s_[:, row : row + read.shape[1], column : column + read.shape[2]]
        values[at][read] = part[f"{number}.values"][read]
        known[at][read] = True
    return values, known


def _joined_sides(run: BlockRun, sheet: Sheet, number: int) -> tuple[Float32Array, Float32Array]:
    """Return both sides of a sheet, and where they are known."""
    both, known = _joined(run, "sides", sheet, number, 2)
    return both, known.astype(np.float32)


def choice_facts(run: BlockRun) -> None:
    """Choose the sheets that are faults, and measure what they threw when they moved."""
    moving = []
    for number in range(run.fact("link")["n_sheets"]):
        part, _ = run.read_part("throw", number)
        moving.append((_unpacked("sheet", part, Sheet)[0], _unpacked("throw", part, SheetThrow)[0]))
    numbers, candidates = choose_faults(moving, run.settings.choice), run_sheets(run)
    sheets, today = [moving[number][0] for number in numbers], [moving[number][1] for number in numbers]
    throws = finish_throws(
        sheets, today,
        lambda n: _joined_sides(run, candidates[numbers[n]], numbers[n]), run.settings,
        is_section=1 in run.plan.shape[:2],
    )  # fmt: skip
    run.write_fact(
        "choice",
        n_faults=len(sheets),
        **_packed("sheet", sheets),
        **_packed("throw", throws),
        **_packed("today", today),
    )


def place(run: BlockRun, number: int) -> None:
    """Move a fault to where the layers on its two sides break."""
    sheet = _unpacked("sheet", run.fact("choice"), Sheet)[number]
    settings = run.settings.place
    values, known = _joined(run, "profiles", sheet, number, 2 * settings.reach)
    run.write_part("place", number, _packed("sheet", [place_sheet(sheet, values, known, settings=settings)]))


def place_facts(run: BlockRun) -> None:
    """Gather the faults where they lie."""
    parts = [run.read_part("place", number)[0] for number in range(count_faults(run))]
    run.write_fact("place", **_packed("sheet", [_unpacked("sheet", part, Sheet)[0] for part in parts]))


def count_faults(run: BlockRun) -> int:
    """Return how many sheets are faults."""
    return int(run.fact("choice")["n_faults"])


def chosen_faults(run: BlockRun) -> tuple[list[Sheet], list[SheetThrow], list[SheetThrow]]:
    """Return the sheets that are faults, their throws when they moved, and what lies apart today."""
    throws, today = (_unpacked(name, run.fact("choice"), SheetThrow) for name in ("throw", "today"))
    return _unpacked("sheet", run.fact("place"), Sheet), throws, today


def run_sheets(run: BlockRun) -> list[Sheet]:
    """Return the sheets that may be faults."""
    return _unpacked("sheet", run.fact("link"), Sheet)


def draw(run: BlockRun, number: int) -> None:
    """Draw the faults into a block."""
    box = run.plan.tiling("draw").box(number)
    sheets, throws, _ = chosen_faults(run)
    drawn: list[tuple[Sheet, SheetThrow]] = []
    for sheet, measured in zip(sheets, throws, strict=True):
        rows = _rows_near(sheet, box, run.plan.shape)
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


def _places(sheet: Sheet, w: Float32Array) -> tuple[AnyArray, AnyArray]:
    """Return the inlines and crosslines of nodes at every row, NaN off the sheet."""
    s = (sheet.first_s + np.arange(len(w)))[:, None]
    inline, crossline = (sheet.origin[d] + s * sheet.along[d] + w * sheet.across[d] for d in range(2))
    return inline, crossline


def _rows_near(sheet: Sheet, box: Box, shape: tuple[int, ...]) -> tuple[int, int] | None:
    """Return the first row of a sheet that comes near a box, and the one after the last; None where none does."""
    known = np.isfinite(sheet.w)
    if not known.any():
        return None
    with np.errstate(invalid="ignore"):
        low = np.where(known, sheet.w, np.inf).min(axis=1)
        high = np.where(known, sheet.w, -np.inf).max(axis=1)
    filled = known.any(axis=1)
    low, high = np.where(filled, low, 0.0), np.where(filled, high, 0.0)
    ends = [_places(sheet, np.stack([low, high], axis=1))[d] for d in range(2)]
    near = filled.copy()
    for place, first, last, n in zip(ends, (box.i0, box.j0), (box.i1, box.j1), shape[:2], strict=True):
        near &= (first == 0) | (place.max(axis=1) > first - 2)
        near &= (last == n) | (place.min(axis=1) < last + 1)
    rows: IntArray = np.flatnonzero(near)
    return (int(rows[0]), int(rows[-1]) + 1) if len(rows) else None


def _cut(sheet: Sheet, box: Box, shape: tuple[int, ...]) -> tuple[Sheet, Float32Array, int, int] | None:
    """Return the part of a sheet whose nodes lie in a box, its position at every sample, and where it begins."""
    rows = _rows_near(sheet, box, shape)
    if rows is None:
        return None
    first, last = max(0, rows[0] - 1), min(len(sheet.w), rows[1] + 1)
    part = replace(sheet, first_s=sheet.first_s + first, w=sheet.w[first:last], score=sheet.score[first:last])
    w = every_sample(part)
    inline, crossline = _places(part, w)
    with np.errstate(invalid="ignore"):
        # what lies beyond the cube belongs to the block beside it
        i = np.clip(np.floor(inline + 0.5), 0, shape[0] - 1)
        j = np.clip(np.floor(crossline + 0.5), 0, shape[1] - 1)
        inside = (i >= box.i0) & (i < box.i1) & (j >= box.j0) & (j < box.j1)
    if not inside.any():
        return None
    r, c = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    cut = np.s_[r[0] : r[-1] + 1, c[0] : c[-1] + 1]
    w = np.where(inside, w, np.float32(np.nan))[cut]
    made = replace(part, first_s=part.first_s + int(r[0]), first_sample=part.first_sample + int(c[0]))
    return made, np.ascontiguousarray(w), first + int(r[0]), int(c[0])


def _packed(name: str, items: list[Any]) -> dict[str, Any]:
    """Return results as arrays, by name, number and field."""
    return {
        f"{name}.{number}.{entry.name}": np.asarray(getattr(item, entry.name))
        for number, item in enumerate(items)
        for entry in fields(item)
    }


def _unpacked(name: str, found: dict[str, Any], kind: type) -> list[Any]:
    """Return what :func:`_packed` laid out."""
    items: dict[int, dict[str, Any]] = {}
    for key, value in found.items():
        if key.startswith(f"{name}."):
            _, number, field = key.split(".")
            array = np.asarray(value)
            items.setdefault(int(number), {})[field] = array if array.ndim else array[()].item()
    return [kind(**items[number]) for number in sorted(items)]
