"""Neighbouring slices registered coarse to fine, and how each trace's own side of a break carries on across it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from seismo3d._settings import Amount, Positive, Share, Steps, Width
from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.seismic._kernels_filters import (
    Traces,
    all_traces,
    filter_traces,
    gaussian_taps,
    grow_traces,
    shift_traces,
    spread_traces,
)
from seismo3d.seismic._kernels_registration import one_sided_means, pick_cheapest, search_costs
from seismo3d.seismic.misfit import trace_energies
from seismo3d.seismic.shifts import (
    ShiftField,
    ShiftSettings,
    judge_misfits,
    match_lengths,
    matching_floor,
    usual_misfit,
)

SLAB = 64
"""Inlines whose costs of all shifts are held at a time."""
_FLOOR = np.float32(1e-3)


@dataclass(frozen=True, slots=True)
class RegistrationSettings:
    """How neighbouring slices are registered; lengths in samples and traces.

    Attributes
    ----------
    farthest : int in [1, 100]
        Largest shift from a trace to the next that is looked for, either way.
    coarse : float in (0, 1000]
        Lateral width of the window of the search in whole samples.
    shifts : ShiftSettings
        Windows of the least-squares fit that refines it.
    wide, jump : float in (0, 1000], (0, inf)
        Width of the surroundings that a shift is compared with, and the jump against them, in samples, at which it
        counts half.
    across : float in (0, 1000]
        Width, beside the direction that they are carried along, over which shifts are averaged.
    down : float in (0, 1000]
        The same along the samples.
    memory : float in (0, 1000]
        Traces over which the mean of one side forgets; four times as many count at all.
    share : tuple of (float, float, float) in [0, 1]
        Share of registration where it is used beside semblance: without noise, in the mild noise of a good survey,
        whose slopes are averages over more traces than a shift is, and in noise.
    share_noises : tuple of (float, float, float) in [0, inf), rising
        Median misfit ratios of a cube at which these hold; between them the share is interpolated.
    """

    farthest: Steps = 4
    coarse: Width = 2.0
    # a mean over a few traces: scatter alone counts
    shifts: ShiftSettings = field(default_factory=lambda: ShiftSettings(noisy=np.inf))
    wide: Width = 4.0
    jump: Positive = 0.15
    across: Width = 3.0
    down: Width = 4.0
    memory: Width = 5.0
    share: tuple[Share, Share, Share] = (0.75, 0.0, 1.0)
    share_noises: Annotated[tuple[Amount, Amount, Amount], "rising"] = (0.0, 0.057, 0.115)


@dataclass(frozen=True, slots=True, eq=False)
class SideShifts:
    """Shifts a trace along one axis, each side of every trace by itself.

    Attributes
    ----------
    behind, ahead : ndarray of shape (inline, crossline, ceil(sample / step)), float32
        Robust mean of the shifts between the traces up to this one, and between those from it on, in samples a trace.
    step : int
        Samples from one entry to the next.
    """

    behind: Float32Array
    ahead: Float32Array
    step: int


def register_slices(
    volume: Float32Array, valid: BoolArray, *, settings: RegistrationSettings | None = None
) -> list[ShiftField]:
    """Register every inline and crossline with the next: whole-sample search, then a least-squares fit between samples.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, and where there are any.
    settings : RegistrationSettings, optional
        Windows.

    Returns
    -------
    list of ShiftField
        To the next inline and to the next crossline, with variances and what the registration leaves.
    """
    settings = settings or RegistrationSettings()
    floor = slice_floor(trace_energies(volume, valid), volume.shape[2], settings)
    found = match_slices(volume, valid, floor=floor, settings=settings)
    return [judge_misfits(one, usual_misfit(one), settings.shifts) for one in found]


def match_slices(
    volume: Float32Array,
    valid: BoolArray,
    *,
    floor: np.float32,
    settings: RegistrationSettings,
    within: Traces | None = None,
) -> list[ShiftField]:
    """Register as :func:`register_slices` does; misfits are ratios to the energy, and not yet judged.

    Given traces within the volume, only theirs are returned.
    """
    asked = within or all_traces(volume)
    around = grow_traces(asked, (fit_reach(settings),) * 2, volume.shape)
    coarse = (_search(volume, valid, 0, settings, around), _search(volume, valid, 1, settings, around))
    volume, valid = np.ascontiguousarray(volume[around]), np.ascontiguousarray(valid[around])
    no_cuts = np.zeros((1, 1, 1), np.uint8)
    found = match_lengths(volume, valid, coarse, cuts=no_cuts, lengths=(1,), floor=floor, settings=settings.shifts)
    inner = shift_traces(asked, around)
    return [ShiftField(f.axis, 1, f.shift[inner], f.variance[inner], f.misfit[inner]) for f in found]


def slice_floor(energies: Float64Array, n_samples: int, settings: RegistrationSettings) -> np.float32:
    """Return the squared derivative below which nothing is to be matched, from the energies of a cube's traces."""
    return matching_floor(float(energies.sum()) / (energies.size * n_samples), settings.shifts)


