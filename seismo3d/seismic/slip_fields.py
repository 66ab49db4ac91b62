"""Throw over a fault, refined: a stiff field of throw about which both sides match best."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, TypeAlias

import numpy as np

from seismo3d._settings import Stiffness, Threshold, Width
from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_costs import compare_about
from seismo3d.seismic._kernels_filters import gaussian_taps
from seismo3d.seismic._kernels_restore import enlarge_grid
from seismo3d.seismic._kernels_slip import add_bending, add_places, find_in_view, pull_shifts, solve_bands
from seismo3d.seismic.throw_bells import smooth_about_bell

# grid places between the nodes of a field, and how firmly a field that nothing holds stays at the mean
_COARSE, _RIDGE = 4, 1e-3
# shifts tried to either side of a field
_REACH = 8
MISMATCH = 0.6
"""Misfit ratio beyond which the sides do not match, in the strongest noise."""
# the same without noise
_CHANCE = 0.2
# how it grows between them with what the best quarter of the places leaves
_NOISE = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Sides:
    """Both sides of a fault read along its surface, and where they are known (1) or not (0).

    Attributes
    ----------
    hanging, foot : ndarray of shape (row, sample), float32
        Amplitudes of the two sides.
    in_hanging, in_foot : ndarray of the same shape, float32
        Where these are known.
    """

    hanging: Float32Array
    foot: Float32Array
    in_hanging: Float32Array
    in_foot: Float32Array

    def mean_energy(self) -> float:
        """Return the mean square of both sides."""
        known = float(self.in_hanging.sum() + self.in_foot.sum())
        return float((self.hanging**2).sum() + (self.foot**2).sum()) / max(known, 1.0) + 1e-12

    def in_view(self, throw: Float32Array, thin: int, share: float = 0.0) -> BoolArray:
        """Tell where the hanging wall is known and so is the footwall at the place that it came from."""
        return np.asarray(find_in_view(self.in_hanging, self.in_foot, throw, thin, np.float32(share)))


_Round: TypeAlias = Annotated[tuple[tuple[Width, Stiffness], ...], "not empty"]


@dataclass(frozen=True, slots=True)
class SlipSettings:
    """How throws are refined.

    Attributes
    ----------
    start : float in [0, 1000000]
        Stiffness, about their bell, of the field through the throws that matched.
    rounds : tuple of tuple of (float, float) in (0, 1000] and [0, 1000000], not empty
        For each comparison about the field so far, the steps of its fit: how far, in samples, a throw may lie from the
        field for half a misfit ratio, and the stiffness of the field.
    along_strike, down : float in (0, 1000]
        Widths of the Gaussian window over which the sides are compared.
    least_share, least_gain, least_certainty, least_wavering : float in [0, inf]
        Strike slip over throw, share of what throws leave over that it explains, how sharply it is told, and samples by
        which it makes the sides waver, from which on slip is oblique.
    most_misfit : float in [0, inf]
        Misfit ratio of the sides, in the median, up to which that is told.
    """

    start: Stiffness = 1000.0
    rounds: Annotated[tuple[_Round, ...], "not empty"] = (((4.0, 100.0), (3.0, 30.0)), ((3.0, 30.0), (2.0, 30.0)))
    along_strike: Width = 3.0
    down: Width = 4.0
    least_share: Threshold = 0.15
    least_gain: Threshold = 0.2
    least_certainty: Threshold = 0.2
    least_wavering: Threshold = 0.3
    most_misfit: Threshold = 0.08


@dataclass(frozen=True, slots=True, eq=False)
class SlipField:
    """Refined throw on a grid.

    Attributes
    ----------
    throw, misfit : ndarray of shape (row, sample), float32
        Throw in samples; misfit ratio of the sides about it, infinite where it leads out of view.
    share : float
        Slip along the rows over throw.
    certainty : float
        How sharply that share is told, 0 to 1.
    """

    throw: Float32Array
    misfit: Float32Array
    share: float
    certainty: float = 0.0


def refine_slip(
    sides: Sides,
    throw: Float32Array,
    fit: Float32Array,
    inside: BoolArray,
    *,
    thin: int,
    settings: SlipSettings,
    share: float = 0.0,
) -> SlipField:
    """Refine a throw.

    The sides are compared again, each place with its counterpart and a few samples above and below it, so that the
    window follows the throw as it changes. At every place the shift is taken that costs least together with its
    distance from the field; the field is the thin plate through all of them, weighed by their match. Both are repeated
    with less leeway.

    Parameters
    ----------
    sides : Sides
        Both sides, at every sample.
    throw, fit : ndarray of shape (row, sample), float32
        Throw at every `thin`-th place, and how well it matches, 0 where it is guessed.
    inside : ndarray of the same shape, bool
        Places on the surface.
    thin : int
        Places of the sides for one of the throw.
    settings : SlipSettings
        Windows and limits.
    share : float
        Slip along the rows over throw.

    Returns
    -------
    SlipField
    """
    longest = float(max(1, sides.hanging.shape[1] - 1))
    known = np.where(inside, fit, 0.0).astype(np.float32)
    field = smooth_about_bell(throw, known, partial(smooth_field, weights=known, stiffness=settings.start))
    field = np.clip(field, -longest, longest)
    return _refine(sides, field, share, inside, thin, settings.rounds, settings)


def match_about_field(
    sides: Sides, slip: SlipField, inside: BoolArray, thin: int, leeway: float, settings: SlipSettings
) -> tuple[Float32Array, Float32Array]:
    """Return the shifts that match best about a field, place by place, and what each counts.

    Parameters
    ----------
    sides : Sides
        Both sides, at every sample.
    slip : SlipField
        The field.
    inside : ndarray of shape (row, sample), bool
        Places on the surface.
    thin : int
        Places of the sides for one of the field.
    leeway : float
        Distance from the field, in samples, that counts as half a misfit ratio.
    settings : SlipSettings
        Windows.

    Returns
    -------
    shift, weight : ndarray of shape (row, sample), float32
        Samples; weight 0 where nothing matches.
    """
    known = inside & sides.in_view(slip.throw, thin, slip.share)
    cost = costs_about(sides, slip.throw, slip.share, thin, settings)
    return _pull(cost, known, np.zeros_like(slip.throw), leeway, 0.0)


def costs_about(
    sides: Sides, field: Float32Array, share: float, thin: int, settings: SlipSettings, *, reach: int = _REACH
) -> Float32Array:
    """Return the misfit ratios of throws up to `reach` samples about a field, in windows that follow it.

    Parameters
    ----------
    sides : Sides
        Both sides, at every sample.
    field : ndarray of shape (row, sample), float32
        Throw at every `thin`-th place.
    share : float
        Slip along the rows over throw.
    thin : int
        Places of the sides for one of the field.
    settings : SlipSettings
        Windows.
    reach : int
        Samples to either side.

    Returns
    -------
    ndarray of shape (row, sample, throw), float32
        That of the field in the middle; infinite without a counterpart.
    """
    n_shifts, mean = 2 * reach + 1, sides.mean_energy()
    ratio, out = np.empty((n_shifts, *field.shape), np.float32), np.empty((*field.shape, n_shifts), np.float32)
    compare_about(
        sides.hanging, sides.foot, sides.in_hanging, sides.in_foot, field, np.float32(share), thin,
        np.float32(4.0 * mean), gaussian_taps(settings.along_strike / thin), gaussian_taps(settings.down / thin),
        np.float32(0.6 * mean), np.float32(np.inf), ratio, out,
    )  # fmt: skip
    return out


def smooth_field(values: Float32Array, weights: Float32Array, *, stiffness: float) -> Float32Array:
    """Fit a thin plate to weighted values on a grid; it goes on straight where there are none.

    Parameters
    ----------
    values, weights : ndarray of two axes, float32
        Values, and what each counts.
    stiffness : float
        What its squared bending counts against them.

    Returns
    -------
    ndarray of the same shape, float32
        0 where nothing counts.
    """
    total = float(weights.sum())
    if total <= 0.0:
        return np.zeros(values.shape, np.float32)
    mean = float((values * weights).sum()) / total
    n_rows, n_columns = ((n - 1) // _COARSE + 2 if n > 1 else 1 for n in values.shape)
    size = n_rows * n_columns
    bands, right = np.zeros((min(2 * n_columns, size - 1) + 1, size)), np.zeros(size)
    add_places(values.astype(np.float64) - mean, weights.astype(np.float64), _COARSE, n_columns, bands, right)
    add_bending(n_columns, stiffness, bands)
    bands[-1] += _RIDGE
    solve_bands(bands, right)
    nodes = right.reshape(n_rows, n_columns)
    rows, columns = (np.arange(n) / _COARSE for n in values.shape)
    return np.asarray(enlarge_grid(nodes, rows, columns) + mean, np.float32)


def _refine(
    sides: Sides,
    field: Float32Array,
    share: float,
    inside: BoolArray,
    thin: int,
    rounds: tuple[tuple[tuple[float, float], ...], ...],
    settings: SlipSettings,
) -> SlipField:
    """Refine a field of throw, its slip along the rows a given share of it."""
    longest = float(max(1, sides.hanging.shape[1] - 1))
    cost = np.empty((*field.shape, 1), np.float32)
    change = np.zeros_like(field)
    for steps in rounds:
        cost = costs_about(sides, field, share, thin, settings)
        change = _fit_change(cost, inside & sides.in_view(field, thin, share), steps)
        field = np.clip(field + change, -longest, longest).astype(np.float32)
    at = np.rint(change).astype(np.int64) + _REACH
    misfit = np.take_along_axis(cost, at[..., None], axis=2)[..., 0]
    misfit[~sides.in_view(field, thin, share)] = np.inf
    return SlipField(field, misfit, share)


def _fit_change(cost: Float32Array, known: BoolArray, steps: tuple[tuple[float, float], ...]) -> Float32Array:
    """Return the stiff field of shifts that cost little."""
    field = np.zeros(cost.shape[:2], np.float32)
    for leeway, stiffness in steps:
        shift, weight = _pull(cost, known, field, leeway, 0.02)
        weight[np.abs(shift - field) > 2.5 * leeway] = 0.0
        field = smooth_field(shift, weight, stiffness=stiffness)
    return np.clip(field, -_REACH, _REACH)


def _pull(
    cost: Float32Array, known: BoolArray, field: Float32Array, leeway: float, least: float
) -> tuple[Float32Array, Float32Array]:
    """Return the best shifts near a field, and weights by their match and sharpness, the latter `least` or more."""
    shift, misfit, rise = (np.empty(cost.shape[:2], np.float32) for _ in range(3))
    pull_shifts(cost, known, field, np.float32(0.5 / leeway**2), shift, misfit, rise)
    weight = np.clip(1.0 - misfit / _mismatch(misfit[known]), 0.0, 1.0) ** 2 * np.clip(rise / 0.3, least, 1.0)
    return shift, np.where(known, weight, 0.0).astype(np.float32)


def _mismatch(misfits: Float32Array) -> float:
    """Return the misfit ratio beyond which sides do not match that match as well as these at their best.

    Without noise places that belong together leave next to nothing, and what leaves a third does so by chance; in
    strong noise the right ones leave as much.
    """
    found = misfits[np.isfinite(misfits)]
    if not found.size:
        return MISMATCH
    return min(_CHANCE + _NOISE * float(np.percentile(found, 25.0)), MISMATCH)
