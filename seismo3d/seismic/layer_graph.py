"""The registration graph of a cube: samples of traces as vertices, shifts between traces as edges."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array
from seismo3d.graph.scalars import ScalarEdges, SolveSettings, solve_scalars
from seismo3d.seismic._kernels_layers import count_links, link_samples, link_traces
from seismo3d.seismic.block_links import BlockLinks, BlockSettings, label_blocks, match_blocks
from seismo3d.seismic.dip import DipSettings
from seismo3d.seismic.fault_links import LinkSettings, SurfaceGrid, link_grid
from seismo3d.seismic.shifts import ShiftField, ShiftSettings

_DOUBT = np.float32(1e4)


@dataclass(frozen=True, slots=True)
class LayerTimeSettings:
    """Settings of the layer time.

    Attributes
    ----------
    lengths : tuple of int
        Distances in traces over which shifts are measured.
    strides : tuple of int
        The graph is solved on every so-many-th trace; each is half of the one before, the last is 1.
    thickness : float
        Standard deviation, in samples, of the growth of layer time over one coarse sample about that of its
        surroundings: what ties the layers of a trace together.
    wide : (float, float)
        Widths of these surroundings, in traces and samples.
    clear : int
        Shifts this close to a fault, in traces, are hardly trusted until the rest agrees.
    least : float
        Least growth of layer time a sample.
    first_cutoffs, clear_cutoffs : tuple of float
        Robust rounds on the coarsest graph, in standard deviations: first with shifts that are clear, then with all.
    block_cutoffs : tuple of tuple of float
        For each time that blocks are matched across faults, the rounds after it.
    cutoffs : tuple of float
        The same on each finer graph.
    iterations : int
        Most steps a round on the finest graph; a graph of every n-th trace has n squared times as many.
    dip, shifts, links, blocks
        Settings of the stages.
    """

    lengths: tuple[int, ...] = (1, 2, 4)
    strides: tuple[int, ...] = (4, 2, 1)
    thickness: float = 0.3
    wide: tuple[float, float] = (8.0, 8.0)
    clear: int = 2
    least: float = 1e-3
    first_cutoffs: tuple[float, ...] = (np.inf, 30.0, 15.0, 8.0, 5.0)
    clear_cutoffs: tuple[float, ...] = (3.0,)
    block_cutoffs: tuple[tuple[float, ...], ...] = ((8.0, 3.0), (5.0, 3.0))
    cutoffs: tuple[float, ...] = (3.0,)
    iterations: int = 50
    dip: DipSettings = field(default_factory=DipSettings)
    shifts: ShiftSettings = field(default_factory=ShiftSettings)
    links: LinkSettings = field(default_factory=LinkSettings)
    blocks: BlockSettings = field(default_factory=BlockSettings)


@dataclass(frozen=True, slots=True, eq=False)
class LayerGraph:
    """What is measured in a cube, ready to be turned into edges at any stride.

    Attributes
    ----------
    fields : list of ShiftField
        Shifts between traces.
    cuts : ndarray of the cube's shape, uint8
        Bits 0, 1 and 2: a fault passes before the next inline, crossline or sample.
    breaks : ndarray of shape (inline, crossline, coarse sample), uint8
        How many samples below a coarse sample the first fault is met, from 1; 0 where there is none.
    faults : list of (SurfaceGrid, throw, variance)
        Faults, and the throws that match their sides.
    volume, valid : ndarray of the cube's shape
        Amplitudes, float32, and where there are any.
    settings : LayerTimeSettings
    """

    fields: list[ShiftField]
    cuts: AnyArray
    breaks: AnyArray
    faults: list[tuple[SurfaceGrid, Float64Array, Float64Array]]
    volume: Float32Array
    valid: BoolArray
    settings: LayerTimeSettings

    @property
    def nearest(self) -> list[Float32Array]:
        """Shifts to the next inline and to the next crossline."""
        return [f.shift for f in self.fields if f.length == 1]


def solve_graph(graph: LayerGraph) -> tuple[Float32Array, float]:
    """Solve for layer time less sample at every coarse sample of every trace.

    The coarsest graph comes first. Shifts that touch a fault, or fit worse than is usual in the cube, count for next to
    nothing there until faults and clear shifts agree: else the few that leak past a fault hold its two sides together.

    Parameters
    ----------
    graph : LayerGraph

    Returns
    -------
    values : ndarray of shape (inline, crossline, coarse sample), float32
    rejected : float
        Share of the edges of the finest graph that the solution rejects.
    """
    settings = graph.settings
    values, links = _solve_coarsest(graph)
    rejected = 0.0
    for stride in settings.strides[1:]:
        edges = ScalarEdges.join(_edges(graph, graph.fields, stride), links.edges(graph.breaks.shape, stride))
        values = _refine_grid(values, graph.breaks.shape[:2], stride)
        for cutoff in settings.cutoffs:
            values, rejected = _round(graph, edges, values, stride, cutoff)
    return values, rejected


def _solve_coarsest(graph: LayerGraph) -> tuple[Float32Array, BlockLinks]:
    """Solve the coarsest graph, match the blocks across faults by its layer time, and solve it again with that."""
    settings, traces, m = graph.settings, graph.breaks.shape[:2], graph.breaks.shape[2]
    stride, step = settings.strides[0], settings.shifts.step
    values = np.zeros((*(-(-n // stride) for n in traces), m), np.float32)
    doubted = _edges(graph, _doubt(graph), stride)
    for cutoff in settings.first_cutoffs:
        values, _ = _round(graph, doubted, values, stride, cutoff)
    edges = _edges(graph, graph.fields, stride)
    for cutoff in settings.clear_cutoffs:
        values, _ = _round(graph, edges, values, stride, cutoff)
    links = BlockLinks.none()
    if not graph.faults:
        return values, links
    blocks = label_blocks(graph.cuts, graph.breaks, step)
    for cutoffs in settings.block_cutoffs:
        at = (values, blocks, graph.breaks, graph.volume, graph.valid)
        links = BlockLinks.join(
            [match_blocks(g, *at, stride=stride, step=step, settings=settings.blocks) for g, *_ in graph.faults]
        )
        both = ScalarEdges.join(edges, links.edges(graph.breaks.shape, stride))
        for cutoff in cutoffs:
            values, _ = _round(graph, both, values, stride, cutoff)
    return values, links


def _round(
    graph: LayerGraph, edges: ScalarEdges, values: Float32Array, stride: int, cutoff: float
) -> tuple[Float32Array, float]:
    """One robust round; the thickness of layers is that of their surroundings in the round before."""
    joined = ScalarEdges.join(edges, _thickness_edges(graph, values, stride))
    settings = SolveSettings((cutoff,), graph.settings.iterations * stride**2, tolerance=1e-3)
    found = solve_scalars(values.size, joined, start=values.ravel(), settings=settings)
    return found.values.reshape(values.shape), float(found.rejected.mean())


def _doubt(graph: LayerGraph) -> list[ShiftField]:
    """Return the shifts, those near a fault or with a bad fit with a much larger variance."""
    settings = graph.settings
    step = settings.shifts.step
    near = np.zeros(graph.breaks.shape, bool)
    for t in range(step):
        part = graph.cuts[:, :, t::step] & 3 > 0
        near[:, :, : part.shape[2]] |= part
    size = 2 * settings.clear + 1
    near = ndimage.maximum_filter(near, (size, size, 1))
    return [
        replace(f, variance=np.where(_is_doubtful(f, near, settings), _DOUBT, 1) * f.variance) for f in graph.fields
    ]


def _is_doubtful(f: ShiftField, near: BoolArray, settings: LayerTimeSettings) -> BoolArray:
    doubt = near | (f.misfit > 1.0) | (f.variance >= np.float32(settings.shifts.most * f.length))
    if f.axis == 0:
        doubt[: -f.length] |= near[f.length :]
    else:
        doubt[:, : -f.length] |= near[:, f.length :]
    return doubt


def _refine_grid(values: Float32Array, traces: tuple[int, ...], stride: int) -> Float32Array:
    """Return values on a grid of half the stride, each from its coarse neighbour."""
    rows, columns = (
        np.minimum(np.arange(-(-n // stride)) // 2, size - 1) for n, size in zip(traces, values.shape[:2], strict=True)
    )
    return np.ascontiguousarray(values[rows][:, columns])


def _edges(graph: LayerGraph, fields: list[ShiftField], stride: int) -> ScalarEdges:
    """Return all edges between traces of a stride, along layers and across faults."""
    step, nearest = graph.settings.shifts.step, graph.nearest
    parts = []
    for f in fields:
        if f.length % stride:
            continue
        arrays = _empty_edges(count_links(f.shift, f.axis, f.length, stride, step))
        along = (nearest[f.axis], f.shift, f.variance, graph.cuts, graph.breaks, f.axis, f.length, stride, step)
        parts.append(_as_edges(arrays, link_traces(*along, *arrays)))
    parts.extend(
        link_grid(grid, throw, variance, nearest, graph.breaks, stride=stride, step=step)
        for grid, throw, variance in graph.faults
    )
    return ScalarEdges.join(*parts)


def _thickness_edges(graph: LayerGraph, values: Float32Array, stride: int) -> ScalarEdges:
    breaks = np.ascontiguousarray(graph.breaks[::stride, ::stride])
    arrays = _empty_edges(values.size)
    thickness = _smooth_thickness(values, breaks, graph.settings, stride).ravel()
    return _as_edges(arrays, link_samples(thickness, breaks, np.float32(graph.settings.thickness**2), *arrays))


def _smooth_thickness(values: Float32Array, breaks: AnyArray, settings: LayerTimeSettings, stride: int) -> Float32Array:
    """Return the mean growth of the values over a coarse sample in wide surroundings, faults left out."""
    known = (breaks == 0).astype(np.float32)
    known[:, :, -1] = 0.0
    change = np.diff(values, axis=2, append=values[:, :, -1:]) * known
    limit = np.float32(0.7 * settings.shifts.step)
    np.clip(change, -limit, limit, out=change)
    sigma = (settings.wide[0] / stride, settings.wide[0] / stride, settings.wide[1] / settings.shifts.step)
    share = np.maximum(ndimage.gaussian_filter(known, sigma), np.float32(1e-3))
    return np.asarray(ndimage.gaussian_filter(change, sigma) / share)


def _empty_edges(n: int) -> tuple[AnyArray, ...]:
    return (np.empty(n, np.int32), np.empty(n, np.int32), *(np.empty(n, np.float32) for _ in range(3)))


def _as_edges(arrays: tuple[AnyArray, ...], n: int) -> ScalarEdges:
    first, second, measured, variance, share = (array[:n] for array in arrays)
    return ScalarEdges(first, second, measured, variance, np.zeros(n, np.float32), share)
