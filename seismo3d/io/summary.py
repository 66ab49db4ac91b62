"""What a cube is, in plain values: geometry, formats, amplitude range, dead and missing traces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.geometry.axis import length_unit_of
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry
from seismo3d.io._as_cube import as_cube

_SAMPLED_ABOVE = 2 * 2**30
_N_BLOCKS = 12
# bytes read at once, and measured at once
_SLAB, _PART = 64 * 2**20, 4 * 2**20


def summarise(cube: Any) -> dict[str, Any]:
    """Describe a cube or a section in values that JSON can hold.

    Amplitudes of a cube above 2 GiB are those of a dozen inlines (traces, in a section) evenly spread over it, and
    ``sampled`` says so; everything else is exact.

    Parameters
    ----------
    cube : DataArray or array
        As :func:`seismo3d.open_cube` gives it.

    Returns
    -------
    dict
        With the keys ``path``, ``file_format``, ``kind`` ("cube" or "line"), ``shape``, ``axes``, ``amplitude``,
        ``traces``, ``map``, ``notes`` and, for SEG-Y, ``segy``.
    """
    volume = as_cube(cube)
    attrs = volume.attrs
    vertical = str(volume.dims[-1])
    out: dict[str, Any] = {
        "path": attrs.get("path"),
        "file_format": attrs.get("file_format"),
        "kind": "cube" if volume.ndim == 3 else "line",
        "shape": list(volume.shape),
        "size_bytes": int(volume.nbytes),
        "dtype": str(volume.dtype),
        "domain": vertical,
        "domain_reason": attrs.get("domain_reason"),
        "unit": attrs.get("sample_unit"),
        "axes": {str(d): _axis(volume[d].values) for d in volume.dims},
    }
    is_sampled = volume.nbytes > _SAMPLED_ABOVE
    counted = [(_amplitudes(part), _counts(part)) for part in _parts(volume, is_sampled=is_sampled)]
    out["amplitude"] = _amplitude([entry for entry, _ in counted], is_sampled=is_sampled)
    out["traces"] = _traces([entry for _, entry in counted], attrs, is_sampled=is_sampled)
    out["map"] = _map(volume)
    if "segy_path" in attrs:
        keys = (
            "sample_format",
            "header_bytes",
            "inline_byte",
            "crossline_byte",
            "x_byte",
            "y_byte",
            "sorting",
            "n_traces",
        )
        out["segy"] = {key: attrs.get(key) for key in keys}
    out["notes"] = list(attrs.get("notes", []))
    return out


def _axis(values: AnyArray) -> dict[str, Any]:
    step = float(np.median(np.diff(values))) if values.size > 1 else None
    return {"first": _plain(values[0]), "last": _plain(values[-1]), "step": _plain(step), "n": int(values.size)}


def _plain(value: Any) -> Any:
    if value is None:
        return None
    number = float(value)
    return int(number) if number.is_integer() else number


def _parts(volume: Any, *, is_sampled: bool) -> Iterator[AnyArray]:
    """Parts of the cube along its first axis: all of it, a few at a time in memory, or a dozen lines of a large one."""
    n = volume.shape[0]
    if is_sampled:
        for k in np.unique(np.linspace(0, n - 1, _N_BLOCKS).astype(int)):
            yield np.asarray(volume[int(k) : int(k) + 1].data)
        return
    block = max(1, _SLAB // max(1, volume[:1].nbytes))
    for k in range(0, n, block):
        slab = np.asarray(volume[k : k + block].data)
        yield from np.array_split(slab, min(len(slab), 1 + slab.nbytes // _PART))


def _amplitudes(part: AnyArray) -> tuple[int, int, float, float, float, float]:
    """Count of samples and of bad ones, smallest, largest, sum, and root of the sum of squares."""
    finite = np.isfinite(part)
    values = part[finite].astype(np.float64)
    # NaN throughout a trace is a missing trace, not a bad sample
    n_bad = int((~finite).sum() - (~finite.any(axis=-1)).sum() * part.shape[-1])
    low, high = values.min(initial=np.inf), values.max(initial=-np.inf)
    total = float(values.sum())
    # squares of what double precision holds may be beyond it
    peak = max(float(high), -float(low), 0.0)
    values /= peak or 1.0
    return values.size, n_bad, float(low), float(high), total, peak * math.sqrt(float(values @ values))


def _amplitude(rows: list[tuple[int, int, float, float, float, float]], *, is_sampled: bool) -> dict[str, Any]:
    sizes, bad, lows, highs, totals, roots = zip(*rows, strict=True)
    n, n_bad = sum(sizes), sum(bad)
    if n == 0:
        return {"min": None, "max": None, "mean": None, "rms": None, "n_not_finite": n_bad, "sampled": is_sampled}
    out = {"min": min(lows), "max": max(highs), "mean": sum(totals) / n, "rms": math.hypot(*roots) / math.sqrt(n)}
    return out | {"n_not_finite": n_bad, "sampled": is_sampled}


def _counts(part: AnyArray) -> tuple[int, int, int]:
    """Count of traces, of missing and of dead ones."""
    return part[..., 0].size, int(np.isnan(part).all(axis=-1).sum()), int((part == 0).all(axis=-1).sum())


def _traces(rows: list[tuple[int, int, int]], attrs: dict[str, Any], *, is_sampled: bool) -> dict[str, Any]:
    total, missing, dead = (sum(column) for column in zip(*rows, strict=True))
    return {
        "bins_looked_at": total,
        "missing": int(attrs.get("n_missing", missing)) if is_sampled else missing,
        "dead": dead,
        "duplicate": int(attrs.get("n_duplicates", 0)),
        "sampled": is_sampled,
    }


def _map(volume: Any) -> dict[str, Any] | None:
    if volume.ndim == 2:
        unit, xy = length_unit_of(volume), SectionGeometry.from_cube(volume).xy
        if xy is None:
            return None
        length = float(np.hypot(*np.diff(xy, axis=0).T).sum())
        return {"unit": unit, "first": xy[0].tolist(), "last": xy[-1].tolist(), f"length_{unit}": length}
    survey = SurveyGeometry.from_cube(volume)
    if survey.map_fit is None:
        return None
    n_il, n_xl = volume.shape[:2]
    corners = survey.index_to_map([[0, 0, 0], [0, n_xl - 1, 0], [n_il - 1, n_xl - 1, 0], [n_il - 1, 0, 0]])[:, :2]
    return {
        "unit": survey.length_unit,
        f"bin_size_{survey.length_unit}": list(survey.bin_size),
        "inline_axis_azimuth_deg": survey.inline_axis_azimuth_deg,
        "crossline_axis_azimuth_deg": survey.crossline_axis_azimuth_deg,
        "right_handed": survey.is_right_handed,
        f"fit_rms_{survey.length_unit}": survey.map_fit.rms,
        "corners": corners.tolist(),
    }
