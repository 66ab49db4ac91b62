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
    """

    rows: int = 6
    samples: int = 8
    reach: float = 12.0
    clear: float = 1.5
    window: float = 16.0
    farthest: int = 30
    least_known: float = 0.4
    smooth: float = 1.0
    slope: float = 0.003
    least: float = 0.6


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
    rows, samples = np.meshgrid(
        np.arange(0, grid.w.shape[0], settings.rows),
        np.arange(first, grid.w.shape[1], -(-settings.samples // step) * step),
        indexing="ij",
    )
    index = np.stack(np.meshgrid(*(np.arange(n) for n in rows.shape), indexing="ij"), axis=-1).reshape(-1, 2)
    rows, samples = rows.ravel(), samples.ravel()
    at = grid.place(rows, samples)
    slopes = []
    for axis in range(2):
        reach = 6 if axis else 4
        ends = [np.clip((rows, samples)[axis] + d, 0, grid.w.shape[axis] - 1) for d in (-reach, reach)]
        w = [grid.w[end, samples] if axis == 0 else grid.w[rows, end] for end in ends]
        slope = (w[1] - w[0]) / np.maximum(ends[1] - ends[0], 1)
        slopes.append(np.where(np.isfinite(slope), slope, 0.0))
    along = np.array([-grid.across[1], grid.across[0]])
    planes = np.column_stack([grid.across - slopes[0][:, None] * along, -slopes[1]])
    n0, n1, m = blocks.shape
    ok = np.isfinite(at).all(axis=1) & grid.inside[rows, samples] & (at[:, 2] >= 0) & (at[:, 2] <= (m - 1) * step)
    at, planes, index = at[ok], planes[ok], index[ok]
    level = np.rint(at[:, 2] / step).astype(np.int64)
    sides = []
    for sign in (-1.0, 1.0):
        trace = np.rint((at[:, :2] + sign * 3.0 * grid.across) / stride).astype(np.int64) * stride
        inside = (trace >= 0).all(axis=1) & (trace < (n0, n1)).all(axis=1)
        trace = np.where(inside[:, None], trace, -1)
        i, j = np.where(inside, trace[:, 0], 0), np.where(inside, trace[:, 1], 0)
        block = np.where(inside, blocks[i, j, level], -1).astype(np.int32)
        sides.append((trace, block, values[i // stride, j // stride, level] + at[:, 2]))
    foot, hang = sides
    return _Places(at, planes, index, (foot[0], hang[0]), (foot[1], hang[1]), (foot[2], hang[2]))


def _score_lags(
    places: _Places, side: int, values: Float32Array, blocks: IntArray, breaks: AnyArray, volume: Float32Array,
    valid: BoolArray, stride: int, step: int, settings: BlockSettings,
) -> Float32Array:  # fmt: skip
    """Correlation of a side's layers with the other's, at every lag of layer time."""
    half = int(2.0 * settings.window)
    t = np.arange(-half, half + 1)
    taper = np.exp(-0.5 * (t / settings.window) ** 2)
    stacks = []
    for which, length in ((side, half), (1 - side, half + settings.farthest)):
        out, weight = (np.empty((len(places.at), 2 * length + 1), np.float32) for _ in range(2))
        sides = np.full(len(places.at), 2.0 * which - 1.0)
        stack_layers(
            values, blocks, breaks, volume, valid, places.at, places.planes, sides, places.blocks[which],
            places.times[side], stride, step, settings.reach, settings.clear, out, weight,
        )  # fmt: skip
        stacks += [out, weight]
    scores = np.empty((len(places.at), 2 * settings.farthest + 1), np.float32)
    match_layers(*stacks, taper, settings.least_known, scores)
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


def match_blocks(
    grid: SurfaceGrid, values: Float32Array, blocks: IntArray, breaks: AnyArray, volume: Float32Array, valid: BoolArray,
    *, stride: int, step: int, settings: BlockSettings | None = None,
) -> tuple[ScalarEdges, Float64Array]:  # fmt: skip
    """Edges across a fault, from either of its sides to the other, and the corrections of the layer time they ask for."""
    settings = settings or BlockSettings()
    places = _choose_places(grid, values, blocks, stride, step, settings)
    parts, asked = [ScalarEdges.from_arrays([], [], measured=[])], [np.zeros(0)]
    if not len(places.at):
        return parts[0], asked[0]
    lags = np.arange(-settings.farthest, settings.farthest + 1)
    for side in range(2):
        scores = _score_lags(places, side, values, blocks, breaks, volume, valid, stride, step, settings)
        scores = _smooth_scores(scores, places, settings.smooth) - settings.slope * np.abs(lags)
        best = np.clip(scores.argmax(axis=1), 1, len(lags) - 2)
        rows = np.arange(len(best))
        before, here, after = (scores[rows, best + d] for d in (-1, 0, 1))
        bend = before - 2.0 * here + after
        lag = lags[best] + np.where(bend < -1e-6, np.clip(0.5 * (before - after) / np.minimum(bend, -1e-6), -0.5, 0.5), 0.0)
        far = np.abs(lags[None] - lags[best][:, None]) > 6
        rival = np.where(far, scores, -1.0).max(axis=1)
        sure = (here > settings.least) & (here - rival > 0.1)
        parts_, asked_ = _edges(places, side, lag, here, sure, values, blocks, breaks, stride, step)
        parts.append(parts_)
        asked.append(asked_)
    return ScalarEdges.join(*parts), np.concatenate(asked)


def _edges(
    places: _Places, side: int, lag: Float64Array, score: Float64Array, sure: BoolArray, values: Float32Array,
    blocks: IntArray, breaks: AnyArray, stride: int, step: int,
) -> tuple[ScalarEdges, Float64Array]:  # fmt: skip
    here, there = places.traces[side], places.traces[1 - side]
    low, share = np.empty(len(lag), np.int64), np.zeros(len(lag))
    targets = places.times[side] + lag
    locate_levels(values, blocks, breaks, there, places.blocks[1 - side], targets, stride, step, low, share)
    ok = sure & (here[:, 0] >= 0) & (low >= 0)
    n1, m = values.shape[1:]
    level = np.rint(places.at[:, 2] / step).astype(np.int64)
    first = ((here[:, 0] // stride) * n1 + here[:, 1] // stride) * m + level
    second = ((there[:, 0] // stride) * n1 + there[:, 1] // stride) * m + low
    measured = places.at[:, 2] - (low + share) * step
    spread = 0.3 + 4.0 * (1.0 - np.clip(score, 0.0, 1.0))
    edges = ScalarEdges.from_arrays(
        first[ok], second[ok], measured=measured[ok], variance=spread[ok] ** 2, second_share=share[ok]
    )
    return edges, lag[ok]
