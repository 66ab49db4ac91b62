"""Fault evidence: what is left unexplained after both sides of a voxel are aligned along their own dip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_filters import (
    Traces,
    all_traces,
    filter_samples,
    gaussian_taps,
    grow_traces,
    shift_traces,
    smooth,
    spread_traces,
)
from seismo3d.seismic._kernels_misfit import clear_unknown, divide_known, log_ratio, side_misfit

Compare = Callable[[int, int, tuple[int, int], Float32Array, Float32Array], None]

NOISES = (0.0, 0.057, 0.145)
"""Median misfit ratios of a cube without noise, of a good survey, and of one with nearly as much noise as signal."""

# median misfit ratio of mild noise
_MILD = 0.036
# widths along the trace, and what noise leaves in the median ratio over them, as a share of that over the second
_WIDTHS, _LEFT = (0.7, 1.5, 2.0), (0.81, 1.0, 1.06)
# samples over which the energy of a depth is averaged, about, and share of that of all depths which it is at least
_DEPTH, _LEAST_ENERGY = 256, 0.01
# pieces of such a depth; what is bright here and there must not hide the rest: in a piece a trace's energy counts up to
# so many times the median of all traces, and that of a piece up to so many times the median of the pieces
_PIECES, _BRIGHT_TRACE, _BRIGHT_PIECE = 4, 8.0, 4.0

# share of a second way that is not worth measuring it
_LEAST_SHARE = 0.05
# mean and spread of the evidence of a cube with a few faults: without noise, and in the mild noise of a good survey
_LEAST_MEAN = (0.47, 0.6)
_LEAST_SPREAD = (0.65, 0.9)
_LEAST_LINE = 32


@dataclass(frozen=True, slots=True)
class MisfitSettings:
    """How the misfit is measured; lengths in samples and traces.

    Attributes
    ----------
    reach : tuple of (int, int)
        Traces averaged on each side, in a cube without noise and in a cube of noise.
    vertical : tuple of (float, float)
        Width of the Gaussian that smooths the misfit along the trace, in a cube without noise and in a cube of noise.
        What it spreads along the trace lies off a gently dipping fault, by as many traces as samples and more.
    lateral : float
        Width of the Gaussian that smooths the evidence over neighbouring traces.
    footprint : float
        Most that is taken out of the evidence for acquisition footprint; less in a cube with next to no noise.
    background : tuple of (float, float)
        Lateral and vertical width of the window of the local background.
    levelling : float
        Share of the local background that is taken out: 0 none, 1 all.
    energy : tuple of (float, float)
        Lateral and vertical width of the window whose energy normalises the misfit.
    floor : float
        What is added to that energy, as a share of the mean at the depth: between strong reflectors the noise alone
        differs from side to side, and in proportion to itself it differs much.
    step : int
        Every how many samples the evidence is kept.
    softness : float
        Misfit ratio below which differences count no more.
    most : float
        Largest misfit ratio; two unrelated sides give 1 on average.
    slab : int
        Inlines that are worked on at a time; bounds the memory.
    """

    reach: tuple[int, int] = (2, 10)
    vertical: tuple[float, float] = (0.7, 2.0)
    lateral: float = 1.25
    footprint: float = 0.5
    background: tuple[float, float] = (7.0, 9.0)
    levelling: float = 1.0
    energy: tuple[float, float] = (2.0, 4.0)
    floor: float = 0.25
    step: int = 2
    softness: float = 0.02
    most: float = 1.5
    slab: int = 64


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Misfit across every voxel, along inlines and along crosslines, thinned along the sample axis.

    Attributes
    ----------
    along_inlines, along_crosslines : ndarray of shape (inline, crossline, ceil(sample / step)), float32
        log(1 + misfit ratio / softness); bridged where little is unknown, the mean of its axis where nothing near is
        known.
    known : ndarray of the same shape, float32
        0 where the misfit could not be measured, up to 1.
    noise : float
        The cube's own median misfit ratio, as it would be over the usual width along the trace: 0 without noise, about
        a quarter in noise alone.
    noisiness : float
        0 for a cube without noise to 1 for one whose noise is as strong as its signal; it sets window sizes.
    mean, spread : float
        Mean and standard deviation of the evidence where it is known, not below those of a cube with a few faults.
    step : int
        Samples from one plane of the evidence to the next.
    present : ndarray of the same shape, bool, or None
        False where nothing near is known, as in mutes and wide gaps; None where it is nowhere so.
    """

    along_inlines: Float32Array
    along_crosslines: Float32Array
    known: Float32Array
    noise: float
    noisiness: float
    mean: float
    spread: float
    step: int
    present: BoolArray | None = None


