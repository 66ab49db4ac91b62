"""The exact place of a horizon on every trace, from the waveform along it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from scipy import ndimage

from seismo3d._settings import (
    Amount,
    Correlation,
    Count,
    Positive,
    Smoothing,
    Steps,
    StepsOrNone,
    Stiffness,
    Threshold,
    Width,
)
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.registration.robust import robust_scale
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.layer_parts import PartSettings, stretched
from seismo3d.seismic.layer_pieces import read_around
from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.track_pieces import LARGEST_STEP
from seismo3d.seismic.track_smoothing import find_rims, find_shares, fit_stiffly, link_traces, weigh_traces
from seismo3d.seismic.track_waveforms import match_traces, mean_waveform

# lags beyond the farthest move at which a waveform is compared
_SPARE = 2
# thicknesses that are tried to either side of that at the seeds
_STRETCHES = 6
# share of a waveform from which on it tells them, and traces with so much of it that tell the horizon's
_WHOLE, _LEAST_WHOLE = 0.9, 100
# share of the traces around that must be such for them to count as much as their price
_DOUBT = 0.1
# samples from an end of the cube within which a layer may leave it
_LEAVING = 4.0
# weight of a trace that goes by layer time alone, of one that fits entirely
_UNTOLD = 0.5
# traces around a seed over which it is bent to it
_BENT = 2.0
# share of its waveform, and correlation, from which on a trace tells best itself where it lies
_UNCUT, _UNDISTURBED = 0.99, 0.95
# traces over which they are averaged to be matched first, and again in noise
_SINGLY, _TOGETHER = 1.0, 3.0

FARTHEST_BENT = 3.0
"""Samples by which a track is moved as a whole, or bent, at most to pass through its seeds."""


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """How a layer becomes a track; lengths in samples and traces.

    Attributes
    ----------
    near : int in [1, 100]
        Half-length of the waveform that is followed from trace to trace.
    most : float in [0, 1000]
        Farthest that a trace is moved to fit its neighbours.
    clear : int in [0, 100]
        Samples of it next to a fault that do not count: they hold some of what lies beyond.
    rim : int in [0, 100]
        Traces this close to a fault, whose waveforms hold some of what lies beyond it, count for little.
    stiffness : float in [0, 1000000]
        How stiff a horizon is where waveforms place it, in traces to the fourth power: of details smaller than its
        fourth root little is left, and beside faults, where waveforms are cut short, it is led on over more.
    bent : float in (0, inf)
        Samples by which it may well bend from trace to trace: where matches scatter by s, its stiffness is at least
        :math:`(s / bent)^2`.
    even : float in (0, 1000]
        Width, in traces, over which it is found how much thicker or thinner layers are than at the seeds.
    stretch : float in [0, 1)
        Largest share by which they may be.
    price : float in [0, inf)
        Correlation that it must be worth.
    rounds : int in [1, 100]
        How often parts are compared: first with those of the seeds, then also with those that fit them.
    least_trace : float in [-1, 1]
        Correlation below which a trace is left out.
    step : float in [0, inf]
        Traces side by side whose depths differ by more are not of one piece, unless those beside them differ alike.
    least_piece : int in [1, 1000000]
        Traces of a piece below which it is left out, unless it holds a seed.
    layers : LayerTimeSettings
        Settings of the layer time.
    parts : PartSettings
        How the parts of a track are placed. Layer time was mended where faults were wrong by more. Unrelated layers
        correlate at up to 0.65 at the best of as many places, which right ones hardly reach where an end of the cube
        cuts their waveforms short.
    """

    near: Steps = 16
    most: Smoothing = 2.0
    clear: StepsOrNone = 2
    rim: StepsOrNone = 3
    stiffness: Stiffness = 25.0
    bent: Positive = 0.016
    even: Width = 4.0
    stretch: Annotated[float, "[0, 1)"] = 0.3
    price: Amount = 0.02
    rounds: Steps = 2
    least_trace: Correlation = 0.3
    step: Threshold = LARGEST_STEP
    least_piece: Count = 40
    layers: LayerTimeSettings = field(default_factory=LayerTimeSettings)
    parts: PartSettings = field(default_factory=lambda: PartSettings(trusted=0.85, least=0.6))


def refine_depth(
    layers: LayerModel, depth: Float64Array, parts: IntArray, index: Float64Array, seeded: IntArray,
    scores: Float32Array, settings: TrackSettings,
) -> tuple[Float64Array, Float32Array, Float32Array]:  # fmt: skip
    """Align every trace with the waveform along the parts that the seeds lie on.

    The track is a stiff surface through where the traces match. Next to a fault, where what lies beyond it is mixed
    into the waveforms and may bend the layer time, and where a fault leaves little of the waveform, a trace goes where
    those around it lead. In noise the traces are matched a second time, from that surface. As a whole the track is
    moved to pass through its seeds.

    Parameters
    ----------
    layers : LayerModel
        Of the cube.
    depth : ndarray of shape (inline, crossline), float64
        Fractional sample; NaN where there is none.
    parts : ndarray of the same shape, int
        Part that a trace belongs to; -1 where there is none.
    index : ndarray of shape (n, 3), float64
        Seeds, as fractional indices.
    seeded : ndarray of int
        Parts that seeds lie on.
    scores : ndarray of shape (m,), float32
        Correlation of every part's mean waveform.
    settings : TrackSettings

    Returns
    -------
    depth : ndarray of shape (inline, crossline), float64
    sure : ndarray of the same shape, float32
        Correlation of the waveform, 0 to 1, or that of the part where too little of it is seen; NaN where the horizon
        was not traced.
    seen : ndarray of the same shape, float32
        1, but where it is that of the part the share of the trace's own waveform that faults leave.
    """
    there = parts >= 0
    if not there.any():
        return depth, np.full(depth.shape, np.nan, np.float32), np.ones(depth.shape, np.float32)
    of_seeds = np.isin(parts, seeded) & there
    share = find_shares(layers, depth, near=settings.near, clear=settings.clear)
    plate = _weigh(layers, depth, parts, np.full(depth.shape, _UNTOLD), share, settings)
    depth = fit_stiffly(*plate, settings.stiffness)
    found = _match(layers, depth, parts, of_seeds, scores, _SINGLY, settings)
    depth, stiffness = _lay_matched(layers, found, parts, settings)
    trusted, sure = found.trusted, np.where(found.trusted, np.clip(found.sure, 0.0, 1.0), np.nan)
    seen = np.where(found.told, 1.0, found.share)
    if stiffness > settings.stiffness:
        found = _match(layers, depth, parts, of_seeds, scores, _TOGETHER, settings)
        depth = fit_stiffly(*_weigh(layers, found.depth, parts, found.weight, found.share, settings), stiffness)
    depth = np.where(trusted, depth, np.nan)
    # where no fault cuts a seed's waveform short and it is hardly disturbed it tells best where the seed lies on the
    # track, else the traces around do
    own = (found.share > _UNCUT) & found.told & (found.sure >= _UNDISTURBED)
    miss = _miss(np.where(own, found.depth, depth), of_seeds & trusted, index)
    depth = depth - (found.common if miss is None else miss)
    return depth, sure.astype(np.float32), seen.astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """Where traces match the waveform along a horizon; maps of shape (inline, crossline).

    Attributes
    ----------
    depth : ndarray, float64
        Fractional sample.
    sure : ndarray, float32
        Correlation; of traces that were not compared, that of their part.
    told : ndarray of bool
        Compared, and alike.
    share : ndarray, float64
        Share of the window that faults leave.
    common : float
        How far those whose mean is the waveform were moved down.
    trusted : ndarray of bool
        Sure enough not to be left out.
    """

    depth: Float64Array
    sure: Float32Array
    told: BoolArray
    share: Float64Array
    common: float
    trusted: BoolArray

    @property
    def weight(self) -> AnyArray:
        """By which a trace counts, before what faults take from it."""
        return np.where(self.told, self.sure, _UNTOLD)


def _match(
    layers: LayerModel, depth: Float64Array, parts: IntArray, of_seeds: BoolArray, scores: Float32Array, width: float,
    settings: TrackSettings,
) -> _Found:  # fmt: skip
    """Match every trace, averaged over `width` traces around it, with the mean waveform of the seeds' parts."""
    there = parts >= 0
    reach = int(np.ceil(settings.most)) + _SPARE
    chosen = _choose_reference(layers, depth, parts, of_seeds, scores, settings)
    score = _score_stretched(layers, depth, parts, chosen, reach, width, settings)
    move, here = _best_moves(score, reach)
    compared = there & (score.min(axis=2) > -1.0)
    sure = np.where(compared, here, scores[parts])
    trusted = there & (sure > settings.least_trace)
    told = compared & trusted
    common = float(np.median(move[chosen & told])) if (chosen & told).any() else 0.0
    depth = depth + common + np.where(told, np.clip(move - common, -settings.most, settings.most), 0.0)
    share = find_shares(layers, depth, near=settings.near, clear=settings.clear)
    return _Found(depth, sure, told, share, common, trusted)


