"""Cubes and sections made ready: amplitudes as a clean, whitened volume, and where there are data at all."""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array
from seismo3d._validate import as_array, as_strong
from seismo3d.errors import Seismo3dWarning, ShapeError
from seismo3d.geometry.axis import unit_of
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic._kernels_valid import mark_valid, same_as_next
from seismo3d.seismic.balancing import find_depth_gain, find_trace_gains, trace_likeness, trace_strengths
from seismo3d.seismic.cube_checks import check_order
from seismo3d.seismic.whitening import whiten

# samples of one value, and traces of the same values, from which on they are no data
_LONGEST_RUN = 12
_LEAST_REPEATS = 4
# share of the live traces that are unlike each other below which repeating is the cube's own: padding seldom doubles
# a survey, and layers drawn without noise have but one trace for a whole line, or a few for all of them
_LEAST_UNLIKE = 0.5
# share of the live traces with a live next one, along an axis, below which there is too little to compare
_LEAST_NEIGHBOURS = 0.5
# samples that a trace needs
_LEAST_SAMPLES = 16
# samples of the shortest period of note up to which windows suit reflections, and of one that they suit well
_LONGEST_PERIOD, _GOOD_PERIOD = 16.0, 7.0
# depths, at the least, that a cube's strength is told from
_LEAST_DEPTHS = 64
# how many times their own strength amplitudes must lie off zero for that to be a level of theirs
_SHIFTED = 1.0


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
        Sample interval and its unit: ``"ms"``, ``"m"``, ``"ft"`` or, where none is known, ``"samples"``.

    Raises
    ------
    ShapeError
        If the elements are no real numbers, or the array has other axes or is too small to compare traces in.
    ParameterError
        If amplitudes are too large or too small for single precision.
    """
    values = cube if hasattr(cube, "dims") and hasattr(cube, "dtype") else as_array(cube, "cube")
    sampling = describe_volume(values)
    amplitudes = as_strong(np.asarray(getattr(values, "values", values)), "cube")
    if amplitudes.ndim == 2:
        return amplitudes[None], None, sampling
    return amplitudes, SurveyGeometry.from_cube(cube), sampling


def describe_volume(cube: Any) -> tuple[float, str]:
    """Refuse what is too small to compare traces in, unread; return the sample interval and its unit."""
    name = "section" if cube.ndim == 2 else "cube"
    check_order(cube, name)
    if cube.dtype.kind not in "fiu":
        raise ShapeError(f"{name} has elements of type {cube.dtype}; expected real numbers. Convert it first.")
    if cube.ndim not in (2, 3):
        raise ShapeError(f"cube has shape {cube.shape}; expected (inline, crossline, sample) or (trace, sample).")
    least = (8,) * (cube.ndim - 1) + (_LEAST_SAMPLES,)
    if any(n < m for n, m in zip(cube.shape, least, strict=True)):
        has_line = cube.ndim == 3 and max(cube.shape[:2]) >= least[0] and cube.shape[2] >= least[2]
        remedy = "Give one line of it as a 2D section" if has_line else f"Give a larger {name}"
        raise ShapeError(f"{name} has shape {cube.shape}; expected at least {least}. {remedy}.")
    dims = getattr(cube, "dims", None)
    if dims is not None and dims[-1] in ("time", "depth") and dims[-1] in cube.coords:
        coordinate = cube[dims[-1]].values
        return float(coordinate[1] - coordinate[0]), unit_of(cube)
    return 1.0, "samples"


def clean_volume(
    amplitudes: Float32Array, *, carried: bool = False
) -> tuple[Float32Array, BoolArray, Float64Array | None, float]:
    """Mark where there are data, put zero elsewhere, take off what all amplitudes share, clip spikes, and whiten.

    Amplitudes that fall far with depth are raised there, and traces far off the strength of others are brought near it.

    Parameters
    ----------
    amplitudes : ndarray of shape (inline, crossline, sample), float32
        Written over.
    carried : bool
        Whether whitening carries traces on beyond their ends.

    Returns
    -------
    volume : ndarray of the same shape, float32
        Whitened amplitudes of a root-mean-square of about 1; zero where there are no data.
    valid : ndarray of the same shape, bool
        Where there are: NaN, constant runs, repeated traces and traces of noise alone are none; but where fewer than
        half of the live traces differ from each other, as in a noise-free synthetic, repeated traces are data.
    spectrum : ndarray of shape (n,), float64, or None
        As in :class:`~seismo3d.seismic.whitening.Whitening`.
    level : float
        What was taken off.
    """
    valid = find_valid(amplitudes)
    looked_at = np.arange(0, amplitudes.size, sampling_step(amplitudes.shape))
    looked_at = looked_at[valid.ravel()[looked_at]]
    n_samples = amplitudes.shape[2]
    scale = find_scaling(amplitudes.ravel()[looked_at], looked_at % n_samples, n_samples)
    scale_amplitudes(amplitudes, valid, scale)
    strengths = trace_strengths(amplitudes, valid)
    balance_traces(amplitudes, valid, find_trace_gains(strengths, trace_likeness(amplitudes, valid, strengths)))
    white, whitening = whiten(amplitudes, valid, carried=carried)
    check_period(whitening.period, n_samples)
    return white, valid, whitening.spectrum, scale.level


def refuse_dead(live: BoolArray, name: str = "cube") -> None:
    """Refuse a cube or section without any data."""
    if not live.any():
        raise ShapeError(
            f"{name} has no live trace: all are missing, or of one value throughout. Give a {name} with data."
        )


def check_live(live: BoolArray, *, is_section: bool = False) -> None:
    """Refuse a cube or section without any data, and warn where too few of its live traces have live neighbours."""
    refuse_dead(live, "section" if is_section else "cube")
    for axis, lines in enumerate(("inline", "trace" if is_section else "crossline")):
        along = np.moveaxis(live, axis, 0)
        share = float((along[1:] & along[:-1]).sum() / live.sum())
        if len(along) > 1 and share < _LEAST_NEIGHBOURS:
            warnings.warn(
                f"{100 * share:.0f} % of the live traces have a live one on the next {lines}; expected half or more. "
                "Faults are seen where neighbours differ: few are found. Leave out the empty lines, or fill them.",
                Seismo3dWarning,
                stacklevel=3,
            )


def check_period(period: float, n_samples: int) -> None:
    """Warn where samples are far denser than reflections need, whose shortest period of note is given, or too few."""
    if period > _LONGEST_PERIOD:
        every = int(period / _GOOD_PERIOD)
        remedy = (
            f"Give one of {every} samples (cube[..., ::{every}], or seismo3d convert --every {every}): no reflection "
            "is lost."
            if -(-n_samples // every) >= _LEAST_SAMPLES
            else "Traces are too short to be thinned: give longer ones, or check what is found on the sections."
        )
        warnings.warn(
            f"the shortest period of reflections is {period:.0f} samples long; expected 3 to {_LONGEST_PERIOD:.0f}, "
            f"which all windows are made for. {remedy}",
            Seismo3dWarning,
            stacklevel=3,
        )


def find_valid(amplitudes: Float32Array) -> BoolArray:
    """Mark where there are data in a whole cube, and put zero elsewhere."""
    valid, repeated = mark_data(amplitudes)
    if repeated.any() and not repeats_itself(print_traces(amplitudes), np.any(valid, axis=2)):
        leave_out(amplitudes, valid, repeated)
    return valid


def mark_data(amplitudes: Float32Array) -> tuple[BoolArray, BoolArray]:
    """Mark samples with data, and put zero elsewhere; mark repeated traces. Inlines are independent of each other."""
    valid = np.empty(amplitudes.shape, bool)
    mark_valid(amplitudes, _LONGEST_RUN, valid)
    repeated = _repeated(amplitudes, valid)
    amplitudes[~valid] = 0.0
    return valid, repeated


def leave_out(amplitudes: Float32Array, valid: BoolArray, traces: BoolArray) -> None:
    """Take traces for no data, in place."""
    valid[traces] = False
    amplitudes[traces] = 0.0


def print_traces(amplitudes: Float32Array) -> Int64Array:
    """Return a number for each trace that equal traces share, and others do not but for one chance in billions."""
    odd = np.random.default_rng(0).integers(2**64, size=amplitudes.shape[2], dtype=np.uint64) | np.uint64(1)
    bits = amplitudes.view(np.uint32)
    # a line at a time: whole numbers twice as wide as the samples
    return np.stack([line.astype(np.uint64) @ odd for line in bits]).view(np.int64)


def repeats_itself(prints: Int64Array, live: AnyArray) -> bool:
    """Tell from all traces of a cube whether they repeat by themselves, so that repeated ones are no padding."""
    return len(np.unique(prints[live])) < _LEAST_UNLIKE * int(np.count_nonzero(live))


def sampling_step(shape: tuple[int, ...]) -> int:
    """Return every how many samples a cube's amplitudes are looked at for their strength: at many depths, always."""
    step, n_samples = max(1, int(np.prod(shape, dtype=np.int64)) // 1_000_000), shape[-1]
    while n_samples // np.gcd(step, n_samples) < min(n_samples, _LEAST_DEPTHS):
        step += 1
    return step


class Scale(NamedTuple):
    """What a cube's amplitudes lie about, and how far off it nine tenths of them stay.

    Attributes
    ----------
    level, strength : float
        Of unsigned bytes the level is about 128; of amplitudes about zero it is 0. Both are 0 without any.
    gain : ndarray of shape (sample,), float32, or None
        What the amplitudes are multiplied by first, once the level is off.
    """

    level: float
    strength: float
    gain: Float32Array | None = None


def find_scale(sample: Float32Array) -> Scale:
    """Return the scale of some amplitudes (n,)."""
    if not sample.size:
        return Scale(0.0, 0.0)
    middle = float(np.median(sample))
    around = _most_of(np.abs(sample - np.float32(middle)))
    return Scale(middle, around) if abs(middle) > _SHIFTED * around else Scale(0.0, _most_of(np.abs(sample)))


def find_scaling(sample: Float32Array, depths: Int64Array, n_samples: int) -> Scale:
    """Return the scale of some amplitudes (n,), at these depths of traces of so many samples, and their gain."""
    scale = find_scale(sample)
    centred = sample - np.float32(scale.level)
    gain = find_depth_gain(centred, depths, n_samples)
    return scale if gain is None else Scale(scale.level, _most_of(np.abs(centred * gain[depths])), gain)


def find_level(amplitudes: AnyArray) -> float:
    """Return what amplitudes share, such as the 128 of unsigned bytes; 0 where they lie about zero.

    Parameters
    ----------
    amplitudes : ndarray
        Those of live traces; what is not finite does not count. Of many some are looked at.
    """
    with np.errstate(over="ignore"):  # too large for what is traced in: infinite, and not counted
        some = amplitudes.ravel()[:: sampling_step(amplitudes.shape)].astype(np.float32)
    return find_scale(some[np.isfinite(some)]).level


def scale_amplitudes(amplitudes: Float32Array, valid: BoolArray, scale: Scale) -> None:
    """Take off the level where there are data, put the gain on, and divide by the strength, in place."""
    if scale.level:
        np.subtract(amplitudes, np.float32(scale.level), out=amplitudes, where=valid)
    if scale.gain is not None:
        amplitudes *= scale.gain
    if scale.strength > 0.0:
        amplitudes /= np.float32(scale.strength)


def balance_traces(amplitudes: Float32Array, valid: BoolArray, gains: Float32Array | None = None) -> None:
    """Multiply scaled traces by their gains, if there are any, and clip spikes, in place; a gain of 0 is no data."""
    if gains is not None:
        amplitudes *= gains[..., None]
        valid &= gains[..., None] > 0.0
    np.clip(amplitudes, -8.0, 8.0, out=amplitudes)


def _most_of(sizes: Float32Array) -> float:
    return float(np.percentile(sizes, 90.0))


def _repeated(amplitudes: Float32Array, valid: BoolArray) -> BoolArray:
    """Mark runs of equal traces along an inline: padding and picture frames, not data."""
    same = np.zeros(amplitudes.shape[:2], bool)
    same_as_next(amplitudes, valid, same)
    pairs = _LEAST_REPEATS - 1
    kept = ndimage.binary_opening(np.pad(same, ((0, 0), (pairs, pairs))), np.ones((1, pairs), bool))[:, pairs:-pairs]
    kept[:, 1:] |= kept[:, :-1]
    return kept
