"""Edges across faults from whole windows of layers: the blocks on their two sides, matched in layer time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.graph.scalars import ScalarEdges
from seismo3d.seismic._kernels_blocks import locate_levels, match_layers, stack_layers
from seismo3d.seismic.fault_links import SurfaceGrid


@dataclass(frozen=True, slots=True)
class BlockSettings:
    """How blocks are matched across faults; lengths in traces and samples.

    Attributes
    ----------
    rows, samples : int
        Blocks are matched at every so many traces along a fault and samples down it.
    reach : float
        Traces within this distance are averaged on either side.
    clear : float
        Samples closer to the fault than this do not count.
    off : float
        Distance from the fault of the traces that are joined.
    window : float
        Width of the Gaussian window of layer time.
    farthest : int
        Largest error of the layer time across a fault that is looked for.
    least_known : float
        Share of the window that both sides must have.
    smooth : float
        Width, in matched places, over which matches along a fault are averaged.
    slope : float
        Correlation that a sample of correction must be worth.
    least : float
        Correlation below which blocks are not joined.
    apart, lead : float
        Nor where a lag so many samples off correlates nearly as well: worse by less than this.
    deviation, spread : float
        Standard deviation, in samples, of a perfect match, and what it grows by as the correlation falls to 0.
    stretch : float
        What it grows by a sample that a layer lies beyond the end of its block on the trace that it is joined to.
    """

    rows: int = 6
    samples: int = 8
    reach: float = 12.0
    clear: float = 2.5
    off: float = 6.0
    window: float = 16.0
    farthest: int = 30
    least_known: float = 0.4
    smooth: float = 1.0
    slope: float = 0.003
    least: float = 0.6
    apart: float = 6.0
    lead: float = 0.1
    deviation: float = 0.2
    spread: float = 2.0
    stretch: float = 0.05


def label_blocks(cuts: AnyArray, breaks: AnyArray, step: int) -> IntArray:
    """Give numbers to the parts of a cube that faults separate, at every coarse sample; from 0."""
    numbers = np.arange(breaks.size).reshape(breaks.shape)
    coarse = cuts[:, :, ::step]
    free = [
        (numbers[:-1], numbers[1:], coarse[:-1] & 1 == 0),
        (numbers[:, :-1], numbers[:, 1:], coarse[:, :-1] & 2 == 0),
        (numbers[:, :, :-1], numbers[:, :, 1:], breaks[:, :, :-1] == 0),
    ]
    first, second = (np.concatenate([ends[k][ends[2]] for ends in free]) for k in range(2))
    graph = coo_matrix((np.ones(len(first), bool), (first, second)), shape=(breaks.size,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int32).reshape(breaks.shape)


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Where blocks are matched: places on a fault, its plane there, and for either side trace, block and layer time."""

    at: Float64Array
    planes: Float64Array
    grid: IntArray
    traces: tuple[IntArray, IntArray]
    blocks: tuple[IntArray, IntArray]
    times: tuple[Float64Array, Float64Array]


