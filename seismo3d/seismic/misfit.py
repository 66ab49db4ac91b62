"""Fault evidence: what is left unexplained after both sides of a voxel are aligned along their own dip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_filters import (
    Traces,
    filter_samples,
    gaussian_taps,
    grow_traces,
    shift_traces,
    smooth,
)
from seismo3d.seismic._kernels_misfit import clear_unknown, divide_known, log_ratio, side_misfit
from seismo3d.seismic.levelling import (
    bridge_unknown,
    fill_absent,
    find_footprint,
    find_moments,
    level,
    level_mean,
    mean_known,
    spread_laterally,
    take_out_lines,
    trace_medians,
    trace_moments,
)
from seismo3d.seismic.misfit_settings import (
    NOISES,
    MisfitSettings,
    energy_reach,
    find_noise,
    find_softness,
    judge_noise,
    width_along_trace,
)

Compare = Callable[[int, int, tuple[int, int], Float32Array, Float32Array], None]
"""A way of carrying the sides of every voxel to it, and of comparing them there: see :func:`compare_along`."""

# samples over which the energy of a depth is averaged, about, and share of that of all depths which it is at least
_DEPTH, _LEAST_ENERGY = 256, 0.01
# pieces of such a depth; what is bright here and there must not hide the rest: in a piece a trace's energy counts up to
# so many times the median of all traces, and that of a piece up to so many times the median of the pieces
_PIECES, _BRIGHT_TRACE, _BRIGHT_PIECE = 4, 8.0, 4.0
# share of a second way that is not worth measuring it
_LEAST_SHARE = 0.05


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
    r"""Measure how badly the two sides of every voxel fit under one or two ways of carrying them to it.

    With L and R the means of a few traces on either side, the ratio :math:`\langle (L - R)^2 \rangle / \langle L^2 +
    R^2 \rangle` is near 0 on an unbroken reflector and 1 on average where the sides are unrelated: a semblance of
    two. To its denominator a share of the mean at the depth is added, so that it is less between strong reflectors. Its
    logarithm, softened by the cube's own noise, is the evidence: the mean logarithm over a patch cannot be raised by a
    few bright voxels. How many traces are averaged follows from the cube's noise, which is measured first.

    Of two ways the mean of the logarithms counts. Each has the softness of its own noise, so that its evidence is a log
    ratio to what it leaves where nothing breaks, and the two add up.

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
    counted = [1.0] if len(comparisons) == 1 else shares_at_noise(usual, share, share_noises)
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


def shares_at_noise(noise: float, share: tuple[float, float, float], noises: tuple[float, float, float]) -> list[float]:
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


def _median_ratio(ratios: list[Float32Array], known: list[Float32Array]) -> float:
    parts = [ratio[weight > 0.5] for ratio, weight in zip(ratios, known, strict=True)]
    values = np.concatenate(parts)
    return float(np.median(values, overwrite_input=True)) if values.size else 0.0


def _ratios(
    shape: tuple[int, ...], compare: Compare, reach: int, floor: Float32Array, settings: MisfitSettings
) -> tuple[list[Float32Array], list[Float32Array]]:
    return measure_ratios(shape, compare, reach, floor, settings, (slice(0, shape[0]), slice(0, shape[1])))


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