def measure_misfit(
    volume: Float32Array, valid: BoolArray, p: Float32Array, q: Float32Array, *, settings: MisfitSettings | None = None
) -> Evidence:
    r"""Measure how badly the two sides of every voxel fit after each is carried along its own reflectors.

    With L and R the means of a few traces on either side, the ratio :math:`\langle (L - R)^2 \rangle / \langle L^2 +
    R^2 \rangle` is near 0 on an unbroken reflector and 1 on average where the sides are unrelated: a semblance of
    two. To its denominator a share of the mean at the depth is added, so that it is less between strong reflectors. Its
    logarithm, softened by the cube's own noise, is the evidence: the mean logarithm over a patch cannot be raised by a
    few bright voxels. How many traces are averaged follows from the cube's noise, which is measured first.

    Parameters
    ----------
    volume : ndarray of shape (inline, crossline, sample), float32
        Amplitudes, finite everywhere.
    valid : ndarray of the same shape, bool
        False where there are no data.
    p, q : ndarray of the same shape, float32
        Slopes from :func:`~seismo3d.seismic.dip.estimate_slopes`.
    settings : MisfitSettings, optional
        Windows.

    Returns
    -------
    Evidence
    """
    return fuse_misfits(volume, valid, [compare_along(volume, valid, (p, q))], settings=settings)


def compare_along(volume: Float32Array, valid: BoolArray, slopes: tuple[Float32Array, Float32Array]) -> Compare:
    """Return what compares the two sides of every voxel after each is carried along its own reflectors.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, and where there are any.
    slopes : tuple of ndarray of the same shape, float32
        Reflector slopes along inlines and crosslines.

    Returns
    -------
    callable
        Takes the axis, the number of traces a side, the inline and crossline to begin at, and arrays for
        :math:`(L - R)^2` and :math:`L^2 + R^2`, -1 where a side is empty, of as many traces as are asked for.
    """

    def compare(axis: int, reach: int, corner: tuple[int, int], difference: Float32Array, energy: Float32Array) -> None:
        side_misfit(volume, valid, slopes[axis], axis, reach, corner, difference, energy)

    return compare


def fuse_misfits(
    volume: Float32Array,
    valid: BoolArray,
    comparisons: list[Compare],
    *,
    share: tuple[float, float, float] = (0.5, 0.5, 0.5),
    share_noises: tuple[float, float, float] = NOISES,
    farther: float = 0.0,
    settings: MisfitSettings | None = None,
) -> Evidence:
    """Measure the misfit of both sides under one or two ways of carrying them, and take the mean of their logarithms.

    Each way has the softness of its own noise, so that its evidence is a log ratio to what it leaves
    where nothing breaks, and the two add up.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes, float32, finite everywhere, and where there are any.
    comparisons : list of callable
        One or two, as :func:`compare_along` returns them.
    share : tuple of (float, float, float)
        Share of the second at each of `share_noises`, between which it is interpolated; a way with hardly any share is
        not called.
    share_noises : tuple of (float, float, float)
        Median misfit ratios of a cube.
    farther : float
        Share of the first way that is measured over one trace more a side: sharp are the nearest traces, steady more.
    settings : MisfitSettings, optional
        Windows.

    Returns
    -------
    Evidence
    """
    settings = settings or MisfitSettings()
    floor = energy_floor(depth_energies(volume, valid), volume.shape[2], settings)
    least = settings.reach[0]
    near = _ratios(volume.shape, comparisons[0], least, floor, settings)
    usual = find_noise(_median_ratio(*near), least, settings)
    noisiness, reach = judge_noise(usual, settings)
    counted = [1.0] if len(comparisons) == 1 else share_out(usual, share, share_noises)
    ways = [(compare, reach, weight) for compare, weight in zip(comparisons, counted, strict=True)]
    ways[:1] = [(ways[0][0], reach + more, ways[0][2] * part) for more, part in ((0, 1.0 - farther), (1, farther))]
    parts = (
        _log_ratios(
            *(near if number == 0 and reach == least else _ratios(volume.shape, compare, n_traces, floor, settings)),
            n_traces,
            weight,
            settings,
        )
        for number, (compare, n_traces, weight) in enumerate(ways)
        if weight > 0.0
    )
    logs, known, noise = reduce(_add_logs, parts)
    del near
    moments = [trace_moments(ratio, weight) for ratio, weight in zip(logs, known, strict=True)]
    mean, spread = find_moments(moments, noise, noisiness)
    filled = [bridge_unknown(ratio, weight) for ratio, weight in zip(logs, known, strict=True)]
    present = np.isfinite(filled[0]) | np.isfinite(filled[1])
    for axis, values in enumerate(filled):
        excess = find_footprint(trace_medians(values), axis, noise, settings)
        fill_absent(values, mean_known(moments[axis]))
        take_out_lines(values, excess, axis)
        filled[axis], sums = level(spread_laterally(values, settings.lateral), settings)
        filled[axis] += level_mean(sums, values.shape, settings)
    return Evidence(
        filled[0], filled[1], np.maximum(*known), noise, noisiness, mean, spread, settings.step,
        None if present.all() else present,
    )  # fmt: skip


