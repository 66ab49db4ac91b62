"""Faults to files: VTK and GOCAD surfaces, fault sticks, and the table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry, geometry_of
from seismo3d.io._files import as_path
from seismo3d.io.fault_sticks import write_charisma_sticks, write_opendtect_sticks
from seismo3d.io.gocad import write_gocad
from seismo3d.io.surface_mesh import SurfaceMesh
from seismo3d.io.tables import write_csv
from seismo3d.io.vtk_surfaces import write_vtp
from seismo3d.seismic.cube_checks import check_faults_of
from seismo3d.seismic.fault_table import list_columns, measure_rake, measure_slip, tabulate_faults
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.sticks import cut_sticks

_UNITS = {
    "throw": "samples", "throw_ms": "ms", "heave": "traces", "strike_slip": "traces", "rake": "deg", "strike": "deg",
    "dip": "deg",
} | {f"{name}_{unit}": unit for name in ("throw", "heave", "strike_slip") for unit in ("m", "ft")}  # fmt: skip


def write_faults(faults: FaultSet, cube: Any, *, directory: str | Path) -> list[Path]:
    """Write faults in every exchange format.

    ``surfaces.vtp`` (VTK), ``surfaces.ts`` (GOCAD TSurf; ``surfaces.pl``, polylines, for a section),
    ``sticks_opendtect.txt``, ``sticks_petrel.txt`` (Charisma) and ``faults.csv``. Coordinates are those of the map
    where the cube knows them, in metres or feet, else line numbers; z is time or depth, positive downwards.

    Parameters
    ----------
    faults : FaultSet
        The faults of ``cube``.
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
    ShapeError
        If the faults are not of this cube.
    FileAccessError
        If the folder cannot be written to.
    """
    check_faults_of(cube, faults)
    directory = as_path(directory, "directory")
    meshes = mesh_faults(faults, cube)
    (unit, length_unit), notes = _describe(cube)
    gocad = directory / ("surfaces.ts" if np.ndim(faults.labels) == 3 else "surfaces.pl")
    write_vtp(directory / "surfaces.vtp", meshes, notes=notes)
    write_gocad(gocad, meshes, horizontal_unit=length_unit, z_unit=unit, units=_UNITS)
    sticks = cut_sticks(faults, cube)
    write_opendtect_sticks(directory / "sticks_opendtect.txt", sticks)
    write_charisma_sticks(directory / "sticks_petrel.txt", sticks)
    write_csv(directory / "faults.csv", tabulate_faults(faults, cube), columns=list_columns(cube))
    names = ("surfaces.vtp", gocad.name, "sticks_opendtect.txt", "sticks_petrel.txt", "faults.csv")
    return [directory / name for name in names]


def mesh_faults(faults: FaultSet, cube: Any) -> list[SurfaceMesh]:
    """Turn faults into meshes in map coordinates, with their attributes at the points.

    Parameters
    ----------
    faults : FaultSet
        The faults of ``cube``.
    cube : DataArray or ndarray
        Gives the coordinates.

    Returns
    -------
    list of SurfaceMesh
        One a surface, named ``fault_001`` and so on by label; properties ``throw`` (samples), ``throw_ms`` or
        ``throw_m`` where the sample interval is known, ``throw_fit`` (0 to 1), ``heave`` and ``strike_slip`` (traces),
        ``heave_m`` and ``strike_slip_m`` on a map, split there, all three ``_ft`` in a survey in feet, ``rake``
        (degrees from strike, 90 straight down, of the map where there is one), ``likelihood``, ``strike`` and ``dip``
        (degrees); in a section no strike slip and no rake.
    """
    geometry = geometry_of(cube)
    return [
        SurfaceMesh(
            f"fault_{i:03d}", geometry.index_to_map(surface.vertices), surface.cells, _properties(surface, geometry)
        )
        for i, surface in enumerate(faults.surfaces, start=1)
    ]


def _properties(surface: FaultSurface, geometry: SurveyGeometry | SectionGeometry) -> dict[str, Any]:
    properties = {"throw": surface.throw}
    if surface.sample_unit != "samples":
        properties[f"throw_{surface.sample_unit}"] = surface.throw * np.float32(surface.sample_interval)
    properties |= {"throw_fit": surface.throw_fit, "heave": surface.heave}
    if isinstance(geometry, SurveyGeometry):
        properties |= {"strike_slip": surface.strike_slip, "rake": measure_rake(surface, geometry)}
    if geometry.has_map:
        heave, strike_slip = measure_slip(surface, geometry)
        properties[f"heave_{geometry.length_unit}"] = heave
        if isinstance(geometry, SurveyGeometry):
            properties[f"strike_slip_{geometry.length_unit}"] = strike_slip
    return properties | {"likelihood": surface.likelihood, "strike": surface.strike_deg, "dip": surface.dip_deg}


def _describe(cube: Any) -> tuple[tuple[str, str], dict[str, str]]:
    """Return the units of z and of x and y, and the notes that go into a VTK file."""
    geometry = geometry_of(cube)
    unit = geometry.unit if geometry.unit != "samples" else "none"
    length = {"m": "metres", "ft": "feet"}[geometry.length_unit]
    place = f"{length} on the map" if geometry.has_map else "line numbers" if np.ndim(cube) == 3 else "trace number, 0"
    words = {"ms": "two-way time in ms", "m": "depth in m", "ft": "depth in ft", "none": "sample number"}
    z = words[unit] if unit in words else f"{cube.dims[-1]} in {unit}"
    properties = (
        "throw: samples, positive where the hanging wall is down; throw_fit: 1 where the sides match, 0 where throw is "
        "carried on; heave and strike_slip: traces (_m, _ft: metres, feet), positive where the fault opens and where "
        "the hanging wall went along strike; rake: degrees from strike, 90 straight down the dip; strike, dip: degrees"
    )
    notes = {"xy": f"x, y: {place}", "z": f"z: {z}, positive down", "properties": properties}
    return (unit, geometry.length_unit if geometry.has_map else "none"), notes