def _choose_reference(
    layers: LayerModel, depth: Float64Array, parts: IntArray, of_seeds: BoolArray, scores: Float32Array,
    settings: TrackSettings,
) -> BoolArray:  # fmt: skip
    """Mark the traces whose mean waveform is that of the horizon: those of the parts that the seeds lie on.

    Between faults that are close together these hold too much of what lies beyond; then also those of the parts that
    were surely placed by them.
    """
    there = parts >= 0
    if not of_seeds.any():
        return there
    whole = of_seeds & (find_shares(layers, depth, near=settings.near, clear=settings.clear) > _WHOLE)
    if whole.sum() >= _LEAST_WHOLE:
        return of_seeds
    return of_seeds | (there & (scores[parts] >= settings.parts.trusted))


def _weigh(
    layers: LayerModel, depth: Float64Array, parts: IntArray, weight: AnyArray, share: Float64Array,
    settings: TrackSettings,
) -> tuple[Float64Array, Float64Array, AnyArray]:  # fmt: skip
    """Return what a stiff surface is laid through: depths, weights by the share that faults leave, too, and links."""
    linked = link_traces(layers, depth, parts, settings.step)
    rims = find_rims(linked, parts, _without_faults(layers, depth, parts), settings.rim)
    return np.where(parts >= 0, depth, np.nan), weight * weigh_traces(share, rims), linked


