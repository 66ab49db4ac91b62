"""Blocks of amplitudes made ready: cleaned, scaled and whitened as the whole cube asks for."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array
from seismo3d._validate import as_single
from seismo3d.seismic.balancing import find_trace_gains, trace_likeness, trace_strengths
from seismo3d.seismic.blocks.plan import RAW_REACH, Box
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.preparing import (
    Scale,
    balance_traces,
    check_live,
    check_period,
    find_scaling,
    leave_out,
    mark_data,
    print_traces,
    repeats_itself,
    sampling_step,
    scale_amplitudes,
)
from seismo3d.seismic.whitening import (
    Whitening,
    choose_pairs,
    filter_valid,
    find_complete,
    find_rms,
    scale_to_unit,
    trace_powers,
    whitening_of,
)

_SAMPLE = ("sample", "depths", "of_repeated")
"""What is told of some samples of a block: amplitudes, depths, and whether their traces repeat others."""


def raw_box(run: BlockRun, number: int) -> Box:
    """Return what is read of the input for a block: whether a trace repeats its neighbours is told by these."""
    return run.plan.tiling("raw").box(number).grown((0, RAW_REACH), run.plan.shape)


def survey(run: BlockRun, number: int, piece: Any) -> None:
    """Look at a block's amplitudes and at how much of its traces there is."""
    box, _, inner = _boxes(run, number)
    amplitudes = _read(piece)
    valid, repeated = (marks[inner] for marks in mark_data(amplitudes))
    amplitudes = np.ascontiguousarray(amplitudes[inner])
    n0, n1, n2 = run.plan.shape
    step = sampling_step((n0, n1, n2))
    looked_at, depths, of_repeated = [], [], []
    for line, i in enumerate(range(box.i0, box.i1)):
        places = np.arange(-((i * n1 + box.j0) * n2) % step, valid[line].size, step)
        places = places[valid[line].ravel()[places]]
        looked_at.append(amplitudes[line].ravel()[places])
        depths.append(places % n2)
        of_repeated.append(repeated[line][places // n2])
    found = {
        name: np.concatenate(values) for name, values in zip(_SAMPLE, (looked_at, depths, of_repeated), strict=True)
    }
    found |= {"count": valid.sum(axis=2), "repeated": repeated, "prints": print_traces(amplitudes)}
    run.write_part("survey", number, found)


def survey_facts(run: BlockRun) -> None:
    """Find whether repeated traces are data, and the cube's scale."""
    parts = [run.read_part("survey", number)[0] for number in range(len(run.plan.tiling("raw")))]
    sample, depths, of_repeated = (np.concatenate([part[name] for part in parts]) for name in _SAMPLE)
    counts, repeated = (run.gather("survey", name, "raw") for name in ("count", "repeated"))
    repeats = bool(repeated.any()) and repeats_itself(run.gather("survey", "prints", "raw"), counts > 0)
    if not repeats:
        sample, depths = sample[~of_repeated], depths[~of_repeated]
    scale = find_scaling(sample, depths, run.plan.shape[2])
    told = {name: value for name, value in scale._asdict().items() if value is not None}
    run.write_fact("survey", repeats=repeats, **told)


def strengths(run: BlockRun, number: int, piece: Any) -> None:
    """Find how strong a block's traces are, and how like each other."""
    _, _, inner = _boxes(run, number)
    amplitudes, valid = _scaled(run, piece)
    strength = trace_strengths(amplitudes, valid)
    likeness = trace_likeness(amplitudes, valid, strength)
    found = {"strength": strength[inner], "likeness": likeness[inner], "count": valid[inner].sum(axis=2)}
    run.write_part("strengths", number, found)


def strengths_facts(run: BlockRun) -> None:
    """Find what traces are multiplied by, and those that the cube's wavelet is read from."""
    strength, likeness, n_valid = (run.gather("strengths", name, "raw") for name in ("strength", "likeness", "count"))
    gains = find_trace_gains(strength, likeness)
    if gains is not None:
        n_valid[gains == 0.0] = 0
    if run.kind == "faults":
        check_live(n_valid > 0)
    found = {} if gains is None else {"gains": gains}
    pairs = choose_pairs(find_complete(n_valid))
    run.write_fact("strengths", pairs=pairs, n_valid=int(n_valid.sum()), live=n_valid > 0, **found)


def live_traces(run: BlockRun) -> BoolArray:
    """Return which traces have data."""
    return np.asarray(run.fact("strengths")["live"])


def pairs(run: BlockRun, number: int, piece: Any) -> None:
    """Take a block's share of the pairs of traces that the wavelet is read from."""
    box, wide, _ = _boxes(run, number)
    i, j = run.fact("strengths")["pairs"].T
    mine = np.flatnonzero((i >= box.i0) & (i < box.i1) & (j >= box.j0) & (j < box.j1))
    n2 = run.plan.shape[2]
    found: dict[str, AnyArray] = {
        "first": np.empty((0, n2), np.float32),
        "second": np.empty((0, n2), np.float32),
        "known": np.empty((0, n2), bool),
        "mine": mine,
    }
    if len(mine):
        amplitudes, valid = _balanced(run, number, piece)
        rows, columns = i[mine] - wide.i0, j[mine] - wide.j0
        found |= {"first": amplitudes[rows, columns], "second": amplitudes[rows, columns + 1]}
        found["known"] = valid[rows, columns] & valid[rows, columns + 1]
    run.write_part("pairs", number, found)


def pairs_facts(run: BlockRun) -> None:
    """Design the whitening filter."""
    n_pairs, n2 = len(run.fact("strengths")["pairs"]), run.plan.shape[2]
    first, second, known = np.empty((n_pairs, n2)), np.empty((n_pairs, n2)), np.empty((n_pairs, n2), bool)
    for number in range(len(run.plan.tiling("raw"))):
        part, _ = run.read_part("pairs", number)
        for name, rows in (("first", first), ("second", second), ("known", known)):
            rows[part["mine"]] = part[name]
    whitening = whitening_of(first, second, known, carried=run.kind == "layers")
    check_period(whitening.period, n2)
    run.write_fact("pairs", **{name: found for name, found in whitening._asdict().items() if found is not None})


def make_clean_arrays(run: BlockRun) -> None:
    """Make the arrays that :func:`whiten` writes to."""
    run.store.make("white", run.plan.shape, np.float32)
    run.store.make("valid", run.plan.shape, bool, packed=True)


def whiten(run: BlockRun, number: int, piece: Any) -> None:
    """Whiten a block."""
    box, _, inner = _boxes(run, number)
    amplitudes, valid = _balanced(run, number, piece)
    valid = np.ascontiguousarray(valid[inner])
    whitening = Whitening(**run.fact("pairs"))
    white = filter_valid(np.ascontiguousarray(amplitudes[inner]), valid, whitening)
    run.store.write("white", box, white)
    run.store.write("valid", box, valid)
    run.write_part("whiten", number, {"powers": trace_powers(white)})


def whiten_facts(run: BlockRun) -> None:
    """Find the whitened cube's root-mean-square."""
    run.write_fact("whiten", rms=find_rms(run.gather("whiten", "powers", "raw"), run.fact("strengths")["n_valid"]))


def read_clean(run: BlockRun, box: Box) -> tuple[Float32Array, AnyArray]:
    """Return a box of the cube as the whole cube's :func:`~seismo3d.seismic.preparing.clean_volume` has it."""
    white = run.store.read("white", box)
    scale_to_unit(white, run.fact("whiten")["rms"])
    return white, run.store.read("valid", box)


def _boxes(run: BlockRun, number: int) -> tuple[Box, Box, tuple[slice, slice]]:
    box, wide = run.plan.tiling("raw").box(number), raw_box(run, number)
    return box, wide, box.within(wide)


def _read(piece: Any) -> Float32Array:
    """Return a piece of the input as amplitudes of its own; read by this process alone."""
    if hasattr(piece, "dask"):
        piece = piece.compute(scheduler="synchronous")
    return as_single(piece, "cube")


def _scaled(run: BlockRun, piece: Any) -> tuple[Float32Array, AnyArray]:
    amplitudes = _read(piece)
    valid, repeated = mark_data(amplitudes)
    if not run.fact("survey")["repeats"]:
        leave_out(amplitudes, valid, repeated)
    facts = run.fact("survey")
    scale_amplitudes(amplitudes, valid, Scale(facts["level"], facts["strength"], facts.get("gain")))
    return amplitudes, valid


def _balanced(run: BlockRun, number: int, piece: Any) -> tuple[Float32Array, AnyArray]:
    amplitudes, valid = _scaled(run, piece)
    gains, wide = run.fact("strengths").get("gains"), raw_box(run, number)
    balance_traces(amplitudes, valid, None if gains is None else gains[wide.i0 : wide.i1, wide.j0 : wide.j1])
    return amplitudes, valid
