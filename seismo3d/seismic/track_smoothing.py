"""A horizon as a stiff surface: traces whose waveforms a fault cuts short go where those around them lead."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float64Array, IntArray
from seismo3d.seismic._kernels_track_smoothing import stiffen
from seismo3d.seismic._kernels_tracks import weigh_runs
from seismo3d.seismic.layer_parts import are_cut
from seismo3d.seismic.layer_pieces import LayerVolumes, layer_pieces, neighbours
from seismo3d.seismic.track_pieces import are_joined

# power of the share of its window on its side of faults by which a trace counts: about what its matches scatter by
_SHARED = 5.0
# what a trace counts at least, and one beside a fault, of what it would elsewhere
_LEAST, _BESIDE = 1e-3, 0.1
# misfit, in samples, from which on a surface is near enough to its solution; and the most steps to it
_TOLERANCE, _MOST = 1e-5, 2000


def link_traces(layers: LayerVolumes, depth: Float64Array, parts: IntArray, step: float) -> AnyArray:
    """Tell from which traces a horizon goes on to the next: bit 0 to the next inline, bit 1 to the next crossline.

    It does within a part, where no fault passes and it does not jump; `step` as for
    :func:`~seismo3d.seismic.track_pieces.are_joined`.
    """
    linked = np.zeros(depth.shape, np.uint8)
    last = layers.times.shape[2] - 1
    k: IntArray = np.clip(np.rint(np.nan_to_num(depth)).astype(np.int64), 0, last)
    for axis in range(2):
        a, b = neighbours(axis)
        joined = (parts[a] >= 0) & (parts[a] == parts[b]) & are_joined(depth, step, axis)
        rows, columns = np.nonzero(joined)
        cut = are_cut(layers.cuts, rows, columns, k[a][joined], k[b][joined], axis)
        joined[joined] = ~cut
        linked[a] |= joined.astype(np.uint8) << np.uint8(axis)
    return linked


def find_rims(linked: AnyArray, parts: IntArray, free: BoolArray, rim: int) -> BoolArray:
    """Tell which traces of a horizon are within `rim` of where it ends, or is broken by a fault.

    What is free is none of it, but ends nothing either, as are the edges of the cube.
    """
    there = parts >= 0
    ends = np.zeros(parts.shape, np.bool_)
    for axis in range(2):
        a, b = neighbours(axis)
        broken = (linked[a] & (1 << axis)) == 0
        ends[a] |= broken & there[a] & ~free[b]
        ends[b] |= broken & there[b] & ~free[a]
    if not ends.any():
        return ends
    return np.asarray(there & (ndimage.distance_transform_edt(~ends) < rim), np.bool_)


def find_shares(layers: LayerVolumes, depth: Float64Array, *, near: int, clear: int) -> Float64Array:
    """Return which share of its window every trace has on its side of faults, `clear` samples off them, 0 to 1.

    An end of the cube takes nothing from it: it mixes nothing in.
    """
    share = np.empty(depth.shape)
    taper = np.hanning(2 * near + 3)[1:-1]
    for at, (cuts,) in layer_pieces(layers, "cuts"):
        weigh_runs(cuts, depth[at], taper, clear, share[at])
    return share


def weigh_traces(share: Float64Array, rims: BoolArray) -> Float64Array:
    """How much every trace tells of a horizon's depth, 0 to 1.

    The less of its window a fault leaves, the more what lies beyond is mixed into it, and the less can thicker layers
    be told from deeper ones.
    """
    return np.asarray(np.maximum(share**_SHARED * np.where(rims, _BESIDE, 1.0), _LEAST))


def fit_stiffly(values: Float64Array, weights: Float64Array, linked: AnyArray, stiffness: float) -> Float64Array:
    r"""Lay a stiff surface through depths.

    It minimises :math:`\sum w (u - z)^2 + \lambda \sum (u_{xx}^2 + 2 u_{xy}^2 + u_{yy}^2)`: misfit and the bending
    energy of a thin plate [1]_. Second differences are taken where the horizon goes on from trace to trace; a part is
    led on beyond what is told of it as a plate would be.

    Parameters
    ----------
    values : ndarray of shape (inline, crossline), float64
        Depths :math:`z` in samples; NaN where there is no horizon.
    weights : ndarray of the same shape, float64
        Their weights :math:`w`, above 0.
    linked : ndarray of the same shape, uint8
        From :func:`link_traces`.
    stiffness : float
        :math:`\lambda`, in traces to the fourth power: details much smaller than its fourth root are smoothed out where
        weights are 1.

    Returns
    -------
    ndarray of the same shape, float64
        :math:`u`; NaN where the values are.

    References
    ----------
    .. [1] G. Wahba, Spline Models for Observational Data, SIAM, 1990, chapter 2.
    """
    there = np.isfinite(values)
    out = np.empty(values.shape)
    kept = np.where(there, weights, 0.0)
    stiffen(np.where(there, values, 0.0), kept, linked, stiffness, _TOLERANCE, _MOST, out)
    return np.where(there, out, np.nan)
