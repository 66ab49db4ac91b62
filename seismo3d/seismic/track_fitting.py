"""From layer time to one horizon: where the layer passes, which of its parts are the horizon, and its exact place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_tracks import part_untold
from seismo3d.seismic.inner_seeds import move_inwards
from seismo3d.seismic.layer_parts import find_shapes, label_parts, place_once, read_parts
from seismo3d.seismic.layer_pieces import find_levels, layer_pieces
from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.track_growing import grow_parts, keep_sides
from seismo3d.seismic.track_pieces import keep_pieces
from seismo3d.seismic.track_refining import FARTHEST_BENT, TrackSettings, bend_to_seeds, refine_depth
from seismo3d.seismic.track_seats import find_offset

# traces of a part that is but a scrap, and how far from a seed on one a part is looked for
_SCRAP, _AROUND = 16, 4
# correlation from which on a trace tells whether the seeds lie on the same horizon
_CONFIDENT = 0.7
# how far below or above a seed a part may pass there
_PASSING = 6.0
# samples within which seeds agree
_AGREE = 3.0
# traces within which it is not known where a layer begins to lie over itself
_EDGE = 1
# samples by which a depth may miss the cube by rounding alone
_ROUNDED = 1e-3


def fit_track(
    layers: LayerModel, index: Float64Array, settings: TrackSettings
) -> tuple[Float64Array, Float32Array, IntArray]:
    """Find the horizon through seeds.

    Parameters
    ----------
    layers : LayerModel
        Of the cube.
    index : ndarray of shape (n, 3), float64
        Seeds, as fractional indices.
    settings : TrackSettings

    Returns
    -------
    depth : ndarray of shape (inline, crossline), float64
        Fractional sample; NaN where the horizon was not traced.
    confidence : ndarray of the same shape, float32
    alone : ndarray of int
        Seeds that the horizon does not run through: it holds them on their own traces alone, at a confidence of 0.
    """
    inner = move_inwards(layers, index)
    counts = find_counting(layers, inner)
    inner = inner[counts]
    horizon = _find_horizon(layers, inner, index, settings)
    refined = _refine(layers, horizon, inner, settings)
    stand_in = _find_stand_in(layers, horizon, *refined[:2], settings)
    if stand_in is not None:
        horizon = _join(horizon, _find_horizon(layers, stand_in, index, settings))
        refined = _refine(layers, horizon, inner, settings)
    depth, sure, seen = refined
    depth = bend_to_seeds(depth, horizon.parts, np.isin(horizon.parts, horizon.seeded) & np.isfinite(depth), index)
    depth = _within_data(layers, depth, settings.near)
    kept = keep_pieces(depth, index, step=settings.step, least=settings.least_piece)
    depth, confidence = np.where(kept, depth, np.nan), np.where(kept, sure * seen, np.float32(np.nan))
    return depth, confidence, _hold_seeds(depth, confidence, index, counts)


def _hold_seeds(depth: Float64Array, confidence: Float32Array, index: Float64Array, counts: BoolArray) -> IntArray:
    """Put the traces of the seeds that count on them, in place, where the horizon misses them; return which these are.

    Off by less it was bent to them. Where noise, or a fault that was not found, parts a seed from all around it no more
    than its own trace is known.
    """
    i, j = np.rint(index[:, :2]).astype(int).T
    missed = counts & ~(np.abs(depth[i, j] - index[:, 2]) <= FARTHEST_BENT)
    depth[i[missed], j[missed]] = index[missed, 2]
    confidence[i[missed], j[missed]] = 0.0
    return np.flatnonzero(missed)


def find_counting(layers: LayerModel, index: Float64Array) -> BoolArray:
    """Tell which seeds, fractional indices of shape (n, 3), count: all but those that contradict most of them.

    A stray lies on the part of the layer on which others lie, more than three samples off it, while most seeds agree.
    Across a fault seeds may well differ in layer time: there they tell how far it is off.
    """
    if len(index) < 3:
        return np.ones(len(index), np.bool_)
    times = np.array([_seed_time(layers, at) for at in index])
    agree = np.abs(times[:, None] - times[None]) <= _AGREE
    most = agree[agree.sum(axis=1).argmax()]
    if most.all() or 2 * most.sum() <= len(index):
        return np.ones(len(index), np.bool_)
    crossings = find_crossings(layers, index[most])
    parts = label_parts(crossings, layers.cuts, find_shapes(layers, crossings))
    theirs = {_nearest_part(crossings, parts, at) for at in index[most]} - {-1}
    kept = most.copy()
    for n in np.flatnonzero(~most):
        i, j = np.rint(index[n, :2]).astype(int)
        on_theirs = np.isin(parts[:, i, j], list(theirs))
        off = np.abs(crossings[:, i, j][on_theirs] - index[n, 2])
        kept[n] = not (off.size and off.min() > _AGREE)
    return kept


def _within_data(layers: LayerModel, depth: Float64Array, reach: int) -> Float64Array:
    """Return depths with NaN for those off the cube, in mutes and in long gaps: nothing there shows a horizon."""
    last = layers.times.shape[2] - 1
    inside = (depth >= -_ROUNDED) & (depth <= last + _ROUNDED)
    within = np.where(inside, np.clip(depth, 0.0, last), np.nan)
    for at, (valid,) in layer_pieces(layers, "valid"):
        part_untold(valid, reach, within[at])
    return within


@dataclass(frozen=True, slots=True, eq=False)
class _Horizon:
    """A horizon as its parts were placed.

    Attributes
    ----------
    depth : ndarray of shape (inline, crossline), float64
        Fractional sample; NaN where there is none.
    parts : ndarray of the same shape, int
        Part that a trace belongs to; -1 where there is none.
    seeded : ndarray of int
        Parts that seeds lie on.
    scores : ndarray of shape (part,), float32
        How well each fits, 0 to 1.
    """

    depth: Float64Array
    parts: IntArray
    seeded: IntArray
    scores: Float32Array


def _find_horizon(layers: LayerModel, index: Float64Array, seeds: Float64Array, settings: TrackSettings) -> _Horizon:
    """Find the parts of the layer that passes through some points, and place them; it passes through the seeds."""
    first = find_crossings(layers, index, beyond=settings.parts.farthest)
    parts = label_parts(first, layers.cuts, find_shapes(layers, first))
    seeded = np.unique([_nearest_part(first, parts, at) for at in index])
    seeded = seeded[seeded >= 0]
    moves, scores = _place_parts(layers, first, parts, seeded, settings)
    crossings = np.where(parts >= 0, first + np.append(moves, np.nan)[parts], np.nan)
    keep_sides(layers, first, crossings)
    size = np.bincount(parts[parts >= 0], minlength=len(moves))
    misfit = np.isnan(moves) & (scores > 0.0) & (size >= _SCRAP)
    misfits = np.where((parts >= 0) & np.append(misfit, False)[parts], parts, -1).max(axis=0)
    depth, placed = _choose_upper(crossings, parts, seeded, seeds)
    depth, parts = _leave_out_unlike(layers, placed, *grow_parts(layers, depth, placed), misfits, scores, settings)
    return _Horizon(depth, parts, seeded, scores)


def _refine(
    layers: LayerModel, horizon: _Horizon, index: Float64Array, settings: TrackSettings
) -> tuple[Float64Array, Float32Array, Float32Array]:
    return refine_depth(layers, horizon.depth, horizon.parts, index, horizon.seeded, horizon.scores, settings)


def _find_stand_in(
    layers: LayerModel, horizon: _Horizon, depth: Float64Array, sure: Float32Array, settings: TrackSettings
) -> Float64Array | None:
    """Return a point on the horizon far from the seeds, where their waveforms put it; None where it is there already.

    Seeds on a part that is larger than all others need none: it is the others that are wrong then.
    """
    own = np.isin(horizon.parts, horizon.seeded) & np.isfinite(depth)
    others = ~own & (sure >= _CONFIDENT)
    if others.sum() <= own.sum():
        return None
    off = find_offset(layers, depth, own, others, clear=settings.clear, least=settings.parts.trusted)
    if not off:
        return None
    moved = depth - off
    inside = others & (moved >= 0) & (moved <= layers.times.shape[2] - 1)
    if not inside.any():
        return None
    largest = inside & (horizon.parts == np.bincount(horizon.parts[inside]).argmax())
    within = ndimage.distance_transform_edt(np.pad(largest, 1))[1:-1, 1:-1]
    i, j = np.unravel_index(within.argmax(), within.shape)
    return np.array([[i, j, moved[i, j]]])


def _join(own: _Horizon, rest: _Horizon) -> _Horizon:
    """Return a horizon that has the seeds' parts as they are, and elsewhere another one."""
    seeded = np.isin(own.parts, own.seeded)
    n = len(rest.scores)
    return _Horizon(
        np.where(seeded, own.depth, rest.depth),
        np.where(seeded, own.parts + n, rest.parts),
        np.concatenate([own.seeded + n, rest.seeded]),
        np.concatenate([rest.scores, own.scores]),
    )


