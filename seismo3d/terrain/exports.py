"""Lineaments and scarps as files: GeoJSON lines, a GeoTIFF of the likelihood, a table."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._validate import as_kind, check_list
from seismo3d.io._files import as_path, written_aside
from seismo3d.io.elevation import has_rasterio, raster_suffix, write_elevation
from seismo3d.terrain.lineament_search import Lineament, LineamentSet
from seismo3d.terrain.scarp_profiles import Scarp


def to_geojson(found: LineamentSet, scarps: Sequence[Scarp] = ()) -> dict[str, Any]:
    """Return lineaments as a GeoJSON FeatureCollection.

    Parameters
    ----------
    found : LineamentSet
    scarps : sequence of Scarp
        Their heights and facings are given to the lines they were measured on.

    Returns
    -------
    dict
        Line strings in longitude and latitude where the map has a named reference system and rasterio is installed (as
        RFC 7946 wants), else in the map's own coordinates, with a member ``crs`` that names the system.
    """
    as_kind(found, LineamentSet, "found", remedy="Give what lineaments returned.")
    check_list(scarps, "scarps", Scarp)
    heights = {id(scarp.lineament): scarp for scarp in scarps}
    carry, member = _to_degrees(found)
    features = [
        {
            "type": "Feature",
            "properties": {"id": number, **_properties(line), **_scarp_properties(heights.get(id(line)))},
            "geometry": {"type": "LineString", "coordinates": carry(line.points)},
        }
        for number, line in enumerate(found.lines, start=1)
    ]
    return {"type": "FeatureCollection", **member, "features": features}


def write_lineaments(directory: str | Path, found: LineamentSet, *, scarps: Sequence[Scarp] = ()) -> list[Path]:
    """Write ``lineaments.geojson``, ``lineaments.csv``, and ``likelihood.tif`` (``.npz`` without rasterio) to a folder.

    Parameters
    ----------
    directory : str or Path
        Must be there.
    found : LineamentSet
    scarps : sequence of Scarp
        With them, ``scarp_profiles.csv`` too.

    Returns
    -------
    list of Path
    """
    folder = as_path(directory, "directory")
    out = [folder / "lineaments.geojson", folder / "lineaments.csv"]
    with written_aside(out[0]) as aside:
        aside.write_text(json.dumps(to_geojson(found, scarps), indent=1) + "\n", encoding="utf-8")
    heights = {id(scarp.lineament): scarp for scarp in scarps}
    rows = [
        {"id": n, **_properties(line), **_scarp_properties(heights.get(id(line)))}
        for n, line in enumerate(found.lines, start=1)
    ]
    names = ["id", *_NAMES, *_SCARP_NAMES]
    with written_aside(out[1]) as aside, aside.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, names)
        table.writeheader()
        table.writerows(rows)
    out.append(write_elevation(folder / f"likelihood{raster_suffix()}", found.likelihood))
    if scarps:
        numbers = {id(line): n for n, line in enumerate(found.lines, start=1)}
        out.append(folder / "scarp_profiles.csv")
        with written_aside(out[-1]) as aside, aside.open("w", newline="", encoding="utf-8") as file:
            rows_out = csv.writer(file)
            rows_out.writerow(["id", "offset_m", "elevation_m", "slope_deg"])
            for scarp in scarps:
                for w, z, slope in zip(scarp.offset, scarp.profile, scarp.slope_profile_deg, strict=True):
                    rows_out.writerow([numbers[id(scarp.lineament)], f"{w:.6g}", f"{z:.6g}", f"{slope:.5g}"])
    return out


_NAMES = ("kind", "strike_deg", "length_m", "confidence", "score", "prominence")
_SCARP_NAMES = (
    "scarp_height_m", "scarp_height_sigma_m", "scarp_facing_deg", "scarp_width_m", "scarp_slope_deg", "scarp_age_m2",
)  # fmt: skip


def _properties(line: Lineament) -> dict[str, Any]:
    values = (line.kind, round(line.strike_deg, 2), round(line.length, 3), round(line.confidence, 4))
    return dict(zip(_NAMES, (*values, round(float(line.score.mean()), 3), round(line.prominence, 2)), strict=True))


def _scarp_properties(scarp: Scarp | None) -> dict[str, Any]:
    if scarp is None:
        return {}
    known = scarp.slope_deg[np.isfinite(scarp.slope_deg)]
    steepest = float(np.median(known)) if len(known) else float(scarp.slope_profile_deg.max())
    values = (scarp.height_m, scarp.height_sigma, scarp.facing_deg, scarp.width, steepest, scarp.morphologic_age)
    named = zip(_SCARP_NAMES, values, strict=True)
    return {name: round(float(value), 4) for name, value in named if np.isfinite(value)}


def _to_degrees(found: LineamentSet) -> tuple[Any, dict[str, Any]]:
    """Return what carries points to coordinate lists, and the member that names their system where it is needed."""
    grid = found.grid
    if grid.unit == "degree":
        return lambda points: np.round(points, 7).tolist(), {}
    if grid.crs and has_rasterio():
        from rasterio.warp import transform

        def carry(points: Any) -> Any:
            x, y = transform(grid.crs, "OGC:CRS84", points[:, 0].tolist(), points[:, 1].tolist())
            return np.round(np.column_stack([x, y]), 7).tolist()

        return carry, {}
    name = grid.crs or ("map units" if grid.has_place else "cells (column, row)")
    return lambda points: np.round(points, 3).tolist(), {"crs": {"type": "name", "properties": {"name": name}}}
