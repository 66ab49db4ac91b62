"""VTK XML PolyData (``.vtp``): all surfaces in one file, for ParaView and everything else built on VTK."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import ShapeError
from seismo3d.io._files import written_aside
from seismo3d.io.surface_mesh import SurfaceMesh

_TYPES = {"<f4": "Float32", "<f8": "Float64", "<i4": "Int32", "<i8": "Int64", "|u1": "UInt8"}


def write_vtp(path: str | Path, surfaces: Iterable[SurfaceMesh], *, notes: Mapping[str, str]) -> None:
    """Write surfaces to one VTK XML PolyData file, properties as point data.

    The point data ``surface`` counts the surfaces from 1. z grows downwards; a viewer shows the scene upside down
    unless its z axis is turned. Numbers are stored binary (base64, little-endian, uncompressed).

    Parameters
    ----------
    path : str or Path
        The file.
    surfaces : iterable of SurfaceMesh
        Meshes of triangles, or of segments, with the same properties each.
    notes : mapping of str to str
        Text field data: what the coordinates and units are.

    Raises
    ------
    ShapeError
        If the surfaces differ in their properties or kind of cells.
    FileAccessError
        If the folder cannot be written to.
    """
    meshes = list(surfaces)
    properties, width = _shared_layout(meshes)
    points = _join([np.asarray(mesh.points, dtype="<f8") for mesh in meshes], (0, 3))
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    shifted = [np.asarray(mesh.cells, dtype="<i8") + start for mesh, start in zip(meshes, starts, strict=False)]
    cells = _join(shifted, (0, width)).astype("<i8")
    sizes = [len(mesh.points) for mesh in meshes]
    data = {"surface": np.repeat(np.arange(1, len(meshes) + 1, dtype="<i4"), sizes).astype("<i4")}
    for name in properties:
        data[name] = _join([np.asarray(mesh.properties[name], dtype="<f4") for mesh in meshes], (0,))
    text = _document(points, cells, data, notes)
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(text.encode())


def _shared_layout(meshes: list[SurfaceMesh]) -> tuple[list[str], int]:
    layouts = {(tuple(mesh.properties), np.asarray(mesh.cells).shape[1]) for mesh in meshes}
    if len(layouts) > 1:
        raise ShapeError(
            f"the surfaces have different properties or cells ({sorted(layouts)}); expected the same for all. "
            "Write them to separate files."
        )
    names, width = next(iter(layouts), ((), 3))
    return list(names), width


def _join(parts: list[AnyArray], empty: tuple[int, ...]) -> AnyArray:
    return np.concatenate(parts) if parts else np.zeros(empty)


def _document(points: AnyArray, cells: AnyArray, data: Mapping[str, AnyArray], notes: Mapping[str, str]) -> str:
    connectivity = _array("connectivity", cells.ravel())
    offsets = _array("offsets", np.arange(1, len(cells) + 1, dtype="<i8") * cells.shape[1])
    kind, n_polys, n_lines = ("Polys", len(cells), 0) if cells.shape[1] == 3 else ("Lines", 0, len(cells))
    fields = "".join(_text(name, value) for name, value in notes.items())
    return "".join(
        (
            '<?xml version="1.0"?>\n',
            '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n<PolyData>\n',
            f"<FieldData>\n{fields}</FieldData>\n",
            f'<Piece NumberOfPoints="{len(points)}" NumberOfLines="{n_lines}" NumberOfPolys="{n_polys}">\n',
            "<PointData>\n",
            *(_array(name, values) for name, values in data.items()),
            "</PointData>\n<Points>\n",
            _array("Points", points),
            f"</Points>\n<{kind}>\n{connectivity}{offsets}</{kind}>\n",
            "</Piece>\n</PolyData>\n</VTKFile>\n",
        )
    )


def _array(name: str, values: AnyArray) -> str:
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    components = f' NumberOfComponents="{little.shape[1]}"' if little.ndim == 2 else ""
    payload = base64.b64encode(np.uint64(little.nbytes).tobytes() + little.tobytes()).decode()
    kind = _TYPES[little.dtype.str]
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{components} format="binary">{payload}</DataArray>\n'


def _text(name: str, value: str) -> str:
    codes = " ".join(str(code) for code in [*value.encode(), 0])
    return f'<Array type="String" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{codes}</Array>\n'
