"""Benchmark of fault tracing on synthetic cubes: ``python -m seismo3d.experiments.faults``.

Every cube is made anew from its kind and seed, traced at default settings, and scored against its exact truth. The
seeds of the suite, :data:`SUITE_SEEDS`, are for measuring only; settings are tuned on others.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d.errors import ParameterError
from seismo3d.experiments._command import run_command
from seismo3d.io.records import write_json
from seismo3d.seismic.fault_evidence import EVIDENCE
from seismo3d.seismic.scores import FaultScore, ThrowScore, fault_score, throw_score
from seismo3d.synthetic import KINDS, SyntheticCube, fault_cube
from seismo3d.synthetic.cutoffs import present_slip

SUITE_SEEDS = (101, 102, 103)
SUITE_KINDS = tuple(kind for kind in KINDS if kind != "demo")
VISIBLE_THROW = 1.0
"""Truth below this absolute throw, in samples, is left out of ``visible``: so small a throw leaves no trace."""

Tracer = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class CubeResult:
    """Scores of one cube.

    Attributes
    ----------
    kind : str
        Kind of the cube.
    seed : int
        Its seed.
    score : FaultScore
        Against all true fault voxels.
    visible : FaultScore
        Recall against those with a throw of :data:`VISIBLE_THROW` or more; precision against all.
    throw : ThrowScore
        Throws at the voxels found, against those of the faults when they moved.
    present : ThrowScore
        The same against what lies apart today: where throw changes over a surface and both walls moved, or later faults
        have strained an older one, this alone can be seen.
    seconds : float
        Time that tracing took.
    ratio : float
        That time over the median time of ``scipy.ndimage.gaussian_filter(cube, 4)`` in the same run.
    peak_mb : float or None
        Peak memory that tracing took beyond what was there before, in MB; None where it was not measured.
    peak_cubes : float or None
        The same over the size of the cube in float32.
    """

    kind: str
    seed: int
    score: FaultScore
    visible: FaultScore
    throw: ThrowScore
    present: ThrowScore
    seconds: float
    ratio: float
    peak_mb: float | None = None
    peak_cubes: float | None = None


def score_cube(cube: SyntheticCube, labels: Any, throw: Any) -> tuple[FaultScore, FaultScore, ThrowScore, ThrowScore]:
    """Score a cube's labels against all true voxels and visible ones, its throws against past and present ones."""
    labels, throw = np.asarray(labels), np.asarray(throw)
    score = fault_score(labels, cube.faults)
    seen = fault_score(labels, np.abs(np.nan_to_num(cube.throw)) >= VISIBLE_THROW)
    f1 = 2.0 * score.precision * seen.recall / (score.precision + seen.recall) if score.f1 else score.f1
    visible = FaultScore(score.precision, seen.recall, f1, score.called)
    present = present_slip(cube)[..., 2]
    return (
        score,
        visible,
        throw_score(labels, throw, cube.faults, cube.throw),
        throw_score(labels, throw, np.isfinite(present), present),
    )


def run_cube(
    kind: str,
    seed: int,
    *,
    shape: tuple[int, int, int] = (128, 128, 128),
    trace: Tracer | None = None,
    memory: bool = False,
) -> CubeResult:
    """Make a cube, trace its faults and score them.

    Parameters
    ----------
    kind : str
        One of :data:`SUITE_KINDS`, or "demo".
    seed : int
        Seed of the cube.
    shape : tuple of int
        Its size.
    trace : callable, optional
        Takes the amplitudes, gives an object with ``labels`` and ``throw``; :func:`seismo3d.trace_faults` if not given.
    memory : bool
        True to measure peak memory in a second pass (Linux).

    Returns
    -------
    CubeResult
        Scores and timing.
    """
    if trace is None:
        import seismo3d

        trace = seismo3d.trace_faults
    cube = fault_cube(kind, seed=seed, shape=shape)
    reference = reference_seconds(cube.seismic)
    start = time.perf_counter()
    faults = trace(cube.seismic)
    seconds = time.perf_counter() - start
    reference = min(reference, reference_seconds(cube.seismic))
    score, visible, throws, present = score_cube(cube, faults.labels, faults.throw)
    peak = _peak_mb(trace, cube.seismic) if memory else None
    cubes = None if peak is None else peak * 1e6 / (4.0 * cube.seismic.size)
    return CubeResult(kind, seed, score, visible, throws, present, seconds, seconds / reference, peak, cubes)


