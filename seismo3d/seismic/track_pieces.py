"""Pieces that a track falls into where it jumps from a trace to the next, and which are too small to be trusted."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from seismo3d._typing import AnyArray, BoolArray, Float64Array, IntArray

LARGEST_STEP = 4.0
"""Samples from a trace to the next beyond which a track jumps, unless it goes on alike."""


def are_joined(depth: AnyArray, step: float, axis: int = -1) -> BoolArray:
    """Tell where a track goes on from a trace to the next along an axis.

    It does where it steps by little, or, on a steep flank, as it did a trace before or does a trace further on.

    Parameters
    ----------
    depth : ndarray
        Depths; NaN where the horizon was not traced.
    step : float
        Largest step, in the unit of the depths. Of a steep one, half of that is the largest change.
    axis : int
        The axis.

    Returns
    -------
    ndarray of bool
        One shorter along the axis; False beside traces without the horizon.

    Examples
    --------
    >>> import numpy as np
    >>> are_joined(np.array([0.0, 1.0, 21.0, 22.0, 32.0, 42.0]), 4.0)
    array([ True, False,  True,  True,  True])
    """
    steps = np.moveaxis(np.diff(depth, axis=axis), axis, -1)
    alike = np.abs(np.diff(steps, axis=-1)) <= 0.5 * step
    joined = np.abs(steps) <= step
    joined[..., 1:] |= alike
    joined[..., :-1] |= alike
    return np.asarray(np.moveaxis(joined, -1, axis), np.bool_)


def keep_pieces(depth: Float64Array, index: Float64Array, *, step: float, least: int) -> BoolArray:
    """Tell which traces lie on a piece of a track that is large enough to be trusted, or holds a seed.

    Beside faults, where layer time is at its worst, a few traces may match their surroundings at a wrong depth by
    chance. They hang together with nothing around them.

    Parameters
    ----------
    depth : ndarray of shape (inline, crossline), float64
        Fractional sample; NaN where the horizon was not traced.
    index : ndarray of shape (n, 3), float64
        Seeds, as fractional indices.
    step : float
        As for :func:`are_joined`, in samples.
    least : int
        Fewest traces of a piece without a seed.

    Returns
    -------
    ndarray of the same shape, bool
    """
    labels = label_pieces(depth, step)
    large = np.bincount(labels.ravel()) >= least
    seeds = np.rint(index[:, :2]).astype(int)
    large[labels[seeds[:, 0], seeds[:, 1]]] = True
    return np.asarray(large[labels] & np.isfinite(depth), np.bool_)


def label_pieces(depth: AnyArray, step: float) -> IntArray:
    """Give a number to each of the pieces that a map of depths falls into where it jumps from a trace to the next.

    Parameters
    ----------
    depth : ndarray of shape (inline, crossline)
        Depths; NaN where the horizon was not traced.
    step : float
        As for :func:`are_joined`, in the unit of the depths.

    Returns
    -------
    ndarray of the same shape, int
        From 0; each trace without the horizon is a piece of its own.
    """
    numbers = np.arange(depth.size).reshape(depth.shape)
    ends = []
    for axis in (0, 1):
        joined = are_joined(depth, step, axis)
        before, after = np.split(numbers, [1], axis=axis)[1], np.split(numbers, [-1], axis=axis)[0]
        ends.append(np.stack([after[joined], before[joined]]))
    one, other = np.concatenate(ends, axis=1)
    links = coo_array((np.ones(len(one), np.bool_), (one, other)), shape=(depth.size, depth.size))
    labels: IntArray = connected_components(links, directed=False)[1].reshape(depth.shape)
    return labels
