"""GOCAD ASCII: triangulated surfaces (TSurf) and polylines (PLine), one object a fault."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from seismo3d.io._files import written_aside
from seismo3d.io.surface_mesh import SurfaceMesh

_NO_DATA = -99999.0


def write_gocad(
    path: str | Path,
    surfaces: Iterable[SurfaceMesh],
    *,
    horizontal_unit: str,
    z_unit: str,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write surfaces as GOCAD objects to one file.

    A mesh of triangles becomes a TSurf, a mesh of segments a PLine. z is positive downwards (``ZPOSITIVE Depth``);
    values that are not known are -99999 (``NO_DATA_VALUES``).

    Parameters
    ----------
    path : str or Path
        The file, ``.ts`` by custom (``.pl`` for polylines).
    surfaces : iterable of SurfaceMesh
        The surfaces; all must have the same kind of cells for a reader that takes one kind only.
    horizontal_unit : str
        Unit of x and y, such as "m"; "none" for bin indices.
    z_unit : str
        Unit of z: "ms", "m", "ft", or "none" for samples.
    units : mapping of str to str, optional
        Units of properties by name; "none" for those that are not in it.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    with written_aside(path) as aside, aside.open("wb") as file:
        for surface in surfaces:
            for line in _lines(surface, horizontal_unit, z_unit, units or {}):
                file.write(line.encode("ascii", "replace") + b"\n")


def _lines(surface: SurfaceMesh, horizontal_unit: str, z_unit: str, units: Mapping[str, str]) -> Iterator[str]:
    triangles = np.asarray(surface.cells).shape[1] == 3
    yield "GOCAD TSurf 1" if triangles else "GOCAD PLine 1"
    yield "HEADER {"
    yield f"name:{surface.name}"
    yield "}"
    yield "GOCAD_ORIGINAL_COORDINATE_SYSTEM"
    yield "NAME Default"
    yield 'AXIS_NAME "X" "Y" "Z"'
    yield f'AXIS_UNIT "{horizontal_unit}" "{horizontal_unit}" "{z_unit}"'
    yield "ZPOSITIVE Depth"
    yield "END_ORIGINAL_COORDINATE_SYSTEM"
    names = list(surface.properties)
    if names:
        yield "PROPERTIES " + " ".join(names)
        yield "NO_DATA_VALUES " + " ".join(f"{_NO_DATA:g}" for _ in names)
        yield "ESIZES " + " ".join("1" for _ in names)
        yield "UNITS " + " ".join(units.get(name, "none") for name in names)
    yield "TFACE" if triangles else "ILINE"
    yield from _vertices(surface, names)
    word = "TRGL" if triangles else "SEG"
    for cell in np.asarray(surface.cells) + 1:
        yield word + " " + " ".join(str(number) for number in cell)
    yield "END"


def _vertices(surface: SurfaceMesh, names: list[str]) -> Iterator[str]:
    word = "PVRTX" if names else "VRTX"
    values = (
        np.column_stack([np.asarray(surface.properties[name], dtype=np.float64) for name in names]) if names else None
    )
    for number, (x, y, z) in enumerate(np.asarray(surface.points, dtype=np.float64), start=1):
        line = f"{word} {number} {x:.3f} {y:.3f} {z:.4f}"
        if values is not None:
            row = np.where(np.isfinite(values[number - 1]), values[number - 1], _NO_DATA)
            line += "".join(f" {value:.6g}" for value in row)
        yield line
