"""How well a cube's shifts agree with each other: loops of four traces, which must come back to where they began."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._settings import as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import AnyArray, Float32Array, Progress
from seismo3d._validate import freeze
from seismo3d.seismic._kernels_closure import close_loops
from seismo3d.seismic.cube_checks import check_cube
from seismo3d.seismic.dip import estimate_slopes
from seismo3d.seismic.fault_links import cut_grid, grid_surface
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.preparing import as_volume, clean_volume, refuse_dead
from seismo3d.seismic.shifts import ShiftField, are_measured, measure_shifts


@dataclass(frozen=True, slots=True, eq=False)
class LoopClosure:
    """Errors of closed loops, in samples.

    Attributes
    ----------
    median : float
        Median absolute error; NaN where there is no loop.
    over_one : float
        Share of the loops that miss by more than one sample; NaN where there is none.
    n_loops : int
        Number of loops.
    length : int
        Side of a loop, in traces.
    error : ndarray of shape (inline, crossline), float32
        Median absolute error of the loops that begin at a trace; NaN where none does.
    """

    median: float
    over_one: float
    n_loops: int
    length: int
    error: Float32Array


def loop_closure(
    cube: Any, *, faults: Any = None, settings: LayerTimeSettings | None = None, progress: Progress | None = None
) -> LoopClosure:
    """Measure how far a reflector followed round a square of traces comes out beside where it began.

    From a trace along the inlines and then the crosslines, and from the same trace the other way round: each of the
    four shifts is measured by itself, so that the two ways meet only where all four are right. It is the check of a
    cube's registration that needs no truth. Loops that cross a fault, or a dead trace, are left out.

    Parameters
    ----------
    cube : DataArray or array_like
        A cube (inline, crossline, sample), as ``open_cube`` gives it or a bare array.
    faults : FaultSet, optional
        Faults of this cube.
    settings : LayerTimeSettings, optional
        Windows; the longest of ``lengths`` is the side of a loop.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    LoopClosure

    Raises
    ------
    ShapeError
        If the cube has not three axes, is too small, has no live trace, or the faults are of a cube of another shape.
    ParameterError
        If `faults` is no FaultSet, or `settings` are no LayerTimeSettings.
    GeometryError
        If the faults are of a cube elsewhere.
    """
    settings = as_settings(settings, LayerTimeSettings)
    report = as_progress(progress)
    check_cube(cube, faults)
    volume, valid, *_ = clean_volume(as_volume(cube)[0], carried=True)
    refuse_dead(valid)
    cuts = np.zeros(volume.shape, np.uint8)
    for surface in faults.surfaces if faults is not None else ():
        cut_grid(grid_surface(surface, beyond=settings.links.beyond), cuts)
    step = settings.shifts.step
    report("dip", 0.0)
    p, q = (np.ascontiguousarray(s[:, :, ::step]) for s in estimate_slopes(volume, valid, settings=settings.dip))
    report("shifts", 0.0)
    fields = measure_shifts(volume, valid, (p, q), cuts=cuts, lengths=settings.lengths, settings=settings.shifts)
    return close_fields(fields, cuts, settings=settings)


def close_fields(fields: list[ShiftField], cuts: AnyArray, *, settings: LayerTimeSettings) -> LoopClosure:
    """Close the loops of the longest shifts.

    Parameters
    ----------
    fields : list of ShiftField
        From :func:`~seismo3d.seismic.shifts.measure_shifts`, by length, then axis, the shortest over one trace.
    cuts : ndarray of the cube's shape, uint8
        Bit 0 or 1 where a fault passes before the next inline or crossline.
    settings : LayerTimeSettings
        Those that the shifts were measured with.

    Returns
    -------
    LoopClosure
    """
    length = fields[-1].length
    n0, n1, _ = fields[-1].shift.shape
    errors = loop_errors(fields, cuts, settings)
    known = np.isfinite(errors)
    closed = known.any(axis=2)
    by_trace = np.full((n0, n1), np.nan, np.float32)
    by_trace[: closed.shape[0], : closed.shape[1]][closed] = np.nanmedian(errors[closed], axis=1)
    sizes = errors[known]
    if not sizes.size:
        return LoopClosure(float("nan"), float("nan"), 0, length, freeze(by_trace))
    median, over = float(np.median(sizes)), float((sizes > 1.0).mean())
    return LoopClosure(median, over, int(sizes.size), length, freeze(by_trace))


def loop_errors(fields: list[ShiftField], cuts: AnyArray, settings: LayerTimeSettings) -> Float32Array:
    """Return by how many samples the loops that begin at each coarse sample miss; NaN where there is none.

    The shape is that of the shifts, less the side of a loop along inlines and crosslines.
    """
    length, step = fields[-1].length, settings.shifts.step
    n0, n1, m = fields[-1].shift.shape
    errors = np.empty((max(0, n0 - length), max(0, n1 - length), m), np.float32)
    first, second = (np.where(are_measured(f, settings.shifts), f.shift, np.float32(np.nan)) for f in fields[-2:])
    close_loops(first, second, fields[0].shift, fields[1].shift, cuts, length, step, errors)
    return np.asarray(np.abs(errors))


def tabulate_loops(closure: LoopClosure | None) -> dict[str, float | int | None] | None:
    """Return a closure's figures by name, None where there is no loop; None of none."""
    if closure is None:
        return None
    known = closure.n_loops > 0
    return {
        "side_traces": closure.length,
        "n_loops": closure.n_loops,
        "median_error_samples": closure.median if known else None,
        "share_over_one_sample": closure.over_one if known else None,
    }
