"""Slopes, cuts, shifts and throws of blocks: what the layer graph of a large cube is made from."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array
from seismo3d.seismic._kernels_cuts import read_side
from seismo3d.seismic._kernels_layers import find_breaks
from seismo3d.seismic.blocks.cleaning import live_traces, read_clean
from seismo3d.seismic.blocks.medians import BlockMedians
from seismo3d.seismic.blocks.order import positive_lines
from seismo3d.seismic.blocks.plan import Box, Tiling
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.slopes import estimate_block
from seismo3d.seismic.fault_links import SurfaceGrid, find_crossings, grid_surface, match_known
from seismo3d.seismic.faultset import FaultSurface
from seismo3d.seismic.preparing import refuse_dead
from seismo3d.seismic.shifts import ShiftField, judge_misfits, match_lengths, matching_floor, shift_reach

_KINDS = ("shift", "variance", "misfit")


def coarse_shape(run: BlockRun) -> tuple[int, int, int]:
    """Return the shape of what is kept at every step-th sample."""
    n0, n1, n2 = run.plan.shape
    return n0, n1, -(-n2 // run.settings.shifts.step)


def make_slope_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`slopes` writes to."""
    for name in ("p", "q"):
        run.store.make(name, coarse_shape(run), np.float32)


def slopes(run: BlockRun, number: int) -> None:
    """Estimate a block's slopes, and sum up the squares of every other trace of every other inline."""
    box = run.plan.tiling("dip").box(number)
    volume, _, found = estimate_block(run, box)
    for name, slope in zip(("p", "q"), found, strict=True):
        run.store.write(name, box, slope[:, :, :: run.settings.shifts.step])
    looked_at = volume[box.i0 % 2 :: 2, box.j0 % 2 :: 2]
    run.write_part("slopes", number, {"power": np.square(looked_at, dtype=np.float64).sum(axis=2)})


def slopes_facts(run: BlockRun) -> None:
    """Find below which derivative nothing is to be matched."""
    refuse_dead(live_traces(run))
    parts = [run.read_part("slopes", number)[0]["power"] for number in range(len(run.plan.tiling("dip")))]
    total, n = sum(float(part.sum()) for part in parts), sum(part.size for part in parts) * run.plan.shape[2]
    run.write_fact("slopes", floor=float(matching_floor(total / n, run.settings.shifts)))


def grids(run: BlockRun, number: int, surface: FaultSurface) -> None:
    """Lay a surface out on its grid."""
    grid = grid_surface(surface, beyond=run.settings.links.beyond)
    found = {"across": grid.across, "first": np.array(grid.first), "w": grid.w, "inside": grid.inside}
    places = _places(grid)
    known = places[np.isfinite(places[..., 0])]
    reach = np.concatenate([known.min(axis=0), known.max(axis=0)]) if len(known) else np.full(4, np.nan)
    run.write_part("grids", number, {**found, "throw": grid.throw, "reach": reach})


def grids_facts(run: BlockRun) -> None:
    """Note where each surface lies."""
    n = run.fact("faults")["n_surfaces"]
    reaches = [run.read_part("grids", number, prefix="reach")[0]["reach"] for number in range(n)]
    run.write_fact("grids", reach=np.array(reaches, np.float64).reshape(-1, 4))


def read_grid(run: BlockRun, number: int) -> SurfaceGrid:
    """Return the grid of a surface."""
    part, _ = run.read_part("grids", number)
    first = (int(part["first"][0]), int(part["first"][1]))
    return SurfaceGrid(part["across"], first, part["w"], part["inside"], part["throw"])


def make_cut_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`cut` writes to."""
    run.store.make("cuts", run.plan.shape, np.uint8, packed=True)
    run.store.make("breaks", coarse_shape(run), np.uint8, packed=True)


def cut(run: BlockRun, number: int) -> None:
    """Mark where faults pass through a block."""
    box = run.plan.tiling("fill").box(number)
    cuts = np.zeros((*box.shape, run.plan.shape[2]), np.uint8)
    wide = box.grown((2, 2), run.plan.shape)
    for place, (i0, j0, i1, j1) in enumerate(run.fact("grids")["reach"]):
        if i1 >= wide.i0 and i0 <= wide.i1 and j1 >= wide.j0 and j0 <= wide.j1:
            _cut_block(read_grid(run, place), box, wide, run.plan.shape, cuts)
    breaks = np.empty((*box.shape, coarse_shape(run)[2]), np.uint8)
    find_breaks(cuts, run.settings.shifts.step, breaks)
    run.store.write("cuts", box, cuts)
    run.store.write("breaks", box, breaks)
    run.write_part("cut", number, {})


def _places(grid: SurfaceGrid) -> Float64Array:
    """(inline, crossline) of every node of a grid."""
    along = np.array([-grid.across[1], grid.across[0]])
    s = np.arange(grid.w.shape[0])[:, None] + grid.first[0]
    return np.asarray(s[..., None] * along + grid.w[..., None] * grid.across)


def _cut_block(grid: SurfaceGrid, box: Box, wide: Box, shape: tuple[int, int, int], cuts: AnyArray) -> None:
    """Mark where a surface passes through a block; what crosses is told in the cube's own indices, as it is whole."""
    i, j = np.moveaxis(_places(grid), -1, 0)
    near = ((i >= wide.i0 - 1) & (i <= wide.i1 + 1) & (j >= wide.j0 - 1) & (j <= wide.j1 + 1)).any(axis=1)
    rows = np.flatnonzero(near)
    if not len(rows):
        return
    low = max(rows[0] - 1, 0)
    part = slice(low, rows[-1] + 2)
    first = (grid.first[0] + int(low), grid.first[1])
    strip = SurfaceGrid(grid.across, first, grid.w[part], grid.inside[part], grid.throw[part])
    vertices, cells = strip.triangulate()
    cells = cells[np.isfinite(vertices[cells]).all(axis=(1, 2))]
    edges, _ = find_crossings(vertices, np.empty((len(vertices), 0)), cells, shape)
    axis, voxel = np.divmod(edges, shape[0] * shape[1] * shape[2])
    at = np.stack(np.unravel_index(voxel, shape), axis=1) - (box.i0, box.j0, 0)
    kept = ((at >= 0) & (at < cuts.shape)).all(axis=1)
    np.bitwise_or.at(cuts, tuple(at[kept].T), np.left_shift(1, axis[kept]).astype(cuts.dtype))


