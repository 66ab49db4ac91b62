"""Waveforms along a horizon: their mean over some traces, and how well others match one at every lag."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.seismic._kernels_tracks import match_waveforms
from seismo3d.seismic.layer_pieces import LayerVolumes, read_around


def mean_waveform(
    layers: LayerVolumes, depth: Float64Array, chosen: BoolArray, half: int, clear: int
) -> tuple[Float32Array, Float32Array]:
    """Return the mean amplitudes of some traces up to `half` samples from a horizon, and how many tell each, of most.

    Those less than `clear` samples from a fault do not count.
    """
    waves, known = read_around(layers, np.where(chosen, depth, np.nan), half, clear=clear)
    total = known.sum(axis=(0, 1))
    mean = ((waves * known).sum(axis=(0, 1)) / np.maximum(total, 1.0)).astype(np.float32)
    return mean, (total / max(float(total.max()), 1.0)).astype(np.float32)


def match_traces(
    waves: Float32Array, known: Float32Array, references: Float32Array, in_reference: Float32Array, reach: int,
    least: float,
) -> Float32Array:  # fmt: skip
    """Correlation of rows with waveforms (k, width), of which `in_reference` (width) is known: (k, row, lag).

    A row is compared where it knows a share of at least `least` of what is known of the waveforms.
    """
    n, width = references.shape
    lags = np.empty((n, len(waves), 2 * reach + 1), np.float32)
    taper = np.hanning(width + 2)[1:-1].astype(np.float32)
    share = float(taper @ in_reference / taper.sum())
    match_waveforms(waves, known, references, in_reference[None], taper, np.float32(least * share), lags)
    return lags
