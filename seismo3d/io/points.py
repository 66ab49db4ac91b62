"""Point files: PLY, PCD, XYZ and CSV, LAS and LAZ, NPY and NPZ, read into one form; PLY, XYZ and NPY written."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import as_points
from seismo3d.errors import FormatError, MissingDependencyError, Seismo3dWarning
from seismo3d.io import _lzf
from seismo3d.io._column_names import find_names
from seismo3d.io._decimal_commas import may_have_decimal_commas
from seismo3d.io._files import as_readable_file, check_output, refuse_os_errors, written_aside
from seismo3d.io._las import check_las
from seismo3d.io.numpy_files import list_npz, read_npy, read_npz

_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double":
    "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
_PCD_TYPES = {
    (kind, str(size)): f"<{kind.lower()}{size}" for kind in "IUF" for size in (1, 2, 4, 8) if (kind, size) != ("F", 1)
}
_MOST_COLUMNS = 10
"""Of arrays of points: coordinates, normals, a colour and one number more."""
WRITTEN_SUFFIXES = (".ply", ".xyz", ".npy")
_LAS_BYTES = 64 * 2**20
_NORMAL_NAMES = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))


@dataclass(frozen=True, slots=True, eq=False)
class PointFile:
    """What a point file holds.

    Attributes
    ----------
    points : ndarray of shape (n, d), float64
        Finite points in the file's units; d is 2 or 3. Rows with values that are not finite are left out.
    normals : ndarray of shape (n, d), float64, or None
        As in the file.
    n_dropped : int
        Rows left out.
    """

    points: Float64Array
    normals: Float64Array | None
    n_dropped: int = 0


def read_points(path: str | Path) -> PointFile:
    """Read the points, and normals where there are any, of a file; the format is told by its name.

    Parameters
    ----------
    path : str or Path
        ``.ply`` (ASCII or binary), ``.pcd`` (ASCII, binary, binary compressed), ``.xyz``, ``.txt``, ``.csv``, ``.pts``
        (numbers with decimal points, or commas where semicolons or blanks part them; the first columns, or those that
        a line before them, or a comment, names x, y and z or easting, northing and height), ``.las`` or ``.laz`` (with
        the extra ``las``), ``.npy``, ``.npz`` (entry ``points``, perhaps ``normals``).

    Returns
    -------
    PointFile

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    FormatError
        If it is not what its name says, or is cut short.
    MissingDependencyError
        If a LAS or LAZ file is given and laspy is not installed.

    Warns
    -----
    Seismo3dWarning
        If rows hold values that are not finite.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FormatError(f"{path.name} ends in {path.suffix!r}; expected one of {', '.join(sorted(_READERS))}.")
    with refuse_os_errors(as_readable_file(path), "read"):
        points, normals = reader(path)
    good = np.isfinite(points).all(axis=1)
    if normals is not None:
        good &= np.isfinite(normals).all(axis=1)
        normals = np.ascontiguousarray(normals[good], dtype=np.float64)
    n_dropped = int((~good).sum())
    if n_dropped:
        warnings.warn(
            f"{path.name} has {n_dropped} of {len(points)} points with values that are not finite; they are left out.",
            Seismo3dWarning,
            stacklevel=2,
        )
    return PointFile(np.ascontiguousarray(points[good], dtype=np.float64), normals, n_dropped)