def find_crossings(layers: LayerModel, index: Float64Array, *, beyond: float = 0.0) -> Float64Array:
    """Find where the layer of the seeds passes through every trace, from above; NaN where it does not (again).

    Between seeds of differing layer times these are weighed by distance. Crossings may lie `beyond` samples off the
    cube: where layer time is off on the far side of a fault, the layer may be in the cube all the same.
    """
    times, weights = [], []
    n0, n1 = layers.times.shape[:2]
    i, j = np.meshgrid(np.arange(n0), np.arange(n1), indexing="ij")
    for at in index:
        times.append(_seed_time(layers, at))
        weights.append(1.0 / ((i - at[0]) ** 2 + (j - at[1]) ** 2 + 0.25))
    target = np.tensordot(times, weights, axes=1) / np.sum(weights, axis=0)
    return find_levels(layers, target, beyond)


def _seed_time(layers: LayerModel, at: Float64Array) -> float:
    row, cut = (a[tuple(np.rint(at[:2]).astype(int))] for a in (layers.times, layers.cuts))
    return _time_at(row, cut, float(at[2]))


def _time_at(row: AnyArray, cut: AnyArray, z: float) -> float:
    """Layer time at a fractional sample of a trace; between the two sides of a fault that of the nearer."""
    low = min(int(z), len(row) - 2)
    if not cut[low] & 4:
        return float(row[low] + (z - low) * (row[low + 1] - row[low]))
    near = low if z - low < 0.5 else low + 1
    return float(row[near] + z - near)


