"""What faults did to the layers around them: which share of the slip either wall took, and how it dies away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.registration.robust import robust_scale
from seismo3d.seismic._kernels_strain import sum_products
from seismo3d.seismic.fault_ages import HistorySettings
from seismo3d.seismic.fault_motion import FaultMotion, nearest_parts, slip_left
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetSides, SheetThrow, mask_sheets

# traces, traces and samples from one place to the next at which the layers' slopes are kept, and traces clear of faults
_SPACING, _CLEAR = np.array([4, 4, 8]), 4
# places at which slopes are kept at most: of a larger cube they lie farther apart; and numbers that the terms of all
# faults may take: of many faults fewer places are used
_MOST_PLACES, _MOST = 262_144, 10_000_000
# voxels within which slopes are no independent of each other, and places that it takes to tell anything
_ALIKE, _LEAST_PLACES = 12_800.0, 200
# distance, in traces, over which slopes of what a fault did are taken
_APART = 2.0
# shares of the slip that are lost a trace off a fault, among which that is found that fits best
_DECAYS = np.array([0.0, 0.004, 0.008, 0.012, 0.017, 0.023, 0.03])
# rounds of robust fits, and of trying all decays of all faults in each; where its weight falls off, in spreads
_ROUNDS, _SWEEPS, _SPREADS = 4, 4, 2.0
# fit from which on a throw counts, smallest throw that tells, how many places it takes, and how many tell as one
_FITS, _TELLS, _LEAST_BESIDE, _FEW = 0.5, 1.0, 100, 30.0
# at most so much, as a logarithm of odds, speak the tilts beside a fault for or against a decay
_MOST_ODDS = 6.0


class LayerSlopes(NamedTuple):
    """Slopes of the layers at places spread over a cube, clear of its faults.

    Attributes
    ----------
    points : ndarray of shape (n, 3), float64
        Places, in the order of the cube's axes.
    slopes : ndarray of shape (2, n), float32
        How much deeper layers lie an inline, and a crossline, farther on, in samples.
    voxels : int
        Voxels of the cube for one place.
    """

    points: Float64Array
    slopes: Float32Array
    voxels: int


@dataclass(frozen=True, slots=True)
class Strain:
    """How a fault moved what lies on its two sides.

    Attributes
    ----------
    lift : float
        Share of the slip that the hanging wall took, 0.5 to 1; the footwall took the rest, the other way.
    decay : float
        Share of the slip that is lost with the first trace off it.
    """

    lift: float = 1.0
    decay: float = 0.0

    def of(self, motion: FaultMotion) -> FaultMotion:
        """Return a motion with this strain."""
        return replace(motion, lift=self.lift, decay=self.decay)


def sample_slopes(
    slopes: tuple[Float32Array, Float32Array],
    valid: BoolArray,
    sheets: list[Sheet],
    shape: tuple[int, ...],
    *,
    corner: tuple[int, int] = (0, 0),
) -> LayerSlopes:
    """Keep the slopes of a cube of some shape, or of a block of it, at places where there are data and no sheet.

    The places are every so many traces and samples of the cube, so that blocks, of which each begins at a corner, give
    those of the whole.
    """
    apart = int(np.ceil(np.cbrt(np.prod(shape, dtype=np.float64) / np.prod(_SPACING) / _MOST_PLACES)))
    spacing = _SPACING * max(apart, 1)
    clear = mask_sheets(sheets, valid, beside=_CLEAR, corner=corner)
    first = np.array([-corner[0] % spacing[0], -corner[1] % spacing[1], spacing[2]])
    end = max(valid.shape[2] - int(_SPACING[2]), 0)
    at = tuple(
        np.s_[a : z : int(every)] for a, z, every in zip(first.tolist(), (None, None, end), spacing, strict=True)
    )
    places = np.argwhere(clear[at])
    points = (places * spacing + first + np.array((*corner, 0))).astype(np.float64)
    return LayerSlopes(points, np.stack([slope[at][tuple(places.T)] for slope in slopes]), int(np.prod(spacing)))


def join_slopes(parts: Sequence[LayerSlopes]) -> LayerSlopes:
    """Put together what was kept of the blocks of a cube."""
    points, slopes = (np.concatenate([part[k] for part in parts], axis=k) for k in (0, 1))
    order = np.lexsort(points.T[::-1])
    return LayerSlopes(points[order], slopes[:, order], parts[0].voxels)


def tell_strains(
    motions: list[FaultMotion],
    families: IntArray,
    layers: LayerSlopes,
    beside: Callable[[int], tuple[SheetThrow, SheetSides, int]],
    settings: HistorySettings,
) -> list[Strain]:
    r"""Tell which share of its slip each wall of a fault took, and how slip dies away off it.

    Where a fault has thrown layers by :math:`T`, which changes along it, those of the hanging wall lie deeper than
    before by :math:`\lambda T g`, and those of the footwall higher by :math:`(1 - \lambda) T g`, if the hanging wall
    took the share :math:`\lambda` and :math:`g = (1 - c\,d / 2)^2` is left at a distance :math:`d` (rollover and
    footwall uplift [1]_ [2]_). So the slopes of layers around all faults are fitted at once, robustly, by those of what
    each did on either side and of a quadratic that grows with depth, as layers lay before. :math:`\lambda` is found by
    least squares, held at 1 where slopes do not tell; :math:`c` is the best of a few, and 0 where throw hardly changes
    along the fault: slip reaches about as far off a fault as along it [3]_. By
    :math:`(2\lambda - 1)\,c\,T` a trace more layers tilt in the hanging wall than in the footwall where they came from:
    close to the fault that is seen even where layers are folded, and counts as well.

    Parameters
    ----------
    motions : list of FaultMotion
        The faults, or parts of them, as they lie today.
    families : ndarray of shape (part,), int64
        Which are parts of one.
    layers : LayerSlopes
        Slopes of the layers around them.
    beside : callable
        Takes the number of a part, and gives its throw as it seems today, its two sides, and every how many samples
        its sheet has a node.
    settings : HistorySettings
        How firmly it is held that the hanging wall alone moved, all of it alike.

    Returns
    -------
    list of Strain
        One for each part.

    References
    ----------
    .. [1] W. K. Hamblin, Geological Society of America Bulletin 76(10), 1145-1164, 1965.
    .. [2] J. A. Jackson, D. P. McKenzie, Journal of Structural Geology 5(5), 471-482, 1983.
    .. [3] J. A. Barnett et al., AAPG Bulletin 71(8), 925-937, 1987.
    """
    if not motions:
        return []
    n_families = int(families.max()) + 1
    parts = [np.flatnonzero(families == family).tolist() for family in range(n_families)]
    near = [_Beside.of([beside(n) for n in members]) for members in parts]
    layers = _thinned(layers, n_families)
    if len(layers.points) < _LEAST_PLACES:
        layers = LayerSlopes(layers.points[:0], layers.slopes[:, :0], layers.voxels)
    walls = [_terms_of([motions[n] for n in members], layers.points) for members in parts]
    terms = np.concatenate([np.concatenate(walls), _regional_terms(layers.points)])
    slopes = np.ascontiguousarray(layers.slopes.astype(np.float32).reshape(-1))
    lifts, decays = _fit(terms, slopes, max(_ALIKE / layers.voxels, 1.0), near, settings)
    # what threads leave in the last bits must not go on from here
    told = [
        Strain(round(float(np.clip(lift, 0.5, 1.0)), 4), float(_DECAYS[n]))
        for lift, n in zip(lifts, decays, strict=True)
    ]
    return [told[family] for family in families]


def _thinned(layers: LayerSlopes, n_families: int) -> LayerSlopes:
    """Return fewer places where faults are many."""
    most = max(1, _MOST // (4 * len(_DECAYS) * n_families))
    every = max(1, -(-len(layers.points) // most))
    return LayerSlopes(layers.points[::every], layers.slopes[:, ::every], layers.voxels * every)


def _terms_of(parts: list[FaultMotion], points: Float64Array) -> Float32Array:
    """Return the slopes of what a fault did: (decay and part of it, direction and place).

    For each decay there are two terms: those of both walls moved down by all of the slip, which its lift counts, and of
    the footwall moved up by all of it.
    """
    off = _throw_around(parts, points)[1]
    out = np.zeros((len(_DECAYS), 2, 2, len(points)), np.float32)
    for axis in (0, 1):
        step = np.zeros(3)
        step[axis] = _APART
        (above, before), (below, after) = (_throw_around(parts, points + sign * step) for sign in (1.0, -1.0))
        one_wall = (before > 0.0) == (after > 0.0)
        for n, decay in enumerate(_DECAYS):
            change = (above * slip_left(before, decay) - below * slip_left(after, decay)) / (2.0 * _APART)
            out[n, 0, axis] = np.where(one_wall, change, 0.0)
            out[n, 1, axis] = np.where((off <= 0.0) & one_wall, -change, 0.0)
    return out.reshape(2 * len(_DECAYS), -1)


def _throw_around(parts: list[FaultMotion], points: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the throw of a fault, carried across its strike to points, and how far on the hanging side they lie."""
    nearest = nearest_parts(parts, points)
    thrown, off = np.zeros(len(points)), np.zeros(len(points))
    for number, part in enumerate(parts):
        mine = nearest == number
        thrown[mine], off[mine] = part.throw_at(points[mine]), part.side(points[mine])
    return thrown, off


