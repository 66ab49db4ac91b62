"""From layer time to one horizon: where the layer passes, which of its parts are the horizon, and its exact place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_tracks import match_waveforms
from seismo3d.seismic.layer_pieces import Waves, find_levels, read_along, read_around
from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.track_growing import grow_parts, keep_sides
from seismo3d.seismic.track_refining import STRETCHES, TrackSettings, refine_depth, stretched

# how often a trace may cross one layer, and a step between traces that is none of one part
_CROSSINGS, _STEP = 3, 6.0
# traces of a part that is but a scrap, and how far from a seed on one a part is looked for
_SCRAP, _AROUND = 16, 4
# half-length of the waveforms by which neighbours are compared, and share of their usual correlation that is too little
_ALIKE_HALF, _ALIKE = 10, 0.65
# share of a window that must be known for it to be compared
_LEAST_KNOWN = 0.3
# share of either side of it that must be known for thicknesses to be compared
_BOTH_SIDES = 0.5
# how far a part is moved for whatever it gains
_NEARBY = 3


def fit_track(layers: LayerModel, index: Float64Array, settings: TrackSettings) -> tuple[Float64Array, Float32Array]:
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
    """
    crossings = find_crossings(layers, index, beyond=settings.farthest)
    first = crossings
    parts = label_parts(crossings, layers.cuts, _shapes(layers, crossings))
    seeded = np.unique([_nearest_part(crossings, parts, at) for at in index])
    seeded = seeded[seeded >= 0]
    scores = np.isin(np.arange(int(parts.max(initial=-1)) + 1), seeded).astype(np.float32)
    for _ in range(settings.rounds):
        crossings, scores = _place_parts(layers, crossings, parts, seeded, scores, settings)
    keep_sides(layers, first, crossings)
    depth, parts = grow_parts(layers, *_uppermost(crossings, parts, seeded))
    return refine_depth(layers, depth, parts, index, seeded, scores, settings)


def find_crossings(layers: LayerModel, index: Float64Array, *, beyond: float = 0.0) -> Float64Array:
    """Find where the layer of the seeds passes through every trace, from above; NaN where it does not (again).

    Between seeds of differing layer times these are weighed by distance. Crossings may lie `beyond` samples off the
    cube: where layer time is off on the far side of a fault, the layer may be in the cube all the same.
    """
    times, weights = [], []
    n0, n1 = layers.times.shape[:2]
    i, j = np.meshgrid(np.arange(n0), np.arange(n1), indexing="ij")
    for at in index:
        row, cut = (a[tuple(np.rint(at[:2]).astype(int))] for a in (layers.times, layers.cuts))
        times.append(_time_at(row, cut, float(at[2])))
        weights.append(1.0 / ((i - at[0]) ** 2 + (j - at[1]) ** 2 + 0.25))
    target = np.tensordot(times, weights, axes=1) / np.sum(weights, axis=0)
    crossings = np.empty((_CROSSINGS, n0, n1))
    find_levels(layers, target, beyond, crossings)
    crossings[:, ~layers.live] = np.nan
    return crossings


def _time_at(row: AnyArray, cut: AnyArray, z: float) -> float:
    """Layer time at a fractional sample of a trace; between the two sides of a fault that of the nearer."""
    low = min(int(z), len(row) - 2)
    if not cut[low] & 4:
        return float(row[low] + (z - low) * (row[low + 1] - row[low]))
    near = low if z - low < 0.5 else low + 1
    return float(row[near] + z - near)


def _shapes(layers: LayerModel, crossings: Float64Array) -> Float32Array:
    """Return the waveform about every crossing, of unit length; zero where less than half of it is known."""
    shapes = np.zeros((*crossings.shape, 2 * _ALIKE_HALF + 1), np.float32)
    for depth, shape in zip(crossings, shapes, strict=True):
        if not np.isfinite(depth).any():
            continue
        waves, known = read_around(layers, depth, _ALIKE_HALF)
        waves *= known.mean(axis=2, keepdims=True) > 0.5
        shape[:] = waves / np.maximum(np.linalg.norm(waves, axis=2, keepdims=True), 1e-6)
    return shapes