def reference_seconds(seismic: Any, *, repeats: int = 5) -> float:
    """Median time of ``scipy.ndimage.gaussian_filter(cube, 4)`` in seconds."""
    from scipy.ndimage import gaussian_filter

    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        gaussian_filter(seismic, 4)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def _peak_mb(trace: Tracer, seismic: Any) -> float:
    """Largest resident memory while tracing, above what was resident before; compiled code's own arrays included."""
    _return_freed_memory()
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError as error:
        raise ParameterError(
            "peak memory was asked for; it needs Linux's /proc/self/clear_refs. Run without it."
        ) from error
    before = _resident_mb("VmRSS")
    trace(seismic)
    return _resident_mb("VmHWM") - before


def _return_freed_memory() -> None:
    """Give the system what was freed but is kept for later: arrays that reuse it would not be seen to grow."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def _resident_mb(field: str) -> float:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(field + ":"):
            return float(line.split()[1]) * 1024.0 / 1e6
    raise ParameterError(f"peak memory was asked for, but /proc/self/status has no {field}. Run without it.")


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return statistics.fmean(finite) if finite else math.nan


def summarise(results: Sequence[CubeResult]) -> list[dict[str, Any]]:
    """Average the results of each kind over its seeds; one dictionary a kind."""
    rows = []
    for kind in dict.fromkeys(result.kind for result in results):
        of_kind = [result for result in results if result.kind == kind]
        rows.append(
            {
                "kind": kind,
                "cubes": len(of_kind),
                "f1": _mean([r.score.f1 for r in of_kind]),
                "precision": _mean([r.score.precision for r in of_kind]),
                "recall": _mean([r.score.recall for r in of_kind]),
                "f1_visible": _mean([r.visible.f1 for r in of_kind]),
                "called_percent": 100.0 * _mean([r.score.called for r in of_kind]),
                "throw_known": _mean([r.throw.known for r in of_kind]),
                "throw_within": _mean([r.throw.within for r in of_kind]),
                "throw_present": _mean([r.present.within for r in of_kind]),
                "throw_median_error": _mean([r.throw.median_error for r in of_kind]),
                "seconds": _mean([r.seconds for r in of_kind]),
                "ratio": _mean([r.ratio for r in of_kind]),
                "peak_mb": max((r.peak_mb for r in of_kind if r.peak_mb is not None), default=None),
                "peak_cubes": max((r.peak_cubes for r in of_kind if r.peak_cubes is not None), default=None),
            }
        )
    return rows


_COLUMNS = (
    ("kind", "", "{}"), ("F1", "f1", "{:.3f}"), ("precision", "precision", "{:.3f}"), ("recall", "recall", "{:.3f}"),
    ("F1 visible", "f1_visible", "{:.3f}"), ("called %", "called_percent", "{:.2f}"),
    ("throw known", "throw_known", "{:.2f}"),
    ("within 1.5", "throw_within", "{:.2f}"), ("of today's", "throw_present", "{:.2f}"),
    ("median error", "throw_median_error", "{:.2f}"),
    ("seconds", "seconds", "{:.2f}"),
    ("x filter", "ratio", "{:.0f}"), ("peak MB", "peak_mb", "{:.0f}"), ("x cube", "peak_cubes", "{:.1f}"),
)  # fmt: skip


def print_table(rows: Sequence[dict[str, Any]]) -> None:
    """Print one line a kind on standard output."""
    from rich.console import Console
    from rich.table import Table

    measured = [c for c in _COLUMNS if not c[1].startswith("peak") or any(row[c[1]] is not None for row in rows)]
    table = Table(title="Faults on synthetic cubes, default settings, tolerance 2 voxels", box=None)
    for name, _, _ in measured:
        table.add_column(name, justify="left" if name == "kind" else "right")
    for row in rows:
        values = [row[key or "kind"] for _, key, _ in measured]
        cells = ["-" if v is None or (isinstance(v, float) and math.isnan(v)) else form.format(v)
                 for (_, _, form), v in zip(measured, values)]  # fmt: skip
        table.add_row(*cells)
    Console(width=150).print(table)


def print_evidence(rows: dict[str, Sequence[dict[str, Any]]]) -> None:
    """Print the F1 of every kind, or for cubes without faults the share called, under each evidence.

    Parameters
    ----------
    rows : dict of list
        What :func:`summarise` returns, by evidence.
    """
    from rich.console import Console
    from rich.table import Table

    table = Table(title="F1 by evidence; of cubes without faults, per cent of voxels called", box=None)
    for name in ("kind", *rows):
        table.add_column(name, justify="left" if name == "kind" else "right")
    for of_kind in zip(*rows.values(), strict=True):
        called = all(math.isnan(row["f1"]) for row in of_kind)
        cells = [f"{row['called_percent']:.2f} %" if called else f"{row['f1']:.3f}" for row in of_kind]
        table.add_row(of_kind[0]["kind"], *cells)
    Console(width=150).print(table)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.faults", description=__doc__.split("\n")[0])
    parser.add_argument("--kinds", nargs="+", default=list(SUITE_KINDS), choices=list(KINDS), metavar="KIND")
    parser.add_argument("--seeds", type=int, default=len(SUITE_SEEDS), help="number of cubes of each kind")
    parser.add_argument("--first-seed", type=int, default=SUITE_SEEDS[0], help="seed of the first cube of each kind")
    parser.add_argument("--shape", type=int, default=128, help="samples along each side")
    parser.add_argument("--memory", action="store_true", help="measure peak memory too, in a second pass")
    parser.add_argument(
        "--evidence", nargs="+", choices=EVIDENCE, metavar="EVIDENCE",
        help="trace with each of these (semblance, registration, both) and print F1 by evidence",
    )  # fmt: skip
    parser.add_argument("--json", type=Path, help="write all results to this file")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None, *, trace: Tracer | None = None) -> None:
    """Run the suite and print its table.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line; the process's own if not given.
    trace : callable, optional
        What traces the faults; :func:`seismo3d.trace_faults` if not given. With ``--evidence`` it gets that keyword.
    """
    options = _parse(arguments)
    if options.seeds < 1 or options.shape < 16:
        raise ParameterError("seeds and shape are too small; expected 1 seed and 16 samples or more.")
    if trace is None:
        import seismo3d

        trace = seismo3d.trace_faults
    if options.evidence is None:
        results = _run_kinds(options, trace)
        print_table(rows := summarise(results))
        found: dict[str, Any] = {"kinds": rows, "cubes": [asdict(result) for result in results]}
    else:
        by_evidence = {kind: _run_kinds(options, partial(trace, evidence=kind)) for kind in options.evidence}
        print_evidence({kind: summarise(results) for kind, results in by_evidence.items()})
        found = {kind: [asdict(result) for result in results] for kind, results in by_evidence.items()}
    if options.json is not None:
        write_json(options.json, found)


def _run_kinds(options: argparse.Namespace, trace: Tracer) -> list[CubeResult]:
    """Run all kinds and seeds that were asked for."""
    shape = (options.shape,) * 3
    start = time.perf_counter()
    trace(fault_cube("crossing", seed=0, shape=(64, 64, 64)).seismic)
    sys.stderr.write(f"kernels compiled, or loaded where they were, in {time.perf_counter() - start:.1f} s\n")
    results = []
    for kind in options.kinds:
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            sys.stderr.write(f"{kind}, seed {seed}\n")
            results.append(run_cube(kind, seed, shape=shape, trace=trace, memory=options.memory))
    return results


if __name__ == "__main__":
    run_command(main)