def write_points(path: str | Path, points: ArrayLike, *, normals: ArrayLike | None = None) -> Path:
    """Write points, and normals where given, as PLY (binary, float64), XYZ (text) or NPY, as the name says.

    Parameters
    ----------
    path : str or Path
        Ends in ``.ply``, ``.xyz`` or ``.npy``.
    points : array_like of shape (n, d)
    normals : array_like of shape (n, d), optional
        Not kept in NPY.

    Returns
    -------
    Path
        The file; it appears complete, or not at all.

    Raises
    ------
    ParameterError
        If the name ends in something else.
    FileAccessError
        If it cannot be written.
    """
    path = check_output(path, endings=WRITTEN_SUFFIXES)
    p = as_points(points, "points")
    n = None if normals is None else as_points(normals, "normals", dim=p.shape[1])
    table = p if n is None else np.hstack([p, n])
    suffix = path.suffix.lower()
    with written_aside(path) as aside:
        if suffix == ".npy":
            with aside.open("wb") as stream:
                np.save(stream, p)
        elif suffix == ".xyz":
            # as few digits as tell the numbers from their neighbours
            np.savetxt(aside, table, fmt="%s")
        else:
            _write_ply(aside, p, n)
    return path


def _write_ply(path: Path, p: Float64Array, n: Float64Array | None) -> None:
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


def _read_ply(path: Path) -> tuple[AnyArray, AnyArray | None]:
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
    return _pick_columns(table, path)


def _ply_elements(lines: list[str], path: Path) -> tuple[str, list[tuple[str, int, list[tuple[str, str]]]]]:
    form = ""
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for line in lines:
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            form = words[1]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdigit():
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"] and elements and len(words) >= 3:
            elements[-1][2].append((words[-1], "list" if words[1] == "list" else _PLY_TYPES.get(words[1], "")))
    if form not in ("ascii", "binary_little_endian", "binary_big_endian") or not any(
        e[0] == "vertex" for e in elements
    ):
        raise FormatError(
            f"{path.name} has format {form!r}; expected an ascii or binary PLY file with an element 'vertex'."
        )
    return form, elements


def _ply_ascii(body: bytes, elements: list[tuple[str, int, list[tuple[str, str]]]], path: Path) -> dict[str, AnyArray]:
    lines = body.decode("ascii", errors="replace").split("\n")
    first = 0
    for name, count, properties in elements:
        if name == "vertex":
            return _text_table(lines[first : first + count], [p[0] for p in properties], count, path)
        first += count
    return {}


def _ply_binary(
    body: bytes, elements: list[tuple[str, int, list[tuple[str, str]]]], order: str, path: Path
) -> dict[str, AnyArray]:
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