def _lay_matched(
    layers: LayerModel, found: _Found, parts: IntArray, settings: TrackSettings
) -> tuple[Float64Array, float]:
    """Lay a surface through what was matched, the stiffer the more it scatters about it, in noise; and how stiff."""
    plate = _weigh(layers, found.depth, parts, found.weight, found.share, settings)
    smooth = fit_stiffly(*plate, settings.stiffness)
    sure = found.told & (found.share > _WHOLE)
    stiffness = float((robust_scale(found.depth[sure] - smooth[sure]) / settings.bent) ** 2)
    if stiffness <= settings.stiffness:
        return smooth, settings.stiffness
    return fit_stiffly(*plate, stiffness), stiffness


def bend_to_seeds(depth: Float64Array, parts: IntArray, chosen: BoolArray, index: Float64Array) -> Float64Array:
    """Bend a track, over the traces around each seed and of its part, to pass through it.

    Where it is led on along a fault, or smoothed, it may miss a seed, which is not to move all the others.
    """
    rows, columns = np.indices(depth.shape)
    for i, j, z in zip(*np.rint(index[:, :2]).astype(int).T, index[:, 2], strict=True):
        left = z - depth[i, j]
        if chosen[i, j] and abs(left) <= FARTHEST_BENT:
            share = np.exp(-0.5 * ((rows - i) ** 2 + (columns - j) ** 2) / _BENT**2)
            depth = np.where(parts == parts[i, j], depth + share * left, depth)
    return depth


def _miss(depth: Float64Array, chosen: BoolArray, index: Float64Array) -> float | None:
    """How far depths lie below the seeds, on the whole; None where they miss them all."""
    at = tuple(np.rint(index[:, :2]).astype(int).T)
    below = depth[at] - index[:, 2]
    near = chosen[at] & (np.abs(below) <= FARTHEST_BENT)
    return float(below[near].mean()) if near.any() else None


