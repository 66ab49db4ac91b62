"""Spectral whitening: the wavelet shortened as far as the cube's own noise allows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_filters import filter_carried, filter_known

_MOST_TRACES = 4096
_MOST_PIECES = 128
# share of the samples that a trace of the cube usually holds from which on it is complete, and of a piece of one where
# too few are whole: for every so many pairs of traces one whole piece is enough
_COMPLETE = 0.9
_WHOLE_AMONG = 16
_FLOOR = 0.01
_HALF_LENGTH = 16
# share of the power that has longer periods than the shortest of note
_OF_NOTE = 0.9
# cycles a sample between which the filter tapers off: beyond, samples cannot be interpolated
_BAND = (0.3, 0.5)
# share of the power that counts as white noise where traces are carried on beyond their ends
_GRAIN = 1e-3


class Whitening(NamedTuple):
    """A filter along the traces, and what carries traces on beyond their ends for it.

    Attributes
    ----------
    taps : ndarray of shape (2 half + 1,), float32
        Weights, symmetric.
    beyond : ndarray of shape (half, n), float32, or None
        Row t tells the sample t + 1 beyond an end from the last n samples, the end first. None: the cube's end samples
        are repeated.
    spectrum : ndarray of shape (n,), float64, or None
        Mean amplitude spectrum of the filtered traces, at frequencies evenly spread from 0 to half a cycle a sample:
        that of the wavelet that is left. None where there are no traces to tell it.
    """

    taps: Float32Array
    beyond: Float32Array | None = None
    spectrum: Float64Array | None = None

    @property
    def period(self) -> float:
        """Samples in the shortest period of note: nine tenths of the filtered traces' power have longer ones.

        0 where there are no traces.
        """
        return 0.0 if self.spectrum is None else _shortest_period(self.spectrum**2)


def whiten(volume: Float32Array, valid: BoolArray, *, carried: bool = False) -> tuple[Float32Array, Whitening]:
    r"""Flatten the amplitude spectrum along the traces where neighbouring traces agree.

    One zero-phase filter serves the whole cube: :math:`W(f) = \gamma(f) / (A(f) + 0.01 \max A)`, with :math:`A` the
    root-mean-square amplitude spectrum and :math:`\gamma` the coherence of neighbouring traces: their mean
    cross-spectrum over their mean power, 1 where all is signal and 0 where all is noise. A wavelet smears a
    fault's break along the
    trace by its own length; a shorter one shows it where it is.

    Carried on, traces go on beyond their ends by the least-squares prediction from their last samples. What they were
    cut off with lies level from trace to trace, whatever the layers do, and is matched as if it were one.

    Parameters
    ----------
    volume : ndarray of shape (inline, crossline, sample), float32
        Amplitudes, zero where not valid.
    valid : ndarray of the same shape, bool
        Where there are data.
    carried : bool
        Whether traces are carried on beyond their ends.

    Returns
    -------
    white : ndarray of the same shape, float32
        Filtered amplitudes, scaled to a root-mean-square of about 1 and clipped at 8; zero where not valid.
    whitening : Whitening
        The filter.
    """
    whitening = design_whitening(volume, valid, carried=carried)
    out = filter_valid(volume, valid, whitening)
    scale_to_unit(out, find_rms(trace_powers(out), int(valid.sum())))
    return out, whitening


def filter_valid(volume: Float32Array, valid: BoolArray, whitening: Whitening) -> Float32Array:
    """Return the traces filtered; zero where not valid."""
    out = np.empty_like(volume)
    if whitening.beyond is None:
        filter_known(volume, valid, whitening.taps, out)
    else:
        filter_carried(volume, valid, whitening.taps, whitening.beyond, out)
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


def design_whitening(volume: Float32Array, valid: BoolArray, *, carried: bool = False) -> Whitening:
    """Return the filter of a cube."""
    if volume.shape[1] < 2:
        volume, valid = volume.transpose(1, 0, 2), valid.transpose(1, 0, 2)
    i, j = choose_pairs(find_complete(valid.sum(axis=2))).T
    first, second = volume[i, j].astype(np.float64), volume[i, j + 1].astype(np.float64)
    return whitening_of(first, second, valid[i, j] & valid[i, j + 1], carried=carried)


def find_complete(n_valid: IntArray) -> BoolArray:
    """Tell which traces hold data as far as most do, from how many samples each holds.

    A mute above, or padding below, takes the same of all.
    """
    live = n_valid > 0
    usual = float(np.median(n_valid[live])) if live.any() else 0.0
    return np.asarray(live & (n_valid > _COMPLETE * usual))


def choose_pairs(complete: BoolArray) -> IntArray:
    """Return evenly spread pairs of complete neighbouring traces: the indices of the first of each."""
    pairs = np.argwhere(complete[:, :-1] & complete[:, 1:])
    return pairs[:: max(1, len(pairs) // _MOST_TRACES)]


def whitening_of(first: Float64Array, second: Float64Array, known: BoolArray, *, carried: bool) -> Whitening:
    """Return the filter from pairs of neighbouring traces, one a row, and where both hold data."""
    half = min(_HALF_LENGTH, max(1, first.shape[1] // 4))
    beyond = _design_prediction(first, known, half) if carried else None
    n_fft = 4 * (2 * half + 1)
    power, cross = _pair_spectra(first, second, known, n_fft)
    if not power.max() > 0.0:
        return Whitening(_identity(half), beyond)
    taps = _design_taps(_smooth_spectrum(power), _smooth_spectrum(cross), half)
    return Whitening(taps, beyond, np.sqrt(power) * np.abs(np.fft.rfft(taps, n_fft)))


def _shortest_period(power: Float64Array) -> float:
    """Return the samples of the period above which most of the power lies."""
    total = np.cumsum(power)
    if not total[-1] > 0.0:
        return 0.0
    place = float(np.interp(_OF_NOTE * total[-1], total, np.arange(len(total)) + 0.5))
    return 2.0 * (len(power) - 1) / place


def _identity(half: int) -> Float32Array:
    taps = np.zeros(2 * half + 1, np.float32)
    taps[half] = 1.0
    return taps


def _design_prediction(traces: Float64Array, known: BoolArray, half: int) -> Float32Array:
    """Return the weights that tell samples beyond an end from twice as many before it, by least squares over traces."""
    n, length = 2 * half, 3 * half
    products = np.zeros((length, length))
    if len(traces):
        starts = np.unique(np.rint(np.linspace(0, traces.shape[1] - length, _MOST_PIECES)))
        for least in (1.0, _COMPLETE):
            for (piece,) in _find_pieces((traces,), known, starts, length, least=least):
                products += piece.T @ piece
            if products.any():
                break
    # an upper end is a lower one upside down
    products += products[::-1, ::-1].copy()
    power = np.trace(products) / length
    if not power > 0.0:
        return np.zeros((half, n), np.float32)
    inside = products[n - 1 :: -1, n - 1 :: -1] + _GRAIN * power * np.eye(n)
    return np.linalg.solve(inside, products[n - 1 :: -1, n:]).T.astype(np.float32)


def _design_taps(power: Float64Array, cross: Float64Array, half: int) -> Float32Array:
    """Return the filter's weights, an odd number of them, symmetric, from smooth power and cross-spectra."""
    n_fft = 2 * (len(power) - 1)
    amplitude = np.sqrt(power)
    coherence = np.clip(cross / np.maximum(power, 1e-6 * power.max()), 0.0, 1.0)
    frequency = np.arange(len(power)) / n_fft
    low, high = _BAND
    band = 0.5 + 0.5 * np.cos(np.pi * np.clip((frequency - low) / (high - low), 0.0, 1.0))
    response = band * coherence / (amplitude + _FLOOR * amplitude.max())
    impulse = np.fft.fftshift(np.fft.irfft(response, n_fft))
    centre = n_fft // 2
    window = np.hanning(2 * half + 3)[1:-1]
    taps = impulse[centre - half : centre + half + 1] * window
    # where neighbours agree nowhere the response is zero
    peak = np.abs(np.fft.rfft(taps, n_fft)).max()
    return (taps / peak).astype(np.float32) if peak > 0.0 else _identity(half)