def share_out(noise: float, share: tuple[float, float, float], noises: tuple[float, float, float]) -> list[float]:
    """Return the shares of two ways of carrying the sides, given the second's at three `noises`."""
    second = float(np.interp(noise, noises, share))
    second = 0.0 if second < _LEAST_SHARE else 1.0 if second > 1.0 - _LEAST_SHARE else second
    return [1.0 - second, second]


def _log_ratios(
    ratios: list[Float32Array], known: list[Float32Array], reach: int, weight: float, settings: MisfitSettings
) -> tuple[list[Float32Array], list[Float32Array], float]:
    """Weigh ratios as :func:`weigh_logs` does; return also the noise."""
    noise = find_noise(_median_ratio(ratios, known), reach, settings)
    weigh_logs(ratios, known, noise, weight, settings)
    return ratios, known, noise


def weigh_logs(
    ratios: list[Float32Array], known: list[Float32Array], noise: float, weight: float, settings: MisfitSettings
) -> None:
    """Take the logarithms of ratios, given their median, and weigh them and how far they are known, in place."""
    for ratio in ratios:
        log_ratio(ratio, find_softness(noise, settings))
    if weight != 1.0:
        for values in ratios + known:
            values *= np.float32(weight)


def _add_logs(
    first: tuple[list[Float32Array], list[Float32Array], float],
    second: tuple[list[Float32Array], list[Float32Array], float],
) -> tuple[list[Float32Array], list[Float32Array], float]:
    """Add what :func:`_log_ratios` returned of the second way to that of the first, in place."""
    for values, added in zip(first[0] + first[1], second[0] + second[1], strict=True):
        values += added
    return first[0], first[1], min(first[2], second[2])


def judge_noise(noise: float, settings: MisfitSettings) -> tuple[float, int]:
    """Return how noisy a cube is, 0 to 1, by its median misfit ratio, and how many traces to average for that."""
    least, most = settings.reach
    noisiness = float(np.clip((noise - 0.01) / 0.28, 0.0, 1.0))
    return noisiness, round(least + noisiness * (most - least))


def find_noise(median: float, reach: int, settings: MisfitSettings) -> float:
    """Return what a median ratio would be over the usual width along the trace: noise leaves less over a narrow one."""
    return median / float(np.interp(width_along_trace(reach, settings), _WIDTHS, _LEFT))


def width_along_trace(reach: int, settings: MisfitSettings) -> float:
    """Return the width of the window along the trace, given how many traces a side the cube's noise asks for."""
    least, most = settings.reach
    return float(np.interp(reach, settings.reach, settings.vertical)) if least < most else settings.vertical[0]


def find_softness(noise: float, settings: MisfitSettings) -> np.float32:
    """Return the misfit ratio below which differences count no more, given the cube's median one."""
    return np.float32(max(settings.softness, 0.8 * noise))


def share_of_noise(noise: float) -> float:
    """Return how much of what differs between lines is taken for noise, given the cube's median misfit ratio.

    All of it from mild noise on; in a cube with next to none it is the faults'.
    """
    return min(1.0, noise / _MILD)


