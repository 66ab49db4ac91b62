"""The fracture network to files: the graph, and tables of its faults, intersections, zones, sets and cells."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.io._files import as_path
from seismo3d.io.tables import write_csv
from seismo3d.seismic.flow_paths import FlowPath
from seismo3d.seismic.network import FractureNetwork


def write_network(network: FractureNetwork, cube: Any, *, directory: str | Path) -> list[Path]:
    """Write a network: ``network.graphml`` and tables as CSV.

    ``network_faults.csv``, ``intersections.csv``, ``zones.csv``, ``sets.csv`` and ``density.csv``, with x, y on the map
    where the cube knows them, else line numbers, and z in time or depth. Strikes and dips are those of mean poles; the
    mean of a curved fault's dips, in ``faults.csv``, is another number.

    Parameters
    ----------
    network : FractureNetwork
        The network of ``cube``'s faults.
    cube : DataArray or ndarray
        Gives the coordinates.
    directory : str or Path
        A folder that is there; files in it are replaced one by one.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    directory = as_path(directory, "directory")
    geometry = SurveyGeometry.from_cube(cube)
    network.write_graphml(directory / "network.graphml")
    files = [directory / "network.graphml"]
    for name, columns, rows in (
        ("network_faults.csv", _FAULTS, _fault_rows(network)),
        ("intersections.csv", _LINES, _line_rows(network, geometry)),
        ("zones.csv", _ZONES, _zone_rows(network, geometry)),
        ("sets.csv", _SETS, _set_rows(network)),
        ("density.csv", _CELLS, _cell_rows(network, geometry)),
    ):
        write_csv(directory / name, rows, columns=columns)
        files.append(directory / name)
    return files


def write_path(path: FlowPath, file: str | Path) -> None:
    """Write the places along a flow path as CSV: x, y, z."""
    rows = [dict(zip("xyz", (float(v) for v in point), strict=True)) for point in path.points]
    write_csv(file, rows, columns=("x", "y", "z"))


def summarise_network(network: FractureNetwork) -> dict[str, Any]:
    """Return the numbers of a network, for JSON and for people."""
    connected = [zone for zone in network.zones if len(zone.surfaces) > 1]
    n = network.graph.number_of_nodes()
    return {
        "faults": n,
        "intersections": len(network.intersections),
        "intersections_by_kind": {
            kind: sum(line.kind == kind for line in network.intersections) for kind in ("cross", "abut", "corner")
        },
        "intersections_per_fault": 2.0 * len(network.intersections) / n if n else 0.0,
        "zones_of_several_faults": len(connected),
        "share_of_area_in_largest_zone": network.zones[0].area / sum(z.area for z in network.zones) if n else 0.0,
        "intensity": network.intensity,
        "intensity_unit": f"1/{network.unit}",
        "cell": list(network.cell),
        "sets": [asdict(entry) for entry in network.sets],
    }


_FAULTS = ("fault", "zone", "set", "intersections", "area", "strike_deg", "dip_deg", "throw_mean_samples", "kind",
           "confidence", "x", "y", "z")  # fmt: skip
_LINES = ("first", "second", "kind", "abutting", "length", "unit", "angle_deg", "x", "y", "z_top", "z_foot")
_ZONES = ("zone", "n_faults", "faults", "area", "intensity", "n_intersections", "intersection_length", "unit",
          "x_min", "x_max", "y_min", "y_max", "z_min", "z_max")  # fmt: skip
_SETS = ("set", "faults", "share", "strike_deg", "dip_deg", "kappa", "spread_deg")
_CELLS = ("x", "y", "z", "density", "unit")


def _fault_rows(network: FractureNetwork) -> list[dict[str, Any]]:
    number = {label: n for n, entry in enumerate(network.sets, start=1) for label in entry.surfaces}
    return [
        {"fault": label, "set": number[label], "intersections": network.graph.degree(label), **facts}
        for label, facts in network.graph.nodes(data=True)
    ]


def _line_rows(network: FractureNetwork, geometry: SurveyGeometry) -> list[dict[str, Any]]:
    rows = []
    for line in network.intersections:
        places = geometry.index_to_map(line.points)
        x, y, _ = places.mean(axis=0)
        row = {name: getattr(line, name) for name in ("first", "second", "kind", "length", "angle_deg")}
        row |= {"abutting": line.abutting or None, "unit": network.unit, "x": float(x), "y": float(y)}
        rows.append(row | {"z_top": float(places[:, 2].min()), "z_foot": float(places[:, 2].max())})
    return rows


def _zone_rows(network: FractureNetwork, geometry: SurveyGeometry) -> list[dict[str, Any]]:
    rows = []
    for number, zone in enumerate(network.zones, start=1):
        ends = np.array([zone.low, zone.high])
        corners = np.array([[ends[a, 0], ends[b, 1], ends[c, 2]] for a in (0, 1) for b in (0, 1) for c in (0, 1)])
        places = geometry.index_to_map(corners)
        row: dict[str, Any] = {"zone": number, "n_faults": len(zone.surfaces), "unit": network.unit}
        row["faults"] = " ".join(str(label) for label in zone.surfaces)
        for name in ("area", "intensity", "n_intersections", "intersection_length"):
            row[name] = getattr(zone, name)
        for k, axis in enumerate("xyz"):
            row[f"{axis}_min"], row[f"{axis}_max"] = float(places[:, k].min()), float(places[:, k].max())
        rows.append(row)
    return rows


def _set_rows(network: FractureNetwork) -> list[dict[str, Any]]:
    return [
        {**asdict(entry), "set": number, "faults": " ".join(str(label) for label in entry.surfaces)}
        for number, entry in enumerate(network.sets, start=1)
    ]


def _cell_rows(network: FractureNetwork, geometry: SurveyGeometry) -> list[dict[str, Any]]:
    """Return the cells that hold some fault, with their middles."""
    filled = np.argwhere(network.density > 0)
    shape = np.array([geometry.inline.n, geometry.crossline.n, geometry.sample.n])
    low = filled * np.array(network.cell)
    high = np.minimum(low + np.array(network.cell), shape)
    places = geometry.index_to_map((low + high - 1) / 2.0)
    return [
        {"x": float(x), "y": float(y), "z": float(z), "density": float(value), "unit": f"1/{network.unit}"}
        for (x, y, z), value in zip(places, network.density[tuple(filled.T)], strict=True)
    ]
