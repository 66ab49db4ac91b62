"""Cubes and sections made ready: amplitudes as a clean, whitened volume, and where there are data at all."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.errors import ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic._kernels_valid import mark_valid, same_as_next
from seismo3d.seismic.whitening import whiten

# samples of one value, and traces of the same values, from which on they are no data
_LONGEST_RUN = 12
_LEAST_REPEATS = 4


def as_volume(cube: Any) -> tuple[Float32Array, SurveyGeometry | None, tuple[float, str]]:
    """Return a cube's or section's amplitudes as a volume of their own.

    Parameters
    ----------
    cube : DataArray or array_like
        Of two or three axes, the sample axis last.

    Returns
    -------
    amplitudes : ndarray of shape (inline, crossline, sample), float32
        A copy; a section is one inline.
    geometry : SurveyGeometry or None
        None for a section.
    sampling : tuple of (float, str)
        Sample interval and its unit: ``"ms"``, ``"m"`` or, for bare arrays, ``"samples"``.

    Raises
    ------
    ShapeError
        If the elements are no real numbers, or the array has other axes or is too small to hold a fault.
    """
    values = np.asarray(getattr(cube, "values", cube))
    if values.dtype.kind not in "fiu":
        raise ShapeError(f"cube has elements of type {values.dtype}; expected real numbers. Convert it first.")
    if values.ndim not in (2, 3):
        raise ShapeError(f"cube has shape {values.shape}; expected (inline, crossline, sample) or (trace, sample).")
    least = (8,) * (values.ndim - 1) + (16,)
    if any(n < m for n, m in zip(values.shape, least, strict=True)):
        raise ShapeError(f"cube has shape {values.shape}; expected at least {least}. A fault needs both its sides.")
    dims = getattr(cube, "dims", None)
    sampling = (1.0, "samples")
    if dims is not None and dims[-1] in ("time", "depth") and dims[-1] in cube.coords:
        coordinate = cube[dims[-1]].values
        sampling = (float(coordinate[1] - coordinate[0]), "ms" if dims[-1] == "time" else "m")
    if values.ndim == 2:
        return values[None].astype(np.float32), None, sampling
    return values.astype(np.float32), SurveyGeometry.from_cube(cube), sampling


def clean_volume(amplitudes: Float32Array) -> tuple[Float32Array, BoolArray]:
    """Mark where there are data, put zero elsewhere, clip spikes, and whiten.

    Parameters
    ----------
    amplitudes : ndarray of shape (inline, crossline, sample), float32
        Written over.

    Returns
    -------
    volume : ndarray of the same shape, float32
        Whitened amplitudes of a root-mean-square of about 1; zero where there are no data.
    valid : ndarray of the same shape, bool
        Where there are: NaN, constant runs and repeated traces are none.
    """
    valid = np.empty(amplitudes.shape, bool)
    mark_valid(amplitudes, _LONGEST_RUN, valid)
    valid[_repeated(amplitudes, valid)] = False
    amplitudes[~valid] = 0.0
    step = max(1, amplitudes.size // 1_000_000)
    sample = np.abs(amplitudes.ravel()[::step][valid.ravel()[::step]])
    strength = float(np.percentile(sample, 90.0)) if sample.size else 0.0
    if strength > 0.0:
        amplitudes /= np.float32(strength)
        np.clip(amplitudes, -8.0, 8.0, out=amplitudes)
    return whiten(amplitudes, valid), valid


def _repeated(amplitudes: Float32Array, valid: BoolArray) -> BoolArray:
    """Mark runs of equal traces along an inline: padding and picture frames, not data."""
    same = np.zeros(amplitudes.shape[:2], bool)
    same_as_next(amplitudes, valid, same)
    pairs = _LEAST_REPEATS - 1
    kept = ndimage.binary_opening(np.pad(same, ((0, 0), (pairs, pairs))), np.ones((1, pairs), bool))[:, pairs:-pairs]
    kept[:, 1:] |= kept[:, :-1]
    return kept
