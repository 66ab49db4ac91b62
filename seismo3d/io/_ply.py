"""PLY files of points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import FormatError
from seismo3d.io._point_tables import pick_columns, text_table

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double":
    "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}  # fmt: skip

# name and number of an element, and its properties: name and type, "list" or "" where that is not a plain one
_Elements = list[tuple[str, int, list[tuple[str, str]]]]


def read_ply(path: Path) -> tuple[AnyArray, AnyArray | None]:
    """Return the points of a PLY file, ASCII or binary, and their normals."""
    data = path.read_bytes()
    end = data.find(b"end_header")
    start = data.find(b"\n", end) + 1
    if not data.startswith(b"ply") or end < 0 or start == 0:
        raise FormatError(f"{path.name} has no PLY header; expected 'ply' first and a line 'end_header'.")
    lines = data[:end].decode("ascii", errors="replace").split("\n")
    form, elements = _ply_elements(lines, path)
    if form == "ascii":
        table = _ply_ascii(data[start:], elements, path)
    else:
        table = _ply_binary(data[start:], elements, "<" if form == "binary_little_endian" else ">", path)
    return pick_columns(table, path)


def _ply_elements(lines: list[str], path: Path) -> tuple[str, _Elements]:
    form = ""
    elements: _Elements = []
    for line in lines:
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            form = words[1]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdigit():
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"] and elements and len(words) >= 3:
            elements[-1][2].append((words[-1], "list" if words[1] == "list" else _TYPES.get(words[1], "")))
    if form not in ("ascii", "binary_little_endian", "binary_big_endian") or not any(
        e[0] == "vertex" for e in elements
    ):
        raise FormatError(
            f"{path.name} has format {form!r}; expected an ascii or binary PLY file with an element 'vertex'."
        )
    return form, elements


def _ply_ascii(body: bytes, elements: _Elements, path: Path) -> dict[str, AnyArray]:
    lines = body.decode("ascii", errors="replace").split("\n")
    first = 0
    for name, count, properties in elements:
        if name == "vertex":
            return text_table(lines[first : first + count], [p[0] for p in properties], count, path)
        first += count
    return {}


def _ply_binary(body: bytes, elements: _Elements, order: str, path: Path) -> dict[str, AnyArray]:
    offset = 0
    for name, count, properties in elements:
        if any(kind in ("list", "") for _, kind in properties):
            raise FormatError(f"{path.name} has lists in or before element 'vertex'; expected plain numbers there.")
        if not properties or len({p for p, _ in properties}) < len(properties):
            raise FormatError(f"{path.name} has no property, or two of one name, in {name!r}; expected one of each.")
        layout = np.dtype([(p, order + kind) for p, kind in properties])
        if name == "vertex":
            if len(body) < offset + count * layout.itemsize:
                raise FormatError(f"{path.name} is cut short: expected {count} points. Get the file again.")
            rows = np.frombuffer(body, dtype=layout, count=count, offset=offset)
            return {p: rows[p] for p, _ in properties}
        offset += count * layout.itemsize
    return {}


def write_ply(path: Path, p: Float64Array, n: Float64Array | None) -> None:
    """Write points, and normals, as binary PLY of double precision; places on a plane get z = 0."""
    space = np.zeros((len(p), 3))
    space[:, : p.shape[1]] = p
    names = ["x", "y", "z"]
    if n is not None:
        lifted = np.zeros_like(space)
        lifted[:, : n.shape[1]] = n
        space = np.hstack([space, lifted])
        names += ["nx", "ny", "nz"]
    properties = "".join(f"property double {name}\n" for name in names)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(p)}\n{properties}end_header\n"
    path.write_bytes(header.encode("ascii") + space.astype("<f8").tobytes())
