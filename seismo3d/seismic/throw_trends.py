"""Smooth trends of throw over a fault: fitted to the costs of throws, and to throws that matched."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.seismic._kernels_restore import enlarge_grid
from seismo3d.seismic._kernels_trends import (
    fit_block_planes,
    gather_blocks,
    search_trends,
    throws_of_trend,
)

# places of the grid that one place of a trend's own coarser grid stands for
_COARSE = 4
# share of the places that a trend must have counterparts for where it tells how well throws match by chance
_LEAST_SEEN = 0.25
# misfit ratio below which sides are as equal as they get
_SILENCE = 0.15
# slopes of quadratics that are tried first, over half of a surface; slopes and bends of bells, in shares of their throw
_SLOPES = np.array([-12.0, -6.0, 0.0, 6.0, 12.0])
_BELL_SLOPES, _BELL_BENDS = np.array([-0.8, -0.4, 0.0, 0.4, 0.8]), np.array([0.0, 0.7, 1.5, 3.0])
# throw from which on a bell is tried, and how much better, in what misfits tell, it must match than a quadratic
_LEAST_BELL, _CLEARLY = 8.0, 0.005
# how much better a trend must match whose throws are larger than usual: of more that are tried more match by chance
_LARGER = 0.02
# how much better, in what misfits tell, a trend must match that lies so far from the throw expected, or farther
_COMPANY, _AWAY = 0.06, 8.0


def rank_trends(
    cost: Float32Array, inside: BoolArray, *, unmatched: float, usual: int | None = None, about: float | None = None
) -> list[Float32Array]:
    """Return the throws of trends over a surface, quadratics and bells, the one that costs least first.

    Most throws change little over a surface, and a quadratic follows them. Where one dies away from the middle towards
    the tips no quadratic does, and in noise, where no place tells its throw by itself, a bell finds what it would miss.

    What a misfit tells is its logarithm, as of noise whose strength is not known: where throws are right many places
    match nearly without one, while a throw of another cycle matches everywhere by half. Trends of any throw match by
    chance to some degree, and most of those found from one start or another do no more. A throw without a counterpart
    costs as much as that: neither large throws, which lead out of view, nor small ones that are nowhere right gain by
    it.

    Parameters
    ----------
    cost : ndarray of shape (row, sample, throw), float32
        Misfit ratio of every throw, 0 in the middle, at every second place along rows and samples.
    inside : ndarray of shape (row, sample), bool
        Places on the surface.
    unmatched : float
        Misfit ratio of a throw without a counterpart, in ``cost``; the most that it is taken for.
    usual : int, optional
        Larger throws must match clearly better; as large as any if not given.
    about : float, optional
        The mean throw that is expected: trends far from it must match clearly better.

    Returns
    -------
    list of ndarray of shape (row, sample), float32
        Throws in steps of the last axis of ``cost``, at all places; one for each starting throw, and several may be the
        same. None larger than usual where none of them matches so much better.
    """
    rows, columns = np.nonzero(inside[::2, ::2])
    if len(rows) < 2:
        rows, columns = np.nonzero(np.ones_like(inside[::2, ::2]))
    costs = cost[rows, columns]
    blind = costs == np.float32(unmatched)
    costs = _surprise(np.where(blind, costs, ndimage.minimum_filter1d(costs, 3, axis=1, mode="nearest")))
    unmatched = float(_surprise(np.float32(unmatched)))
    middle, half = [], []
    for at in (2.0 * rows, 2.0 * columns):
        middle.append(0.5 * (at.min() + at.max()))
        half.append(max(0.5 * float(np.ptp(at)), 1.0))
    u, v = (2.0 * rows - middle[0]) / half[0], (2.0 * columns - middle[1]) / half[1]
    longest = cost.shape[2] // 2
    usual = longest if usual is None else min(usual, longest)
    near, among = _starts(usual), slice(longest - usual, longest + usual + 1)
    terms, _ = _search(costs[:, among], u, v, near, bell=False, level=unmatched)
    told = [_at(costs[:, among], blind[:, among], _throws_of(term, u, v)) for term in terms]
    costs[blind] = level = _level_of_chance(told, unmatched)
    grid = np.indices(inside.shape).astype(np.float64)
    a, b = (((at - m) / h).ravel() for at, m, h in zip(grid, middle, half, strict=True))

    def find(looked_at: Float32Array, starts: Float64Array) -> list[tuple[float, Float32Array]]:
        found, most = [], looked_at.shape[1] // 2
        for bell in (False, True):
            terms, scores = _search(looked_at, u, v, starts, bell=bell, level=level)
            for term, score in zip(terms, scores, strict=True):
                away = _price_of(_throws_of(term, u, v, bell).mean(), about)
                throws = np.clip(_throws_of(term, a, b, bell), -most, most).reshape(inside.shape)
                found.append((score + away + (_CLEARLY if bell else 0.0), throws.astype(np.float32)))
        return found

    found, far = find(np.ascontiguousarray(costs[:, among]), near), _starts(longest)
    larger = find(costs, far[np.abs(far) > usual])
    if larger and min(score for score, _ in larger) < min(score for score, _ in found) - _LARGER:
        found += larger
    return [throws for _, throws in sorted(found, key=itemgetter(0))]


def _starts(longest: int) -> Float64Array:
    """Return throws, up to the longest either way, from which trends are looked for."""
    return np.arange(-longest + 2.0, longest - 1.0, 4.0) if longest > 3 else np.zeros(1)


class TrendScores:
    """What trends cost by the misfit ratios of their throws, as :func:`rank_trends` scores them; less is better.

    Parameters
    ----------
    trends : sequence of (ndarray, ndarray) of shape (place,), float32
        Misfit ratios, infinite without a counterpart, and throws of some trends, of which most match by chance.
    unmatched : float
        The most that a throw without a counterpart is taken for.
    about : float, optional
        The mean throw that is expected.

    Attributes
    ----------
    own : list of float
        Scores of these trends.
    """

    def __init__(
        self, trends: Sequence[tuple[Float32Array, Float32Array]], *, unmatched: float, about: float | None
    ) -> None:
        told = [_tell(cost) for cost, _ in trends]
        self._level = _level_of_chance(told, float(_surprise(np.float32(unmatched))))
        self._about = about
        self.own = [self._score(*t, throws) for t, (_, throws) in zip(told, trends, strict=True)]

    def of(self, cost: Float32Array, throws: Float32Array) -> float:
        """Return the score of a trend from its misfit ratios and its throws at the same places."""
        return self._score(*_tell(cost), throws)

    def _score(self, told: Float32Array, seen: BoolArray, throws: Float32Array) -> float:
        mean = float(np.where(seen, told, np.float32(self._level)).mean(dtype=np.float64))
        return mean + _price_of(float(throws.mean(dtype=np.float64)), self._about)


def _tell(cost: Float32Array) -> tuple[Float32Array, BoolArray]:
    """Return what misfit ratios tell against a throw, and where it has a counterpart."""
    seen = np.isfinite(cost)
    return _surprise(np.where(seen, cost, np.float32(1.0))), seen


def _price_of(mean: float, about: float | None) -> float:
    """Return what a mean throw costs for lying away from the one expected."""
    return 0.0 if about is None else _COMPANY * min(abs(mean - about) / _AWAY, 1.0)


def _search(
    costs: Float32Array, u: Float64Array, v: Float64Array, starts: Float64Array, *, bell: bool, level: float
) -> tuple[Float64Array, Float64Array]:
    """Return the trends reached from starting throws, and their scores; of bells only from those large enough."""
    slopes, bends = (_BELL_SLOPES, _BELL_BENDS) if bell else (_SLOPES, np.zeros(1))
    starts = starts[np.abs(starts) >= _LEAST_BELL] if bell else starts
    terms, scores = np.zeros((len(starts), 6)), np.zeros(len(starts))
    search_trends(np.ascontiguousarray(costs), u, v, starts, slopes, bends, bell, 1.5 * level, 40, terms, scores)
    return terms, scores


def _surprise(ratio: Any) -> Any:
    """Return what misfit ratios tell against a throw, from 0 to 1: their logarithms, from none to all of the energy."""
    return (np.log1p(ratio / _SILENCE) / np.log1p(1.0 / _SILENCE)).astype(np.float32)


def _throws_of(terms: Float64Array, a: Float64Array, b: Float64Array, bell: bool = False) -> Float64Array:
    """Return the throws of a trend at places from -1 to 1 along rows and columns."""
    throws = np.empty(len(a))
    throws_of_trend(a, b, terms, bell, throws)
    return throws


def _at(costs: Float32Array, blind: BoolArray, throws: Float64Array) -> tuple[Float32Array, BoolArray]:
    """Return what a trend's throws cost at every place, and where they have a counterpart."""
    middle, index = costs.shape[1] // 2, np.arange(len(costs))
    shift = np.clip(np.rint(throws).astype(np.int64), -middle, middle) + middle
    return costs[index, shift], ~blind[index, shift]


