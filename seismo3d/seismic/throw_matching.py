"""Throws matched place by place: the trend that costs least over a surface, then the cheapest paths about it.

Sides are compared in windows of one throw first. Where throws change fast, as they do towards the tips of a fault that
dies within the cube, what is right in the middle of such a window is off at its ends and matches hardly better than by
chance. Windows that follow a trend match there, and tell the right one from all others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_costs import compare_throws
from seismo3d.seismic._kernels_filters import gaussian_taps
from seismo3d.seismic._kernels_throw import bar_far_shifts, pick_shifts, sum_paths
from seismo3d.seismic.slip_fields import MISMATCH, Sides, costs_about
from seismo3d.seismic.throw_bells import smooth_about_bell
from seismo3d.seismic.throw_trends import TrendScores, local_trend, rank_trends

if TYPE_CHECKING:
    from seismo3d.seismic.throw import ThrowSettings

# how far a throw may lie from those around it, before and after these are known well
_BAND, _OUTLIER = 8.0, 6.0
# throws farther off a trend cost more than any that matches: they are left out
_NEAR = 20
# rounds of paths about a trend, which is then fitted anew
_ROUNDS = 2
# throws about a trend that are looked at: to judge it, and to find paths about it
_JUDGED, _ABOUT = 1, 8
# how much better, in what misfits tell, a trend must match in windows that follow it; and how many such are tried
_BETTER, _TRIED = 0.05, 4
# samples, on the mean, by which trends are apart that are not the same; and every so many places tell that
_APART, _EVERY = 1.0, 16


@dataclass(frozen=True, slots=True, eq=False)
class _Followed:
    """A trend, and what was matched about it; of shape (row, sample).

    Attributes
    ----------
    throw, fit : ndarray, float32
        Throws, those of the trend where nothing matches; how well they match, 0 there.
    trend : ndarray, float32
        The trend, fitted anew.
    """

    throw: Float32Array
    fit: Float32Array
    trend: Float32Array


def match_throws(
    sides: Sides, inside: BoolArray, *, about: float | None, settings: ThrowSettings
) -> tuple[Float32Array, Float32Array]:
    """Find the throw of every `thin`-th place of a surface.

    Parameters
    ----------
    sides : Sides
        Both sides, at every sample.
    inside : ndarray of shape (row, sample), bool
        Places on the surface.
    about : float, optional
        The mean throw that is expected, if any is.
    settings : ThrowSettings
        Windows and limits.

    Returns
    -------
    throw, fit : ndarray of shape (row, sample), float32
        At every `thin`-th place: samples, and 1 where the sides are equal there, 0 where nothing matches and the throw
        is that of the trend.
    """
    inside = inside[:: settings.thin, :: settings.thin]
    longest = _longest(sides, settings)
    cost = _costs(sides, -longest, longest, settings, every=2)
    trends = rank_trends(cost, inside, unmatched=settings.unmatched, usual=settings.usual, about=about)
    plain = _follow(sides, trends[0], inside, partial(_cheapest, sides, settings), settings.thin)
    best = _follow_steeper(sides, plain, trends, inside, about, settings) or plain
    return best.throw, best.fit


def _follow_steeper(
    sides: Sides, plain: _Followed, trends: list[Float32Array], inside: BoolArray, about: float | None,
    settings: ThrowSettings,
) -> _Followed | None:  # fmt: skip
    """Follow a trend that matches clearly better than the plain one does in windows that follow them, if any does."""
    places = inside if inside.any() else np.ones_like(inside)
    trends = _tell_apart(trends, places)
    longest = float(_longest(sides, settings))

    def judge(trend: Float32Array) -> tuple[Float32Array, Float32Array]:
        throws = np.clip(trend, -longest, longest)
        cost = costs_about(sides, throws, 0.0, settings.thin, settings.slip, reach=_JUDGED)
        return cost.min(axis=2)[places], throws[places]

    scores = TrendScores([judge(trend) for trend in trends], unmatched=settings.unmatched, about=about)
    least = scores.of(*judge(plain.trend)) - _BETTER
    if min(scores.own) >= least:
        return None
    best = None
    for number in np.argsort(scores.own, kind="stable")[:_TRIED]:
        steep = _follow(sides, trends[number], inside, partial(_cheapest_about, sides, settings), settings.thin)
        score = scores.of(*judge(steep.trend))
        if score < least:
            best, least = steep, score
    return best


def _tell_apart(trends: list[Float32Array], places: BoolArray) -> list[Float32Array]:
    """Leave out trends that are the same as one before them, but for less than a sample on the mean."""
    throws = np.array([trend[places][::_EVERY] for trend in trends])
    kept: list[int] = []
    for number, throw in enumerate(throws):
        if (np.abs(throws[kept] - throw).mean(axis=1) >= _APART).all():
            kept.append(number)
    return [trends[number] for number in kept]


def _follow(
    sides: Sides, trend: Float32Array, inside: BoolArray,
    cheapest: Callable[[Float32Array], tuple[Float32Array, Float32Array]], thin: int,
) -> _Followed:  # fmt: skip
    """Find the cheapest throws near a trend, which is fitted anew to what matches."""
    for _ in range(_ROUNDS):
        throw, fit = cheapest(trend)
        # what matches where the trend has the counterpart out of view does so by chance
        in_view = sides.in_view(throw, thin) & sides.in_view(trend, thin)
        matched = inside & in_view & (fit > 1.0 - MISMATCH)
        trend = _trend_about_bell(throw, matched, thin)
        near = matched & (np.abs(throw - trend) < _OUTLIER)
        if near.any():
            trend = _trend_about_bell(throw, near, thin)
        kept = matched & (np.abs(throw - trend) < _OUTLIER)
    throw, fit = np.where(kept, throw, trend), np.where(kept, fit, 0.0)
    return _Followed(throw.astype(np.float32), fit.astype(np.float32), trend)


def _trend_about_bell(throw: Float32Array, known: BoolArray, thin: int) -> Float32Array:
    """Return the trend around every place of the throws known, the bell through all of them taken off first."""
    around = partial(local_trend, known=known, width=24.0 / thin)
    return smooth_about_bell(throw, known.astype(np.float32), around)


def _longest(sides: Sides, settings: ThrowSettings) -> int:
    """Return the largest throw that is looked for between two sides."""
    return min(settings.longest, max(1, sides.hanging.shape[1] - 1))


def _costs(sides: Sides, first: int, last: int, settings: ThrowSettings, *, every: int = 1) -> Float32Array:
    """Return the misfit ratio of throws from the first to the last at some `thin`-th places: (row, sample, throw)."""
    thin, n_throws = settings.thin, last - first + 1
    shape = tuple((size - 1) // (thin * every) + 1 for size in sides.hanging.shape)
    mean = sides.mean_energy()
    ratio, out = np.empty((n_throws, *shape), np.float32), np.empty((*shape, n_throws), np.float32)
    compare_throws(
        sides.hanging, sides.foot, sides.in_hanging, sides.in_foot, first, thin, every, np.float32(4.0 * mean),
        gaussian_taps(settings.along_strike / thin), gaussian_taps(settings.down / thin),
        np.float32(0.6 * mean), np.float32(settings.unmatched), ratio, out,
    )  # fmt: skip
    return out


def _cheapest(sides: Sides, settings: ThrowSettings, trend: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return the throw of the cheapest paths near a trend at every place, and its fit."""
    longest = _longest(sides, settings)
    first, last = np.clip([int(trend.min()) - _NEAR, int(trend.max()) + _NEAR], -longest, longest).tolist()
    cost = _costs(sides, first, last, settings)
    barred = np.empty_like(cost)
    bar_far_shifts(cost, first, trend, np.float32(_BAND), barred)
    return _pick(cost, barred, first, settings)


def _cheapest_about(sides: Sides, settings: ThrowSettings, trend: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return what :func:`_cheapest` does, of paths that follow the trend, compared in windows that do, too."""
    cost = costs_about(sides, trend, 0.0, settings.thin, settings.slip, reach=_ABOUT)
    cost = np.where(np.isfinite(cost), cost, np.float32(settings.unmatched))
    change, fit = _pick(cost, cost, -_ABOUT, settings)
    return trend + change, fit


def _pick(
    cost: Float32Array, barred: Float32Array, first: int, settings: ThrowSettings
) -> tuple[Float32Array, Float32Array]:
    """Return the shift of the cheapest paths at every place, and its fit, from costs of shifts from the first on."""
    total = np.zeros_like(cost)
    sum_paths(barred, np.float32(settings.step), np.float32(settings.jump), total)
    shift, fit = np.empty(cost.shape[:2], np.float32), np.empty(cost.shape[:2], np.float32)
    pick_shifts(total, cost, first, shift, fit)
    return shift, fit