def _read_pcd(path: Path) -> tuple[AnyArray, AnyArray | None]:
    data = path.read_bytes()
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        end = data.find(b"\n", start)
        if end < 0 or start > 65536:
            raise FormatError(f"{path.name} has no PCD header; expected lines up to DATA.")
        words = data[start:end].decode("ascii", errors="replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    try:
        names, count = header["FIELDS"], int(header["POINTS"][0])
        counts = [int(c) for c in header.get("COUNT", ["1"] * len(names))]
        kinds = [_PCD_TYPES[t.upper(), s] for t, s in zip(header["TYPE"], header["SIZE"])]
        layout = np.dtype([(n, k, (c,)) if c > 1 else (n, k) for n, k, c in zip(_unique(names), kinds, counts)])
        form = header["DATA"][0]
    except (KeyError, ValueError, IndexError, TypeError, OverflowError) as error:
        raise FormatError(f"{path.name} has a broken PCD header: {error}. Write it again.") from error
    if count < 0 or min(counts, default=1) < 1:
        raise FormatError(
            f"{path.name} has a broken PCD header: {count} points of {counts} values a field. Write it again."
        )
    if form == "ascii":
        lines = data[start:].decode("ascii", errors="replace").split("\n")
        spread = [n if c == 1 else f"{n}{k}" for n, c in zip(_unique(names), counts) for k in range(c)]
        return _pick_columns(_text_table(lines[:count], spread, count, path), path)
    return _pick_columns(_pcd_binary(data[start:], layout, count, form, path), path)


def _pcd_binary(body: bytes, layout: np.dtype[Any], count: int, form: str, path: Path) -> dict[str, AnyArray]:
    size = count * layout.itemsize
    if form == "binary":
        if len(body) < size:
            raise FormatError(f"{path.name} is cut short: expected {count} points. Get the file again.")
        rows = np.frombuffer(body, dtype=layout, count=count)
        return {name: rows[name] for name in layout.names or ()}
    if form != "binary_compressed" or len(body) < 8:
        raise FormatError(f"{path.name} has DATA {form!r}; expected ascii, binary or binary_compressed.")
    packed, full = (int(value) for value in np.frombuffer(body, dtype="<u4", count=2))
    # three bytes of LZF unpack to 264 at most
    if packed > len(body) - 8 or full > 88 * packed + 264:
        raise FormatError(f"{path.name} announces {full} bytes of points in {packed}; expected fewer. It is damaged.")
    out = _lzf.decompress(np.frombuffer(body, dtype=np.uint8)[8 : 8 + int(packed)], int(full))
    if out.size < size:
        raise FormatError(f"{path.name} is cut short: expected {count} points. Get the file again.")
    columns, offset = {}, 0
    for name in layout.names or ():  # compressed files keep each field's values together
        kind = layout[name]
        columns[name] = np.frombuffer(out.tobytes(), dtype=kind, count=count, offset=offset)
        offset += count * kind.itemsize
    return columns


def _unique(names: list[str]) -> list[str]:
    return [name if names.count(name) == 1 else f"{name}_{k}" for k, name in enumerate(names)]


def _text_table(lines: list[str], names: list[str], count: int, path: Path) -> dict[str, AnyArray]:
    table = _parse_numbers(lines, path)
    if table.shape[0] < count or table.shape[1] < len(names):
        raise FormatError(
            f"{path.name} is cut short: {table.shape[0]} rows of {table.shape[1]} numbers; "
            f"expected {count} rows of {len(names)}."
        )
    return {name: table[:, k] for k, name in enumerate(names)}


def _parse_numbers(lines: list[str], path: Path) -> Float64Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # numpy's remark on empty input: shapes are checked by the callers
        try:
            text = [line.replace(",", " ").replace(";", " ") for line in lines]
            return np.loadtxt(text, ndmin=2, dtype=np.float64, comments=("#", "//"))
        except ValueError as error:
            raise FormatError(f"{path.name} holds a row that is not numbers: {error}. Take it out.") from error


def _read_text(path: Path) -> tuple[AnyArray, AnyArray | None]:
    lines = path.read_text(encoding="utf-8-sig", errors="replace").split("\n")
    first = next((k for k, line in enumerate(lines) if _is_row(line)), len(lines) - 1)
    table = _parse_numbers(_with_points(lines[first:]), path)
    if table.shape[1] < 2 or table.shape[0] == 0:
        raise FormatError(f"{path.name} has rows of {table.shape[1]} numbers; expected at least two coordinates a row.")
    names = find_names([line for line in lines[:first] if line.strip()], table.shape[1], path.name)
    if names and names != ["x", "y", "z"]:
        named = {name: table[:, k] for k, name in reversed(list(enumerate(names)))}  # the first of equal names holds
        return _pick_columns(named, path)
    return table[:, : min(3, table.shape[1])], (
        table[:, 3:6] if table.shape[1] == 6 and _are_unit(table[:, 3:6]) else None
    )


def _with_points(rows: list[str]) -> list[str]:
    """Return rows with decimal points: a comma is one where semicolons or blanks, without commas, part the numbers."""
    first = next((row for row in rows if "," in row and not row.lstrip().startswith(("#", "//"))), "")
    numbers = re.split(r"[;\s]+", first.strip().strip(";"))
    if len(numbers) < 2 or not may_have_decimal_commas(numbers):
        return rows
    return [row.replace(",", ".") for row in rows]


def _are_unit(vectors: Float64Array) -> bool:
    return bool(np.abs(np.linalg.norm(vectors, axis=1) - 1.0).max() < 1e-2)


def _is_row(line: str) -> bool:
    """Tell whether a line begins with a number and goes on: one alone is a count of points."""
    words = line.replace(",", " ").replace(";", " ").split()
    if len(words) < 2:
        return False
    try:
        float(words[0])
    except ValueError:
        return False
    return True


def _pick_columns(table: dict[str, AnyArray], path: Path) -> tuple[AnyArray, AnyArray | None]:
    axes = ("x", "y", "z") if "z" in table else ("x", "y")
    if not all(axis in table for axis in axes):
        raise FormatError(f"{path.name} has fields {', '.join(table)}; expected x, y and z among them.")
    points = np.column_stack([table[axis].astype(np.float64) for axis in axes])
    for names in _NORMAL_NAMES:
        if all(name in table for name in names[: len(axes)]):
            return points, np.column_stack([table[name].astype(np.float64) for name in names[: len(axes)]])
    return points, None


def _read_las(path: Path) -> tuple[AnyArray, AnyArray | None]:
    try:
        import laspy
    except ImportError as error:
        raise MissingDependencyError(
            f"{path.name} needs laspy, which is not installed. Install it with: pip install 'seismo3d[las]'."
        ) from error
    check_las(path)
    try:
        # the decoder of several threads gives memory to whatever the table of chunks says, and ends the process
        with laspy.open(path, laz_backend=[laspy.LazBackend.Lazrs]) as file:
            n_at_once = max(1, _LAS_BYTES // file.header.point_format.size)
            parts = [np.column_stack([part.x, part.y, part.z]) for part in file.chunk_iterator(n_at_once)]
            expected = int(file.header.point_count)
    except BaseException as error:
        # the decoder of LAZ panics on what it does not understand, which is no Exception
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise FormatError(f"{path.name} is not a readable LAS or LAZ file: {error}. Get it again.") from error
    points = np.concatenate([np.zeros((0, 3)), *parts])
    if len(points) != expected:
        raise FormatError(f"{path.name} is cut short: {len(points)} points of {expected}. Get the file again.")
    return points, None


def _read_numpy(path: Path) -> tuple[AnyArray, AnyArray | None]:
    normals = None
    if path.suffix.lower() == ".npy":
        points = read_npy(path)
    else:
        entries = list_npz(path)
        if "points" not in entries:
            raise FormatError(f"{path.name} has entries {', '.join(entries)}; expected one called 'points'.")
        loaded = read_npz(path, [name for name in ("points", "normals") if name in entries])
        points, normals = loaded["points"], loaded.get("normals")
    if points.ndim != 2 or points.shape[1] < 2 or points.dtype.kind not in "fiu":
        raise FormatError(
            f"{path.name} holds an array of shape {points.shape}; expected points of shape (n, 2) or (n, 3)."
        )
    if points.shape[1] > _MOST_COLUMNS or (len(points) in (2, 3) and points.shape[1] > 6):
        remedy = "transpose it" if len(points) < _MOST_COLUMNS else "a map is an .npz with an entry 'elevation'"
        raise FormatError(
            f"{path.name} holds an array of shape {points.shape}; expected points of shape (n, 2) or (n, 3), at most "
            f"{_MOST_COLUMNS} columns with all else. Give one point a row; {remedy}."
        )
    points = points[:, :3]
    if normals is not None and (normals.shape != points.shape or normals.dtype.kind not in "fiu"):
        raise FormatError(
            f"{path.name} has normals of shape {normals.shape} and type {normals.dtype}; expected numbers of shape "
            f"{points.shape}, as its points."
        )
    return points, normals


_READERS: dict[str, Callable[[Path], tuple[AnyArray, AnyArray | None]]] = {
    ".ply": _read_ply,
    ".pcd": _read_pcd,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".csv": _read_text,
    ".pts": _read_text,
    ".las": _read_las,
    ".laz": _read_las,
    ".npy": _read_numpy,
    ".npz": _read_numpy,
}
