"""Layer time: when each voxel was laid down, relative to the others, in samples of a reference trace."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._settings import as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Progress
from seismo3d.seismic._kernels_layers import fill_samples, find_breaks, make_increasing, make_runs_increasing
from seismo3d.seismic.cube_checks import check_cube
from seismo3d.seismic.dip import estimate_slopes
from seismo3d.seismic.fault_links import SurfaceGrid, cut_grid, grid_surface, match_grid
from seismo3d.seismic.layer_graph import LayerGraph, LayerTimeSettings, solve_graph
from seismo3d.seismic.layer_levels import find_level_moves, join_levels, mend_times
from seismo3d.seismic.loop_closure import LoopClosure, close_fields
from seismo3d.seismic.preparing import as_volume, clean_volume, refuse_dead
from seismo3d.seismic.shifts import measure_shifts


@dataclass(frozen=True, slots=True, eq=False)
class LayerModel:
    """Layer time of a cube, and what tracks need beside it.

    Attributes
    ----------
    times : ndarray of shape (inline, crossline, sample), float32
        Layer time, in samples, also where a trace is not live. It grows down every trace from one fault to the next;
        at a reverse fault it falls back.
    cuts : ndarray of the same shape, uint8
        Bits 0, 1 and 2: a fault passes before the next inline, crossline or sample.
    volume, valid : ndarray of the same shape
        Amplitudes, float32, cleaned, and where there are any.
    live : ndarray of shape (inline, crossline), bool
        Traces with data.
    sample_unit : str
        "ms", "m", "ft" or "samples"; any other word of the cube as it is.
    rejected : float
        Share of all measurements that the solution rejects.
    closure : LoopClosure
        How well the shifts agree with each other round closed loops.
    spectrum : ndarray of shape (n,), float64, or None
        Amplitude spectrum of the wavelet, at frequencies evenly spread from 0 to half a cycle a sample; None where it
        is not known.
    level : float
        What the cube's own amplitudes lie about: 0, or some 128 where they are unsigned bytes.
    """

    times: Float32Array
    cuts: AnyArray
    volume: Float32Array
    valid: BoolArray
    live: BoolArray
    sample_unit: str
    rejected: float
    closure: LoopClosure
    spectrum: Float64Array | None = None
    level: float = 0.0

    def increasing(self, settings: LayerTimeSettings | None = None) -> Float32Array:
        """Return the nearest layer time that grows down every trace across faults too."""
        times = self.times.copy()
        make_increasing(times, (settings or LayerTimeSettings()).least)
        return times


def layer_time(
    cube: Any,
    *,
    faults: Any = None,
    settings: LayerTimeSettings | None = None,
    progress: Progress | None = None,
    memory: int | str | None = None,
    folder: str | Path | None = None,
    scheduler: str | None = None,
) -> Any:
    r"""Find when each voxel was laid down, relative to all others: every horizon of the cube at once.

    Shifts between traces are measured over several distances, and across every fault by matching its sides near the
    throw that it has. All of them are edges of one graph; its vertices are samples of traces, and an edge says that two
    of them are of one age. The graph is solved robustly by least squares, coarse to fine. Level sets of the solution
    are horizons [1]_.

    Where a throw is off by a cycle all beyond the fault is. So, at one level after another, the parts that faults bound
    are then compared as a whole with those around, over long waveforms, and moved to where they fit.

    Parameters
    ----------
    cube : DataArray or array_like
        A cube (inline, crossline, sample), as ``open_cube`` gives it or a bare array.
    faults : FaultSet, optional
        Faults of this cube. Layers are cut at their surfaces and joined across them by their throw.
    settings : LayerTimeSettings, optional
        Windows and weights.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.
    memory : int or str, optional
        Bytes that a process may take, such as ``"2GB"``. A cube that needs more in one piece is worked on in blocks;
        without it, always in one piece.
    folder : str or Path, optional
        Needed for work in blocks: gets ``layer_time.zarr``, and what it takes to go on after the run is killed; give
        the same call again for that.
    scheduler : str, optional
        Address of a dask cluster, which then works on the blocks; its workers must see the folder and the input.

    Returns
    -------
    DataArray or ndarray of the cube's shape, float32
        Layer time in samples: layers are as thick as it says on the mean over all traces, and in the trace nearest to
        the middle the middle sample has its own index. It grows down every trace and is NaN on traces that are not
        live. Found in blocks it is lazy, and the same to the bit.

    Raises
    ------
    ShapeError
        If the cube has not three axes, is too small, or the faults are of another cube.
    ParameterError
        If the memory is too little, there is no folder for work in blocks, or the folder holds a run of another input,
        of other faults or with other settings, `faults` is no FaultSet, `settings` are no LayerTimeSettings, or
        `progress` is no function.
    GeometryError
        If the faults are of a cube elsewhere.
    FileAccessError
        If the folder cannot be written, or the cluster does not answer.

    References
    ----------
    .. [1] X. Wu, D. Hale, Geophysics 80(2), IM21-IM33, 2015. :doi:`10.1190/geo2014-0220.1`
    """
    report = as_progress(progress)
    check_cube(cube, faults)
    if memory is not None or folder is not None or scheduler is not None:
        from seismo3d.seismic.blocks.layering import layer_larger, open_layer_time, whole_layers_bytes
        from seismo3d.seismic.blocks.tracing import asks_for_blocks

        if asks_for_blocks(cube, memory, folder=folder, scheduler=scheduler, whole_bytes=whole_layers_bytes):
            run = layer_larger(
                cube, faults, memory, folder=folder, scheduler=scheduler, progress=report,
                settings=as_settings(settings, LayerTimeSettings),
            )  # fmt: skip
            return open_layer_time(run, cube)
    layers = model_layers(cube, faults=faults, settings=settings, progress=report)
    times = layers.increasing(settings)
    times[~layers.live] = np.nan
    times.flags.writeable = False
    return cube.copy(data=times).rename("layer_time") if hasattr(cube, "dims") else times


def model_layers(
    cube: Any, *, faults: Any = None, settings: LayerTimeSettings | None = None, progress: Progress | None = None
) -> LayerModel:
    """Do what :func:`layer_time` does, and keep what tracks need; parameters and errors as there."""
    settings = as_settings(settings, LayerTimeSettings)
    report = as_progress(progress)
    check_cube(cube, faults)
    amplitudes, _, (_, unit) = as_volume(cube)
    volume, valid, spectrum, level = clean_volume(amplitudes, carried=True)
    cuts = np.zeros(volume.shape, np.uint8)
    grids = [grid_surface(s, beyond=settings.links.beyond) for s in (faults.surfaces if faults is not None else ())]
    for grid in grids:
        cut_grid(grid, cuts)
    times, rejected, closure = _solve_times(volume, valid, cuts, grids, settings, report)
    live: BoolArray = np.asarray(valid.any(axis=2))
    refuse_dead(live)
    times += _datum(times, live)
    layers = LayerModel(times, cuts, volume, valid, live, unit, rejected, closure, spectrum, level)
    if grids:
        report("levels", 0.0)
        found = dict(find_level_moves(layers, settings))
        mend_times(times, cuts, join_levels([found[n] for n in range(len(found))]), settings.least)
        times += _datum(times, live)
    return layers


def _datum(times: Float32Array, live: BoolArray) -> np.float32:
    """Return what makes the layer time of the middle sample of the live trace nearest to the middle its own index."""
    k = times.shape[2] // 2
    return np.float32(k - times[(*middle_trace(live), k)])


def middle_trace(live: BoolArray) -> tuple[int, int]:
    """Return the live trace nearest to the middle."""
    places = np.argwhere(live)
    i, j = places[np.abs(places - (np.array(live.shape) - 1) / 2).sum(axis=1).argmin()]
    return int(i), int(j)


def _solve_times(
    volume: Float32Array, valid: BoolArray, cuts: AnyArray, grids: list[SurfaceGrid], settings: LayerTimeSettings,
    report: Progress,
) -> tuple[Float32Array, float, LoopClosure]:  # fmt: skip
    step = settings.shifts.step
    report("dip", 0.0)
    p, q = (np.ascontiguousarray(s[:, :, ::step]) for s in estimate_slopes(volume, valid, settings=settings.dip))
    report("shifts", 0.0)
    fields = measure_shifts(volume, valid, (p, q), cuts=cuts, lengths=settings.lengths, settings=settings.shifts)
    breaks = np.empty(p.shape, np.uint8)
    find_breaks(cuts, step, breaks)
    nearest = [f.shift for f in fields if f.length == 1]
    matched = [(grid, *match_grid(grid, volume, valid, nearest, step=step, settings=settings.links)) for grid in grids]
    report("solve", 0.0)
    graph = LayerGraph(fields, cuts, breaks, matched, settings)
    values, rejected = solve_graph(graph)
    times = np.empty(volume.shape, np.float32)
    fill_samples(values, breaks, step, times)
    make_runs_increasing(times, cuts, settings.least)
    report("solve", 1.0)
    return times, rejected, close_fields(fields, cuts, settings=settings)