def _read_smoothly(
    layers: LayerModel, depth: Float64Array, parts: IntArray, half: int, clear: int, width: float
) -> tuple[Float32Array, Float32Array]:
    """Amplitudes of every trace averaged over those around of the same part, and the share of them that is known."""
    waves, known = read_around(layers, depth, half, clear=clear)
    smooth = _smooth_parts(np.concatenate([waves * known, known], axis=2), parts, width)
    waves, known = (np.ascontiguousarray(a).reshape(depth.size, -1) for a in np.split(smooth, 2, axis=2))
    waves /= np.maximum(known, 1e-6)
    return waves, known


def _score_stretched(
    layers: LayerModel, depth: Float64Array, parts: IntArray, chosen: BoolArray, reach: int, width: float,
    settings: TrackSettings,
) -> Float32Array:  # fmt: skip
    """Correlation of every trace, averaged with its neighbours of the same part, with a waveform at every lag.

    The waveform is the chosen traces' mean, as thick as fits best around each trace. Without that a trace with thicker
    layers goes where those above or below fit, whichever side is seen farther.
    """
    stretch = settings.stretch
    shares = np.linspace(-stretch, stretch, 2 * _STRETCHES + 1)
    half = int(np.ceil(settings.near * (1.0 + 2.0 * stretch))) + 1
    long, seen = mean_waveform(layers, depth, chosen, half, settings.clear)
    references = stretched(long, settings.near, shares, layers.spectrum)
    waves, known = _read_smoothly(layers, depth, parts, settings.near + reach, settings.clear, width)
    # near an end of the cube the reference itself is cut short
    seen = seen[half - settings.near : half + settings.near + 1]
    scores = match_traces(waves, known, references, seen, reach, 0.5).reshape(len(shares), *depth.shape, -1)
    # where a fault or an end of the cube takes one side, layers may as well be thicker as lie elsewhere
    whole = read_around(layers, depth, settings.near, clear=settings.clear)[1].mean(axis=2)[..., None] > _WHOLE
    fits = np.moveaxis(scores.max(axis=3), 0, -1)
    gain = np.where(whole, fits - fits[..., _STRETCHES, None], np.float32(0.0))
    both = _smooth_parts(np.concatenate([gain, whole], axis=2).astype(np.float32), parts, settings.even)
    best = (both[..., :-1] / (both[..., -1:] + _DOUBT) - settings.price * np.abs(shares)).argmax(axis=2)
    return np.asarray(np.take_along_axis(scores, best[None, :, :, None], axis=0)[0], np.float32)


def _best_moves(score: Float32Array, reach: int) -> tuple[Float64Array, Float32Array]:
    """Lag of the best correlation, by a parabola, and the correlation next to it."""
    best = np.clip(score.argmax(axis=2), 1, 2 * reach - 1)
    before, here, after = (np.take_along_axis(score, (best + d)[..., None], axis=2)[..., 0] for d in (-1, 0, 1))
    bend = before - 2.0 * here + after
    part = np.where(bend < -1e-9, 0.5 * (before - after) / np.minimum(bend, -1e-9), 0.0)
    return best - reach + np.clip(part, -0.5, 0.5), here


def _without_faults(layers: LayerModel, depth: Float64Array, parts: IntArray) -> BoolArray:
    """Mark traces that lack a layer for they have no data, or because it leaves the cube near them."""
    there = parts >= 0
    nearest = ndimage.distance_transform_edt(~there, return_distances=False, return_indices=True)
    beside = depth[tuple(nearest)] if there.any() else depth
    last = layers.times.shape[2] - 1
    return ~there & (~layers.live | ~((beside > _LEAVING) & (beside < last - _LEAVING)))


def _smooth_parts(maps: Float32Array, parts: IntArray, sigma: float) -> Float32Array:
    """Smooth maps of shape (inline, crossline, n) within each part alone."""
    out = np.zeros_like(maps)
    for label, box in enumerate(ndimage.find_objects(parts + 1)):
        if box is None:
            continue
        mask = parts[box] == label
        share = ndimage.gaussian_filter(mask.astype(np.float32), sigma)
        smoothed = ndimage.gaussian_filter(maps[box] * mask[..., None], (sigma, sigma, 0))
        out[box][mask] = smoothed[mask] / share[mask][:, None]
    return out
