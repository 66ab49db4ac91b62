"""Reflector slopes from the structure tensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from seismo3d._settings import Count, Share, Width
from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_filters import (
    Traces,
    derivative_taps,
    filter_traces,
    gaussian_taps,
    grow_traces,
    multiply_weighted,
    shift_traces,
    smooth,
    tensor_slopes,
)


@dataclass(frozen=True, slots=True)
class DipSettings:
    """How slopes are estimated; lengths in samples and traces.

    Attributes
    ----------
    derivative : float in [0.1, 100]
        Width of the Gaussian derivative.
    lateral, vertical : float in (0, 1000]
        Widths of the Gaussian over which the structure tensor is averaged.
    steepest : float in (0, 100]
        Largest slope, in samples a trace.
    rim : float in [0, 1]
        Weight of gradients whose window reaches beyond the cube, where its outermost values are repeated.
    slab : int in [1, 1000000]
        Inlines that are worked on at a time; bounds the memory.
    """

    derivative: Annotated[float, "[0.1, 100]"] = 1.0
    lateral: Width = 5.0
    vertical: Width = 8.0
    steepest: Annotated[float, "(0, 100]"] = 4.0
    rim: Share = 0.05
    slab: Count = 96


def estimate_slopes(
    volume: Float32Array, valid: BoolArray, *, settings: DipSettings | None = None
) -> tuple[Float32Array, Float32Array]:
    r"""Estimate how reflectors slope along inlines and crosslines.

    The structure tensor :math:`\langle w \nabla u \nabla u' \rangle` [1]_ has the reflector's normal :math:`n` as its
    leading eigenvector; the slopes are :math:`p = -n_0 / n_2` and :math:`q = -n_1 / n_2`. The leading eigenvector,
    unlike a least-squares slope, is not drawn to zero by noise.

    Parameters
    ----------
    volume : ndarray of shape (inline, crossline, sample), float32
        Amplitudes, finite everywhere.
    valid : ndarray of the same shape, bool
        False where there are no data; gradients there and beside there are left out.
    settings : DipSettings, optional
        Widths and limits.

    Returns
    -------
    p, q : ndarray of the same shape, float32
        Change of a reflector's sample from an inline to the next, and from a crossline to the next.

    References
    ----------
    .. [1] L. J. van Vliet, P. W. Verbeek, ASCI, 442-450, 1995.
    """
    settings = settings or DipSettings()
    p, q = np.empty_like(volume), np.empty_like(volume)
    reach = dip_reach(settings)
    for start in range(0, len(volume), settings.slab):
        stop = min(start + settings.slab, len(volume))
        low, high = max(0, start - reach), min(len(volume), stop + reach)
        ends = ((low == 0, high == len(volume)), (True, True))
        within = (slice(start - low, stop - low), slice(0, volume.shape[1]))
        p[start:stop], q[start:stop] = block_slopes(volume[low:high], valid[low:high], ends, settings, within)
    return p, q


def dip_reach(settings: DipSettings) -> int:
    """Return how many traces off a slope depends on."""
    return int(np.ceil(3.0 * settings.derivative)) + tensor_reach(settings) + 1


def tensor_reach(settings: DipSettings) -> int:
    """Return over how many traces to either side the structure tensor is averaged."""
    return len(gaussian_taps(settings.lateral)) // 2


def block_slopes(
    volume: Float32Array,
    valid: BoolArray,
    ends: tuple[tuple[bool, bool], tuple[bool, bool]],
    settings: DipSettings,
    within: Traces,
) -> tuple[Float32Array, Float32Array]:
    """Return the slopes at traces within a block, right where their `dip_reach` lies in it or beyond the cube.

    `ends` says, for inlines and for crosslines, whether the block's first and last are the cube's.
    """
    weight = _trusted(valid, int(np.ceil(1.5 * settings.derivative)))
    _weigh_rim(weight, settings, (*ends, (True, True)))
    around = grow_traces(within, (tensor_reach(settings),) * 2, volume.shape)
    weight = np.ascontiguousarray(weight[around])
    gradient = _gradient(volume, settings.derivative, around)
    inner = shift_traces(within, around)
    sigma = (settings.lateral, settings.lateral, settings.vertical)
    product = np.empty_like(weight)
    tensor = []
    for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        multiply_weighted(gradient[a], gradient[b], weight, product)
        tensor.append(smooth(product, sigma, within=inner))
    del product, gradient, weight
    p, q = np.empty_like(tensor[0]), np.empty_like(tensor[0])
    txx, txy, txz, tyy, tyz, tzz = tensor
    tensor_slopes(txx, txy, txz, tyy, tyz, tzz, np.float32(settings.steepest), p, q)
    return p, q


def _gradient(volume: Float32Array, sigma: float, within: Traces) -> tuple[Float32Array, Float32Array, Float32Array]:
    even, odd = gaussian_taps(sigma), derivative_taps(sigma)
    return (
        filter_traces(volume, odd, even, even, within=within),
        filter_traces(volume, even, odd, even, within=within),
        filter_traces(volume, even, even, odd, within=within),
    )


def _trusted(valid: BoolArray, reach: int) -> Float32Array:
    """1 where the gradient's own window holds data only, else 0."""
    weight = np.ones(valid.shape, np.float32)
    if valid.all():
        return weight
    box = np.ones(2 * reach + 1, np.float32)
    weight[filter_traces((~valid).astype(np.float32), box, box, box) > 0.5] = 0.0
    return weight


def _weigh_rim(weight: Float32Array, settings: DipSettings, ends: tuple[tuple[bool, bool], ...]) -> None:
    """Multiply the weights of gradients that reach beyond the cube; `ends` says where each axis ends with it."""
    reach = int(np.ceil(2.0 * settings.derivative))
    if settings.rim == 1.0:
        return
    for axis, (first, last) in enumerate(ends):
        along = np.moveaxis(weight, axis, 0)
        if len(along) <= 2 * reach:
            continue
        if first:
            along[:reach] *= np.float32(settings.rim)
        if last:
            along[-reach:] *= np.float32(settings.rim)