def _regional_terms(points: Float64Array) -> Float32Array:
    """Return the slopes of quadratics over a cube, alike at all depths and growing with it, as no fault made them."""
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0)) if len(points) else np.zeros(3)
    half = np.maximum(0.5 * np.ptp(points, axis=0), 1.0) if len(points) else np.ones(3)
    i, x, s = ((points - middle) / half).T
    one, none = np.ones_like(i), np.zeros_like(i)
    level = [(one, none), (none, one), (2.0 * i, none), (x, i), (none, 2.0 * x)]
    return np.array([np.concatenate([grows * a, grows * b]) for grows in (one, s) for a, b in level], np.float32)


def measure_evenness(throws: Sequence[SheetThrow]) -> float:
    """Return how even the throw of a fault is over its parts: the least over the largest, but for outliers.

    Places that match tell it; NaN where these are too few.
    """
    known = [np.isfinite(part.throw) & (part.fit > _FITS) for part in throws]
    thrown = np.abs(np.concatenate([part.throw[matched] for part, matched in zip(throws, known, strict=True)]))
    if len(thrown) < _LEAST_BESIDE:
        return np.nan
    least, most = np.percentile(thrown, [10.0, 95.0])
    return float(least / max(most, 1e-6))


class _Beside(NamedTuple):
    """How much more layers tilt in the hanging wall than in the footwall, by throw, and the variance of that.

    And how even the throw is.
    """

    tilt: float
    variance: float
    evenness: float

    @staticmethod
    def of(parts: Sequence[tuple[SheetThrow, SheetSides, int]]) -> _Beside:
        """Return what is seen close to the parts of a fault; of infinite variance where that is next to nothing."""
        evenness = measure_evenness([throw for throw, _, _ in parts])
        found = [_tilt_by_throw(*part) for part in parts]
        tilt, throw, weight = (np.concatenate([part[k] for part in found]) for k in range(3))
        if len(tilt) < _LEAST_BESIDE:
            return _Beside(0.0, np.inf, evenness)
        factor, spread, weights = 0.0, 0.0, weight
        for _ in range(8):
            factor = -float((weights * tilt * throw).sum()) / float((weights * throw**2).sum())
            left = tilt + factor * throw
            spread = _spread(left)
            weights = weight * _weights(left, spread)
        energy = float((weights * throw**2).sum() / weights.sum())
        # more than the most that is tried speaks for that
        return _Beside(min(factor, float(_DECAYS[-1])), spread**2 / (energy * _FEW), evenness)

    def odds_against(self, lift: float, decay: float, spread: float) -> float:
        """Return the logarithm of the odds against a strain."""
        wrong = (2.0 * lift - 1.0) * decay - self.tilt
        return min(0.5 * wrong**2 / (spread**2 + self.variance), _MOST_ODDS)


