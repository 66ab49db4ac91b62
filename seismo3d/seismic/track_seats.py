"""Whether a horizon lies, away from its seeds, where their waveforms tell."""

from __future__ import annotations

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.seismic.layer_parts import find_vertices
from seismo3d.seismic.layer_pieces import LayerVolumes
from seismo3d.seismic.track_waveforms import match_traces, mean_waveform

# half-length of the waveforms that are compared, farthest that they are looked for, and how far off they may well be
_HALF, _FARTHEST, _NEAR = 24, 24, 3
# how much better than near where they lie they must match elsewhere
_GAIN = 0.1
# share of what is known of one waveform that must be of the other: between two faults there may be little
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
    wave, seen = mean_waveform(layers, depth, own, _HALF, clear)
    around, known = mean_waveform(layers, depth, others, _HALF + _FARTHEST, clear)
    lags = match_traces(around[None], known[None], wave[None], seen, _FARTHEST, _LEAST_KNOWN)[0]
    here = lags[0, _FARTHEST - _NEAR : _FARTHEST + _NEAR + 1].max()
    best = lags[:, 1:-1].argmax(axis=1) + 1
    if lags[0, best[0]] < max(here + _GAIN, least):
        return 0.0
    return _FARTHEST - float(find_vertices(lags, best)[0])
