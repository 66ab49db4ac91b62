"""Seeds that touch a fault, moved along their layer to where it runs on undisturbed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse.csgraph import connected_components

from seismo3d._typing import AnyArray, BoolArray, Float64Array
from seismo3d.seismic.layer_parts import graph_of
from seismo3d.seismic.layer_pieces import LayerVolumes
from seismo3d.seismic.term_fits import fit_terms

# how far around a seed its layer is looked for, in traces and samples
_ACROSS, _DOWN = 8, 14
# voxels this close to a fault do not tell, nor do those so many samples above or below the seed; how many it takes
_BESIDE, _ABOVE, _LEAST = 2.0, 4.0, 60
# widths, in traces and samples, of the window in which they do
_WIDTH, _HEIGHT = 5.0, 3.0
# what keeps slopes, and changes of thickness, at nothing where a sliver does not tell them
_LEVEL, _EVEN = 1e-6, 1e-2
# voxels off all faults that are enough
_CLEAR = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """The voxels about a seed that no fault parts from it, in a box.

    Attributes
    ----------
    corner : (int, int, int)
        First voxel of the box.
    times : ndarray of shape (inline, crossline, sample), float32
        Layer time in the box.
    inside : ndarray of the same shape, bool
        Where the block is.
    apart : ndarray of the same shape, float64
        Distance in voxels from the nearest that touches a fault.
    """

    corner: tuple[int, int, int]
    times: AnyArray
    inside: BoolArray
    apart: Float64Array


def move_inwards(layers: LayerVolumes, index: Float64Array) -> Float64Array:
    """Move seeds that touch a fault along their layer, to traces of their block off it; leave all others.

    Next to a fault, which is placed to half a trace or worse, layer time is bent and waveforms hold some of what lies
    beyond. The layer time of the seed is that of the plane through the layer times of its block farther off, and the
    horizon passes there where they reach it.

    Parameters
    ----------
    layers : LayerVolumes
        Of the cube.
    index : ndarray of shape (n, 3), float64
        Seeds, as fractional indices.

    Returns
    -------
    ndarray of the same shape, float64
        A seed whose block is but a sliver stays where it is.
    """
    return np.array([_move_one(layers, at) for at in index])


def _move_one(layers: LayerVolumes, at: Float64Array) -> Float64Array:
    block = _block_around(layers, at)
    if block is None:
        return at
    level = _level_at(block, at)
    inner = None if level is None else _inner_point(block, level, at)
    return at if inner is None else inner


def _block_around(layers: LayerVolumes, at: Float64Array) -> _Block | None:
    """Return the block of a seed that touches a fault; None of others."""
    shape = np.array(layers.times.shape)
    middle = np.clip(np.rint(at).astype(int), 0, shape - 1)
    reach = np.array([_ACROSS, _ACROSS, _DOWN])
    low, high = np.maximum(middle - reach, 0), np.minimum(middle + reach + 1, shape)
    traces, samples = tuple(slice(a, b) for a, b in zip(low[:2], high[:2], strict=True)), slice(low[2], high[2])
    cuts = np.asarray(layers.cuts[traces])[:, :, samples]
    touching, ends = np.zeros(cuts.shape, bool), []
    numbers = np.arange(cuts.size).reshape(cuts.shape)
    for axis in range(3):
        ahead, behind = (tuple(s if k == axis else slice(None) for k in range(3)) for s in (slice(1, None), slice(-1)))
        cut = cuts[behind] >> axis & 1 > 0
        touching[ahead] |= cut
        touching[behind] |= cut
        ends.append(np.stack([numbers[behind][~cut], numbers[ahead][~cut]]))
    here = tuple(middle - low)
    if not touching[here]:
        return None
    graph = graph_of(np.concatenate(ends, axis=1), cuts.size)
    labels = connected_components(graph, directed=False)[1].reshape(cuts.shape)
    inside = (labels == labels[here]) & layers.live[traces][:, :, None]
    times = np.asarray(layers.times[traces])[:, :, samples]
    return _Block((low[0], low[1], low[2]), times, inside, ndimage.distance_transform_edt(~touching))


def _level_at(block: _Block, at: Float64Array) -> float | None:
    """Return the layer time that a block's voxels off the faults tell for a seed; None where they are too few."""
    away = np.indices(block.times.shape, dtype=np.float64)
    away += (np.array(block.corner) - at)[:, None, None, None]
    tells = block.inside & (block.apart > _BESIDE) & (np.abs(away[2]) <= _ABOVE)
    tells &= away[0] ** 2 + away[1] ** 2 <= _ACROSS**2
    if tells.sum() < _LEAST:
        return None
    i, j, k = away[:, tells]
    weight = np.exp(-0.5 * ((i**2 + j**2) / _WIDTH**2 + (k / _HEIGHT) ** 2))
    terms, rest = (np.ones_like(i), i, j, k), block.times[tells].astype(np.float64) - k
    factors, _ = fit_terms(terms, rest, weights=weight, ridge=(0.0, _LEVEL, _LEVEL, _EVEN))
    return float(factors[0])


def _inner_point(block: _Block, level: float, at: Float64Array) -> Float64Array | None:
    """Return where a block reaches a layer time off the faults, next to the seed; None where it does not."""
    above, below = block.times[:, :, :-1], block.times[:, :, 1:]
    crosses = block.inside[:, :, :-1] & block.inside[:, :, 1:] & (above <= level) & (below > level)
    if not crosses.any():
        return None
    i, j, k = np.nonzero(crosses)
    share = (level - above[i, j, k].astype(np.float64)) / (below[i, j, k].astype(np.float64) - above[i, j, k])
    points = np.column_stack([i, j, k + share]) + np.array(block.corner)
    apart = np.minimum(block.apart[i, j, k], _CLEAR)
    away = np.hypot(points[:, 0] - at[0], points[:, 1] - at[1])
    return np.asarray(points[np.lexsort((away, -apart))[0]])