def _tilt_by_throw(throw: SheetThrow, sides: SheetSides, step: int) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return how much more layers tilt in the hanging wall than where they came from, the throw, and its weight."""
    rows, columns = np.nonzero(np.isfinite(throw.throw) & (throw.fit > _FITS) & (np.abs(throw.throw) > _TELLS))
    thrown, fit = (values[rows, columns].astype(np.float64) for values in (throw.throw, throw.fit))
    below = columns * step
    above = np.rint(below - thrown).astype(np.int64)
    n_samples = sides.tilts.shape[2]
    inside = (below < n_samples) & (above >= 0) & (above < n_samples)
    rows, below, above, thrown, fit = (values[inside] for values in (rows, below, above, thrown, fit))
    up = 1 if throw.hanging_side > 0 else 0
    hanging, foot = ((side, rows, at) for side, at in ((up, below), (1 - up, above)))
    known = (sides.known[hanging] > 0.0) & (sides.known[foot] > 0.0)
    tilt = throw.hanging_side * (sides.tilts[hanging].astype(np.float64) - sides.tilts[foot])
    return tilt[known], thrown[known], fit[known] ** 2


def _fit(
    terms: Float32Array, slopes: Float32Array, alike: float, near: list[_Beside], settings: HistorySettings
) -> tuple[Float64Array, IntArray]:
    """Return the lift of each fault, and the number of its decay, that fit slopes best, of which some tell as one."""
    decays = np.zeros(len(near), np.int64)
    weights = np.ones(len(slopes))
    spread = _spread(slopes - np.median(slopes)) if len(slopes) else 1.0
    factors = np.ones(len(near))
    for _ in range(_ROUNDS if len(slopes) else 1):
        matrix, right = np.zeros((len(terms), len(terms))), np.zeros(len(terms))
        energy = sum_products(terms, slopes, weights, matrix, right)
        system = _System(matrix, right, energy, spread**2 * alike, near, settings)
        for _ in range(_SWEEPS):
            before = decays.copy()
            for fault in range(len(near)):
                n_tried = 1 if near[fault].evenness >= settings.even else len(_DECAYS)
                tried = [np.where(np.arange(len(near)) == fault, n, decays) for n in range(n_tried)]
                decays = min(tried, key=lambda numbers: system.solve(numbers)[1])
            if (decays == before).all():
                break
        factors, _ = system.solve(decays)
        if len(slopes):
            free, fixed = system.chosen(decays)
            left = slopes - terms[fixed].sum(axis=0) - (factors[:, None] * terms[free]).sum(axis=0)
            spread = _spread(left)
            weights = _weights(left, spread)
    return factors[: len(near)], decays


def _spread(left: Float64Array | Float32Array) -> float:
    return robust_scale(left) + 1e-4


def _weights(left: Float64Array, spread: float) -> Float64Array:
    """Return what values count of which so much is left over: less the more that is (Cauchy)."""
    return np.asarray(1.0 / (1.0 + (left / (_SPREADS * spread)) ** 2))


class _System:
    """Sums of products of all terms, solved for the lifts of faults at given decays."""

    def __init__(
        self, matrix: Float64Array, right: Float64Array, energy: float, variance: float, near: list[_Beside],
        settings: HistorySettings,
    ) -> None:  # fmt: skip
        self._matrix, self._right, self._energy, self._variance = matrix, right, energy, variance
        self._near, self._settings = near, settings
        self._regional = np.arange(2 * len(near) * len(_DECAYS), len(right))
        held = variance / settings.lift_spread**2
        self._ridge = np.full(len(near) + len(self._regional), 1e-3 * min(held, 1.0))
        self._ridge[: len(near)] = held
        self._expected = np.zeros(len(self._ridge))
        self._expected[: len(near)] = 1.0

    def chosen(self, decays: IntArray) -> tuple[IntArray, IntArray]:
        """Return the numbers of the terms that count at some decays: free ones, lifted first, and fixed ones."""
        lifted = 2 * (np.arange(len(decays)) * len(_DECAYS) + decays)
        return np.concatenate([lifted, self._regional]), lifted + 1

    def solve(self, decays: IntArray) -> tuple[Float64Array, float]:
        """Return the factors of the free terms, lifts first, and the logarithm of the odds against these decays."""
        free, fixed = self.chosen(decays)
        matrix, right = self._matrix[np.ix_(free, free)], self._right[free]
        right = right - self._matrix[np.ix_(free, fixed)].sum(axis=1)
        factors = np.linalg.solve(matrix + np.diag(self._ridge), right + self._ridge * self._expected)
        left = self._energy + float(self._matrix[np.ix_(fixed, fixed)].sum() - 2.0 * self._right[fixed].sum())
        left += float((factors * (matrix @ factors - 2.0 * right)).sum())
        left += float((self._ridge * (factors - self._expected) ** 2).sum())
        odds = 0.5 * left / self._variance + self._settings.decay_odds * float((decays > 0).sum())
        for near, lift, n in zip(self._near, np.clip(factors[: len(decays)], 0.5, 1.0), decays, strict=True):
            odds += near.odds_against(float(lift), float(_DECAYS[n]), self._settings.decay_spread)
        return factors, odds
