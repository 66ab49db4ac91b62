"""Layer time at every sample of blocks, from the solution of the layer graph, and mended level by level."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_layers import fill_samples, make_increasing, make_runs_increasing
from seismo3d.seismic.blocks.layer_solve import count_rounds, last_stride, values_name
from seismo3d.seismic.blocks.layers import live_traces
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.results import write_result
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.stored_volume import StoredVolumes
from seismo3d.seismic.layer_levels import LevelMoves, find_level_moves, join_levels, mend_times, most_levels
from seismo3d.seismic.layer_time import middle_trace


def level_name(number: int) -> str:
    """Return the array that keeps where a level's layer passes, and how far it is off there."""
    return f"level_{number}"


def datum_facts(run: BlockRun) -> None:
    """Find what makes the layer time of the middle sample of the live trace nearest to the middle its own index."""
    run.write_fact("datum", shift=_datum(run, _solved_times(run, _middle(run))))


def levels_facts(run: BlockRun) -> None:
    """Place the parts of every level that faults bound, and find the datum once more."""
    n_levels = 0
    if run.fact("faults")["n_surfaces"]:
        layers = StoredVolumes.of(run, lambda box: _first_times(run, box))
        for number, found in find_level_moves(layers, run.settings):
            both = np.concatenate([found.depth, found.move], axis=2)
            name, n_levels = level_name(number), n_levels + 1
            run.store.remove(name)
            run.store.make(name, both.shape, np.float32)
            for box in run.plan.tiling("fill"):
                run.store.write(name, box, both[box.i0 : box.i1, box.j0 : box.j1])
    shift = _datum(run, _mended_times(run, _middle(run), n_levels)) if n_levels else 0.0
    run.write_fact("levels", n_levels=n_levels, shift=shift)


def level_names(run: BlockRun) -> tuple[str, ...]:
    """Return the arrays of all levels that there may be."""
    return tuple(level_name(n) for n in range(most_levels(run.plan.shape[2], run.settings)))


def forget_levels(run: BlockRun) -> None:
    """Take the levels for not placed."""
    run.forget_fact("levels")


def fill(run: BlockRun, number: int) -> None:
    """Write a block's layer time; NaN on traces that are not live."""
    box = run.plan.tiling("fill").box(number)
    times = read_times(run, box)
    make_increasing(times, run.settings.least)
    times[~_live_box(run, box)] = np.nan
    write_result(run, "layer_time", box, times)
    run.write_part("fill", number, {})


def read_times(run: BlockRun, box: Box) -> Float32Array:
    """Return the layer time of a box, growing from one fault to the next, also where a trace is not live."""
    found = run.fact("levels")
    if not found["n_levels"]:
        return _first_times(run, box)
    times = _mended_times(run, box, found["n_levels"])
    times += np.float32(found["shift"])
    return times


def _mended_times(run: BlockRun, box: Box, n_levels: int) -> Float32Array:
    times = _first_times(run, box)
    both = [np.split(run.store.read(level_name(n), box), 2, axis=2) for n in range(n_levels)]
    found = join_levels([LevelMoves(depth, move) for depth, move in both])
    mend_times(times, run.store.read("cuts", box), found, run.settings.least)
    return times


def _first_times(run: BlockRun, box: Box) -> Float32Array:
    """Return the layer time of a box as the graph has it."""
    times = _solved_times(run, box)
    times += np.float32(run.fact("datum")["shift"])
    return times


def _solved_times(run: BlockRun, box: Box) -> Float32Array:
    settings = run.settings
    last = last_stride(settings)
    values = run.store.read(values_name(last, count_rounds(settings, last) - 1), box)
    times = np.empty((*box.shape, run.plan.shape[2]), np.float32)
    fill_samples(values, run.store.read("breaks", box), settings.shifts.step, times)
    make_runs_increasing(times, run.store.read("cuts", box), settings.least)
    return times


def _middle(run: BlockRun) -> Box:
    """Return the live trace nearest to the middle."""
    i, j = middle_trace(live_traces(run))
    return Box(i, i + 1, j, j + 1)


def _datum(run: BlockRun, times: Float32Array) -> float:
    """Return what makes the layer time of a trace's middle sample its own index."""
    k = run.plan.shape[2] // 2
    return float(np.float32(k - times[0, 0, k]))


def _live_box(run: BlockRun, box: Box) -> BoolArray:
    return np.asarray(run.store.read("valid", box).any(axis=2))
