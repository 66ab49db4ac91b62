"""Amplitudes evened out with depth and from trace to trace, and traces that hold nothing told from those that do."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array
from seismo3d.registration.robust import robust_scale
from seismo3d.seismic._kernels_balancing import liken_traces, mean_sizes

# samples whose strength is told together, and the percentile of their sizes that it is
_DEPTH, _QUANTILE = 16, 75.0
# such pieces there are to a median, and width, in samples, of the window that medians are followed in
_PIECES, _WINDOW = 5, 32.0
# decibels from one piece to the next but one by which amplitudes set in or out at once
_STEP = 24.0
# decibels that the strength may range over, down the cube, as it is
_RANGE = 12.0
# samples of a trace that its strength is told from, and share of them that counts, the largest left out
_SAMPLES, _KEPT = 512, 0.9
# decibels that a trace may lie off the others, and traces around it that it is compared with
_OFF, _AROUND = 8.0, 4.0
# decibels below its neighbours, and, if like none of them, below the strong ones of the cube, from which on a trace is
# but what a filter has left of a dead one, and how many times as far as others lie off theirs that is at least
_DEAD, _FAR = (40.0, 60.0), 5.0
# decibels below the strong ones that this takes where these are like their neighbours
_HOLLOW = 25.0
# decibels off the others beyond which a trace lies no farther off in what is usual around it
_MOST = 60.0
# how like its neighbours a trace is: samples a trace that these may lie higher or lower, and times a trace's strength
# up to which its samples count
_SLOPE, _CLIP = 2, 4.0
# share of the likeness of traces around from which on down one is noise, of how many traces around, and what these must
# have at least
_UNLIKE, _NEAR, _LIKE = 0.5, 7, 0.5
# usual scatter of traces, in decibels, from which on they may lie off by less
_SCATTER = 2.0


def find_depth_gain(amplitudes: Float32Array, depths: Int64Array, n_samples: int) -> Float32Array | None:
    """Find what raises the weak depths of a cube and lowers the strong ones, where they are far apart.

    Spreading and absorption take the same off all layers of a depth: that is no reflectivity, and what is measured
    against the whole cube's strength would be blind at depth. What they took off is told by the strength at every
    depth, followed by straight lines in decibels over windows so wide that a strong reflector stays what it is. Weak
    noise above the sea floor, or at the foot, where strengths change at once and for good, has no say in it.
    Up to 12 dB from the weakest to the strongest depth nothing is changed; of a range R beyond, 12 dB times 12 dB / R
    is left.

    Parameters
    ----------
    amplitudes : ndarray of shape (n,), float32
        Some of a cube's amplitudes, about zero.
    depths : ndarray of shape (n,), int64
        The sample of a trace that each of them is.
    n_samples : int
        Samples a trace.

    Returns
    -------
    ndarray of shape (n_samples,), float32, or None
        Factors; None where amplitudes are not to be changed.
    """
    edges = np.linspace(0, n_samples, max(1, round(n_samples / _DEPTH)) + 1).astype(np.int64)
    order = np.argsort(depths, kind="stable")
    ends = np.searchsorted(depths[order], edges)
    parts = [np.abs(amplitudes[order[a:b]]) for a, b in pairwise(ends)]
    strengths = np.array([np.percentile(part, _QUANTILE) if len(part) else 0.0 for part in parts], np.float64)
    told = np.flatnonzero(strengths > 0.0)
    if not len(told):
        return None
    usual = ndimage.median_filter(20.0 * np.log10(strengths[told]), _PIECES, mode="nearest")
    within = _within_steps(usual)
    told, usual = told[within], usual[within]
    middles = np.asarray(0.5 * (edges[:-1] + edges[1:] - 1.0)[told], np.float64)
    level = _follow(middles, usual, np.array([len(part) for part in parts])[told])
    spread = np.ptp(level)
    if spread <= _RANGE:
        return None
    excess = (level - 0.5 * (level.min() + level.max())) * (1.0 - (_RANGE / spread) ** 2)
    places = np.arange(n_samples, dtype=np.float64)
    # to the ends of the cube the strength goes on as it came, beyond a step it does not
    first = middles[0] if told[0] else 0.0
    last = middles[-1] if told[-1] < len(parts) - 1 else n_samples - 1.0
    return (10.0 ** (-_carry_on(np.clip(places, first, last), middles, excess) / 20.0)).astype(np.float32)


def _within_steps(strengths: Float64Array) -> slice:
    """Return the pieces between the last large step up in the upper half of a cube and the first down in the lower."""
    n = len(strengths)
    up = np.flatnonzero(strengths[2:] - strengths[:-2] > _STEP) + 2
    down = np.flatnonzero(strengths[:-2] - strengths[2:] > _STEP)
    up, down = up[2 * up < n], down[2 * down >= n]
    return slice(int(up[-1]) if len(up) else 0, int(down[0]) + 1 if len(down) else n)


def _carry_on(at: Float64Array, places: Float64Array, values: Float64Array) -> Float64Array:
    """Return values between places, and beyond them on the straight lines through the first and the last two."""
    found = np.interp(at, places, values)
    if len(places) > 1:
        slopes = np.diff(values) / np.diff(places)
        found += np.where(at < places[0], slopes[0] * (at - places[0]), 0.0)
        found += np.where(at > places[-1], slopes[-1] * (at - places[-1]), 0.0)
    return found


def _follow(places: Float64Array, values: Float64Array, counts: Int64Array) -> Float64Array:
    """Return, at every place, the value of the straight line that fits best through those around it."""
    apart = places - places[:, None]
    weights = counts * np.exp(-0.5 * (apart / _WINDOW) ** 2)
    total, first, second = (np.sum(weights * apart**power, axis=1) for power in range(3))
    sums, moments = weights @ values, (weights * apart) @ values
    second += 1e-9 * _WINDOW**2 * total  # one depth alone has no slope
    return np.asarray((sums * second - moments * first) / (second * total - first**2))


def trace_strengths(volume: Float32Array, valid: BoolArray) -> Float32Array:
    """Return how strong every trace is: the mean size of nine tenths of its samples; 0 where there are no data."""
    out = np.empty(volume.shape[:2], np.float32)
    mean_sizes(volume, valid, _SAMPLES, _KEPT, out)
    return out


def trace_likeness(volume: Float32Array, valid: BoolArray, strengths: Float32Array) -> Float32Array:
    """Return the mean correlation of every trace with the two most like it of those beside it on its inline.

    NaN where it has none, or no data. What a trace is multiplied by makes no difference.
    """
    out = np.empty(volume.shape[:2], np.float32)
    liken_traces(volume, valid, strengths, _SLOPE, _CLIP, out)
    return out


def find_trace_gains(strengths: AnyArray, likeness: AnyArray) -> Float32Array | None:
    """Find what makes traces as strong as others, where they are far from that, and which of them hold nothing.

    Surveys that were put together, shadows, and what a trace was recorded with make whole traces weaker or stronger;
    faults and layers change the strength of one by little. Of what a trace lies off the cube's median by more than 8
    dB, the less is left the more it is: of 20 dB no more than 1.3. So it is with what it then lies off its neighbours,
    by less than 8 dB where traces scatter by more than 2 dB by themselves. Traces are dead that are 40 dB weaker than
    their neighbours, but where others scatter by a fifth of that; those like no neighbour that are 25 dB weaker than
    the strong ones, or 60 where these are like none either; and traces of noise, which are half as like their
    neighbours, or less, as the traces around are like theirs.

    Parameters
    ----------
    strengths : ndarray of shape (inline, crossline)
        From :func:`trace_strengths`.
    likeness : ndarray of the same shape
        From :func:`trace_likeness`.

    Returns
    -------
    ndarray of the same shape, float32, or None
        Factors, 0 where a trace holds no data; None where amplitudes are not to be changed.
    """
    empty = _find_noise_traces(likeness)
    some = (strengths > 0.0) & ~empty
    if not some.any():
        return None
    level = 20.0 * np.log10(np.where(some, strengths, 1.0).astype(np.float64))
    # most traces may be dead: what is usual is told by the strong ones
    level[some] -= np.percentile(level[some], 90.0)
    own = _beside(level, some)
    scatter = robust_scale(own[some & (level > -_MOST)])
    beside, below = (max(least, _FAR * scatter) for least in _DEAD)
    usual = likeness[some & (level > -_HOLLOW) & np.isfinite(likeness)]
    below = _HOLLOW if len(usual) and np.median(usual) > _LIKE else below
    # the strong ones may be too strong: what is like its neighbours is data, however much weaker
    empty |= some & ((own < -beside) | ((level < -below) & ~(likeness > _LIKE)))
    live = some & ~empty
    level[~live] = 0.0
    level[live] -= np.median(level[live])
    excess = _beyond(level, _OFF)
    own = _beside(level - excess, live)
    excess += _beyond(own, _OFF * min(1.0, _SCATTER / max(robust_scale(own[live]), 1e-9)) ** 2)
    gains = np.where(empty, 0.0, 10.0 ** (-excess / 20.0)).astype(np.float32)
    gains[strengths <= 0.0] = 1.0
    return gains if (gains != 1.0).any() else None


def _find_noise_traces(likeness: AnyArray) -> BoolArray:
    """Mark traces that are far less like their neighbours than those around them are like theirs."""
    told = np.isfinite(likeness)
    if not told.any():
        return np.zeros(likeness.shape, np.bool_)
    usual = np.where(told, likeness, np.median(likeness[told]))
    around = ndimage.median_filter(usual, _NEAR, mode="nearest")
    return np.asarray(told & (around > _LIKE) & (usual < _UNLIKE * around))


def _beside(level: Float64Array, live: BoolArray) -> Float64Array:
    """Return what live traces lie off those around them; levels are 0 on others."""
    share = ndimage.gaussian_filter(live.astype(np.float64), _AROUND, mode="nearest")
    level = np.clip(level, -_MOST, _MOST)
    common = ndimage.gaussian_filter(level, _AROUND, mode="nearest") / np.maximum(share, 1e-9)
    return np.where(live, level - common, 0.0)


def _beyond(level: Float64Array, least: float) -> Float64Array:
    """Return what is to be taken off levels beyond the least, so that the less is left the farther they are."""
    size = np.abs(level)
    return np.where(size > least, level * (1.0 - (least / np.maximum(size, 1e-9)) ** 3), 0.0)
