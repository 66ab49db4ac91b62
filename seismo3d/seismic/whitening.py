"""Spectral whitening: the wavelet shortened as far as the cube's own noise allows."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_filters import filter_samples

_MOST_TRACES = 4096
_FLOOR = 0.01
_HALF_LENGTH = 16
# cycles a sample between which the filter tapers off: beyond, samples cannot be interpolated
_BAND = (0.3, 0.5)


def whiten(volume: Float32Array, valid: BoolArray) -> Float32Array:
    r"""Flatten the amplitude spectrum along the traces where neighbouring traces agree.

    One zero-phase filter serves the whole cube: :math:`W(f) = \gamma(f) / (A(f) + 0.01 \max A)`, with :math:`A` the
    root-mean-square amplitude spectrum and :math:`\gamma` the coherence of neighbouring traces: their mean
    cross-spectrum over their mean power, 1 where all is signal and 0 where all is noise. A wavelet smears a
    fault's break along the
    trace by its own length; a shorter one shows it where it is.

    Parameters
    ----------
    volume : ndarray of shape (inline, crossline, sample), float32
        Amplitudes, zero where not valid.
    valid : ndarray of the same shape, bool
        Where there are data.

    Returns
    -------
    ndarray of the same shape, float32
        Filtered amplitudes, scaled to a root-mean-square of about 1 and clipped at 8; zero where not valid.
    """
    out = filter_valid(volume, valid, whitening_taps(volume, valid))
    scale_to_unit(out, find_rms(trace_powers(out), int(valid.sum())))
    return out


def filter_valid(volume: Float32Array, valid: BoolArray, taps: Float32Array) -> Float32Array:
    """Return the traces filtered; zero where not valid."""
    out = np.empty_like(volume)
    filter_samples(volume, taps, out)
    out[~valid] = 0.0
    return out


def trace_powers(volume: Float32Array) -> Float64Array:
    """Return the sum of squares of every trace: added up, they give the same however a cube is cut."""
    return np.stack([np.square(line, dtype=np.float64).sum(axis=1) for line in volume])


def find_rms(powers: Float64Array, n_valid: int) -> float:
    """Return the root-mean-square of a cube from its traces' sums of squares."""
    return float(np.sqrt(powers.sum() / max(n_valid, 1)))


def scale_to_unit(volume: Float32Array, rms: float) -> None:
    """Scale to a root-mean-square of 1, in place, and clip at 8."""
    if rms > 0.0:
        volume /= np.float32(rms)
        np.clip(volume, -8.0, 8.0, out=volume)


def whitening_taps(volume: Float32Array, valid: BoolArray) -> Float32Array:
    """Return the whitening filter's weights, an odd number of them, symmetric."""
    if volume.shape[1] < 2:
        volume, valid = volume.transpose(1, 0, 2), valid.transpose(1, 0, 2)
    i, j = choose_pairs(is_complete(valid)).T
    return design_taps(volume[i, j].astype(np.float64), volume[i, j + 1].astype(np.float64), volume.shape[2])


def is_complete(valid: BoolArray) -> BoolArray:
    """Tell which traces are complete, but for a tenth."""
    return np.asarray(valid.mean(axis=2) > 0.9)


def choose_pairs(complete: BoolArray) -> IntArray:
    """Return evenly spread pairs of complete neighbouring traces: the indices of the first of each."""
    pairs = np.argwhere(complete[:, :-1] & complete[:, 1:])
    return pairs[:: max(1, len(pairs) // _MOST_TRACES)]


def design_taps(first: Float64Array, second: Float64Array, n_samples: int) -> Float32Array:
    """Return the filter's weights from pairs of neighbouring traces, one a row."""
    half = min(_HALF_LENGTH, max(1, n_samples // 4))
    identity = np.zeros(2 * half + 1, np.float32)
    identity[half] = 1.0
    if len(first) == 0:
        return identity
    n_fft = 4 * (2 * half + 1)
    spectra = [_short_spectra(traces, n_fft) for traces in (first, second)]
    power = 0.5 * sum((np.abs(s) ** 2).mean(axis=0) for s in spectra)
    cross = (spectra[0] * spectra[1].conj()).real.mean(axis=0)
    if not power.max() > 0.0:
        return identity
    smooth_power, smooth_cross = _smooth_spectrum(power), _smooth_spectrum(cross)
    amplitude = np.sqrt(smooth_power)
    coherence = np.clip(smooth_cross / np.maximum(smooth_power, 1e-6 * smooth_power.max()), 0.0, 1.0)
    frequency = np.arange(len(power)) / n_fft
    low, high = _BAND
    band = 0.5 + 0.5 * np.cos(np.pi * np.clip((frequency - low) / (high - low), 0.0, 1.0))
    response = band * coherence / (amplitude + _FLOOR * amplitude.max())
    impulse = np.fft.fftshift(np.fft.irfft(response, n_fft))
    centre = n_fft // 2
    window = np.hanning(2 * half + 3)[1:-1]
    taps = impulse[centre - half : centre + half + 1] * window
    peak = np.abs(np.fft.rfft(taps, n_fft)).max()
    return (taps / peak).astype(np.float32) if peak > 0.0 else identity


def _short_spectra(traces: Float64Array, n_fft: int) -> np.ndarray:
    """Return spectra of tapered pieces of n_fft samples, spread evenly over the traces; of short traces whole."""
    length = min(traces.shape[1], n_fft)
    taper = np.hanning(length + 2)[1:-1]
    n_pieces = 1 if length < n_fft else int(np.ceil(2 * (traces.shape[1] - length) / length)) + 1
    starts = np.rint(np.linspace(0, traces.shape[1] - length, n_pieces)).astype(int)
    pieces = np.concatenate([traces[:, start : start + length] for start in starts])
    return np.fft.rfft(pieces * taper, n_fft, axis=1)


def _smooth_spectrum(values: Float64Array) -> Float64Array:
    weights = np.hanning(11)[1:-1]
    weights /= weights.sum()
    padded = np.pad(values, 4, mode="reflect")
    return np.convolve(padded, weights, "valid")