def _level_of_chance(told: Sequence[tuple[Float32Array, BoolArray]], unmatched: float) -> float:
    """Return what most trends cost where they have counterparts, from the costs of each and where it has them."""
    found = [float(cost[seen].mean()) for cost, seen in told if seen.mean() > _LEAST_SEEN]
    return min(float(np.median(found)), unmatched) if found else unmatched


def local_trend(values: Float32Array, known: BoolArray, *, width: float) -> Float32Array:
    """Fit a plane around every place to the known values, near ones most; it carries them on where none are known.

    Parameters
    ----------
    values : ndarray of two axes, float32
        Values, read where known.
    known : ndarray of the same shape, bool
        Where they are.
    width : float
        Width of the Gaussian window, in places; three times that where it is nearly empty.

    Returns
    -------
    ndarray of the same shape, float32
        0 where nothing is known; else never farther beyond the range of what is than a quarter of its largest size and
        one.
    """
    if not known.any():
        return np.zeros(values.shape, np.float32)
    parts = gather_blocks(values, known, _COARSE)
    narrow, weight = _planes(parts, width)
    wide, spare = _planes(parts, 3.0 * width)
    share = np.clip(20.0 * weight / max(float(weight.max()), 1e-12), 0.0, 1.0)
    mean = (parts[3] * parts[0]).sum() / parts[0].sum()
    trend = np.where(spare > 1e-9, share * narrow + (1.0 - share) * wide, mean)
    low, high = np.percentile(values[known], [0.5, 99.5])
    trend = _enlarge(trend, values.shape)
    return np.clip(trend, low - 0.25 * abs(low) - 1.0, high + 0.25 * abs(high) + 1.0).astype(np.float32)


def _planes(parts: Float64Array, width: float) -> tuple[Float64Array, Float64Array]:
    """Value at the middle of every block of the plane through the blocks around it, and the weight of these."""
    sigma = width / _COARSE
    reach = round(3.0 * sigma)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    value, weight = fit_block_planes(parts, _COARSE, taps / taps.sum(), 0.02 * width**2)
    return value, weight


def _enlarge(values: Float64Array, shape: tuple[int, ...]) -> Float64Array:
    rows, columns = ((np.arange(n) - 0.5 * (_COARSE - 1)) / _COARSE for n in shape)
    return np.asarray(enlarge_grid(values, rows, columns), np.float64)
