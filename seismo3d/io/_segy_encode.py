"""Samples and headers as SEG-Y stores them."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Int64Array
from seismo3d._validate import as_single, tell_weak
from seismo3d.errors import GeometryError, Seismo3dWarning
from seismo3d.geometry.axis import METRES, Axis, check_downwards, length_unit_of, unit_of
from seismo3d.geometry.survey import usual_spacing
from seismo3d.io._segy_layout import set_header_field

_MAX_SHORT = 32767
LONGEST_INTERVAL = _MAX_SHORT / 1000
"""Longest sample interval that SEG-Y can hold, in ms, m or ft."""
# whole numbers up to which single precision holds all, and double precision does
_ALL_EXACT, _STILL_WHOLE = 2**24, 2**53
_MAX_LONG = 2**31 - 1
# what a number may be off a whole one
_OFF_WHOLE = 1e-6
# share of the distance between traces by which their coordinates may be off, rounded to whole numbers
_OFF = 0.05


def encode(values: AnyArray, code: int, fill: float) -> AnyArray:
    """Encode amplitudes to the 4-byte words of format 5 (IEEE) or 1 (IBM); what is not finite becomes ``fill``.

    Raises
    ------
    ParameterError
        If finite amplitudes are too large for single precision.
    """
    real = as_single(values, "cube")
    _tell_rounded(values, real)
    weak = tell_weak(values, "cube")
    if weak:
        warnings.warn(weak, Seismo3dWarning, stacklevel=2)
    finite = np.isfinite(real)
    if not finite.all():
        real = np.where(finite, real, np.float32(fill))
    return real.view(np.uint32) if code == 5 else ibm_words(real)


def _tell_rounded(values: AnyArray, real: AnyArray) -> None:
    """Warn of whole numbers that single precision rounds: the samples of a file of integers come back changed."""
    if values.dtype.itemsize < real.itemsize or values.dtype == real.dtype:
        return
    size = np.abs(values.astype(np.float64))
    whole = (size > _ALL_EXACT) & (size <= _STILL_WHOLE) & (values == np.rint(values))
    if (whole & (real != values)).any():
        warnings.warn(
            f"cube has whole numbers beyond {_ALL_EXACT}, which SEG-Y's 4-byte floats round to 7 digits. Write Zarr to "
            "keep them.",
            Seismo3dWarning,
            stacklevel=2,
        )


def ibm_words(values: AnyArray) -> AnyArray:
    """Encode finite float32 as IBM System/360 words: sign, base-16 exponent in excess 64, 24-bit fraction, rounded.

    What is below the smallest normal float32, 1.2e-38, becomes zero.
    """
    bits = np.ascontiguousarray(values, dtype=np.float32).view(np.uint32)
    binary = ((bits >> 23) & 0xFF).astype(np.int32)  # excess 126 of a fraction in [1/2, 1)
    power = (binary - 126 + 3) >> 2  # rounded up to a power of 16
    shift = (4 * power - (binary - 126)).astype(np.uint32)
    fraction: AnyArray = (bits & 0x7FFFFF) | 0x800000
    # half of the last bit that stays, added before the others fall off; a fraction that shifts has room for the carry
    fraction = (fraction + ((np.uint32(1) << shift) >> 1)) >> shift
    words = (bits & 0x80000000) | ((power + 64).astype(np.uint32) << 24) | fraction
    words[binary == 0] = 0
    return words


def sample_fields(volume: Any) -> dict[int, int]:
    """Return a trace header's fields of a cube's sample axis, by their first byte; refuse what they cannot hold."""
    check_downwards(volume)
    axis = Axis.from_coordinates(volume[volume.dims[-1]].values, str(volume.dims[-1]))
    if axis.n > 65535:
        raise GeometryError(
            f"cube has {axis.n} samples a trace; expected at most 65535, all that SEG-Y can count. Write Zarr instead."
        )
    interval = axis.step * 1000.0
    if not 0.5 <= interval <= _MAX_SHORT or abs(interval - round(interval)) * axis.n > 500.0:
        raise GeometryError(
            f"cube has a sample interval of {axis.step:g}; expected 0.001 to {LONGEST_INTERVAL} in whole "
            "thousandths, all that SEG-Y can hold. Resample it, or write Zarr."
        )
    delay, scalar = _start_fields(axis.first)
    return {109: delay, 115: axis.n, 117: round(interval), 215: scalar}


def _start_fields(start: float) -> tuple[int, int]:
    """Return the first sample as a whole number and its scalar; refuse one that they cannot hold."""
    for scalar in (0, -10, -100, -1000, -10000, 10, 100, 1000, 10000):
        factor = 1.0 / scalar if scalar > 0 else float(-scalar or 1)
        delay = round(start * factor)
        # coordinates may have been kept in single precision
        if abs(delay) <= _MAX_SHORT and abs(delay / factor - start) <= 1e-6 + 1e-7 * abs(start):
            return delay, scalar
    raise GeometryError(
        f"cube starts at {start:.10g}; expected a whole number of -32767 to 32767, times or over 1, 10, 100, 1000 or "
        "10000, all that SEG-Y can hold. Resample it to a start that is such a number, or write Zarr."
    )


def _check_units(volume: Any) -> None:
    """Refuse units that a file has no place for, and a depth and a map in two units: it has one for both."""
    unit, length_unit = unit_of(volume), length_unit_of(volume)
    if unit not in ("ms", "samples", *METRES):
        raise GeometryError(f"cube has {volume.dims[-1]} in {unit}; expected ms, m or ft. Convert it, or write Zarr.")
    if "cdp_x" in volume.coords and unit in METRES and unit != length_unit:
        raise GeometryError(
            f"cube has depth in {unit} and map coordinates in {length_unit}; SEG-Y has one unit for both. "
            "Convert one of them, or write Zarr."
        )


def fresh_file_header(volume: Any, code: int, title: str) -> bytes:
    """Make the textual and the binary header."""
    interval = sample_fields(volume)[117]
    binary = np.zeros(400, dtype=np.uint8)
    for byte, value in (
        (3217, interval),
        (3221, volume.shape[-1]),
        (3225, code),
        (3229, 4),
        (3255, 2 if "ft" in (unit_of(volume), length_unit_of(volume)) else 1),
        (3501, 0x0100),
        (3503, 1),
    ):
        binary[byte - 3201 : byte - 3199] = np.array([value], dtype=">u2").view(np.uint8)
    lines = _text_lines(volume, title)
    lines += [""] * (38 - len(lines)) + ["SEG Y REV1", "END TEXTUAL HEADER"]
    text = "".join(f"C{number:2d} {line}"[:80].ljust(80) for number, line in enumerate(lines, start=1))
    return text.encode("cp037", errors="replace") + binary.tobytes()


def _text_lines(volume: Any, title: str) -> list[str]:
    vertical = str(volume.dims[-1])
    first, last = float(volume[vertical][0]), float(volume[vertical][-1])
    unit = volume.attrs.get("sample_unit", "samples")
    lines = [title or f"{volume.name or 'Amplitude'} written by seismo3d", f"Domain: {vertical}"]
    for name in volume.dims[:-1]:
        values = volume[name].values
        lines.append(f"{str(name).capitalize()}s {values[0]} to {values[-1]}, {values.size} of them")
    lines.append(f"{vertical.capitalize()} {first:g} to {last:g} {unit}, {volume.shape[-1]} samples")
    lines.append("Trace header bytes: inline 189, crossline 193, CDP X 181, CDP Y 185,")
    lines.append(f"  scalar 71 (negative divides), first sample 109 ({unit})")
    return lines


def fresh_heads(part: Any, keep: Int64Array, n_before: int, *, factor: int) -> AnyArray:
    """Make the trace headers of some traces of a block; ``keep`` are their numbers in it, inline by inline.

    Map coordinates are written in whole numbers, ``factor`` times themselves.
    """
    heads = np.zeros((keep.size, 240), dtype=np.uint8)
    number = n_before + 1 + np.arange(keep.size)
    fields: dict[int, Any] = {1: number, 5: number, 29: 1, **sample_fields(part)}
    if part.ndim == 3:
        i, j = np.divmod(keep, part.shape[1])
        fields |= {9: part["inline"].values[i], 21: part["crossline"].values[j]}
        fields |= {189: fields[9], 193: fields[21]}
    else:
        fields[21] = part["cdp"].values[keep] if "cdp" in part.coords else number
        for byte, name in ((189, "inline"), (193, "crossline")):
            if name in part.coords:
                fields[byte] = part[name].values[keep]
    if "cdp_x" in part.coords and "cdp_y" in part.coords:
        fields |= _coordinate_fields(part, keep, factor)
    for byte, value in fields.items():
        set_header_field(heads, byte, value, little_endian=False)
    return heads


def _check_lines(volume: Any) -> None:
    """Refuse line and CDP numbers that are not whole, or larger than SEG-Y can hold."""
    for name in ("inline", "crossline", "cdp"):
        if name not in volume.coords:
            continue
        numbers = np.asarray(volume[name].values, dtype=np.float64)
        bad = ~(np.abs(numbers - np.rint(numbers)) <= _OFF_WHOLE) | (np.abs(numbers) > _MAX_LONG)
        if bad.any():
            raise GeometryError(
                f"cube has {name} {numbers[bad][0]:g}; expected whole numbers of at most {_MAX_LONG}, all that SEG-Y "
                "can hold. Number the lines anew, or write Zarr."
            )


def check_fresh(volume: Any) -> int:
    """Refuse a cube that headers cannot be made for; return what its map coordinates are multiplied by."""
    sample_fields(volume)
    _check_units(volume)
    _check_lines(volume)
    return _coordinate_factor(volume)


def _coordinate_factor(volume: Any) -> int:
    """Return what map coordinates are multiplied by to become whole numbers; refuse those that SEG-Y cannot hold."""
    if "cdp_x" not in volume.coords or "cdp_y" not in volume.coords:
        return 1
    xy = np.stack([np.asarray(volume[name].values, dtype=np.float64) for name in ("cdp_x", "cdp_y")], axis=-1)
    largest = float(np.nanmax(np.abs(xy), initial=0.0))
    held = [factor for factor in (100, 1000, 10000, 10, 1) if largest * factor < _MAX_LONG]
    if not held:
        raise GeometryError(
            f"cube has map coordinates up to {largest:g}; expected less than 2147483647, all that SEG-Y can hold."
        )
    spacing = usual_spacing(xy)
    factor = next((factor for factor in held if 0.5 / factor <= _OFF * spacing), None)
    if factor is None:
        raise GeometryError(
            f"cube has traces {spacing:g} apart on the map, at coordinates up to {largest:g}: less than the whole "
            "numbers of SEG-Y can tell. Project degrees to metres, take off an origin, or drop cdp_x and cdp_y."
        )
    return factor


def _coordinate_fields(part: Any, keep: Int64Array, factor: int) -> dict[int, Any]:
    xy = [np.asarray(part[name].values, dtype=np.float64).ravel()[keep] for name in ("cdp_x", "cdp_y")]
    x, y = (np.rint(np.where(np.isfinite(values), values, 0.0) * factor).astype(np.int64) for values in xy)
    return {71: -factor if factor > 1 else 1, 89: 1, 73: x, 77: y, 181: x, 185: y}
