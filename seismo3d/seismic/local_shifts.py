"""Shifts between two cubes in local windows, by least squares, with what they are known to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.seismic.index_frame import settle_places

# misfit, as a share of the amplitudes, that cubes are taken to have at least: one shift a window leaves some where no
# noise is, and taken for less it is exchanged for lateral shifts along the dip, and for changes between the surveys
_LEAST_MISFIT = 0.1
# how wide windows are over which layers have one dip, beside those of the fit: vertical shifts may change so fast
_DIP_WINDOW = 0.5
# squared vertical derivative, beside that with noise and beside squared amplitudes of 1, that tells of a dip at least
_STEADY, _FLAT = 0.1, np.float32(1e-6)
# weights are taken to take at most so many times more of what shifts are told by than is left
_MOST_EXCESS = 2.0
# most that a step moves, in traces and samples
_MOST = (1.0, 1.0, 3.0)


@dataclass(frozen=True, slots=True, eq=False)
class LocalShifts:
    """Shifts from one cube to another.

    Attributes
    ----------
    shift, variance : ndarray of shape (3, inline, crossline, sample), float32
        In traces and samples, and the variances if the shift of the whole is as expected.
    follow : ndarray of shape (3, 2, inline, crossline, sample), float32
        How far shifts go along where the two lateral shifts expected of the whole are others.
    dip : ndarray of shape (2, inline, crossline, sample), float32
        Vertical shifts that a lateral shift less by a trace looks like.
    """

    shift: Float32Array
    variance: Float32Array
    follow: Float32Array
    dip: Float32Array


def refine_shifts(
    cubes: tuple[Float32Array, Float32Array], known: tuple[BoolArray, BoolArray], shift: Float32Array,
    whole: Float64Array, *, window: tuple[float, float, float], prior: tuple[float, float],
) -> LocalShifts:  # fmt: skip
    r"""One least-squares step in every window.

    Of the products of derivatives those of the noise are taken out, which are told by what the cubes do not share: with
    :math:`g` the mean of their gradients and :math:`d` half their difference, :math:`H = \sum w\,(g g^T - d d^T)` holds
    those of the signal alone where noise is independent, and :math:`G = \sum w\,g g^T` tells how the pull
    :math:`\sum w\,g\,r` scatters. The information on the shifts is then :math:`H G^{-1} H` over the misfit.

    Lateral shifts are told by what changes along the layers only, for the vertical shift may be another in each part of
    a window: a lateral shift is exchanged for it along the dip.

    Parameters
    ----------
    cubes : (ndarray, ndarray)
        Base and monitor, of unit strength.
    known : (ndarray, ndarray)
        Where they have data.
    shift : ndarray of shape (3, inline, crossline, sample), float32
        Shifts so far.
    whole : ndarray of shape (3,)
        Shift of the whole; the lateral ones are expected.
    window : (float, float, float)
        Widths of the Gaussian window, in traces and samples.
    prior : (float, float)
        Standard deviations that are expected: of the lateral shifts about those of the whole, and of the vertical one
        about its surroundings.

    Returns
    -------
    LocalShifts
    """
    target = cubes[0]
    carried, weight = carry(cubes[1], known[1], shift)
    weight *= known[0]
    trust, excess = _robust(target - carried, weight)
    weight *= trust
    gradient = np.stack([0.5 * (np.gradient(target, axis=k) + np.gradient(carried, axis=k)) for k in range(3)])
    noise = np.stack([0.5 * np.gradient(target - carried, axis=k) for k in range(3)])
    dip = _measure_dip(gradient, noise, weight, window)
    for values in (gradient, noise):
        values[:2] -= dip * values[2]
    scatter = _smooth_products(gradient, weight, window)
    signal = scatter - _smooth_products(noise, weight, window)
    residual = (target - carried) * weight
    right = np.stack([ndimage.gaussian_filter(g * residual, window) for g in gradient])
    share = np.maximum(ndimage.gaussian_filter(weight, window), np.float32(1e-6))
    misfit = ndimage.gaussian_filter(residual * residual, window) / share * np.float32(excess)
    misfit = np.maximum(misfit, np.float32(_LEAST_MISFIT**2))
    count = _count_free(gradient[2] * residual, window)
    scale = np.minimum(share, 1.0) / share * np.float32(count) / misfit
    around = np.stack(
        [np.full_like(shift[0], whole[0]), np.full_like(shift[1], whole[1]), _level(shift[2], share, window)]
    )
    around -= shift
    moved, variance = np.empty_like(shift), np.empty_like(shift)
    follow = np.empty((3, 2, *target.shape), np.float32)
    for i in range(len(target)):
        products = _as_matrices(signal[:, i]), _as_matrices(scatter[:, i])
        step, variance[:, i], follow[:, :, i] = _solve(products, right[:, i], scale[i], dip[:, i], around[:, i], prior)
        moved[:, i] = shift[:, i] + step
    return LocalShifts(moved, variance, follow, dip)


def _robust(residual: Float32Array, weight: Float32Array) -> tuple[Float32Array, float]:
    """Weights of Geman and McClure: what changed between the surveys, and ends of traces, must not pull.

    Beside them is what the weighted misfit is to be multiplied by, for weights take more of the noise than of what
    shifts are told by (Huber's variance of an M-estimator): 2.06 in Gaussian noise.
    """
    size = np.abs(residual[weight > 0][::7])
    cutoff = max(4.0 * float(np.median(size)) if len(size) else 1.0, _LEAST_MISFIT)
    square = (residual / np.float32(cutoff)) ** 2
    trust = 1.0 / (1.0 + square) ** 2
    mean = float((weight * trust).mean())
    bend = mean - float((weight * 4.0 * square / (1.0 + square) ** 3).mean())
    excess = (mean / max(bend, mean / _MOST_EXCESS)) ** 2 if mean > 0.0 else 1.0
    return np.asarray(trust, dtype=np.float32), excess


def _measure_dip(
    gradient: Float32Array, noise: Float32Array, weight: Float32Array, window: tuple[float, float, float]
) -> Float32Array:
    """Lateral derivatives over the vertical one, which small windows have in common."""
    small = tuple(_DIP_WINDOW * width for width in window)
    down = ndimage.gaussian_filter(weight * gradient[2] ** 2, small)
    floor = np.float32(_STEADY) * down + _FLAT
    down = np.maximum(down - ndimage.gaussian_filter(weight * noise[2] ** 2, small), floor)
    both = [
        ndimage.gaussian_filter(weight * (gradient[k] * gradient[2] - noise[k] * noise[2]), small) for k in range(2)
    ]
    return np.stack(both) / down


_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_PLACES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def _smooth_products(values: Float32Array, weight: Float32Array, window: tuple[float, float, float]) -> Float32Array:
    """Weighted products of three volumes with each other in windows: the upper triangle of a matrix, row by row."""
    return np.stack([ndimage.gaussian_filter(weight * values[a] * values[b], window) for a, b in _PAIRS])


def _as_matrices(triangle: Float32Array) -> Float32Array:
    return np.ascontiguousarray(np.moveaxis(triangle[_PLACES], (0, 1), (-2, -1)))


def _count_free(pull: Float32Array, window: tuple[float, float, float]) -> float:
    """Count independent pulls of a window, as they are like each other along the axes.

    At most quarter wavelengths of six samples, times pairs of traces: shifts themselves are uneven where noise is not.
    """
    count, power = 1.0, max(float(np.mean(pull * pull)), 1e-30)
    for axis, width in enumerate(window):
        lags = np.arange(1, min(int(2.0 * width), pull.shape[axis] - 1) + 1)
        lines = np.moveaxis(pull, axis, 0)
        alike = np.array([float(np.mean(lines[lag:] * lines[:-lag])) for lag in lags]) / power
        alike[np.logical_or.accumulate(alike < 0.0)] = 0.0  # beyond that it is chance
        length = 1.0 + 2.0 * float((alike * np.exp(-((lags / (2.0 * width)) ** 2))).sum())
        count *= max(1.0, 2.0 * np.sqrt(np.pi) * width / length)
    return min(count, max(1.0, 3.5 * window[2] / 6.0 * (3.5 * window[0] / 2.0) * (3.5 * window[1] / 2.0)))


def _solve(
    products: tuple[Float32Array, Float32Array], right: Float32Array, scale: Float32Array, dip: Float32Array,
    around: Float32Array, prior: tuple[float, float],
) -> tuple[Float32Array, Float32Array, Float32Array]:  # fmt: skip
    """Return steps to the shifts of largest posterior probability, their variances, and how they follow the whole.

    Unknown are the lateral shifts and the vertical one along the layers: that at a place less dip times lateral shifts.
    """
    (signal, scatter), diagonal = products, np.arange(3)
    expected = np.array([prior[0], prior[0], prior[1]], np.float32) ** -2
    scatter[..., diagonal, diagonal] += _FLAT
    gain = signal @ np.linalg.inv(scatter)
    precision = gain @ signal * scale[..., None, None]
    precision[..., diagonal, diagonal] += expected
    covariance = np.linalg.inv(precision)
    # steps as short as if noise were signal too: where noise is the stronger, what coarser levels told stands
    damped = scatter * scale[..., None, None]
    damped[..., diagonal, diagonal] += expected
    pull = np.einsum("...ab,b...->...a", gain, right) * scale[..., None] + expected * np.moveaxis(around, 0, -1)
    step = np.moveaxis(np.einsum("...ab,...b->...a", np.linalg.inv(damped), pull), -1, 0)
    step[2] -= (dip * step[:2]).sum(axis=0)
    limit = np.array(_MOST, np.float32)[:, None, None]
    turn = np.zeros_like(covariance)
    turn[..., diagonal, diagonal] = 1.0
    turn[..., 2, :2] = -np.moveaxis(dip, 0, -1)
    follow = turn @ covariance[..., :2] * expected[:2]
    variance = np.einsum("...ab,...bc,...ac->...a", turn, covariance, turn)
    return np.clip(step, -limit, limit), np.moveaxis(variance, -1, 0), np.moveaxis(follow, (-2, -1), (0, 1))


def _level(values: Float32Array, weight: Float32Array, window: tuple[float, float, float]) -> Float32Array:
    """Weighted mean of shifts over a wide window: what the prior expects."""
    wide = tuple(2.0 * width for width in window)
    share = np.maximum(ndimage.gaussian_filter(weight, wide), np.float32(1e-6))
    return np.asarray(ndimage.gaussian_filter(values * weight, wide) / share)


def measure_unevenness(shift: Float32Array, window: tuple[float, float, float]) -> Float32Array:
    """Return the mean square of shifts about their mean in a window: one shift cannot be nearer to all of them."""
    return np.stack([ndimage.gaussian_filter((s - ndimage.gaussian_filter(s, window)) ** 2, window) for s in shift])


def carry(volume: Float32Array, known: BoolArray, shift: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return amplitudes at the shifted places, and where these are known (1) or not (0)."""
    weights = ndimage.spline_filter(volume, order=3, output=np.float32, mode="mirror")
    out, weight = np.empty_like(volume), np.empty_like(volume)
    rest = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in volume.shape[1:]), indexing="ij")
    marks = None if known.all() else known.astype(np.float32)
    for i in range(len(out)):
        at = shift[:, i] + np.stack([np.full_like(rest[0], i), *rest])
        at, weight[i] = settle_places(at, volume.shape)
        out[i] = ndimage.map_coordinates(weights, at, order=3, mode="mirror", prefilter=False)
        if marks is not None:
            weight[i] *= ndimage.map_coordinates(marks, at, order=1, mode="nearest") > 0.99
    return out, weight
