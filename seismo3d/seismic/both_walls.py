"""Faults both of whose walls moved: throw where it is, and how far apart it has taken what touched before.

A layer of the hanging wall came down by its wall's share of the throw where it lies today. Its counterpart in the
footwall lies higher up the fault, and went up by the other share of the throw there, which is another where throw
changes down the fault. What lies apart is the sum of the two.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.seismic.fault_motion import fill_nearest

# rounds in which the one is told from the other: where throw changes by half a sample a sample, to a hundredth of it
_ROUNDS = 4


def tell_throw(apart: Float64Array, lift: float, along: float, step: int = 1) -> Float64Array:
    """Return the throw at every place of a fault, from how far apart what touched lies.

    Parameters
    ----------
    apart : ndarray of shape (row, node), float64
        How far each place of the hanging wall lies below its counterpart in the footwall, in samples; NaN where that is
        not known.
    lift : float
        Share of the throw that the hanging wall took, 0.5 to 1.
    along : float
        Motion of the hanging wall along the rows for each sample of throw.
    step : int
        Samples from a node to the next.

    Returns
    -------
    ndarray of the same shape, float64
        Samples, NaN there.
    """
    known = np.isfinite(apart)
    if lift >= 1.0 or not known.any():
        return apart
    throw = filled = fill_nearest(apart)
    for _ in range(_ROUNDS):
        throw = filled + (1.0 - lift) * (throw - _at_counterparts(throw, filled, along, step))
    return np.where(known, throw, np.nan)


def tell_apart(throw: Float64Array, lift: float, along: float, step: int = 1) -> Float64Array:
    """Return how far apart what touched lies at every place of a fault, from its throw: what :func:`tell_throw` undoes.

    Parameters
    ----------
    throw : ndarray of shape (row, node), float64
        Throw at every place, in samples; NaN where it is not known.
    lift, along, step
        As there.

    Returns
    -------
    ndarray of the same shape, float64
        Samples, NaN there.
    """
    known = np.isfinite(throw)
    if lift >= 1.0 or not known.any():
        return throw
    apart = filled = fill_nearest(throw)
    for _ in range(_ROUNDS):
        apart = lift * filled + (1.0 - lift) * _at_counterparts(filled, apart, along, step)
    return np.where(known, apart, np.nan)


def _at_counterparts(values: Float64Array, apart: Float64Array, along: float, step: int) -> Float64Array:
    rows, columns = np.indices(values.shape).astype(np.float64)
    at = [rows - along * apart, columns - apart / step]
    return np.asarray(ndimage.map_coordinates(values, at, order=1, mode="nearest"))
