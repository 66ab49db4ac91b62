"""Bells, the shape that throw has over a fault: what throws are smooth about, and how they go on out of view."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.seismic.term_fits import fit_terms

# what keeps slopes and bends at nothing where too little is known to tell them: for what throws scatter, within bounds
_RIDGES, _DOUBT = (1e-5, 1e-3), 10.0
# places that it takes, throws in samples below which logarithms tell nothing, and how much may be below
_LEAST_PLACES, _LEAST_THROW, _BELOW = 60, 0.5, 0.2
# samples by which a throw may miss the bell for half of its weight, and rounds of that
_MISS, _ROUNDS = 1.5, 5
# logarithms of the smallest and the largest throw of a bell
_SMALLEST, _LARGEST = -3.0, 4.6
# weight from which on a throw counts as known
_KNOWN = 0.2
# places over which what the bell misses is smoothed, over which it dies away, and over which the bell takes over
_SMOOTH, _FADING, _TURNING = 3.0, 10.0, 2.0


def carry_on(throw: Float32Array, weight: Float32Array) -> Float32Array:
    """Carry throws on from where they are known, as the bell through them goes on.

    A plate through the known throws goes on straight, and leads astray where throw dies away towards a tip. A bell
    follows it there, and is near to straight where throws are.

    Parameters
    ----------
    throw : ndarray of shape (row, sample), float32
        Throws in samples; they stay as they are where they are known.
    weight : ndarray of the same shape, float32
        0 to 1: how well each is known.

    Returns
    -------
    ndarray of the same shape, float32
        The same throws where no bell can be told: too few are known, or they have both signs.
    """
    bell = fit_bell(throw, weight)
    known = weight > _KNOWN
    if bell is None or not known.any():
        return throw
    away, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
    # what the known throws nearest to a place have over the bell
    share = ndimage.gaussian_filter(known.astype(np.float64), _SMOOTH)
    over = ndimage.gaussian_filter(np.where(known, throw - bell, 0.0), _SMOOTH) / np.maximum(share, 1e-3)
    led = bell + over[tuple(nearest)] * np.exp(-away / _FADING)
    turned = np.clip(away / _TURNING, 0.0, 1.0)
    return np.asarray((1.0 - turned) * throw + turned * led, np.float32)


def smooth_about_bell(
    throw: Float32Array, weight: Float32Array, smooth: Callable[[Float32Array], Float32Array]
) -> Float32Array:
    """Smooth throws about the bell through them.

    What is smooth by itself flattens the top of a bell, and leads straight on where it dies away; what the bell misses
    is small, and can be smoothed the more.

    Parameters
    ----------
    throw, weight
        As for :func:`carry_on`.
    smooth : callable
        Takes values, and gives a smooth field of the same shape.

    Returns
    -------
    ndarray of the same shape, float32
        The smooth field alone where no bell can be told.
    """
    bell = fit_bell(throw, weight)
    if bell is None:
        return smooth(throw)
    return (bell + smooth((throw - bell).astype(np.float32))).astype(np.float32)


def fit_bell(throw: Float32Array, weight: Float32Array) -> Float64Array | None:
    r"""Fit a bell over a surface to throws.

    It is :math:`\pm\exp(q)`, with a :math:`q` of second order along either axis that bends down or not at all: a
    Gaussian, or throw that grows by the same share from place to place. Throws count by their weights, less the
    farther they lie from it.

    Parameters
    ----------
    throw, weight
        As for :func:`carry_on`.

    Returns
    -------
    ndarray of the same shape, float64, or None
        None where too few are known, or they have both signs.
    """
    kept = weight > 0
    sign = 1.0 if float((weight * throw).sum()) >= 0.0 else -1.0
    total, kept = float(weight.sum()), kept & (sign * throw > _LEAST_THROW)
    if kept.sum() < _LEAST_PLACES or float(weight[kept].sum()) < (1.0 - _BELOW) * total:
        return None
    size, counts = sign * throw[kept].astype(np.float64), weight[kept].astype(np.float64)
    # a logarithm that is off by so much is off by that share of the throw
    counts *= (size / float(np.median(size))) ** 2
    everywhere = _terms(throw.shape)
    factors = _fit_logarithms(size, counts, [term[kept] for term in everywhere])
    q = sum((factor * term for factor, term in zip(factors, everywhere, strict=True)), np.zeros(throw.shape))
    return sign * np.exp(np.clip(q, _SMALLEST, _LARGEST))


def _terms(shape: tuple[int, ...]) -> list[Float64Array]:
    """Return the terms of second order, without the mixed one, at every place: from -1 to 1 along each axis."""
    a, b = (
        (at - 0.5 * n) / max(0.5 * n, 1.0) for at, n in zip(np.indices(shape, dtype=np.float64), shape, strict=True)
    )
    return [np.ones(shape), a, b, a * a, b * b]


def _fit_logarithms(size: Float64Array, counts: Float64Array, terms: list[Float64Array]) -> Float64Array:
    """Return the factors of the terms for the logarithms of throws; of the squares none that grows."""
    free = list(range(len(terms)))
    while True:
        factors = _fit_robustly(size, counts, [terms[n] for n in free])
        growing = [n for n, factor in zip(free, factors, strict=True) if n >= 3 and factor > 0.0]
        if not growing:
            break
        free = [n for n in free if n not in growing]
    whole = np.zeros(len(terms))
    whole[free] = factors
    return whole


def _fit_robustly(size: Float64Array, counts: Float64Array, terms: list[Float64Array]) -> Float64Array:
    logarithms, weights, ridge = np.log(size), counts, _RIDGES[0]
    for _ in range(_ROUNDS):
        factors, left = fit_terms(terms, logarithms, weights=weights, ridge=[0.0] + [ridge] * (len(terms) - 1))
        weights = counts / (1.0 + (left * size / _MISS) ** 2)
        # throws that lie together are off together: the more they scatter, the less they say of places farther off
        ridge = float(np.clip(_DOUBT * np.median(np.abs(left)) ** 2, *_RIDGES))
    return factors
