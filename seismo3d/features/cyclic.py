r"""Compare descriptors under every cyclic shift at once, by Fourier transform over the shift.

For descriptors a, b of shape (T, d), :math:`s_k = \sum_t a_{t+k} \cdot b_t` has the transform
:math:`\hat s_f = \hat a_f \cdot \overline{\hat b_f}`: one small matrix product a frequency compares all pairs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array
from seismo3d.features import _kernels

# descriptors that are compared at a time: bounds the memory
_CHUNK = 8


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Pairs that survive: rows of target and source, similarity 0 to 1, distance ratio, and cyclic shift in radians."""

    target: Int64Array
    source: Int64Array
    similarity: Float64Array
    ratio: Float64Array
    shift: Float64Array


def _synthesis(n_satellites: int, n_shifts: int) -> tuple[Float32Array, Float32Array]:
    """Matrices (n_shifts, F) that turn real and imaginary parts of a half spectrum into values at all shifts."""
    f = np.arange(n_satellites // 2 + 1)[None]
    phase = 2.0 * math.pi * np.arange(n_shifts)[:, None] * f / n_shifts
    weight = np.where((f == 0) | (2 * f == n_satellites), 1.0, 2.0) / n_satellites
    return (weight * np.cos(phase)).astype(np.float32), (-weight * np.sin(phase)).astype(np.float32)


def _spectra(descriptors: Float32Array) -> AnyArray:
    """Half spectra over the shift, (F, n, d) complex64."""
    return np.ascontiguousarray(np.fft.rfft(descriptors, axis=1).transpose(1, 0, 2).astype(np.complex64))


def best_similarity(target: AnyArray, source: AnyArray, *, n_satellites: int, n_shifts: int = 32) -> Float32Array:
    """Best similarity over all cyclic shifts of all pairs of half spectra (F, n, d) and (F, m, d): (n, m), float32.

    Shifts +k and -k share the even part C and differ in the sign of the odd part S: the better of both is ``C + |S|``.
    """
    n_frequencies, n, _ = target.shape
    m = source.shape[1]
    even, odd = (part[: n_shifts // 2 + 1] for part in _synthesis(n_satellites, n_shifts))
    left = np.concatenate([target.real, target.imag], axis=2)
    right = np.concatenate([source.real, source.imag], axis=2).transpose(0, 2, 1).copy()
    turned = np.concatenate([-source.imag, source.real], axis=2).transpose(0, 2, 1).copy()
    best = np.empty((n, m), dtype=np.float32)
    for start in range(0, n, _CHUNK):
        rows = left[:, start : start + _CHUNK]
        real = np.matmul(rows, right).reshape(n_frequencies, -1)
        imaginary = np.matmul(rows, turned).reshape(n_frequencies, -1)
        values = even @ real
        values += np.abs(odd @ imaginary)
        best[start : start + _CHUNK] = values.max(axis=0).reshape(-1, m)
    return best


def _best_shift(first: AnyArray, second: AnyArray, rows: Int64Array, columns: Int64Array, t: int) -> Float64Array:
    """Shift of the best similarity of given pairs, in radians: zero-padded transform and a parabola."""
    n_fine = 8 * t
    product = np.einsum("fnd,fnd->nf", first[:, rows], second[:, columns].conj())
    even, odd = _synthesis(t, n_fine)
    values = product.real @ even.T + product.imag @ odd.T
    peak = values.argmax(axis=1)
    row = np.arange(len(peak))
    before, here, after = (values[row, (peak + k) % n_fine].astype(float) for k in (-1, 0, 1))
    bend = 2.0 * here - before - after
    offset = np.divide(after - before, 2.0 * bend, out=np.zeros_like(bend), where=bend > 1e-12)
    angle = 2.0 * math.pi * (peak + np.clip(offset, -0.5, 0.5)) / n_fine
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All descriptors of a target against all of a source.

    Attributes
    ----------
    target, source : ndarray of shape (F, n, d), (F, m, d), complex64
        Half spectra over the shift.
    similarity : ndarray of shape (n, m), float32
        At the best shift of each pair.
    n_satellites : int
        Shifts of a full turn.
    """

    target: AnyArray
    source: AnyArray
    similarity: Float32Array
    n_satellites: int


def compare_descriptors(target: Float32Array, source: Float32Array) -> Comparison:
    """Compare all descriptors (n, T, d) with all (m, T, d), unit vectors each, under all cyclic shifts."""
    first, second = _spectra(target), _spectra(source)
    if len(target) == 0 or len(source) == 0:
        return Comparison(first, second, np.empty((len(target), len(source)), np.float32), target.shape[1])
    similarity = best_similarity(first, second, n_satellites=target.shape[1])
    return Comparison(first, second, similarity, target.shape[1])


def pick_matches(
    compared: Comparison,
    points_target: Float64Array,
    points_source: Float64Array,
    *,
    max_ratio: float,
    apart: float,
    allowed: BoolArray | None = None,
) -> Candidates:
    """Mutual nearest neighbours, clearly nearer than the best competitor elsewhere.

    Parameters
    ----------
    compared : Comparison
        Of n descriptors with m.
    points_target, points_source : ndarray of shape (n, k), (m, k)
        Where they are.
    max_ratio : float
        Largest ratio of the distance to that of the best competitor, in both directions.
    apart : float
        A competitor lies further than this from the match, in pixels.
    allowed : ndarray of shape (n, m), bool, optional
        Pairs that may match, and compete; all where not given.

    Returns
    -------
    Candidates
        Shifts that carry the source's descriptor onto the target's.
    """
    table = compared.similarity if allowed is None else compared.similarity * allowed
    if table.size == 0:
        empty = np.empty(0, dtype=np.int64)
        return Candidates(empty, empty, *(np.empty(0) for _ in range(3)))
    forth, ratio_forth = _kernels.nearest_apart(table, points_source, apart)
    back, ratio_back = _kernels.nearest_apart(np.ascontiguousarray(table.T), points_target, apart)
    rows = np.arange(len(table))
    ratio = np.maximum(ratio_forth, ratio_back[forth])
    rows = rows[(back[forth] == rows) & (ratio <= max_ratio) & (table[rows, forth] > 0.0)]
    columns = forth[rows]
    shift = _best_shift(compared.target, compared.source, rows, columns, compared.n_satellites)
    return Candidates(rows, columns, table[rows, columns].astype(float), ratio[rows], shift)
