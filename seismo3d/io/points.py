"""Point files: PLY, PCD, XYZ and CSV, LAS and LAZ, NPY and NPZ, read into one form; PLY, XYZ and NPY written."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import as_points
from seismo3d.errors import FormatError, Seismo3dWarning, ShapeError
from seismo3d.io._column_names import find_names
from seismo3d.io._decimal_commas import may_have_decimal_commas
from seismo3d.io._files import as_path, as_readable_file, check_output, refuse_os_errors, written_aside
from seismo3d.io._las import read_las
from seismo3d.io._pcd import read_pcd
from seismo3d.io._ply import read_ply, write_ply
from seismo3d.io._point_tables import parse_numbers, pick_columns
from seismo3d.io.numpy_files import list_npz, read_npy, read_npz

_MOST_COLUMNS = 10
"""Of arrays of points: coordinates, normals, a colour and one number more."""
WRITTEN_SUFFIXES = (".ply", ".xyz", ".npy")


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
    path = as_path(path)
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
    if n is not None and n.shape != p.shape:
        raise ShapeError(f"normals has shape {n.shape}; expected {p.shape}, one a point.")
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
            write_ply(aside, p, n)
    return path


def _read_text(path: Path) -> tuple[AnyArray, AnyArray | None]:
    lines = path.read_text(encoding="utf-8-sig", errors="replace").split("\n")
    first = next((k for k, line in enumerate(lines) if _is_row(line)), len(lines) - 1)
    table = parse_numbers(_with_points(lines[first:]), path)
    if table.shape[1] < 2 or table.shape[0] == 0:
        raise FormatError(f"{path.name} has rows of {table.shape[1]} numbers; expected at least two coordinates a row.")
    names = find_names([line for line in lines[:first] if line.strip()], table.shape[1], path.name)
    if names and names != ["x", "y", "z"]:
        named = {name: table[:, k] for k, name in reversed(list(enumerate(names)))}  # the first of equal names holds
        return pick_columns(named, path)
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
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".csv": _read_text,
    ".pts": _read_text,
    ".las": read_las,
    ".laz": read_las,
    ".npy": _read_numpy,
    ".npz": _read_numpy,
}
