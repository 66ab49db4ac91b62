"""The sample axis of a SEG-Y file: time or depth, its interval and its start, and why."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, IntArray
from seismo3d._validate import as_number, is_among, told
from seismo3d.errors import FormatError, ParameterError
from seismo3d.geometry.survey import Axis
from seismo3d.io._segy_layout import SegyLayout, read_fields

# what says depth (positive) or time (negative), and how much it weighs
_HINTS: tuple[tuple[str, int, str], ...] = (
    (
        r"depth[- ]to[- ]time|(stretched|converted|scaled) (back )?to time",
        -4,
        "text header: converted to time",
    ),
    (r"time[- ]to[- ]depth|(stretched|converted|scaled) to depth", 4, "text header: converted to depth"),
    (r"domain\s*[:=]?\s*depth|depth domain|z[- ]?domain\s*[:=]?\s*depth", 4, "text header: depth domain"),
    (r"domain\s*[:=]?\s*(twt|time)|(twt|time) domain", -4, "text header: time domain"),
    (
        (
            r"depth (min|max|range|interval|step)|"
            r"(sample|z) (interval|rate|unit)s?\s*[:=]?\s*[\d.]*\s*(m|metre|meter|ft|feet)s?\b"
        ),
        2,
        "text header: depth range",
    ),
    (
        r"time (min|max|range)|(sample|z) (interval|rate|unit)s?\s*[:=]?\s*[\d.]*\s*(ms|msec|us)\b",
        -2,
        "text header: time range",
    ),
    (r"\bpsdm\b|depth[- ]migrat|pre-?stack depth", 2, "text header: depth migration"),
    (r"\bpstm\b|time[- ]migrat|pre-?stack time", -2, "text header: time migration"),
)
_USUAL_INTERVAL_MS = 4.0
# interval from which on it is too coarse for time in ms, and speaks for depth
_COARSE_MS = 10.0
# traces whose headers are asked where they start
_N_STARTS = 4096
# share of a sample by which starts may differ from a whole one and still be one
_SAME = 0.001


@dataclass(frozen=True, slots=True)
class SampleAxis:
    """The sample axis, and what it was judged by.

    Attributes
    ----------
    axis : Axis
        In ms, m or ft.
    domain, unit : str
        "time" and "ms", or "depth" and "m" or, in a survey in feet, "ft".
    reason : str
        Why time, or why depth.
    notes : tuple of str
        Where headers were odd, what was decided.
    """

    axis: Axis
    domain: str
    unit: str
    reason: str
    notes: tuple[str, ...] = ()


def sample_axis(
    layout: SegyLayout, *, domain: str | None = None, interval: float | None = None, start: float | None = None
) -> SampleAxis:
    """Read the sample axis from the headers; what the caller gives wins.

    Parameters
    ----------
    layout : SegyLayout
        The file.
    domain : {"time", "depth"}, optional
        What the samples run along.
    interval, start : float, optional
        Sample interval and first sample, in ms, m or ft.
    """
    if domain is not None and not is_among(domain, ("time", "depth")):
        raise ParameterError(f"domain is {told(domain)}; expected 'time' or 'depth'.")
    notes: list[str] = []
    step = as_number(interval, "interval", low=0, strict=True) if interval is not None else _interval(layout, notes)
    first = as_number(start, "start") if start is not None else _start(layout, notes)
    reason = "as given"
    if domain is None:
        domain, reason = judge_domain(layout, step)
    axis = Axis(first, step, layout.n_samples)
    return SampleAxis(axis, domain, "ms" if domain == "time" else layout.length_unit, reason, tuple(notes))


def judge_domain(layout: SegyLayout, interval: float, *, by_name: bool = True) -> tuple[str, str]:
    """Tell time from depth by the textual header, the interval, and else the file's name; time where nothing speaks."""
    text = re.sub(r"\s+", " ", layout.text.lower())
    found = [(weight, words) for pattern, weight, words in _HINTS if re.search(pattern, text)]
    if interval >= _COARSE_MS:
        found.append((3, f"interval {interval:g} is too coarse for time in ms"))
    total = sum(weight for weight, _ in found)
    name = Path(layout.path).stem.lower() if by_name and total == 0 else ""
    if re.search(r"depth|psdm", name):
        found.append((1, "file name"))
    elif re.search(r"time|twt|pstm", name):
        found.append((-1, "file name"))
    total = sum(weight for weight, _ in found)
    if total > 0:
        return "depth", "; ".join(words for weight, words in found if weight > 0)
    reasons = "; ".join(words for weight, words in found if weight < 0)
    return "time", reasons or "nothing says depth"


def _interval(layout: SegyLayout, notes: list[str]) -> float:
    in_trace = int(read_fields(layout, np.array([0]), [117])[117][0])
    in_file = layout.interval_us
    if in_file > 0:
        if in_trace not in (0, in_file):
            notes.append(
                f"sample interval {in_file} us in the binary header, {in_trace} in the trace headers: "
                "took the binary header's"
            )
        return in_file / 1000.0
    if in_trace > 0:
        notes.append(f"no sample interval in the binary header: took the trace headers' {in_trace} us")
        return in_trace / 1000.0
    notes.append(
        f"no sample interval in the headers: took {_USUAL_INTERVAL_MS:g}, the usual one; give interval= to change it"
    )
    return _USUAL_INTERVAL_MS


def _start(layout: SegyLayout, notes: list[str]) -> float:
    _, starts, odd = _starts(layout)
    if odd is not None:
        notes.append(f"time scalar {odd} (trace header byte 215) is not a power of ten: taken as 1")
    values, counts = np.unique(starts, return_counts=True)
    first = float(values[np.argmax(counts)])
    if values.size > 1:
        notes.append(
            f"traces start at different times ({values[0]:g} to {values[-1]:g}, trace header byte 109): "
            f"took the commonest, {first:g}, for all"
        )
    return first


def _starts(layout: SegyLayout) -> tuple[IntArray, AnyArray, int | None]:
    """Return some thousand traces, where they start by their headers, and a time scalar among these that cannot be."""
    rows = np.unique(np.linspace(0, layout.n_traces - 1, min(layout.n_traces, _N_STARTS)).astype(np.int64))
    fields = read_fields(layout, rows, [109, 215])
    scalar = fields[215]
    odd = ~np.isin(np.abs(scalar), (0, 1, 10, 100, 1000, 10000))
    factor = np.where((scalar == 0) | odd, 1.0, np.abs(scalar).astype(np.float64))
    starts = np.where((scalar < 0) & ~odd, fields[109] / factor, fields[109] * factor)
    return rows, starts, int(scalar[odd][0]) if odd.any() else None


def refuse_other_starts(layout: SegyLayout, axis: Axis) -> None:
    """Refuse a file whose traces with data start a sample or more apart: on one axis they would not lie side by side.

    Raises
    ------
    FormatError
        If a trace that is not all zero starts elsewhere than the axis.
    """
    rows, starts, _ = _starts(layout)
    traces = layout.map_traces()
    for k in np.flatnonzero(np.abs(starts - axis.first) >= (1.0 - _SAME) * axis.step):
        if traces["data"][rows[k]].any():
            raise FormatError(
                f"{layout.path} has traces that start at {axis.first:g}, and trace {rows[k] + 1} starts at "
                f"{starts[k]:g} (trace header byte 109); expected one start to within a sample, {axis.step:g}. Shift "
                "the traces to one start, or give start (--start) to take them as they lie."
            )