def find_footprint(medians: Float32Array, axis: int, noise: float, settings: MisfitSettings) -> Float32Array | None:
    """Find what an acquisition footprint adds: evidence that a whole line has more of than its neighbours.

    The median over a line and all its samples does not see a fault, which crosses the line somewhere or leaves it with
    depth, and at most `footprint` is taken out, a fraction of what a fault shows. `medians` are those of the traces;
    None where lines are too short to tell. A line without evidence is taken to be as those beside it.
    """
    most = settings.footprint * share_of_noise(noise)
    if medians.shape[1 - axis] < _LEAST_LINE:
        return None
    lines = np.moveaxis(medians, axis, 0)
    some = np.any(np.isfinite(lines), axis=1)
    if not some.any():
        return None
    told = np.nanmedian(lines[some], axis=1)
    median = np.interp(np.arange(len(lines)), np.flatnonzero(some), told).astype(medians.dtype)
    excess = np.clip(median - ndimage.gaussian_filter1d(median, 8.0), -most, most)
    return np.asarray(excess, np.float32)


def take_out_lines(evidence: Float32Array, excess: Float32Array | None, axis: int) -> None:
    """Subtract each line's excess, in place."""
    if excess is not None:
        evidence -= excess.reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))


def spread_laterally(evidence: Float32Array, sigma: float, *, within: Traces | None = None) -> Float32Array:
    """Smooth over neighbouring traces: a wavelet ties samples of a trace together, and nothing else ties traces."""
    taps = gaussian_taps(sigma)
    return spread_traces(evidence, taps, taps, within=within)


def level(
    evidence: Float32Array, settings: MisfitSettings, *, within: Traces | None = None
) -> tuple[Float32Array, Float64Array]:
    """Take out part of the wide local mean: chaotic and noisy zones have more evidence everywhere.

    Returns also the sums over every trace of what was the local mean, for :func:`level_mean` to put its own mean back.
    """
    lateral, vertical = settings.background
    mean = smooth(evidence, (lateral, lateral, vertical / settings.step), within=within)
    sums = np.stack([line.astype(np.float64).sum(axis=1) for line in mean])
    mean *= np.float32(settings.levelling)
    np.subtract(evidence[within or all_traces(evidence)], mean, out=mean)
    return mean, sums


def level_reach(settings: MisfitSettings) -> int:
    """Return over how many traces to either side :func:`level` averages."""
    return len(gaussian_taps(settings.background[0])) // 2


def level_mean(sums: Float64Array, shape: tuple[int, ...], settings: MisfitSettings) -> np.float32:
    """Return what levelling has to give back, so that the evidence's mean stays: from the sums of all traces."""
    return np.float32(settings.levelling * sums.sum() / np.prod(shape, dtype=np.float64))


def trace_moments(ratio: Float32Array, weight: Float32Array) -> Float64Array:
    """Return count, sum and sum of squares of every trace's evidence where it is known: shape (3, inline, crossline).

    Added up in the order of the traces they give the same however a cube is cut.
    """
    sums = np.empty((3, *ratio.shape[:2]))
    for line, (values, known) in enumerate(zip(ratio, weight > 0.5, strict=True)):
        counted = np.where(known, values, np.float32(0.0)).astype(np.float64)
        sums[:, line] = known.sum(axis=1), counted.sum(axis=1), (counted**2).sum(axis=1)
    return sums


def mean_known(sums: Float64Array) -> float:
    """Return the mean of one way's evidence where it is known, from its traces' sums; 0 where it is nowhere."""
    return float(sums[1].sum() / max(sums[0].sum(), 1.0))


def find_moments(sums: list[Float64Array], noise: float, noisiness: float) -> tuple[float, float]:
    """Mean and standard deviation of a cube's evidence where it is known, from its traces' sums and its noise."""
    count, total, square = (float(sum(part[k].sum() for part in sums)) for k in range(3))
    mean = total / max(count, 1.0)
    spread = max(float(np.sqrt(max(square / max(count, 1.0) - mean**2, 0.0))), 1e-6)
    # where there is next to no evidence, its own scatter must not be taken for faults
    least_mean, least_spread = (
        np.interp(share_of_noise(noise), (0.0, 1.0), ends) for ends in (_LEAST_MEAN, _LEAST_SPREAD)
    )
    return max(mean, float(least_mean)), max(spread, float(least_spread) * (1.0 - noisiness))


def _median_ratio(ratios: list[Float32Array], known: list[Float32Array]) -> float:
    parts = [ratio[weight > 0.5] for ratio, weight in zip(ratios, known, strict=True)]
    values = np.concatenate(parts)
    return float(np.median(values, overwrite_input=True)) if values.size else 0.0


