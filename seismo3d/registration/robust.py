"""Robust scale and redescending weights."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float64Array, FloatArray

TUKEY = 4.685
"""Cutoff of Tukey's weight in standard deviations: 95 % efficiency under a normal law."""

NORMAL = 1.4826
"""Standard deviation over the median magnitude, under a normal law."""


def robust_scale(residuals: FloatArray) -> float:
    """Return the standard deviation of residuals about zero from their median magnitude."""
    magnitude = np.abs(residuals)
    if magnitude.size == 0:
        return 0.0
    # numpy's median looks for NaN first, which costs as much again
    middle = magnitude.size // 2
    if magnitude.size % 2:
        return NORMAL * float(np.partition(magnitude, middle)[middle])
    return NORMAL * float(np.partition(magnitude, (middle - 1, middle))[middle - 1 : middle + 1].mean())


def tukey_weights(residuals: FloatArray, cutoff: float) -> Float64Array:
    """Return Tukey's redescending weights: 1 at zero, 0 from the cutoff on."""
    u = np.clip(1.0 - (np.asarray(residuals, dtype=np.float64) / cutoff) ** 2, 0.0, 1.0)
    return np.asarray(u * u)