def field_names(settings: Any) -> tuple[str, ...]:
    """Return the arrays of the shifts, by length, axis and kind."""
    return tuple(f"{kind}{axis}_{length}" for length in settings.lengths for axis in range(2) for kind in _KINDS)


def make_shift_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`shifts` writes to."""
    for name in field_names(run.settings):
        run.store.make(name, coarse_shape(run), np.float32)


def _read_misfits(run: BlockRun, box: Box) -> list[list[Float32Array]]:
    names = [name for name in field_names(run.settings) if name.startswith("misfit")]
    return [positive_lines(run.store.read(name, box)) for name in names]


USUAL = BlockMedians("shifts", "usual", "shifts", _read_misfits)
"""The misfits that each field's shifts usually leave."""


def shifts(run: BlockRun, number: int) -> None:
    """Measure a block's shifts; their misfits are ratios, not yet judged."""
    settings = run.settings
    box = run.plan.tiling("shifts").box(number)
    reach = shift_reach(settings.lengths, settings.shifts)
    wide = box.grown((reach, reach), run.plan.shape)
    volume, valid = read_clean(run, wide)
    p, q, cuts = (run.store.read(name, wide) for name in ("p", "q", "cuts"))
    floor = np.float32(run.fact("slopes")["floor"])
    inner, misfits = box.within(wide), []
    fields = match_lengths(
        volume, valid, (p, q), cuts=cuts, lengths=settings.lengths, floor=floor, settings=settings.shifts
    )
    for f in fields:
        for kind in _KINDS:
            run.store.write(f"{kind}{f.axis}_{f.length}", box, getattr(f, kind)[inner])
        misfits.append(positive_lines(f.misfit[inner]))
    run.write_part("shifts", number, USUAL.count(misfits))


def shifts_facts(run: BlockRun) -> None:
    """Find where the median misfit of each field lies, roughly."""
    run.write_fact("shifts", **USUAL.locate(run))


def usual_facts(run: BlockRun) -> None:
    """Find the usual misfit of each field."""
    run.write_fact("usual", misfits=USUAL.find(run))


def read_field(run: BlockRun, box: Box, number: int) -> ShiftField:
    """Return a box of a field of shifts, judged; fields are numbered by length, then axis."""
    length, axis = run.settings.lengths[number // 2], number % 2
    shift, variance, misfit = (run.store.read(f"{kind}{axis}_{length}", box) for kind in _KINDS)
    found = ShiftField(axis, length, shift, variance, misfit)
    return judge_misfits(found, run.fact("usual")["misfits"][number], run.settings.shifts)


def match(run: BlockRun, number: int) -> None:
    """Match the sides of a surface, which are read a part of the cube at a time."""
    settings = run.settings.links
    grid = read_grid(run, number)
    rows, samples = np.meshgrid(*(np.arange(n) for n in grid.w.shape), indexing="ij")
    places = grid.place(rows.ravel(), samples.ravel())
    sides, known = np.zeros((2, *grid.w.shape), np.float32), np.zeros((2, *grid.w.shape), np.float32)
    within = grid.inside.ravel() & np.isfinite(places[:, 0])
    for box, chosen in by_box(run.plan.tiling("fill"), places[:, :2], within):
        wide = box.grown((settings.far + 3, settings.far + 3), run.plan.shape)
        volume, valid = read_clean(run, wide)
        p, q = (run.store.read(f"shift{axis}_1", wide) for axis in range(2))
        at = places[chosen] - (wide.i0, wide.j0, 0)
        for side, sign in enumerate((-1.0, 1.0)):
            read, seen = np.zeros(len(at), np.float32), np.zeros(len(at), np.float32)
            read_side(
                volume, valid, p, q, run.settings.shifts.step, at, sign * grid.across, settings.near, settings.far,
                read, seen,
            )  # fmt: skip
            sides[side].reshape(-1)[chosen], known[side].reshape(-1)[chosen] = read, seen
    throw, variance = match_known(grid, sides, known, settings)
    run.write_part("match", number, {"throw": throw, "variance": variance})


def by_box(tiling: Tiling, places: AnyArray, wanted: AnyArray):  # type: ignore[no-untyped-def]
    """Give the boxes that hold places (inline, crossline), and the numbers of the wanted ones in each.

    A place beyond the cube belongs to the box that is next to it.
    """
    numbers = np.flatnonzero(wanted)
    at = np.floor(places[numbers]).astype(np.int64)
    i, j = (np.clip(at[:, axis], 0, tiling.shape[axis] - 1) // tiling.edges[axis] for axis in range(2))
    boxes = i * tiling.counts[1] + j
    order = np.argsort(boxes, kind="stable")
    ends = np.flatnonzero(np.diff(boxes[order])) + 1
    for part in np.split(order, ends) if len(order) else []:
        yield tiling.box(int(boxes[part[0]])), numbers[part]
