"""The lateral shift of a whole cube, told apart from vertical shifts of its parts, and how far it is known."""

from __future__ import annotations

from itertools import product

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array

# standard deviation, in traces, of the lateral shift of the whole before anything is known: surveys are binned alike
_BEFORE = 1.0
# most places along an axis that are read: shifts change slowly
_MOST_PLACES = 48
# share of the squares that keeps the fit of a cube without dips from being undetermined, and the variance of rounding
_SHARE, _ROUNDING = 1e-6, 1e-6


def settle_whole(
    vertical: Float32Array, dip: Float32Array, known: BoolArray, lateral: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Find the lateral shift of the whole by what vertical shifts have of the layers' dip.

    A lateral shift that is wrong by a trace leaves vertical shifts that are the dip. Vertical shifts of parts of the
    cube may happen to look like it: a smooth trend, quadratic in the indices, is left to them, and how far octants of
    the cube tell the same is the covariance (the jackknife).

    Parameters
    ----------
    vertical : ndarray of shape (inline, crossline, sample), float32
        Vertical shifts, in samples.
    dip : ndarray of shape (2, inline, crossline, sample), float32
        Vertical shifts that a lateral shift less by a trace looks like.
    known : ndarray of bool
        Where they count.
    lateral : ndarray of shape (2,)
        Lateral shifts of the whole that they were found with, in traces.

    Returns
    -------
    lateral : ndarray of shape (2,)
        The lateral shift of the whole, in traces.
    covariance : ndarray of shape (2, 2)
        Its covariance.
    """
    thin = tuple(slice(None, None, -(-n // _MOST_PLACES)) for n in vertical.shape)
    vertical, dip, known = vertical[thin], dip[(slice(None), *thin)], known[thin]
    columns = np.stack([*dip, *_trend(vertical.shape)]).astype(np.float64) * known
    halves = [(slice(None, n // 2), slice(n // 2, None)) for n in vertical.shape]
    normals, rights = [], []
    for part in product(*halves):
        rows = columns[(slice(None), *part)].reshape(len(columns), -1)
        normals.append(rows @ rows.T)
        rights.append(rows @ vertical[part].ravel().astype(np.float64))
    normal, right = np.sum(normals, axis=0), np.sum(rights, axis=0)
    normal += _SHARE * max(float(known.sum()), 1.0) * np.eye(len(columns))
    found = np.linalg.solve(normal, right)[:2]
    without = np.stack([np.linalg.solve(normal - n, right - r)[:2] for n, r in zip(normals, rights, strict=True)])
    spread = (without - found) * np.sqrt(1.0 - 1.0 / len(without))
    precision = np.linalg.inv(spread.T @ spread + _ROUNDING * np.eye(2))
    covariance = np.linalg.inv(precision + np.eye(2) / _BEFORE**2)
    return covariance @ precision @ (lateral + found), np.asarray(covariance, np.float64)


def _trend(shape: tuple[int, ...]) -> list[Float64Array]:
    """Monomials up to the second degree."""
    axes = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    squares = [axes[a] * axes[b] for a in range(3) for b in range(a, 3)]
    return [np.ones(shape), *axes, *squares]