def match_reach(settings: RegistrationSettings) -> int:
    """Return how many traces off the shifts of :func:`match_slices` depend on."""
    return fit_reach(settings) + len(gaussian_taps(settings.coarse)) // 2 + 1


def fit_reach(settings: RegistrationSettings) -> int:
    """Return how many traces off the fit depends on, besides those that the search does."""
    return settings.shifts.passes * (len(gaussian_taps(settings.shifts.lateral)) // 2) + 1


def carry_reach(settings: RegistrationSettings) -> int:
    """Return how many traces off the sides of :func:`carry_sides` depend on."""
    return len(gaussian_taps(settings.wide)) // 2 + max(_averaged_reach(0, settings))


def _averaged_reach(axis: int, settings: RegistrationSettings) -> tuple[int, int]:
    """Return how many inlines and crosslines off the shifts lie that the sides along an axis are averaged of."""
    along, beside = len(_shares(settings)), len(gaussian_taps(settings.across)) // 2
    return (along, beside) if axis == 0 else (beside, along)


def carry_sides(
    found: ShiftField, *, settings: RegistrationSettings | None = None, within: Traces | None = None
) -> SideShifts:
    """Average the shifts of either side of every trace, those left out that do not agree with their surroundings.

    A fault parts one pair of traces at each sample: that pair alone shows what moved, and the pairs on either side of
    it show how the layers there slope. A mean over both would take the one for the other. So every shift weighs by its
    variance, less where it jumps against its surroundings, and each side has a mean of its own.

    Parameters
    ----------
    found : ShiftField
        Shifts to the next trace.
    settings : RegistrationSettings, optional
        Windows.
    within : tuple of slice, optional
        Inlines and crosslines whose sides are wanted; all without them.

    Returns
    -------
    SideShifts
    """
    settings, asked = settings or RegistrationSettings(), within or all_traces(found.shift)
    around = grow_traces(asked, _averaged_reach(found.axis, settings), found.shift.shape)
    weight = np.where(found.misfit > 0.0, np.float32(4e-4) / found.variance, np.float32(0.0))
    wide = gaussian_taps(settings.wide)
    spread = spread_traces(weight, wide, wide, within=around)
    smooth = spread_traces(weight * found.shift, wide, wide, within=around)
    smooth /= np.maximum(spread, np.float32(1e-9))
    weight, shift = weight[around], found.shift[around]
    weight = weight / (1.0 + ((shift - smooth) / np.float32(settings.jump)) ** 2)
    one, across = gaussian_taps(0.0), gaussian_taps(settings.across)
    down = gaussian_taps(settings.down / settings.shifts.step)
    inner = shift_traces(asked, around)
    # along the axis traces around are counted too
    counted = (slice(0, len(weight)), inner[1]) if found.axis == 0 else (inner[0], slice(0, weight.shape[1]))
    taps = (one, across) if found.axis == 0 else (across, one)
    sums = [
        np.ascontiguousarray(filter_traces(values, *taps, down, within=counted).swapaxes(0, found.axis))
        for values in (weight * shift, weight)
    ]
    behind, ahead = np.empty_like(sums[0]), np.empty_like(sums[0])
    one_sided_means(sums[0], sums[1], _shares(settings), behind, ahead)
    kept = inner[found.axis]
    behind, ahead = (np.ascontiguousarray(side[kept].swapaxes(0, found.axis)) for side in (behind, ahead))
    return SideShifts(behind, ahead, settings.shifts.step)


def _shares(settings: RegistrationSettings) -> Float32Array:
    """Return how much the shifts of a side count, the nearest first."""
    return np.asarray((1.0 - 1.0 / settings.memory) ** np.arange(round(4.0 * settings.memory)), np.float32)


def _search(
    volume: Float32Array, valid: BoolArray, axis: int, settings: RegistrationSettings, within: Traces
) -> Float32Array:
    """Return the shift to the next trace that costs least over a wide window; slab by slab, as the costs are many."""
    step, lateral = settings.shifts.step, gaussian_taps(settings.coarse)
    n0, n1, n2 = volume.shape
    inlines, crosslines = within
    shift = np.empty((inlines.stop - inlines.start, crosslines.stop - crosslines.start, -(-n2 // step)), np.float32)
    taps, halo = gaussian_taps(settings.shifts.vertical), len(lateral) // 2
    for first in range(inlines.start, inlines.stop, SLAB):
        last = min(first + SLAB, inlines.stop)
        # the slab's last line has none next to it: it serves none but the one before
        wide = slice(max(first - halo, 0), min(last + halo + 1, n0))
        costs = np.empty((2 * settings.farthest + 1, wide.stop - wide.start, n1, shift.shape[2]), np.float32)
        search_costs(volume[wide], valid[wide], axis, settings.farthest, step, taps, _FLOOR, costs)
        slab = (slice(first - wide.start, last - wide.start), crosslines)
        smoothed = np.stack([spread_traces(cost, lateral, lateral, within=slab) for cost in costs])
        pick_cheapest(smoothed, shift[first - inlines.start : last - inlines.start])
    return shift
