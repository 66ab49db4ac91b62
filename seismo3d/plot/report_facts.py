"""The numbers of a report, worded for people."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from seismo3d.errors import GeometryError
from seismo3d.geometry.bearings import whole_deg
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.plot.pages import in_digits
from seismo3d.plot.pictures import axis_coordinates, axis_labels, live_traces
from seismo3d.plot.sections import count_fault_voxels
from seismo3d.seismic.fault_table import SAMPLE_UNITS, mean_strike_deg, throw_unit
from seismo3d.seismic.index_frame import IndexFrame

# the unit in which long ways are told, and how many of the short ones it is
_FAR = {"m": ("km", 1000.0), "ft": ("mi", 5280.0)}

_HEADINGS = {
    "fault": "Fault",
    "confidence": "Confidence",
    "likelihood_mean": "Likelihood",
    "area_index": "Area (bins x samples)",
    "length_index": "Length (bins, samples)",
    "area_m2": "Area (km²)",
    "area_ft2": "Area (mi²)",
    "length_m": "Length (m)",
    "length_ft": "Length (ft)",
    "strike_deg": "Strike (°)",
    "dip_deg": "Dip (°)",
    "throw_mean_samples": "Mean throw (samples)",
    "throw_max_samples": "Largest throw (samples)",
    **{f"throw_mean_{unit}": f"Mean throw ({unit})" for unit in SAMPLE_UNITS},
    **{f"throw_max_{unit}": f"Largest throw ({unit})" for unit in SAMPLE_UNITS},
    "throw_known": "Throw known",
    "throw_fit": "Match",
    "kind": "Kind",
}


def survey_facts(cube: Any) -> list[tuple[str, str]]:
    """Name and value of what the survey is."""
    labels = axis_labels(cube)
    facts = []
    for axis, label in enumerate(labels):
        coordinates = axis_coordinates(cube, axis)
        step = f", step {np.diff(coordinates).mean():.8g}" if len(coordinates) > 1 else ""
        facts.append((label, f"{coordinates[0]:.8g} to {coordinates[-1]:.8g}{step} ({len(coordinates):,})"))
    live = live_traces(cube)
    facts.append(("Live traces", f"{int(live.sum()):,} of {live.size:,} ({_percent(live.mean())})"))
    if len(labels) == 3:
        facts += _map_facts(cube)
    # such as that lengths are in feet
    return facts + [("Note", str(note)) for note in getattr(cube, "attrs", {}).get("notes", ())]


def key_numbers(faults: Any, cube: Any, rows: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Value and meaning of the numbers at the top of the report."""
    numbers = [(f"{len(rows):,}", "fault found" if len(rows) == 1 else "faults found")]
    if not rows:
        return numbers
    unit = throw_unit(rows[0])
    # the largest single value of a cube is an outlier more often than not: the mean of a fault holds
    finite = [row[f"throw_mean_{unit}"] for row in rows if math.isfinite(row[f"throw_mean_{unit}"])]
    if finite:
        numbers.append((f"{in_digits(max(finite, key=abs))} {unit}", "largest mean throw of a fault"))
    for short, (far, size) in _FAR.items():
        if rows[0].get(f"length_{short}"):
            longest = max(row[f"length_{short}"] for row in rows)
            numbers.append((f"{longest / size:.2f} {far}", "longest fault, along strike"))
    weights = np.array([row.get("area_index", row.get("length_index")) for row in rows])
    numbers.append((f"{np.average([row['dip_deg'] for row in rows], weights=weights):.0f}°", _dip_meaning(cube)))
    if "strike_deg" in rows[0]:
        doubled = mean_strike_deg(2 * np.array([row["strike_deg"] for row in rows]), weights) / 2
        if math.isfinite(doubled):
            doubled = whole_deg(doubled, turn=180.0)
            numbers.append((f"{doubled:.0f}° / {doubled + 180:.0f}°", "mean strike"))
    share = _fault_share(faults)
    numbers.append((_percent(share), "of all voxels lie on a fault"))
    return numbers


def _fault_share(faults: Any) -> float:
    """Share of the voxels that lie on a fault."""
    if np.ndim(faults.labels) == 2:
        return float((np.asarray(faults.labels) > 0).mean())
    return float(count_fault_voxels(faults)[0].sum() / np.prod(np.shape(faults.labels), dtype=np.float64))


def table_columns(rows: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Key and heading of the table's columns; samples are left out where their unit is known."""
    if not rows:
        return []
    keys = [key for key in rows[0] if key in _HEADINGS and key != "likelihood_mean"]
    if throw_unit(rows[0]) != "samples":
        keys = [key for key in keys if not key.endswith("_samples")]
    return [(key, _HEADINGS[key]) for key in keys]


def table_cell(key: str, value: Any) -> tuple[str, str]:
    """Text of a table's cell, and what it is sorted by."""
    if isinstance(value, str):
        return value, value
    number = float(value)
    if not math.isfinite(number):
        return "–", "-1e99"
    for short, (_, size) in _FAR.items():
        if key == f"area_{short}2":
            return in_digits(number / size**2), repr(number)
    if key == "strike_deg":
        return f"{whole_deg(number):.0f}", repr(number)
    if key == "throw_known":
        return _percent(number), repr(number)
    digits = {
        "fault": 0,
        "confidence": 2,
        "throw_fit": 2,
        "dip_deg": 0,
        "area_index": 0,
        "length_index": 0,
        "length_m": 0,
        "length_ft": 0,
    }
    return f"{number:,.{digits.get(key, 1)}f}", repr(number)


def _dip_meaning(cube: Any) -> str:
    is_true = np.ndim(cube) == 3 and IndexFrame.of(cube).unit != "bin"
    return "mean dip" if is_true else "mean dip, in bins and samples"


def _map_facts(cube: Any) -> list[tuple[str, str]]:
    try:
        survey = SurveyGeometry.from_cube(cube)
    except GeometryError as error:
        return [("Map", f"none: {error}")]
    if not survey.has_map:
        return [("Map", "no coordinates in the file: distances are in bins, strikes from the inline axis")]
    bins, short = survey.bin_size, survey.length_unit
    long, size = _FAR[short]
    far = np.array(cube.shape, dtype=np.float64) - 1
    corners = survey.index_to_map([[0, 0, 0], [far[0], 0, 0], [0, far[1], 0], [far[0], far[1], 0]])
    area = bins[0] * far[0] * bins[1] * far[1] / size**2
    (left, south), (right, north) = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    return [
        ("Bin size", f"{bins[0]:.4g} {short} (next inline) x {bins[1]:.4g} {short} (next crossline)"),
        ("Inline axis", f"azimuth {survey.inline_axis_azimuth_deg:.1f}° from north"),
        ("Extent", f"x {left:,.0f} to {right:,.0f}, y {south:,.0f} to {north:,.0f}"),
        ("Box area", f"{area:,.4g} {long}²"),
    ]


def _percent(share: float) -> str:
    return f"{100 * float(share):.3g} %"