def label_parts(crossings: Float64Array, cuts: AnyArray, shapes: Float32Array | None = None) -> IntArray:
    """Give numbers to the parts of a layer that faults bound, from 0; -1 where there is no crossing.

    A fault may end too early, or be missed. Layer time then leads from one side to the other over a few traces, where
    waveforms of neighbours along it are far less alike than they are elsewhere: parts end there too.

    Parameters
    ----------
    crossings : ndarray of shape (n, inline, crossline), float64
        Fractional samples, NaN where there is none.
    cuts : ndarray of shape (inline, crossline, sample), uint8
        Bits 0 and 1: a fault passes before the next inline or crossline.
    shapes : ndarray of shape (n, inline, crossline, m), float32, optional
        Waveform about every crossing, of unit length; zero where it is not known. Without them faults alone are bounds.
    """
    known = np.isfinite(crossings)
    numbers = np.arange(crossings.size).reshape(crossings.shape)
    k: AnyArray = np.clip(np.rint(np.nan_to_num(crossings)).astype(np.int64), 0, cuts.shape[2] - 1)
    i, j = np.meshgrid(*(np.arange(n) for n in crossings.shape[1:]), indexing="ij")
    first, second = [], []
    for axis in range(2):
        a, b = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
        if axis == 1:
            a, b = a[::-1], b[::-1]
        for one, other in np.ndindex(len(crossings), len(crossings)):
            if not (known[one].any() and known[other].any()):
                continue
            ka, kb = k[one][a], k[other][b]
            cut = np.zeros(ka.shape, bool)
            for sample in (ka, (ka + kb) // 2, kb):
                cut |= (cuts[i[a], j[a], sample] & (1 << axis)) > 0
            step = np.abs(np.nan_to_num(crossings[one][a] - crossings[other][b], nan=np.inf))
            free = (step < _STEP) & ~cut
            if shapes is not None:
                free &= _are_alike(shapes[one][a], shapes[other][b], free)
            first.append(numbers[one][a][free])
            second.append(numbers[other][b][free])
    ends = (np.concatenate(first), np.concatenate(second))
    graph = coo_matrix((np.ones(len(ends[0]), bool), ends), shape=(crossings.size,) * 2)
    labels = connected_components(graph, directed=False)[1].reshape(crossings.shape)
    # what is no crossing is labelled too, each by itself: far more labels than parts
    parts = np.full(crossings.shape, -1, np.int64)
    parts[known] = np.unique(labels[known], return_inverse=True)[1]
    return parts


def _are_alike(one: Float32Array, other: Float32Array, among: BoolArray) -> BoolArray:
    """Tell where two waveforms are as alike as most are, among some, or one is not known."""
    alike = np.einsum("ijk,ijk->ij", one, other)
    told = among & one.any(axis=2) & other.any(axis=2)
    usual = float(np.median(alike[told])) if told.any() else 0.0
    return np.asarray(~told | (alike >= _ALIKE * usual))


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
    cost = np.where((near >= 0) & ((away == 0) | (below < _STEP)), away + below, np.inf)
    whole = np.where(size[near] >= _SCRAP, cost, np.inf)
    for choice in (np.where(away == 0, whole, np.inf), whole, cost):
        if np.isfinite(choice).any():
            return int(near.ravel()[choice.argmin()])
    return -1


def _place_parts(
    layers: LayerModel, crossings: Float64Array, parts: IntArray, seeded: IntArray, scores: Float32Array,
    settings: TrackSettings,
) -> tuple[Float64Array, Float32Array]:  # fmt: skip
    """Move every part to where its mean waveform fits that of the trusted parts, or drop it where it fits nowhere.

    Waveforms are read along the layer time, and once more sample by sample: the first holds where layers thicken within
    a part, the second where the layer time is off on its side of a fault. Each part goes by the one that fits better.
    Samples beyond a fault count for nothing. The parts of the seeds stay. Returns the crossings, and the correlation of
    every part.
    """
    far, n = settings.farthest, int(parts.max(initial=-1)) + 1
    along, deep = (_lags(layers, crossings, parts, scores, read, settings) for read in (read_along, read_around))
    lags = np.where((deep.max(axis=1) > along.max(axis=1))[:, None], deep, along)
    size = np.bincount(parts[parts >= 0], minlength=n)
    near = slice(far - _NEARBY, far + _NEARBY + 1)
    best, close = lags.argmax(axis=1), lags[:, near].argmax(axis=1) + near.start
    every = np.arange(n)
    best = np.where(lags[every, best] > lags[every, close] + settings.gain, best, close)
    score = lags[every, best]
    move = np.array([_vertex(row, b) - far for row, b in zip(lags, best, strict=True)])
    move -= np.average(move[seeded], weights=size[seeded]) if len(seeded) else 0.0
    dropped = (size < 4) | (score < settings.least_block)
    move[seeded], dropped[seeded] = 0.0, False
    # near an end of the cube too little of a layer's surroundings is known to be compared
    score[seeded] = np.maximum(score[seeded], settings.trusted)
    crossings = crossings + np.where(dropped, np.nan, move)[parts]
    crossings[parts < 0] = np.nan
    return crossings, np.clip(score, 0.0, 1.0).astype(np.float32)


def _lags(
    layers: LayerModel, crossings: Float64Array, parts: IntArray, scores: Float32Array, read: Callable[..., Waves],
    settings: TrackSettings,
) -> Float32Array:  # fmt: skip
    """Correlation of every part's mean waveform, so read, with that of the trusted parts, at every lag."""
    reach, n = settings.window + settings.farthest, int(parts.max(initial=-1)) + 1
    sums, counts = np.zeros((n, 2 * reach + 1)), np.zeros((n, 2 * reach + 1))
    for depth, part in zip(crossings, parts, strict=True):
        inside = part >= 0
        if not inside.any():
            continue
        waves, known = read(layers, depth, reach)
        order = np.argsort(part[inside], kind="stable")
        begin = np.flatnonzero(np.diff(part[inside][order], prepend=-1))
        labels = part[inside][order][begin]
        if len(labels):
            sums[labels] += np.add.reduceat((waves * known)[inside][order], begin)
            counts[labels] += np.add.reduceat(known[inside][order], begin)
    means = (sums / np.maximum(counts, 1e-6)).astype(np.float32)
    share = (counts / np.maximum(counts.max(axis=1, keepdims=True, initial=0.0), 1.0)).astype(np.float32)
    trust = np.where(scores >= settings.trusted, scores, 0.0)[:, None]
    total = (trust * counts).sum(axis=0)
    reference = ((trust * sums).sum(axis=0) / np.maximum(total, 1e-6)).astype(np.float32)
    in_reference = (total / max(float(total.max(initial=0.0)), 1e-6)).astype(np.float32)
    return _match_stretched(means, share, reference, in_reference, settings)


def _match_stretched(
    means: Float32Array, share: Float32Array, reference: Float32Array, known: Float32Array, settings: TrackSettings
) -> Float32Array:
    """Correlation of every part's mean waveform with a reference, as thick as fits best, at every lag."""
    far, half = settings.farthest, settings.window
    taper = np.hanning(2 * half + 3)[1:-1].astype(np.float32)
    shares = np.linspace(-settings.stretch, settings.stretch, 4 * STRETCHES + 1)
    waves, seen = stretched(reference, half, shares), np.clip(stretched(known, half, shares), 0.0, 1.0)
    scores = np.empty((len(shares), len(means), 2 * far + 1), np.float32)
    for wave, part, found in zip(waves, seen, scores, strict=True):
        match_waveforms(means, share, wave, part, taper, np.float32(_LEAST_KNOWN), found)
    # where a fault or an end of the cube takes one side, layers may as well be thicker as lie elsewhere
    seen_of = (share[:, far:-far] * known[far:-far])[:, 1:].reshape(len(means), 2, half).mean(axis=2).min(axis=1)
    price = np.where(seen_of > _BOTH_SIDES, settings.price, 100.0) * np.abs(shares)[:, None]
    best = (scores.max(axis=2) - price).argmax(axis=0)
    return scores[best, np.arange(len(means))]


def _vertex(scores: AnyArray, best: int) -> float:
    """Place of the maximum next to the best entry, by a parabola."""
    if not 0 < best < len(scores) - 1:
        return float(best)
    before, here, after = (float(s) for s in scores[best - 1 : best + 2])
    bend = before - 2.0 * here + after
    return best + (0.5 * (before - after) / bend if bend < 0 else 0.0)


def _uppermost(crossings: Float64Array, parts: IntArray, seeded: IntArray) -> tuple[Float64Array, IntArray]:
    """Keep one crossing a trace: the seeds' part where it is, else the uppermost."""
    rank = np.where(np.isfinite(crossings), np.arange(1, len(crossings) + 1)[:, None, None], len(crossings) + 1)
    rank[np.isin(parts, seeded) & np.isfinite(crossings)] = 0
    best = rank.argmin(axis=0)[None]
    depth = np.take_along_axis(crossings, best, axis=0)[0]
    return depth, np.where(np.isfinite(depth), np.take_along_axis(parts, best, axis=0)[0], -1)