def _pair_spectra(
    first: Float64Array, second: Float64Array, known: BoolArray, n_fft: int
) -> tuple[Float64Array, Float64Array]:
    """Return the mean power and the mean cross-spectrum of pairs of traces, from tapered pieces of n_fft samples.

    They are shorter where too few traces hold data over so many, and have gaps where too few hold data without one.
    """
    n_samples = first.shape[1]
    lengths = sorted({min(n, n_samples) for n in (n_fft, n_fft // 2, n_fft // 4)}, reverse=True)
    most: tuple[int, Float64Array, Float64Array] = (0, *np.zeros((2, n_fft // 2 + 1)))
    for least, length in ((least, length) for least in (1.0, _COMPLETE) for length in lengths):
        power, cross = np.zeros((2, n_fft // 2 + 1))
        n_starts, count = int(np.ceil(2 * (n_samples - length) / length)) + 1, 0
        taper = np.hanning(length + 2)[1:-1]
        starts = np.linspace(0, n_samples - length, n_starts)
        for pair in _find_pieces((first, second), known, starts, length, least=least):
            one, other = (np.fft.rfft(piece * taper, n_fft, axis=1) for piece in pair)
            power += 0.5 * (np.abs(one) ** 2 + np.abs(other) ** 2).sum(axis=0)
            cross += (one * other.conj()).real.sum(axis=0)
            count += len(one)
        most = max(most, (count, power, cross), key=lambda found: found[0])
        if _WHOLE_AMONG * most[0] > len(first):
            break
    count, power, cross = most
    return power / max(count, 1), cross / max(count, 1)


def _find_pieces(
    traces: tuple[Float64Array, ...], known: BoolArray, starts: Float64Array, length: int, *, least: float
) -> Iterator[list[Float64Array]]:
    """Give pieces of traces, those that begin at one start together: those that hold at least that share of data.

    Where data end within a piece they do so with a step, which has all frequencies.
    """
    for start in np.rint(starts).astype(int):
        kept = known[:, start : start + length].mean(axis=1) >= least
        if kept.any():
            yield [values[kept, start : start + length] for values in traces]


def _smooth_spectrum(values: Float64Array) -> Float64Array:
    weights = np.hanning(11)[1:-1]
    weights /= weights.sum()
    padded = np.pad(values, 4, mode="reflect")
    return np.convolve(padded, weights, "valid")