def _choose_places(
    grid: SurfaceGrid, values: Float32Array, blocks: IntArray, stride: int, step: int, settings: BlockSettings
) -> _Places:
    first = -grid.first[1] % step
    grids = np.meshgrid(
        np.arange(0, grid.w.shape[0], settings.rows),
        np.arange(first, grid.w.shape[1], -(-settings.samples // step) * step),
        indexing="ij",
    )
    index = np.stack(np.meshgrid(*(np.arange(n) for n in grids[0].shape), indexing="ij"), axis=-1).reshape(-1, 2)
    rows, samples = (g.ravel() for g in grids)
    at = grid.place(rows, samples)
    slopes = [_slope(grid, rows, samples, axis, reach) for axis, reach in ((0, 4), (1, 6))]
    along = np.array([-grid.across[1], grid.across[0]])
    planes = np.column_stack([grid.across - slopes[0][:, None] * along, -slopes[1]])
    n0, n1, m = blocks.shape
    ok = np.isfinite(at).all(axis=1) & grid.inside[rows, samples] & (at[:, 2] >= 0) & (at[:, 2] <= (m - 1) * step)
    at, planes, index = at[ok], planes[ok], index[ok]
    level = np.rint(at[:, 2] / step).astype(np.int64)
    sides = []
    for sign in (-1.0, 1.0):
        trace = np.rint((at[:, :2] + sign * settings.off * grid.across) / stride).astype(np.int64) * stride
        inside = (trace >= 0).all(axis=1) & (trace < (n0, n1)).all(axis=1)
        trace = np.where(inside[:, None], trace, -1)
        i, j = np.where(inside, trace[:, 0], 0), np.where(inside, trace[:, 1], 0)
        block = np.where(inside, blocks[i, j, level], -1).astype(np.int32)
        sides.append((trace, block, values[i // stride, j // stride, level] + at[:, 2]))
    foot, hang = sides
    return _Places(at, planes, index, (foot[0], hang[0]), (foot[1], hang[1]), (foot[2], hang[2]))


def _slope(grid: SurfaceGrid, rows: IntArray, samples: IntArray, axis: int, reach: int) -> Float64Array:
    """Slope of a fault along its rows or samples, over some nodes to either side; 0 where it is not known."""
    ends = [np.clip((rows, samples)[axis] + d, 0, grid.w.shape[axis] - 1) for d in (-reach, reach)]
    before, after = (grid.w[end, samples] if axis == 0 else grid.w[rows, end] for end in ends)
    slope = (after - before) / np.maximum(ends[1] - ends[0], 1)
    return np.where(np.isfinite(slope), slope, 0.0)


def _score_lags(
    places: _Places, side: int, values: Float32Array, blocks: IntArray, breaks: AnyArray, volume: Float32Array,
    valid: BoolArray, stride: int, step: int, settings: BlockSettings,
) -> Float32Array:  # fmt: skip
    """Correlation of a side's layers with the other's, at every lag of layer time."""
    half = int(2.0 * settings.window)
    t = np.arange(-half, half + 1)
    taper = np.exp(-0.5 * (t / settings.window) ** 2)
    stacks: list[Float32Array] = []
    for which, length in ((side, half), (1 - side, half + settings.farthest)):
        out, weight = (np.empty((len(places.at), 2 * length + 1), np.float32) for _ in range(2))
        sides = np.full(len(places.at), 2.0 * which - 1.0)
        stack_layers(
            values, blocks, breaks, volume, valid, places.at, places.planes, sides, places.blocks[which],
            places.times[side], stride, step, settings.reach, settings.clear, out, weight,
        )  # fmt: skip
        stacks += [out, weight]
    scores = np.empty((len(places.at), 2 * settings.farthest + 1), np.float32)
    one, in_one, other, in_other = stacks
    match_layers(one, in_one, other, in_other, taper, settings.least_known, scores)
    return scores


def _smooth_scores(scores: Float32Array, places: _Places, sigma: float) -> Float32Array:
    """Average scores along the fault, over places between the same two blocks."""
    size = tuple(places.grid.max(axis=0) + 1) if len(places.grid) else (1, 1)
    pair = places.blocks[0].astype(np.int64) * (int(places.blocks[1].max(initial=0)) + 2) + places.blocks[1]
    out = np.full_like(scores, -1.0)
    for value in np.unique(pair):
        chosen = pair == value
        i, j = places.grid[chosen].T
        total, known = np.zeros((*size, scores.shape[1])), np.zeros((*size, scores.shape[1]))
        known[i, j] = scores[chosen] > -1.0
        total[i, j] = np.where(scores[chosen] > -1.0, scores[chosen], 0.0)
        total, known = (ndimage.gaussian_filter(a, (sigma, sigma, 0), mode="constant") for a in (total, known))
        out[chosen] = np.where(known[i, j] > 0.05, total[i, j] / np.maximum(known[i, j], 1e-6), -1.0)
    return out


@dataclass(frozen=True, slots=True, eq=False)
class BlockLinks:
    """Pairs of places on the two sides of a fault that are of one age.

    Attributes
    ----------
    first, second : ndarray of shape (n, 3), int64
        Inline, crossline and coarse sample of the two places; the second lies below that sample.
    share : ndarray of shape (n,), float64
        How far, as a share of the distance to the next coarse sample.
    measured, variance : ndarray of shape (n,), float64
        Depth of the first less that of the second, in samples, and its variance.
    """

    first: IntArray
    second: IntArray
    share: Float64Array
    measured: Float64Array
    variance: Float64Array

    @classmethod
    def join(cls, parts: list[BlockLinks]) -> BlockLinks:
        """Return the links of all parts, one after the other."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__))

    @classmethod
    def none(cls) -> BlockLinks:
        """Return no links."""
        return cls(np.empty((0, 3), np.int64), np.empty((0, 3), np.int64), np.empty(0), np.empty(0), np.empty(0))

    def edges(self, shape: tuple[int, ...], stride: int) -> ScalarEdges:
        """Return the links as edges of the graph of every stride-th trace, of a cube of a shape in coarse samples."""
        across, m = (shape[1] - 1) // stride + 1, shape[2]
        first, second = (
            ((at[:, 0] // stride) * across + at[:, 1] // stride) * m + at[:, 2] for at in (self.first, self.second)
        )
        return ScalarEdges.from_arrays(
            first, second, measured=self.measured, variance=self.variance, second_share=self.share
        )


def match_blocks(
    grid: SurfaceGrid, values: Float32Array, blocks: IntArray, breaks: AnyArray, volume: Float32Array, valid: BoolArray,
    *, stride: int, step: int, settings: BlockSettings | None = None,
) -> BlockLinks:  # fmt: skip
    """Match the layers on the two sides of a fault, at places all over it.

    On either side the traces near a place are averaged as a function of the layer time found so far, over the whole
    height of the block that it belongs to. The lag at which the two averages correlate best is what the layer time is
    wrong by across the fault.

    Parameters
    ----------
    grid : SurfaceGrid
        The fault.
    values : ndarray of shape (inline, crossline, coarse sample), float32
        Layer time less sample on every stride-th trace.
    blocks : ndarray of shape (inline, crossline, coarse sample), int32
        Parts that faults bound, from :func:`label_blocks`, on every trace.
    breaks : ndarray of the same shape, uint8
        Where a fault passes below a coarse sample.
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, and where there are any.
    stride, step : int
        Traces and samples from one value to the next.
    settings : BlockSettings, optional

    Returns
    -------
    BlockLinks
    """
    settings = settings or BlockSettings()
    places = _choose_places(grid, values, blocks, stride, step, settings)
    if not len(places.at):
        return BlockLinks.none()
    parts = []
    for side in range(2):
        scores = _score_lags(places, side, values, blocks, breaks, volume, valid, stride, step, settings)
        lag, score, sure = _best_lags(_smooth_scores(scores, places, settings.smooth), settings)
        parts.append(_link_places(places, side, lag, score, sure, values, blocks, breaks, stride, step, settings))
    return BlockLinks.join(parts)


def _best_lags(scores: Float32Array, settings: BlockSettings) -> tuple[Float64Array, Float64Array, BoolArray]:
    """Best lag of every place, its correlation, and whether it is high and no other lag comes near it."""
    lags = np.arange(-settings.farthest, settings.farthest + 1)
    scores = (scores - settings.slope * np.abs(lags)).astype(np.float32)
    best = np.clip(scores.argmax(axis=1), 1, len(lags) - 2)
    before, here, after = (scores[np.arange(len(best)), best + d] for d in (-1, 0, 1))
    bend = before - 2.0 * here + after
    part = np.where(bend < -1e-6, 0.5 * (before - after) / np.minimum(bend, -1e-6), 0.0)
    far = np.abs(lags - lags[best][:, None]) > settings.apart
    rival = np.where(far, scores, -1.0).max(axis=1)
    return lags[best] + np.clip(part, -0.5, 0.5), here, (here > settings.least) & (here - rival > settings.lead)


def _link_places(
    places: _Places, side: int, lag: Float64Array, score: Float64Array, sure: BoolArray, values: Float32Array,
    blocks: IntArray, breaks: AnyArray, stride: int, step: int, settings: BlockSettings,
) -> BlockLinks:  # fmt: skip
    """Join the trace beside every place to where the trace on the other side has the layer time that was matched."""
    here, there = places.traces[side], places.traces[1 - side]
    low, share, beyond = np.empty(len(lag), np.int64), np.zeros(len(lag)), np.zeros(len(lag))
    targets = places.times[side] + lag
    locate_levels(values, blocks, breaks, there, places.blocks[1 - side], targets, stride, step, low, share, beyond)
    ok = sure & (here[:, 0] >= 0) & (low >= 0) & (np.abs(beyond) < settings.farthest)
    level = np.rint(places.at[:, 2] / step).astype(np.int64)
    deviation = settings.deviation + settings.spread * (1.0 - np.clip(score[ok], 0.0, 1.0))
    return BlockLinks(
        np.column_stack([here, level])[ok], np.column_stack([there, low])[ok], share[ok],
        (level * step - (low + share) * step - beyond)[ok], deviation**2 + (settings.stretch * beyond[ok]) ** 2,
    )  # fmt: skip