def _ratios(
    shape: tuple[int, ...], compare: Compare, reach: int, floor: Float32Array, settings: MisfitSettings
) -> tuple[list[Float32Array], list[Float32Array]]:
    return measure_ratios(shape, compare, reach, floor, settings, (slice(0, shape[0]), slice(0, shape[1])))


def misfit_reach(reach: int, settings: MisfitSettings) -> int:
    """Return how many traces off the misfit depends on, besides the slopes there."""
    return reach + energy_reach(settings)


def energy_reach(settings: MisfitSettings) -> int:
    """Return over how many traces to either side the energy is averaged."""
    return len(gaussian_taps(settings.energy[0])) // 2


def measure_ratios(
    shape: tuple[int, ...],
    compare: Compare,
    reach: int,
    floor: Float32Array,
    settings: MisfitSettings,
    within: Traces,
) -> tuple[list[Float32Array], list[Float32Array]]:
    """Return the misfit ratios of traces within a volume of some shape, both ways, and how far they are known.

    Some inlines are worked on at a time: what is held of the others is the result alone.
    """
    inlines, crosslines = within
    thinned = (inlines.stop - inlines.start, crosslines.stop - crosslines.start, -(-shape[2] // settings.step))
    ratios = [np.empty(thinned, np.float32) for _ in range(2)]
    known = [np.empty(thinned, np.float32) for _ in range(2)]
    for start in range(inlines.start, inlines.stop, settings.slab):
        slab = slice(start, min(start + settings.slab, inlines.stop))
        out = slice(slab.start - inlines.start, slab.stop - inlines.start)
        _measure_slab(
            shape, compare, reach, floor, settings, (slab, crosslines),
            [values[out] for values in ratios], [values[out] for values in known],
        )  # fmt: skip
    return ratios, known


def _measure_slab(
    shape: tuple[int, ...], compare: Compare, reach: int, floor: Float32Array, settings: MisfitSettings,
    within: Traces, ratios: list[Float32Array], known: list[Float32Array],
) -> None:  # fmt: skip
    """Write the misfit ratios of traces, both ways, and how far they are known."""
    taps = gaussian_taps(width_along_trace(reach, settings))
    around = grow_traces(within, (energy_reach(settings),) * 2, shape)
    inner, corner = shift_traces(within, around), (around[0].start, around[1].start)
    size = (around[0].stop - corner[0], around[1].stop - corner[1], shape[2])
    total, weights = np.zeros(size, np.float32), np.zeros(size, np.float32)
    parts = []
    difference, energy, weight = (np.empty(size, np.float32) for _ in range(3))
    for axis in range(2):
        compare(axis, reach, corner, difference, energy)
        clear_unknown(energy, weight)
        total += energy
        weights += weight
        smoothed = (difference[inner].copy(), weight[inner].copy())
        for values in smoothed:
            filter_samples(values, taps, values)
        parts.append([np.ascontiguousarray(values[:, :, :: settings.step]) for values in smoothed])
    del difference, energy, weight, smoothed
    lateral, vertical = settings.energy
    mean = smooth(total, (lateral, lateral, vertical), within=inner)
    mean /= np.maximum(smooth(weights, (lateral, lateral, vertical), within=inner), np.float32(1e-3))
    mean = np.ascontiguousarray(mean[:, :, :: settings.step])
    thinned_floor = floor[:: settings.step]
    for axis, (smoothed_difference, share) in enumerate(parts):
        divide_known(
            smoothed_difference, mean, share, thinned_floor, np.float32(settings.most), ratios[axis], known[axis]
        )


def trace_energies(volume: Float32Array, valid: BoolArray) -> Float64Array:
    """Return the sum of squares of every trace where there are data."""
    return np.stack(
        [
            np.where(known, np.square(line, dtype=np.float64), 0.0).sum(axis=1)
            for line, known in zip(volume, valid, strict=True)
        ]
    )


def depth_energies(volume: Float32Array, valid: BoolArray) -> Float64Array:
    """Return every trace's sums of squares over pieces of some depths, and how many samples they are of.

    The shape is (2, piece, inline, crossline).
    """
    edges = _piece_edges(volume.shape[2])[:-1]
    out = np.empty((2, len(edges), *volume.shape[:2]))
    for i, (line, known) in enumerate(zip(volume, valid, strict=True)):
        squares = np.where(known, np.square(line, dtype=np.float64), 0.0)
        out[0, :, i] = np.add.reduceat(squares, edges, axis=1).T
        out[1, :, i] = np.add.reduceat(known.astype(np.float64), edges, axis=1).T
    return out


def energy_floor(energies: Float64Array, n_samples: int, settings: MisfitSettings) -> Float32Array:
    """Return what is added to the energy that misfits are divided by, at every sample, from :func:`depth_energies`."""
    pieces = np.array([_usual_energy(*piece) for piece in energies.swapaxes(0, 1)])
    sums, counts = pieces.reshape(-1, min(_PIECES, len(pieces)), 2).transpose(2, 0, 1)
    some = counts > 0.0
    means = np.where(some, sums / np.maximum(counts, 1.0), np.nan)
    middles = np.array([np.median(part[told]) if told.any() else 0.0 for part, told in zip(means, some, strict=True)])
    sums = np.minimum(sums, _BRIGHT_PIECE * middles[:, None] * counts).sum(axis=1)
    counts = counts.sum(axis=1)
    usual = sums.sum() / max(counts.sum(), 1.0)
    means = np.maximum(np.where(counts > 0.0, sums / np.maximum(counts, 1.0), usual), _LEAST_ENERGY * usual)
    edges = _depth_edges(n_samples)
    floor = np.interp(np.arange(n_samples) + 0.5, 0.5 * (edges[:-1] + edges[1:]), 2.0 * settings.floor * means)
    return np.maximum(floor, 1e-20).astype(np.float32)


def _usual_energy(sums: Float64Array, counts: Float64Array) -> tuple[float, float]:
    """Return the sum over all traces, bright ones no more than they may be, and how many samples it is of."""
    known = counts > 0.0
    if not known.any():
        return 0.0, 0.0
    most = _BRIGHT_TRACE * float(np.median(sums[known] / counts[known]))
    return float(np.minimum(sums, most * counts).sum()), float(counts.sum())


def _depth_edges(n_samples: int) -> IntArray:
    """Return where the depths begin whose energies are told apart, and where the last one ends."""
    return np.linspace(0, n_samples, max(1, round(n_samples / _DEPTH)) + 1).astype(np.int64)


def _piece_edges(n_samples: int) -> IntArray:
    """Return where the pieces of these depths begin, and where the last one ends."""
    edges = _depth_edges(n_samples)
    inner = [np.linspace(a, b, min(_PIECES, n_samples) + 1)[:-1].astype(np.int64) for a, b in pairwise(edges)]
    return np.append(np.concatenate(inner), n_samples)


BRIDGE_WIDTH = 2.0
"""Width of the window over which unknown evidence is bridged, in traces and in steps of the samples."""


def bridge_unknown(evidence: Float32Array, weight: Float32Array, *, within: Traces | None = None) -> Float32Array:
    """Bridge what is not known by its neighbours' evidence; NaN where they are far."""
    unknown, inner = weight < 0.5, within or all_traces(evidence)
    if not unknown.any():
        return evidence[inner]
    near = np.where(unknown, np.float32(0.0), np.float32(1.0))
    sigma = (BRIDGE_WIDTH, BRIDGE_WIDTH, BRIDGE_WIDTH)
    share = smooth(near, sigma, within=inner)
    near *= evidence
    bridged = smooth(near, sigma, within=inner)
    del near
    far = share <= np.float32(0.1)
    bridged /= np.maximum(share, np.float32(0.1), out=share)
    bridged[far] = np.nan
    np.copyto(bridged, evidence[inner], where=~unknown[inner])
    return bridged


def trace_medians(bridged: Float32Array) -> Float32Array:
    """Return the median of every trace's evidence where there is any; NaN on traces without."""
    medians = np.median(bridged, axis=2)
    some = np.isnan(medians)
    if some.any():
        in_order = np.sort(bridged[some], axis=1)  # NaN last
        n, rows = np.isfinite(in_order).sum(axis=1), np.arange(len(in_order))
        middle = np.float32(0.5) * (in_order[rows, (n - 1) // 2] + in_order[rows, n // 2])
        medians[some] = np.where(n > 0, middle, np.nan)
    return np.asarray(medians, np.float32)


def fill_absent(bridged: Float32Array, mean: float) -> None:
    """Put the mean of all evidence where there is none, in place: means of windows stay about what they were."""
    np.copyto(bridged, np.float32(mean), where=np.isnan(bridged))
