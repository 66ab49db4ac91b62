"""The registration graph of a cube: samples of traces as vertices, shifts between traces as edges."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

import numpy as np
from scipy import ndimage

from seismo3d._settings import Correlation, Count, Positive, Steps, StepsOrNone, Width
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array
from seismo3d.graph.scalars import ScalarEdges
from seismo3d.seismic._kernels_layer_solve import keep_free
from seismo3d.seismic.dip import DipSettings
from seismo3d.seismic.fault_links import LinkSettings, SurfaceGrid, doubt_matches, link_grid
from seismo3d.seismic.layer_parts import PartSettings
from seismo3d.seismic.layer_system import LayerSystem, LinkFields
from seismo3d.seismic.linking import InMemory
from seismo3d.seismic.shifts import ShiftField, ShiftSettings

# by how much the variance of doubtful shifts is larger on the coarsest graph, and on finer ones in noise
_DOUBT = 1e4
# usual misfit of shifts to the next traces from which one that leaks past a fault cannot be told by its own
_HIDDEN = 0.1
# samples off at which a shift lies at the cutoffs of finer graphs, or nearer
_OFF = 1.5
# of the rounds on the coarsest graph, so many at the end count all shifts
_UNDOUBTED = 3


_Cutoff: TypeAlias = Annotated[float, "[0.1, inf]"]


@dataclass(frozen=True, slots=True)
class LayerTimeSettings:
    """Settings of the layer time.

    Attributes
    ----------
    lengths : tuple of int in [1, 100], rising from 1
        Distances in traces over which shifts are measured.
    strides : tuple of int in [1, 100], halving to 1, among lengths
        The graph is solved on every so-many-th trace; each is half of the one before, the last is 1.
    thickness : float in (0, inf)
        Standard deviation, in samples, of the growth of layer time over one coarse sample about that of its
        surroundings in a cube without noise: what ties the layers of a trace together.
    noisy : float in (0, inf)
        The same of a cube that is all noise; in between it grows with the noise's share of the energy (`usual` of its
        shifts). A noisy cube's shifts weigh less, and ties as stiff as ever would make its layers parallel, whatever
        the shifts say.
    wide : (float, float) in (0, 1000]
        Widths of these surroundings, in traces and samples.
    clear : int in [0, 100]
        Shifts this close to a fault, in traces, are hardly trusted until the rest agrees.
    least : float in (0, 1)
        Least growth of layer time a sample.
    first_cutoffs : tuple of float in [0.1, inf], not empty
        Robust rounds on the coarsest graph, in standard deviations; in the last three all shifts count.
    cutoffs : tuple of float in [0.1, inf], not empty
        The same on each finer graph; none but the last so large that shifts a sample or two off would count, which in
        noise are few standard deviations.
    iterations : int in [1, 1000000]
        Most steps a round on the finest graph; a graph of every n-th trace has n squared times as many.
    grouped : int in [0, inf)
        Vertices up to which the coarsest graph is solved by groups of vertices as well.
    grouped_iterations : int in [1, 1000000]
        Most steps a round there.
    apart : float in [1, 1000]
        Units of layer time between the levels at which parts that faults bound are placed by their waveforms.
    sure : float in [-1, 1]
        Correlation that a part must have for layer time to be mended by it.
    dip, shifts, links, parts
        Settings of the stages. Throws may be wrong by a cycle and a half: parts of levels are looked for as far off.
    """

    lengths: Annotated[tuple[Steps, ...], "rising from 1"] = (1, 2, 4)
    strides: Annotated[tuple[Steps, ...], "halving to 1", "among lengths"] = (4, 2, 1)
    thickness: Positive = 0.3
    noisy: Positive = 16.0
    wide: tuple[Width, Width] = (8.0, 8.0)
    clear: StepsOrNone = 2
    least: Annotated[float, "(0, 1)"] = 1e-3
    first_cutoffs: Annotated[tuple[_Cutoff, ...], "not empty"] = (np.inf, 30.0, 15.0, 8.0, 5.0, 3.0, 3.0, 3.0)
    cutoffs: Annotated[tuple[_Cutoff, ...], "not empty"] = (30.0, 3.0)
    iterations: Count = 40
    grouped: Annotated[int, "[0, inf)"] = 1 << 20
    grouped_iterations: Count = 200
    apart: Annotated[float, "[1, 1000]"] = 8.0
    sure: Correlation = 0.6
    dip: DipSettings = field(default_factory=DipSettings)
    shifts: ShiftSettings = field(default_factory=ShiftSettings)
    links: LinkSettings = field(default_factory=LinkSettings)
    parts: PartSettings = field(default_factory=lambda: PartSettings(farthest=18, wary=1.0, surely=0.8))


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
    settings : LayerTimeSettings
    """

    fields: list[ShiftField]
    cuts: AnyArray
    breaks: AnyArray
    faults: list[tuple[SurfaceGrid, Float64Array, Float64Array]]
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
    settings, traces, m = graph.settings, graph.breaks.shape[:2], graph.breaks.shape[2]
    usual = [f.usual for f in graph.fields]
    values = np.zeros((*(-(-n // settings.strides[0]) for n in traces), m), np.float32)
    rejected = 0.0
    for stride in settings.strides:
        system, filled = _system(graph, stride), 0.0
        for number, (doubt, cutoff) in enumerate(list_rounds(settings, stride, usual)):
            if doubt != filled:
                _fill_variances(graph, stride, doubt, system.fields.variance)
                filled = doubt
            if number == 0 and stride != settings.strides[0]:
                values = _refine_grid(values, traces, stride)
                system.lead(values)
            values, rejected = _round(graph, system, values, stride, cutoff)
    system.bring_to_scale(values)
    return values, rejected


def list_rounds(settings: LayerTimeSettings, stride: int, usual: list[float]) -> list[tuple[float, float]]:
    """Return the robust rounds at a stride: by how much variances of doubtful shifts are larger, and the cutoff.

    Without noise a shift that leaks past a fault fits badly, counts little by itself, and what lies beside faults is
    told on finer graphs by all that is measured there. In noise it fits as well as any other: it must not pull at what
    the coarsest graph found before the rest has settled. A shift's standard deviation is about the root of the cube's
    usual misfit, in samples; no cutoff but the last is larger than what one and a half samples off are in these.
    """
    if stride == settings.strides[0]:
        n_doubted = len(settings.first_cutoffs) - _UNDOUBTED
        return [(_DOUBT if n < n_doubted else 1.0, cutoff) for n, cutoff in enumerate(settings.first_cutoffs)]
    noise = nearest_misfit(usual)
    *first, last = settings.cutoffs
    most = max(last, _OFF / max(noise, 1e-9) ** 0.5)
    return [*((_DOUBT ** min(noise / _HIDDEN, 1.0), min(cutoff, most)) for cutoff in first), (1.0, last)]


def _round(
    graph: LayerGraph, system: LayerSystem, values: Float32Array, stride: int, cutoff: float
) -> tuple[Float32Array, float]:
    """One robust round; the thickness of layers is that of their surroundings in the round before."""
    settings, found, drawn = graph.settings, values.copy(), values.copy()
    system.bring_to_scale(drawn)
    system.thickness[...] = smooth_thickness(drawn, system.breaks, settings, stride)
    del drawn
    spread = thickness_variance([f.usual for f in graph.fields], settings)
    system.weigh(found, cutoff, spread)
    improve_values(system, found, stride, settings)
    return found, system.weigh(found, cutoff, spread)


def improve_values(system: LayerSystem, values: Float32Array, stride: int, settings: LayerTimeSettings) -> None:
    """Take values, in place, nearer to the least squares of the weighted links.

    On the coarsest graph, by groups of vertices too: what whole compartments are off by is told there.
    """
    grouped = stride == settings.strides[0] and values.size <= settings.grouped
    steps = settings.grouped_iterations if grouped else settings.iterations * stride**2
    system.improve(values, steps, grouped=grouped)


def thickness_variance(usual: list[float], settings: LayerTimeSettings) -> float:
    """Return the variance of thickness in a cube with such misfits of its shifts, by length, then axis."""
    return settings.thickness**2 + (settings.noisy * nearest_misfit(usual)) ** 2


def nearest_misfit(usual: list[float]) -> float:
    """Return the cube's usual misfit, of shifts to the next traces, from those of all its shifts."""
    return (usual[0] + usual[1]) / 2


def near_faults(cuts: AnyArray, shape: tuple[int, ...], factor: float, settings: LayerTimeSettings) -> BoolArray | None:
    """Mark the coarse samples, in an array of this shape, beside which a fault passes within `clear` traces.

    None where the factor by which shifts are doubted there is 1.
    """
    if factor == 1.0:
        return None
    step, near = settings.shifts.step, np.zeros(shape, bool)
    for t in range(step):
        part = cuts[:, :, t::step] & 3 > 0
        near[:, :, : part.shape[2]] |= part
    size = 2 * settings.clear + 1
    return np.asarray(ndimage.maximum_filter(near, (size, size, 1)))


def doubt_shifts(f: ShiftField, near: BoolArray | None, factor: float, settings: LayerTimeSettings) -> Float32Array:
    """Return the variances of shifts, those that touch a fault, fit badly or are not measured larger by a factor.

    Without a map of what is near faults, as :func:`near_faults` gives it, none is doubted.
    """
    if near is None:
        return f.variance
    doubt = near | (f.misfit > 1.0) | (f.variance >= np.float32(settings.shifts.most * f.length))
    if f.axis == 0:
        doubt[: -f.length] |= near[f.length :]
    else:
        doubt[:, : -f.length] |= near[:, f.length :]
    return np.where(doubt, np.float32(factor), np.float32(1.0)) * f.variance


def _refine_grid(values: Float32Array, traces: tuple[int, ...], stride: int) -> Float32Array:
    """Return values on a grid of half the stride, each from its coarse neighbour."""
    rows, columns = (
        np.minimum(np.arange(-(-n // stride)) // 2, size - 1) for n, size in zip(traces, values.shape[:2], strict=True)
    )
    return np.ascontiguousarray(values[rows][:, columns])


def _system(graph: LayerGraph, stride: int) -> LayerSystem:
    """Return the links between traces of a stride, along layers, with no variances yet, and those across faults."""
    step, used = graph.settings.shifts.step, _used(graph, stride)
    breaks = np.ascontiguousarray(graph.breaks[::stride, ::stride])
    shape: tuple[int, int, int] = (breaks.shape[0], breaks.shape[1], breaks.shape[2])
    links = LinkFields.empty([(f.axis, f.length // stride) for f in used], shape, InMemory())
    for n, f in enumerate(used):
        links.shift[n] = f.shift[::stride, ::stride]
    usual = nearest_misfit([f.usual for f in graph.fields])
    listed = [
        link_grid(
            grid, throw, doubt_matches(variance, usual, graph.settings.links), graph.nearest, graph.breaks,
            stride=stride, step=step,
        )
        for grid, throw, variance in graph.faults
    ]  # fmt: skip
    return LayerSystem.of(links, breaks, ScalarEdges.join(ScalarEdges.none(), *listed), InMemory(), step=step)


def _used(graph: LayerGraph, stride: int) -> list[ShiftField]:
    """Return the shifts that join traces of a stride."""
    return [f for f in graph.fields if f.length % stride == 0]


def _fill_variances(graph: LayerGraph, stride: int, doubt: float, out: Float32Array) -> None:
    """Write the variances of the links between traces, infinite across faults, those of doubtful ones raised."""
    settings = graph.settings
    near = near_faults(graph.cuts, graph.breaks.shape, doubt, settings)
    for n, f in enumerate(_used(graph, stride)):
        variance, nearest = doubt_shifts(f, near, doubt, settings), graph.nearest[f.axis]
        keep_free(nearest, graph.cuts, variance, f.axis, f.length, stride, settings.shifts.step, 0, 0, out[n])


def smooth_thickness(values: Float32Array, breaks: AnyArray, settings: LayerTimeSettings, stride: int) -> Float32Array:
    """Return the mean growth of the values over a coarse sample in wide surroundings, faults left out."""
    known = (breaks == 0).astype(np.float32)
    known[:, :, -1] = 0.0
    change = np.diff(values, axis=2, append=values[:, :, -1:]) * known
    limit = np.float32(0.7 * settings.shifts.step)
    np.clip(change, -limit, limit, out=change)
    sigma = (settings.wide[0] / stride, settings.wide[0] / stride, settings.wide[1] / settings.shifts.step)
    share = np.maximum(ndimage.gaussian_filter(known, sigma), np.float32(1e-3))
    return np.asarray(ndimage.gaussian_filter(change, sigma) / share)
