"""Local vertical shifts between traces of a cube, with their variances."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from seismo3d._settings import Amount, Positive, Steps, Width
from seismo3d._typing import AnyArray, BoolArray, Float32Array
from seismo3d.seismic._kernels_filters import filter_crosslines, filter_inlines, gaussian_taps
from seismo3d.seismic._kernels_shifts import compose_shifts, finish_shifts, match_products


@dataclass(frozen=True, slots=True)
class ShiftSettings:
    """How shifts are measured; lengths in samples and traces.

    Attributes
    ----------
    step : int in [1, 15]
        Shifts are kept at every step-th sample.
    vertical, lateral : float in (0, 1000]
        Widths of the Gaussian window over which two traces are matched: along the samples, and over neighbouring pairs.
    passes : int in [1, 100]
        Steps of the least-squares fit.
    floor : float in [0, inf)
        Squared derivative, relative to the cube's mean square, below which nothing is to be matched.
    misfit : float in [0, inf)
        Misfit ratio that, above twice the cube's usual one, makes a shift doubtful: its variance grows from there.
    noisy : float in (0, inf]
        Misfit ratio at which a shift's variance is twice what it scatters by; it grows with the fourth power. Noise
        that goes along from trace to trace, as migration smiles do, draws shifts to its own dip, which no mean evens.
    most : float in (0, inf)
        Variance, in samples squared a trace, of a shift that is carried over from the slopes alone.
    """

    step: Annotated[int, "[1, 15]"] = 4
    vertical: Width = 6.0
    lateral: Width = 1.0
    passes: Steps = 2
    floor: Amount = 1e-4
    misfit: Amount = 0.01
    noisy: Annotated[float, "(0, inf]"] = 0.2
    most: Positive = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class ShiftField:
    """Shifts from every trace to the one `length` further along an axis.

    Attributes
    ----------
    axis, length : int
        0 for inlines, 1 for crosslines; and how many traces apart.
    shift, variance : ndarray of shape (inline, crossline, ceil(sample / step)), float32
        How far a reflector at this sample lies deeper on the other trace, in samples, and its variance.
    misfit : ndarray of the same shape, float32
        What the shift leaves over the energy, relative to what counts as doubtful: 1 or more is doubtful.
    usual : float
        Its median before that, where there is one: how strong the cube's noise is, squared, beside its signal.
    """

    axis: int
    length: int
    shift: Float32Array
    variance: Float32Array
    misfit: Float32Array
    usual: float = 0.0


def measure_shifts(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    *,
    cuts: AnyArray,
    lengths: tuple[int, ...] = (1, 4),
    settings: ShiftSettings | None = None,
) -> list[ShiftField]:
    r"""Measure how far reflectors shift between traces, near ones first, and farther ones predicted by them.

    Each shift minimises :math:`\sum w\, (a(z) - b(z + s))^2` over a Gaussian window of one pair of traces and its
    neighbours (Lucas and Kanade's fit [1]_), from the slopes, or, for longer distances, from the shorter shifts one
    after the other. Pairs that a fault parts are left out; where no pair is left, as at dead traces, the prediction
    stands with a large variance.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, and where there are any.
    slopes : tuple of ndarray
        Reflector slopes along inlines and crosslines at every `step`-th sample, in samples a trace.
    cuts : ndarray of the volume's shape, uint8
        Bit 0 or 1 where a fault passes before the next inline or crossline.
    lengths : tuple of int
        Distances in traces, growing from 1.
    settings : ShiftSettings, optional
        Windows.

    Returns
    -------
    list of ShiftField
        By length, then axis.

    References
    ----------
    .. [1] B. D. Lucas, T. Kanade, Proc. 7th IJCAI, 674-679, 1981.
    """
    settings = settings or ShiftSettings()
    floor = matching_floor(float(np.mean(np.square(volume[::2, ::2]))), settings)
    found = match_lengths(volume, valid, slopes, cuts=cuts, lengths=lengths, floor=floor, settings=settings)
    return [judge_misfits(f, usual_misfit(f), settings) for f in found]


def matching_floor(power: float, settings: ShiftSettings) -> np.float32:
    """Return the squared derivative below which nothing is to be matched, from the cube's mean square."""
    return np.float32(settings.floor * max(power, 1e-20))


def shift_reach(lengths: tuple[int, ...], settings: ShiftSettings) -> int:
    """Return how many traces off the shifts depend on."""
    return 2 * settings.passes * (len(gaussian_taps(settings.lateral)) // 2) + max(lengths) + 1


def match_lengths(
    volume: Float32Array, valid: BoolArray, slopes: tuple[Float32Array, Float32Array], *,
    cuts: AnyArray, lengths: tuple[int, ...], floor: np.float32, settings: ShiftSettings,
) -> list[ShiftField]:  # fmt: skip
    """Measure shifts as :func:`measure_shifts` does; misfits are ratios to the energy, and not yet judged."""
    any_cut = bool(np.any(cuts))
    found: list[ShiftField] = []
    nearest = list(slopes)
    for length in lengths:
        for axis in range(2):
            shift = np.empty_like(nearest[axis])
            compose_shifts(nearest[axis], axis, length, settings.step, shift)
            variance = np.empty_like(shift)
            for _ in range(settings.passes):
                ratio = _refine(
                    volume, valid, cuts, any_cut, nearest[axis], axis, length, floor, settings, shift, variance
                )
            if length == 1:
                nearest[axis] = shift
            found.append(ShiftField(axis, length, shift, variance, ratio))
    return found


def usual_misfit(found: ShiftField) -> float:
    """Return the median misfit ratio where there is one, else 0."""
    known = found.misfit[found.misfit > 0.0]
    return float(np.median(known)) if known.size else 0.0


def judge_misfits(found: ShiftField, usual: float, settings: ShiftSettings) -> ShiftField:
    """Divide misfit ratios, in place, by what is doubtful, and raise the variances of noisy and of doubtful shifts.

    A misfit far above the cube's `usual` one is no match: a fault that was not found, or noise.
    """
    found.variance[...] *= _noise_factor(found.misfit, settings)
    found.misfit[...] /= np.float32(2.0 * usual + settings.misfit)
    found.variance[...] *= 1.0 + found.misfit**4
    return replace(found, usual=usual)


def are_measured(found: ShiftField, settings: ShiftSettings) -> BoolArray:
    """Tell which judged shifts are more than carried over from the slopes, and not doubtful, however noisy they are."""
    noise = _noise_factor(found.misfit * np.float32(2.0 * found.usual + settings.misfit), settings)
    return np.asarray(found.variance < np.float32(settings.most * found.length) * noise)


def _noise_factor(ratio: Float32Array, settings: ShiftSettings) -> Float32Array:
    return np.asarray(1.0 + (ratio / np.float32(settings.noisy)) ** 4, np.float32)


def _refine(
    volume: Float32Array, valid: BoolArray, cuts: AnyArray, any_cut: bool, nearest: Float32Array, axis: int,
    length: int, floor: np.float32, settings: ShiftSettings, shift: Float32Array, variance: Float32Array,
) -> Float32Array:  # fmt: skip
    """One step of the least-squares fit, in place; return what it leaves over the energy, 0 where unknown."""
    products = np.empty((5, *shift.shape), np.float32)
    taps = gaussian_taps(settings.vertical)
    match_products(volume, valid, cuts, any_cut, nearest, axis, length, shift, settings.step, taps, products)
    lateral, buffer = gaussian_taps(settings.lateral), variance
    for product in products:
        filter_crosslines(product, lateral, buffer, 0)
        filter_inlines(buffer, lateral, product, 0)
    # a window holds about as many independent samples as quarter wavelengths of six samples, times traces
    n_free = np.float32(max(1.0, settings.vertical * 3.5 / 6.0 * (1.0 + 3.5 * settings.lateral)))
    most = np.float32(settings.most * length)
    finish_shifts(products, shift, floor, most, n_free, shift, variance)
    return products[0].copy()
