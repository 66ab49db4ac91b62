"""Displacements on a cube's grid: made of the jumps across faults, one after another, and applied to amplitudes."""

from __future__ import annotations

import numpy as np
from scipy import fft, ndimage

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int64Array
from seismo3d._validate import as_single, freeze
from seismo3d.seismic.index_frame import settle_places

# steps by which a place is found that a displacement takes to a point
_PULLS = 12


def solve_jumps(
    edges: Int64Array, jumps: Float64Array, shape: tuple[int, ...], *, n_steps: int, tolerance: float
) -> tuple[Float32Array, float]:
    """Return a smooth displacement whose differences along edges are the jumps, and what is missing of them.

    Poisson's equation is solved by cosine transforms, and again with what is missing added (Bregman iteration). The
    mean of the displacement is zero. The grid is made a little larger where its lengths have large prime factors, for
    the sake of the transforms.

    Parameters
    ----------
    edges : ndarray of shape (e,), int64
        As :func:`~seismo3d.seismic.fault_links.find_crossings` numbers them; all others have no jump.
    jumps : ndarray of shape (e, 3), float64
        In traces and samples.
    shape : tuple of int
        The grid's.
    n_steps : int
        Most solutions.
    tolerance : float
        Root mean square of what is missing at which it ends.
    """
    size, wide = int(np.prod(shape)), tuple(fft.next_fast_len(n, real=True) for n in shape)
    place = np.stack(np.unravel_index(edges % size, shape))
    tail = np.ravel_multi_index(tuple(place), wide)
    head = tail + np.array([wide[1] * wide[2], wide[2], 1])[edges // size]
    field = np.zeros((3, *wide), np.float32)
    inverse = _inverse_laplacian(wide)
    asked = np.zeros_like(jumps)
    left = jumps
    missing = float(np.sqrt(np.mean(np.square(left)))) if len(edges) else 0.0
    for _ in range(n_steps):
        if missing <= tolerance:
            break
        asked += left
        for k in range(3):
            source = np.bincount(head, weights=asked[:, k], minlength=inverse.size)
            source -= np.bincount(tail, weights=asked[:, k], minlength=inverse.size)
            spectrum = fft.dctn(source.reshape(wide).astype(np.float32), type=2, norm="ortho", workers=-1)
            spectrum *= inverse
            field[k] = fft.idctn(spectrum, type=2, norm="ortho", workers=-1)
        flat = field.reshape(3, -1)
        left = jumps - (flat[:, head] - flat[:, tail]).T
        missing = float(np.sqrt(np.mean(np.square(left))))
    field = field[:, : shape[0], : shape[1], : shape[2]]
    return np.ascontiguousarray(field - field.mean(axis=(1, 2, 3), keepdims=True)), missing


def _inverse_laplacian(shape: tuple[int, ...]) -> Float32Array:
    """One over the eigenvalues of the grid's Laplacian for cosines; 0 for the constant."""
    waves = np.meshgrid(*(2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in shape), indexing="ij", sparse=True)
    total = waves[0] + waves[1] + waves[2]
    total[0, 0, 0] = np.inf
    return (1.0 / total).astype(np.float32)


def follow_on(today: Float32Array, step: Float32Array) -> Float32Array:
    """Return the displacement by a step and from there on to today."""
    out = step.copy()
    shape = step.shape[1:]
    grid = np.stack(np.meshgrid(*(np.arange(n, dtype=np.float32) for n in shape[1:]), indexing="ij"))
    for i in range(shape[0]):
        at = step[:, i] + np.concatenate([np.full((1, *grid.shape[1:]), i, np.float32), grid])
        for k in range(3):
            out[k, i] += ndimage.map_coordinates(today[k], at, order=1, mode="nearest")
    return out


def places_before(step: Float32Array, points: Float64Array) -> Float64Array:
    """Find the places that a displacement takes to points of shape (n, 3), by fixed-point iteration."""
    places = points
    for _ in range(_PULLS):
        places = points - read_displacement(step, places)
    return places


def read_displacement(step: Float32Array, points: Float64Array) -> Float32Array:
    """Return a displacement at points of shape (n, 3); off its grid that of the grid's end."""
    parts = [ndimage.map_coordinates(part, points.T, order=1, mode="nearest") for part in step]
    return np.stack(parts, axis=1)


def carry_amplitudes(values: AnyArray, displacement: Float32Array) -> Float32Array:
    """Return the amplitudes at the displaced places, inline by inline.

    Parameters
    ----------
    values : ndarray of shape (inline, crossline, sample)
        A cube; NaN where there is no data.
    displacement : ndarray of shape (3, inline, crossline, sample), float32
        In traces and samples.

    Returns
    -------
    ndarray of the cube's shape, float32
        By cubic interpolation; 0 where the cube holds no data for a place, NaN on traces without any.
    """
    known = np.isfinite(values)
    missing = ~known.any(axis=2)
    filled = as_single(np.where(known, values, 0.0), "cube")
    # by a power of two, which changes no digit: near the largest numbers the spline's weights would not be finite
    power = int(np.frexp(np.abs(filled).max(initial=0.0))[1])
    filled = np.ldexp(filled, -power)
    weights = ndimage.spline_filter(filled, order=3, output=np.float32, mode="mirror")
    holes = None if known.all() else known.astype(np.float32)
    out = np.empty(filled.shape, np.float32)
    grid = np.stack(np.meshgrid(*(np.arange(n, dtype=np.float32) for n in filled.shape[1:]), indexing="ij"))
    for i in range(len(out)):
        at = displacement[:, i] + np.concatenate([np.full((1, *grid.shape[1:]), i, np.float32), grid])
        at, inside = settle_places(at, filled.shape)
        out[i] = ndimage.map_coordinates(weights, at, order=3, mode="mirror", prefilter=False)
        if holes is not None:
            inside &= ndimage.map_coordinates(holes, at, order=1, mode="nearest") > 0.99
        out[i][~inside] = 0.0
    most = np.finfo(np.float32).max
    with np.errstate(over="ignore"):
        out = np.clip(np.ldexp(out, power), -most, most)
    out[missing] = np.nan
    return freeze(out)
