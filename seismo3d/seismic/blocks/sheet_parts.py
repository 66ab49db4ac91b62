"""Parts of sheets that lie in blocks: cut out, read, joined again and written down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, IntArray
from seismo3d.seismic.blocks.cleaning import read_clean
from seismo3d.seismic.blocks.plan import Box, read_reach
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import every_sample


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What lies in and around a block."""

    volume: Float32Array
    valid: BoolArray
    slopes: tuple[Float32Array, Float32Array]
    corner: tuple[int, int]


def read_parts(
    run: BlockRun,
    stage: str,
    number: int,
    sheets: list[Sheet],
    read: Callable[[Around, int, Sheet, Float32Array], tuple[Float32Array, BoolArray]],
) -> None:
    """Leave behind what is read, and where it is known, along every sheet where it passes through a block."""
    box = run.plan.tiling("draw").box(number)
    wide = box.grown((read_reach(run.settings),) * 2, run.plan.shape)
    arrays: dict[str, AnyArray] = {}
    around: Around | None = None
    for place, sheet in enumerate(sheets):
        found = _cut(sheet, box, run.plan.shape)
        if found is None:
            continue
        part, w, rows, columns = found
        if around is None:
            slopes = run.store.read("beside_p", wide), run.store.read("beside_q", wide)
            around = Around(*read_clean(run, wide), slopes, (wide.i0, wide.j0))
        values, known = read(around, place, part, w)
        arrays |= {f"{place}.at": np.array([rows, columns]), f"{place}.values": values, f"{place}.known": known}
    run.write_part(stage, number, arrays)


def note_blocks(run: BlockRun, stage: str, n_sheets: int) -> None:
    """Note which blocks each sheet passes through."""
    found: list[list[int]] = [[] for _ in range(n_sheets)]
    for number in range(len(run.plan.tiling("draw"))):
        for place in run.list_part(stage, number, "at"):
            found[int(place)].append(number)
    run.write_fact(stage, blocks=found)


def join_parts(run: BlockRun, stage: str, sheet: Sheet, number: int, n_traces: int) -> tuple[Float32Array, BoolArray]:
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


def _places(sheet: Sheet, w: Float32Array) -> tuple[AnyArray, AnyArray]:
    """Return the inlines and crosslines of nodes at every row, NaN off the sheet."""
    s = (sheet.first_s + np.arange(len(w)))[:, None]
    inline, crossline = (sheet.origin[d] + s * sheet.along[d] + w * sheet.across[d] for d in range(2))
    return inline, crossline


def rows_near(sheet: Sheet, box: Box, shape: tuple[int, ...]) -> tuple[int, int] | None:
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
    rows = rows_near(sheet, box, shape)
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


def pack(name: str, items: list[Any]) -> dict[str, Any]:
    """Return results as arrays, by name, number and field."""
    return {
        f"{name}.{number}.{entry.name}": np.asarray(getattr(item, entry.name))
        for number, item in enumerate(items)
        for entry in fields(item)
    }


def unpack(name: str, found: dict[str, Any], kind: type) -> list[Any]:
    """Return what :func:`pack` laid out."""
    items: dict[int, dict[str, Any]] = {}
    for key, value in found.items():
        if key.startswith(f"{name}."):
            _, number, field = key.split(".")
            array = np.asarray(value)
            items.setdefault(int(number), {})[field] = array if array.ndim else array[()].item()
    return [kind(**items[number]) for number in sorted(items)]
