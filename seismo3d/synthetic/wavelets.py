"""Wavelets of synthetic seismic data."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_array, as_number
from seismo3d.errors import ShapeError


def ricker(time: ArrayLike, peak_frequency: float) -> Float64Array:
    r"""Ricker wavelet with unit peak at time zero.

    :math:`(1 - 2u) e^{-u}` with :math:`u = (\pi f t)^2`.

    Parameters
    ----------
    time : array_like
        Times in samples (or any unit whose inverse is the frequency's).
    peak_frequency : float
        Frequency of the spectrum's peak, in cycles a sample.

    Returns
    -------
    ndarray of time's shape, float64
        Amplitudes.

    Raises
    ------
    ParameterError
        If the frequency is not positive.

    Examples
    --------
    >>> ricker([-1.0, 0.0, 1.0], 0.05).round(3).tolist()
    [0.927, 1.0, 0.927]
    """
    frequency = as_number(peak_frequency, "peak_frequency", low=0.0, strict=True)
    times = as_array(time, "time")
    if times.size and times.dtype.kind not in "fiub":
        raise ShapeError(f"time has elements of type {times.dtype}; expected real numbers.")
    u = (np.pi * frequency * times.astype(np.float64)) ** 2
    return np.asarray((1.0 - 2.0 * u) * np.exp(-u))


def ricker_table(peak_frequency: float, steps: int) -> Float64Array:
    """Ricker wavelet tabulated ``steps`` times a sample, out to where it has died away."""
    half = round(1.3 / peak_frequency * steps)
    return ricker(np.arange(-half, half + 1) / steps, peak_frequency)
