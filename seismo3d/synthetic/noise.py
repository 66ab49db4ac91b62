"""What recording and processing add to the layers' signal: noise, gain, smiles, lost traces."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import ArrayLike, Float32Array
from seismo3d._validate import LONGEST, as_cube_shape, as_number, as_real_array, as_whole_number, check_generator, told
from seismo3d.errors import ParameterError
from seismo3d.synthetic.wavelets import ricker_table


def coloured_noise(
    rng: np.random.Generator, shape: tuple[int, ...], peak_frequency: float, *, lateral: float = 0.0
) -> Float32Array:
    """Gaussian noise with the spectrum of a Ricker wavelet along the last axis, and unit root mean square.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    shape : tuple of int
        Shape of the result, sample axis last.
    peak_frequency : float
        Peak frequency of the spectrum in cycles a sample.
    lateral : float
        Standard deviation, in traces, of a Gaussian smoothing across traces, 1000 at most; 0 leaves traces independent.

    Returns
    -------
    ndarray of the given shape, float32
        Noise.
    """
    from scipy.ndimage import convolve1d, gaussian_filter1d

    check_generator(rng)
    if not isinstance(shape, (tuple, list)) or not shape:
        raise ParameterError(f"shape is {told(shape)}; expected the lengths of the axes, samples last.")
    sides = tuple(as_whole_number(side, "shape", low=1, high=LONGEST) for side in shape)
    as_number(peak_frequency, "peak_frequency", low=0.0, strict=True)
    as_number(lateral, "lateral", low=0.0, high=1000.0)
    noise = rng.standard_normal(sides, dtype=np.float32)
    noise = convolve1d(noise, ricker_table(peak_frequency, 1).astype(np.float32), axis=-1, mode="wrap")
    if lateral > 0.0:
        for axis in range(len(sides) - 1):
            noise = gaussian_filter1d(noise, lateral, axis=axis, mode="wrap")
    return np.asarray(noise / root_mean_square(noise), dtype=np.float32)


def root_mean_square(values: ArrayLike) -> float:
    """Root mean square over all finite values, summed in float64."""
    array = np.asarray(values)
    return float(np.sqrt(np.nanmean(np.square(array, dtype=np.float64))))


def apply_agc(seismic: ArrayLike, *, window: float = 40.0) -> Float32Array:
    """Automatic gain control: divide by the root mean square in a sliding Gaussian window along each trace.

    Parameters
    ----------
    seismic : array_like of shape (..., n_samples)
        Amplitudes.
    window : float
        Length of the window in samples (four standard deviations), from 2 to four times the trace, or to 40.

    Returns
    -------
    ndarray of the same shape, float32
        Amplitudes of about unit root mean square everywhere; zero traces stay zero.
    """
    from scipy.ndimage import gaussian_filter1d

    array = as_real_array(seismic, "seismic", ndim=(1, 2, 3)).astype(np.float32)
    as_number(window, "window", low=2.0, high=max(40.0, 4.0 * array.shape[-1]))
    power = gaussian_filter1d(array * array, window / 4.0, axis=-1, mode="nearest")
    floor = 1e-6 * float(power.max()) + np.finfo(np.float32).tiny
    return np.asarray(array / np.sqrt(power + floor), dtype=np.float32)


def migration_smiles(
    rng: np.random.Generator, shape: tuple[int, int, int], peak_frequency: float, *, count: int
) -> Float32Array:
    """Arcs that migration leaves around noise bursts: bowls, concave upwards, fading outwards; unit peak amplitude.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    shape : tuple of int
        (inline, crossline, sample) size.
    peak_frequency : float
        Peak frequency of their wavelet in cycles a sample.
    count : int
        Number of bowls, 10,000 at most.

    Returns
    -------
    ndarray of the given shape, float32
        Their sum.
    """
    from seismo3d.synthetic.wavelets import ricker

    check_generator(rng)
    ni, nx, ns = as_cube_shape(shape)
    out = np.zeros((ni, nx, ns), np.float32)
    sample = np.arange(ns, dtype=np.float64)
    for _ in range(as_whole_number(count, "count", low=0, high=10_000)):
        place = rng.uniform(0.05, 0.95, 3) * shape
        radius = rng.uniform(0.35, 0.9) * ns
        strength = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.0)
        for i in range(ni):
            rho = np.hypot(i - place[0], np.arange(nx) - place[1])
            reached = np.flatnonzero(rho < 0.75 * radius)
            rho = rho[reached, None]
            depth = place[2] - radius + np.sqrt(radius**2 - rho**2)
            fade = np.cos(0.5 * np.pi * rho / (0.75 * radius)) ** 2
            out[i, reached] += strength * fade * ricker(sample - depth, peak_frequency)
    return out
