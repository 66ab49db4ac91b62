"""Directions on a map, in degrees clockwise from north."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array


def wrap_deg(angle: Any) -> Float64Array:
    """Return angles in [0, 360), in single precision too.

    The remainder of a hair less than nothing is a hair less than a full turn, or rounds to one.

    Parameters
    ----------
    angle : array_like
        Degrees.

    Returns
    -------
    ndarray of the same shape, float64

    Examples
    --------
    >>> wrap_deg([-90.0, 360.0, -1e-15])
    array([270.,   0.,   0.])
    """
    turned = np.asarray(angle, dtype=np.float64) % 360.0
    return np.where(turned.astype(np.float32) == np.float32(360.0), 0.0, turned)


def whole_deg(angle: float, *, turn: float = 360.0) -> float:
    """Round to whole degrees below a full turn: what rounds to the turn is 0.

    Examples
    --------
    >>> whole_deg(359.8), whole_deg(179.7), whole_deg(179.7, turn=180.0)
    (0.0, 180.0, 0.0)
    """
    return float(np.round(angle) % turn)


def bearing_deg(east: AnyArray, north: AnyArray) -> Float64Array:
    """Return the direction of vectors, in [0, 360).

    Examples
    --------
    >>> bearing_deg(-1.0, 0.0)
    array(270.)
    """
    return wrap_deg(np.degrees(np.arctan2(east, north)))
