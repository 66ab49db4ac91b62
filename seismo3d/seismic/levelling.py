"""Evidence made even over a cube: gaps bridged, acquisition footprint and the wide local mean taken out.

Each step works on any part of a cube; what it takes from the whole, such as means and medians, it is given as numbers
by trace, so that a cube in blocks comes out as one in a single piece.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.seismic._kernels_filters import Traces, all_traces, gaussian_taps, smooth, spread_traces
from seismo3d.seismic.misfit_settings import MisfitSettings, share_of_noise

BRIDGE_WIDTH = 2.0
"""Width of the window over which unknown evidence is bridged, in traces and in steps of the samples."""

# mean and spread of the evidence of a cube with a few faults: without noise, and in the mild noise of a good survey
_LEAST_MEAN = (0.47, 0.6)
_LEAST_SPREAD = (0.65, 0.9)
# traces that a line has at least where its excess over its neighbours is told
_LEAST_LINE = 32


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


def level_mean(sums: Float64Array, shape: tuple[int, ...], settings: MisfitSettings) -> np.float32:
    """Return what levelling has to give back, so that the evidence's mean stays: from the sums of all traces."""
    return np.float32(settings.levelling * sums.sum() / np.prod(shape, dtype=np.float64))


def level_reach(settings: MisfitSettings) -> int:
    """Return over how many traces to either side :func:`level` averages."""
    return len(gaussian_taps(settings.background[0])) // 2
