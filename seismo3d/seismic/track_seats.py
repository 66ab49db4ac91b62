"""Whether a horizon lies, away from its seeds, where their waveforms tell."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.seismic._kernels_tracks import match_waveforms
from seismo3d.seismic.layer_pieces import LayerVolumes, read_around

# half-length of the waveforms that are compared, farthest that they are looked for, and how far off they may well be
_HALF, _FARTHEST, _NEAR = 24, 24, 3
# how much better than near where they lie they must match elsewhere
_GAIN = 0.1
# share of a waveform that must be known: between two faults there may be little
_LEAST_KNOWN = 0.15


def find_offset(
    layers: LayerVolumes, depth: Float64Array, own: BoolArray, others: BoolArray, *, clear: int, least: float
) -> float:
    """How far below the traces around the seeds all others lie, which fit each other, by their waveforms.

    Layer time may be off by more than parts are moved beyond all faults around the seeds. Every part is placed then
    next to where it should be, at the best that is in reach. Together they tell.

    Parameters
    ----------
    layers : LayerVolumes
        Of the cube.
    depth : ndarray of shape (inline, crossline), float64
        Fractional sample of the horizon; NaN where there is none.
    own, others : ndarray of the same shape, bool
        Traces around the seeds, and those that are compared with them.
    clear : int
        Samples next to a fault that do not count.
    least : float
        Correlation elsewhere that tells.

    Returns
    -------
    float
        In samples; 0 where they match near where they lie as well as anywhere, or there is nothing to compare.
    """
    if not (own.any() and others.any()):
        return 0.0
    wave, seen = _mean_waveform(layers, np.where(own, depth, np.nan), _HALF, clear)
    around, known = _mean_waveform(layers, np.where(others, depth, np.nan), _HALF + _FARTHEST, clear)
    taper = np.hanning(2 * _HALF + 3)[1:-1].astype(np.float32)
    lags = np.empty((1, 2 * _FARTHEST + 1), np.float32)
    match_waveforms(around[None], known[None], wave, seen, taper, np.float32(_LEAST_KNOWN), lags)
    here = lags[0, _FARTHEST - _NEAR : _FARTHEST + _NEAR + 1].max()
    best = int(lags[0, 1:-1].argmax()) + 1
    if lags[0, best] < max(here + _GAIN, least):
        return 0.0
    before, at, after = (float(lags[0, best + d]) for d in (-1, 0, 1))
    bend = before - 2.0 * at + after
    return _FARTHEST - best - (0.5 * (before - after) / bend if bend < 0.0 else 0.0)


def _mean_waveform(
    layers: LayerVolumes, depth: Float64Array, half: int, clear: int
) -> tuple[Float32Array, Float32Array]:
    """Return the mean amplitudes about a horizon, and the share of its traces that tell them."""
    waves, known = read_around(layers, depth, half, clear=clear)
    count = known.sum(axis=(0, 1), dtype=np.float64)
    mean = (waves * known).sum(axis=(0, 1), dtype=np.float64) / np.maximum(count, 1.0)
    return mean.astype(np.float32), (count / max(float(count.max()), 1.0)).astype(np.float32)