def _nearest_part(crossings: Float64Array, parts: IntArray, at: Float64Array) -> int:
    """Part that passes a seed's trace nearest to it; where a fault leaves but a scrap there, one on the traces around.

    -1 where there is none.
    """
    i, j = np.rint(at[:2]).astype(int)
    size = np.bincount(parts[parts >= 0], minlength=1)
    box = tuple(slice(max(n - _AROUND, 0), n + _AROUND + 1) for n in (i, j))
    near, below = parts[(slice(None), *box)], np.abs(crossings[(slice(None), *box)] - at[2])
    rows, columns = np.indices(near.shape[1:])
    away = np.hypot(rows + box[0].start - i, columns + box[1].start - j)
    cost = np.where((near >= 0) & ((away == 0) | (below < _PASSING)), away + below, np.inf)
    whole = np.where(size[near] >= _SCRAP, cost, np.inf)
    for choice in (np.where(away == 0, whole, np.inf), whole, cost):
        if np.isfinite(choice).any():
            return int(near.ravel()[choice.argmin()])
    return -1


def _place_parts(
    layers: LayerModel, crossings: Float64Array, parts: IntArray, seeded: IntArray, settings: TrackSettings
) -> tuple[Float64Array, Float32Array]:
    """How far every part is to be moved to where it fits the seeds' own, which stay, and what fits them; and its fit.

    NaN where it fits nowhere.
    """
    waves = read_parts(layers, crossings, parts, settings.parts)
    moves = np.zeros(len(waves.size))
    scores = np.isin(np.arange(len(moves)), seeded).astype(np.float32)
    for _ in range(settings.rounds):
        moves, scores = place_once(waves, moves, scores, seeded, settings.parts)
    return moves, scores


def _leave_out_unlike(
    layers: LayerModel, before: IntArray, depth: Float64Array, parts: IntArray, misfits: IntArray, scores: Float32Array,
    settings: TrackSettings,
) -> tuple[Float64Array, IntArray]:  # fmt: skip
    """Leave out where parts were carried on to traces of one that fits nowhere, and do not fit there either.

    Round a fault's tip, or through a gap in it, they may have been led into the block beyond. `misfits` has the number
    of such a part on its traces, and -1 elsewhere.
    """
    carried = (before < 0) & (parts >= 0) & (misfits >= 0)
    if not carried.any():
        return depth, parts
    n = len(scores)
    pairs, pair = np.unique(parts[carried] * n + misfits[carried], return_inverse=True)
    trial = parts.copy()
    trial[carried] = n + pair
    waves = read_parts(layers, depth[None], trial[None], settings.parts)
    trust = np.append(scores, np.zeros(len(pairs), np.float32))
    moves, _ = place_once(waves, np.zeros(len(trust)), trust, np.arange(n), settings.parts)
    unlike = np.append(~(np.abs(moves) <= FARTHEST_BENT), False)[trial] & carried
    return np.where(unlike, np.nan, depth), np.where(unlike, -1, parts)


def _choose_upper(
    crossings: Float64Array, parts: IntArray, seeded: IntArray, index: Float64Array
) -> tuple[Float64Array, IntArray]:
    """Keep one crossing a trace: the uppermost; where a seed lies below another one, all around it that of its part.

    A seed near the edge of where the layer lies over itself tells nothing of the rest of it: where a layer begins is
    known to a trace or so.
    """
    there = np.isfinite(crossings)
    rank = np.where(there, np.arange(1, len(crossings) + 1)[:, None, None], len(crossings) + 1)
    own = np.isin(parts, seeded) & there
    lies_twice = own.any(axis=0) & (there.sum(axis=0) > 1)
    twice, _ = ndimage.label(lies_twice)
    for i, j, z in zip(*np.rint(index[:, :2]).astype(int).T, index[:, 2], strict=True):
        off = np.where(there[:, i, j], np.abs(crossings[:, i, j] - z), np.inf)
        nearest = int(off.argmin())
        below = own[nearest, i, j] and there[:nearest, i, j].any()
        if below and off[nearest] <= _PASSING:
            around = slice(max(i - _EDGE, 0), i + _EDGE + 1), slice(max(j - _EDGE, 0), j + _EDGE + 1)
            told = (slice(None), slice(None)) if lies_twice[around].all() else around
            rank[:, *told][own[:, *told] & (twice[told] == twice[i, j])] = 0
    best = rank.argmin(axis=0)[None]
    depth = np.take_along_axis(crossings, best, axis=0)[0]
    return depth, np.where(np.isfinite(depth), np.take_along_axis(parts, best, axis=0)[0], -1)
