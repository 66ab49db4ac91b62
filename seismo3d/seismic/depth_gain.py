"""Amplitudes that die away with depth, evened out: a gain of the depth alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int64Array

# samples whose strength is told together, and width of the window that strengths are followed in
_DEPTH, _WINDOW = 32, 96.0
# decibels that the strength may range over as it is
_RANGE = 12.0


def find_gain(amplitudes: Float32Array, depths: Int64Array, n_samples: int) -> Float32Array | None:
    """Find what raises the weak depths of a cube and lowers the strong ones, where they are far apart.

    Spreading and absorption take the same off all layers of a depth: that is no reflectivity, and what is measured
    against the whole cube's strength would be blind at depth. What they took off is told by the strength at every
    depth, followed by straight lines in decibels over windows so wide that strong and weak layers stay what they are.
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
    strengths = np.array([np.percentile(part, 90.0) if len(part) else 0.0 for part in parts], np.float64)
    told = strengths > 0.0
    if not told.any():
        return None
    middles = np.asarray(0.5 * (edges[:-1] + edges[1:] - 1.0)[told], np.float64)
    counts = np.array([len(part) for part in parts])[told]
    level = _follow(middles, 20.0 * np.log10(strengths[told]), counts)
    spread = np.ptp(level)
    if spread <= _RANGE:
        return None
    excess = (level - 0.5 * (level.min() + level.max())) * (1.0 - (_RANGE / spread) ** 2)
    return (10.0 ** (-np.interp(np.arange(n_samples), middles, excess) / 20.0)).astype(np.float32)


def _follow(places: Float64Array, values: Float64Array, counts: Int64Array) -> Float64Array:
    """Return, at every place, the value of the straight line that fits best through those around it."""
    apart = places - places[:, None]
    weights = counts * np.exp(-0.5 * (apart / _WINDOW) ** 2)
    total, first, second = (np.sum(weights * apart**power, axis=1) for power in range(3))
    sums, moments = weights @ values, (weights * apart) @ values
    second += 1e-9 * _WINDOW**2 * total  # one depth alone has no slope
    return np.asarray((sums * second - moments * first) / (second * total - first**2))
