"""The table of faults: one row a surface, with the numbers that an interpreter asks for first."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array
from seismo3d.geometry.bearings import wrap_deg
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry, geometry_of
from seismo3d.geometry.triangles import weigh_vertices
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.index_frame import IndexFrame
from seismo3d.seismic.preparing import describe_volume

SAMPLE_UNITS = ("ms", "m", "ft")
"""Units of samples in which throws are told, beside their number."""


def tabulate_faults(faults: FaultSet, cube: Any) -> list[dict[str, Any]]:
    """Sum up each fault in one row.

    Means are weighted by area. Where throw is known at no vertex its cells are NaN; cells that make no sense for the
    kind of data (crosslines of a section, square metres of a time cube) are absent. Of a survey in feet ``_m`` and
    ``_m2`` at the end of a name are ``_ft`` and ``_ft2``.

    Parameters
    ----------
    faults : FaultSet
        The faults of ``cube``.
    cube : DataArray or ndarray
        Gives the coordinates; bare arrays give indices.

    Returns
    -------
    list of dict
        Rows in the order of the surfaces, with the same keys each: ``fault`` (from 1, the label), ``confidence``,
        ``likelihood_mean``, ``area_index`` (or ``length_index`` in a section: units of bins and samples), ``area_m2``
        (depth cubes on a map), ``length_m`` (along strike, on a map), ``strike_deg``, ``dip_deg``,
        ``throw_mean_samples``, ``throw_max_samples`` (largest by size, with its sign), the same in ``_ms`` or ``_m``,
        ``throw_known`` (share of the area where the sides match; elsewhere throw is carried on), ``throw_fit`` (mean
        match of the sides, 0 to 1), ``kind`` (normal, reverse, mixed or unknown); in a cube ``family`` (the same number
        for parts of one fault) and ``generation`` (0 for those that moved last), ``dip_slip_mean_index`` and
        ``strike_slip_mean_index`` (index units, split in bins and samples), ``rake_deg`` (from strike, 90 straight down
        the dip; of the map where there is one) and ``slip_certainty`` (0 to 1); on a map, and split there,
        ``heave_mean_m`` (down the dip) and ``strike_slip_mean_m`` (along ``strike_deg``); and the extents in line
        numbers and time or depth.
    """
    geometry = geometry_of(cube)
    return [_row(number, surface, geometry, cube) for number, surface in enumerate(faults.surfaces, start=1)]


def list_columns(cube: Any) -> list[str]:
    """Return the keys of each row that :func:`tabulate_faults` gives for faults of a cube or section, if it has any."""
    geometry = geometry_of(cube)
    section = isinstance(geometry, SectionGeometry)
    interval, unit = describe_volume(cube)
    # which they are depends on the cube alone, so any surface tells
    corners = np.eye(3, dtype=np.float32)[:, 1:] if section else np.eye(3, dtype=np.float32)
    cells = np.array([[0, 1], [1, 2]] if section else [[0, 1, 2]], np.int32)
    ones = np.ones(3, np.float32)
    surface = FaultSurface(
        corners, cells, np.ones_like(corners), ones, ones, ones, ones, ones, ones,
        sample_interval=interval, sample_unit=unit,
    )  # fmt: skip
    return list(_row(1, surface, geometry, cube))


def throw_unit(row: dict[str, Any]) -> str:
    """Return the unit that the throws of a row are best told in: that of the samples, "samples" where it is not known.

    Examples
    --------
    >>> throw_unit({"throw_mean_samples": 2.0, "throw_mean_ms": 8.0}), throw_unit({"throw_mean_samples": 2.0})
    ('ms', 'samples')
    """
    return next((unit for unit in SAMPLE_UNITS if f"throw_mean_{unit}" in row), "samples")


def mean_strike_deg(strike_deg: AnyArray, weights: AnyArray) -> float:
    """Weighted mean of directions in degrees, 0 to 360; NaN where there is none.

    Examples
    --------
    >>> import numpy as np
    >>> round(mean_strike_deg(np.array([350.0, 20.0]), np.ones(2)), 6)
    5.0
    """
    strike, weights = np.asarray(strike_deg, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    known = np.isfinite(strike) & (weights > 0)
    if not known.any():
        return float("nan")
    turned = (weights[known] * np.exp(1j * np.radians(strike[known]))).sum()
    return float(wrap_deg(np.degrees(np.angle(turned))))


def _row(number: int, surface: FaultSurface, geometry: SurveyGeometry | SectionGeometry, cube: Any) -> dict[str, Any]:
    weights = weigh_vertices(surface.vertices, surface.cells)
    row: dict[str, Any] = {
        "fault": number,
        "confidence": float(surface.confidence),
        "likelihood_mean": weighted_mean(surface.likelihood, weights),
    }
    row |= _size(surface, geometry)
    if isinstance(geometry, SurveyGeometry):
        row["strike_deg"] = mean_strike_deg(surface.strike_deg, weights)
    row["dip_deg"] = weighted_mean(surface.dip_deg, weights)
    return row | _throws(surface, weights) | _slips(surface, geometry, weights) | _extents(surface, geometry, cube)


def weighted_mean(values: AnyArray, weights: Float64Array) -> float:
    """Mean of the values that are known, by weight; NaN where there is none.

    Examples
    --------
    >>> import numpy as np
    >>> weighted_mean(np.array([1.0, 4.0, np.nan]), np.array([2.0, 1.0, 5.0]))
    2.0
    """
    values = np.asarray(values, dtype=np.float64)
    known = np.isfinite(values)
    total = weights[known].sum()
    return float((values[known] * weights[known]).sum() / total) if total > 0 else float("nan")


def _size(surface: FaultSurface, geometry: SurveyGeometry | SectionGeometry) -> dict[str, Any]:
    if isinstance(geometry, SectionGeometry):
        return {"length_index": float(surface.area)}
    sizes: dict[str, Any] = {"area_index": float(surface.area)}
    if not geometry.has_map:
        return sizes
    frame = IndexFrame.of_survey(geometry)
    if frame.unit != "bin":
        sizes[f"area_{frame.unit}2"] = float(frame.areas(surface.vertices, surface.cells).sum())
    places = geometry.index_to_map(surface.vertices)[:, :2]
    spread = places - places.mean(axis=0)
    along = np.linalg.svd(spread, full_matrices=False)[2][0]
    return sizes | {f"length_{geometry.length_unit}": float(np.ptp(spread @ along))}


def _throws(surface: FaultSurface, weights: Float64Array) -> dict[str, Any]:
    throw = np.asarray(surface.throw, dtype=np.float64)
    known = np.isfinite(throw)
    mean = weighted_mean(throw, weights)
    largest = float(throw[known][np.abs(throw[known]).argmax()]) if known.any() else float("nan")
    row = {"throw_mean_samples": mean, "throw_max_samples": largest}
    if surface.sample_unit != "samples":
        row |= {
            f"throw_mean_{surface.sample_unit}": mean * surface.sample_interval,
            f"throw_max_{surface.sample_unit}": largest * surface.sample_interval,
        }
    share = float(weights[surface.is_matched].sum() / weights.sum()) if weights.sum() > 0 else 0.0
    return row | {
        "throw_known": share,
        "throw_fit": weighted_mean(surface.throw_fit, weights),
        "kind": _kind(throw, weights),
    }


def measure_slip(
    surface: FaultSurface, geometry: SurveyGeometry | SectionGeometry
) -> tuple[Float32Array, Float32Array]:
    """Heave and strike slip of a surface in the map's unit of length, in traces where a survey has no map.

    Slip is split on the map, where dip and strike are square to each other whatever the bins are: heave is what the
    whole motion goes down the dip, strike slip what it goes along strike. Where none is told along strike, slip is
    straight down the dip of the map.

    Parameters
    ----------
    surface : FaultSurface
        A fault.
    geometry : SurveyGeometry or SectionGeometry
        Of its cube, or of its section with map coordinates.

    Returns
    -------
    heave, strike_slip : ndarray of shape (n,), float32
        Heave is negative where it closes up. Strike slip is positive where the hanging wall went along
        :attr:`FaultSurface.strike_deg`; 0 in a section.
    """
    if isinstance(geometry, SectionGeometry):
        ends = surface.vertices, surface.vertices + surface.slip
        start, end = (np.asarray(geometry.index_to_map(points), dtype=np.float64)[:, :2] for points in ends)
        heave = np.hypot(*(end - start).T) * np.sign(surface.heave)
        return heave.astype(np.float32), np.zeros_like(surface.throw)
    M = geometry.east_north
    motion = surface.slip[:, :2].astype(np.float64) @ M.T
    down = np.linalg.solve(M.T, surface.normals[:, :2].astype(np.float64).T).T
    down /= np.maximum(np.hypot(*down.T), 1e-30)[:, None]
    heave = (motion * down).sum(axis=1)
    # looking along strike the hanging wall lies to the right: east is to the right of north
    along = motion[:, 1] * down[:, 0] - motion[:, 0] * down[:, 1]
    return heave.astype(np.float32), (along * (surface.strike_share != 0.0)).astype(np.float32)


def measure_rake(surface: FaultSurface, geometry: SurveyGeometry) -> Float32Array:
    """Rake of a surface in degrees, of the slip that :func:`measure_slip` gives: 90 straight down the dip.

    In a time cube a sample counts as the side of a square that is as large as a bin; where there is no map, all is in
    index units.
    """
    heave, along = measure_slip(surface, geometry)
    frame = IndexFrame.of_survey(geometry)
    sample = np.sqrt(abs(np.linalg.det(geometry.east_north))) if frame.unit == "bin" else frame.steps[2]
    fall = surface.throw * np.float32(sample)
    return np.degrees(np.arctan2(np.copysign(np.hypot(heave, fall), fall), along)).astype(np.float32)


def _slips(surface: FaultSurface, geometry: SurveyGeometry | SectionGeometry, weights: Float64Array) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if isinstance(geometry, SurveyGeometry):
        rake = measure_rake(surface, geometry).astype(np.float64)
        known = np.isfinite(rake) & (weights > 0)
        turned = (weights[known] * np.abs(surface.throw[known]) * np.exp(1j * np.radians(rake[known]))).sum()
        row = {
            "family": surface.family,
            "generation": surface.generation,
            "dip_slip_mean_index": weighted_mean(surface.dip_slip, weights),
            "strike_slip_mean_index": weighted_mean(surface.strike_slip, weights),
            "rake_deg": float(np.degrees(np.angle(turned))) if known.any() else float("nan"),
            "slip_certainty": float(surface.slip_certainty),
        }
    if not geometry.has_map:
        return row
    (heave, along), unit = measure_slip(surface, geometry), geometry.length_unit
    row[f"heave_mean_{unit}"] = weighted_mean(np.abs(heave), weights)
    return row | (
        {f"strike_slip_mean_{unit}": weighted_mean(along, weights)} if isinstance(geometry, SurveyGeometry) else {}
    )


def _kind(throw: Float64Array, weights: Float64Array) -> str:
    known = np.isfinite(throw)
    down, up = weights[known & (throw > 0)].sum(), weights[known & (throw < 0)].sum()
    if down + up == 0:
        return "unknown"
    share = down / (down + up)
    return "normal" if share >= 0.8 else "reverse" if share <= 0.2 else "mixed"


def _extents(surface: FaultSurface, geometry: SurveyGeometry | SectionGeometry, cube: Any) -> dict[str, Any]:
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    row: dict[str, Any] = {}
    if isinstance(geometry, SurveyGeometry):
        ends = geometry.index_to_lines(np.stack([low, high]))
        for axis, name in enumerate(("inline", "crossline")):
            row |= {f"{name}_min": float(ends[:, axis].min()), f"{name}_max": float(ends[:, axis].max())}
        top, foot = ends[0, 2], ends[1, 2]
    else:
        row |= {"trace_min": float(low[0]), "trace_max": float(high[0])}
        top, foot = geometry.sample.coordinate(low[-1]), geometry.sample.coordinate(high[-1])
    name = str(cube.dims[-1]) if hasattr(cube, "dims") else "sample"
    return row | {f"{name}_min": float(top), f"{name}_max": float(foot)}
