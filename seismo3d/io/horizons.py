"""Horizons in the ASCII forms that other programs read and write: XYZ points, Charisma points, IRAP classic.

z grows downwards, in the cube's own unit. Charisma's rows name the lines: ``INLINE : n XLINE : m x y z``. An IRAP
classic grid (ROXAR text) has no line numbers; places without a value hold 9999900.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_whole_number, freeze, told
from seismo3d.errors import FormatError, GeometryError, ParameterError
from seismo3d.io._files import written_aside
from seismo3d.io._pick_lines import (
    UNKNOWN,
    fields_of,
    has_value,
    numbers_of,
    read_lines,
    refuse_line,
)

_END_OF_PART = 999.0
"""An IRAP classic file of points ends its parts by a line of three of these."""
_CHARISMA = re.compile(r"^INLINE\s*:\s*(\S+)\s+(?:XLINE|CROSSLINE|TRACE)\s*:\s*(\S+)\s+(.*)$", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class HorizonGrid:
    """A horizon on the traces of a survey.

    Attributes
    ----------
    x, y, z : ndarray of shape (inline, crossline), float64
        Map coordinates of the traces, and the horizon's time or depth; NaN where it is not known.
    inlines, crosslines : ndarray, float64
        Line numbers.
    """

    x: Float64Array
    y: Float64Array
    z: Float64Array
    inlines: Float64Array
    crosslines: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class HorizonPoints:
    """A horizon as points.

    Attributes
    ----------
    name : str
        The file's name without its ending.
    points : ndarray of shape (n, 3), float64
        x, y, z.
    lines : ndarray of shape (n, 2), float64
        Inline and crossline numbers; NaN where the file does not tell.
    """

    name: str
    points: Float64Array
    lines: Float64Array


def read_horizon(path: str | Path, *, columns: Sequence[int] | None = None) -> HorizonPoints:
    """Read a horizon: XYZ, IRAP classic points or grid, or Charisma, told by its lines.

    Lines that are blank or begin with ``#`` or ``!`` are passed over. Points without a value are left out: 9999900 in
    IRAP, 1e30 in OpendTect, and -999.25, -9999, -99999 and NaN, which other programs write. Blanks, tabs, semicolons
    or, in XYZ, commas part the numbers. A comma is a decimal sign where others do.

    Parameters
    ----------
    path : str or Path
        The file.
    columns : sequence of three int, optional
        Which columns of an XYZ file hold x, y and z, counted from 1; needed where there are more than three.

    Returns
    -------
    HorizonPoints

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    FormatError
        If it is not text, a line has another form (the message names the line), or no point has a value.
    ParameterError
        If `columns` are not three different numbers from 1, or are given for another form than XYZ.
    """
    if columns is not None:
        columns = _as_columns(columns)
    lines = read_lines(path)
    first = lines[0][1]
    if first.upper().startswith("INLINE"):
        table, form = _read_charisma(path, lines), "Charisma"
    elif first.replace(";", " ").split()[:1] == ["-996"]:
        table, form = _read_irap_grid(path, lines), "IRAP"
    else:
        table, form = _read_columns(path, lines, columns), "XYZ"
    if columns is not None and form != "XYZ":
        raise ParameterError(f"columns is given, but {path} is in {form} form, which tells them. Leave it out.")
    known = has_value(table[:, 2])
    if not known.any():
        raise FormatError(f"{path} holds no point with a value. Check the export.")
    table = table[known]
    return HorizonPoints(Path(path).stem, freeze(table[:, :3].copy()), freeze(table[:, 3:].copy()))


def _as_columns(columns: Any) -> tuple[int, ...]:
    if not isinstance(columns, Iterable) or isinstance(columns, str) or getattr(columns, "ndim", 1) == 0:
        raise ParameterError(f"columns is {told(columns)}; expected three different numbers, from 1.")
    chosen = tuple(as_whole_number(column, f"columns[{k}]") for k, column in enumerate(columns))
    if len(chosen) != 3 or len(set(chosen)) != 3 or min(chosen) < 1:
        raise ParameterError(f"columns is {chosen}; expected three different numbers, from 1.")
    return chosen


def _read_charisma(path: str | Path, lines: list[tuple[int, str]]) -> Float64Array:
    rows = []
    for number, line in lines:
        match = _CHARISMA.match(line.replace(";", " "))
        words = [*match.group(3).split(), *match.group(1, 2)] if match else []
        if _lacks_value(words, 2):
            continue
        values = numbers_of(words)
        if values is None or len(values) != 5:
            refuse_line(path, number, line, "'INLINE : n XLINE : m x y z' with finite numbers")
        rows.append(values)
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _read_columns(path: str | Path, lines: list[tuple[int, str]], columns: Sequence[int] | None) -> Float64Array:
    n = len(fields_of(path, *lines[0]))
    if n > 3 and columns is None:
        refuse_line(path, *lines[0], f"three numbers x y z, or `columns` to say which of the {n} these are")
    if columns is not None and max(columns) > n:
        refuse_line(path, *lines[0], f"at least {max(columns)} numbers")
    chosen = [0, 1, 2] if columns is None else [column - 1 for column in columns]
    rows = []
    for number, line in lines:
        words = fields_of(path, number, line)
        if _lacks_value(words, chosen[2]):
            continue
        values = numbers_of(words)
        if values is None or len(values) != max(n, 3):
            refuse_line(path, number, line, f"{max(n, 3)} finite numbers")
        rows.append(values)
    table = np.array(rows, dtype=np.float64).reshape(-1, max(n, 3))[:, chosen]
    table = table[(table != _END_OF_PART).any(axis=1)]
    return np.column_stack([table, np.full((len(table), 2), np.nan)])


def _lacks_value(words: list[str], column: int) -> bool:
    return len(words) > column and words[column].lower() == "nan"


def _read_irap_grid(path: str | Path, lines: list[tuple[int, str]]) -> Float64Array:
    """Return the places of all nodes of an IRAP classic grid with their values."""
    header, end = [], 0
    for number, line in lines:
        values = numbers_of(line.replace(";", " ").split())
        if values is None:
            refuse_line(path, number, line, "numbers of the header of an IRAP classic grid")
        header += values
        end += 1
        if len(header) >= 19:
            break
    if len(header) != 19:
        raise FormatError(
            f"{path} ends in its header, or that has {len(header)} numbers; expected 19. Export it again."
        )
    m, dx, dy, n = int(header[1]), header[2], header[3], int(header[8])
    turn, x0, y0 = np.radians(header[9]), header[10], header[11]
    body = []
    for number, line in lines[end:]:
        values = numbers_of(line.replace(";", " ").split(), nan=True)
        if values is None:
            refuse_line(path, number, line, "finite numbers")
        body += values
    if min(m, n) < 1 or len(body) != n * m:
        raise FormatError(f"{path} has {len(body)} values; its header tells {n} x {m}. Export it again.")
    b, a = np.divmod(np.arange(n * m), n)
    x = x0 + a * dx * np.cos(turn) - b * dy * np.sin(turn)
    y = y0 + a * dx * np.sin(turn) + b * dy * np.cos(turn)
    return np.column_stack([x, y, body, np.full((n * m, 2), np.nan)])


def write_xyz_horizon(path: str | Path, horizon: HorizonGrid) -> None:
    """Write one row ``x y z`` for every trace with a value.

    Parameters
    ----------
    path : str or Path
        The file.
    horizon : HorizonGrid
        What to write.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    known = np.isfinite(horizon.z)
    with written_aside(path) as aside, aside.open("wb") as file:
        for x, y, z in zip(horizon.x[known], horizon.y[known], horizon.z[known], strict=True):
            file.write(f"{x:.2f} {y:.2f} {z:.4f}\n".encode())


def write_charisma_horizon(path: str | Path, horizon: HorizonGrid) -> None:
    """Write one row ``INLINE : n XLINE : m x y z`` for every trace with a value; parameters as of the XYZ form."""
    known = np.isfinite(horizon.z)
    lines = np.meshgrid(horizon.inlines, horizon.crosslines, indexing="ij")
    columns = [np.rint(line[known]).astype(np.int64) for line in lines]
    with written_aside(path) as aside, aside.open("wb") as file:
        for i, j, x, y, z in zip(*columns, horizon.x[known], horizon.y[known], horizon.z[known], strict=True):
            file.write(f"INLINE :{i:>8d} XLINE :{j:>8d} {x:>15.2f} {y:>15.2f} {z:>14.4f}\n".encode())


def why_no_irap(x: Float64Array, y: Float64Array) -> str | None:
    """Tell what keeps the traces at these places out of an IRAP classic grid.

    Parameters
    ----------
    x, y : ndarray of shape (inline, crossline), float64
        Map coordinates of the traces.

    Returns
    -------
    str or None
        What they are, and what the grid needs; None where it can hold them.
    """
    if min(x.shape) < 2:
        return f"{x.shape} traces; an IRAP grid needs two lines each way"
    along, across = _steps(x, y)
    step = np.hypot(*along), np.hypot(*across)
    if min(step) <= 0 or abs(along @ across) > 1e-3 * step[0] * step[1]:
        return "lines that do not meet at right angles; an IRAP grid needs them to"
    return None


def _steps(x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the mean step from trace to trace along the first axis and along the second."""
    n, m = x.shape
    along = np.array([x[-1, 0] - x[0, 0], y[-1, 0] - y[0, 0]]) / (n - 1)
    across = np.array([x[0, -1] - x[0, 0], y[0, -1] - y[0, 0]]) / (m - 1)
    return along, across


def write_irap_classic(path: str | Path, horizon: HorizonGrid) -> None:
    """Write an IRAP classic grid: a header with origin, steps and rotation, then six values a row.

    Parameters
    ----------
    path : str or Path
        The file.
    horizon : HorizonGrid
        Its traces must lie on a rectangular grid, which may be turned.

    Raises
    ------
    GeometryError
        If they do not.
    FileAccessError
        If the folder cannot be written to.
    """
    reason = why_no_irap(horizon.x, horizon.y)
    if reason is not None:
        raise GeometryError(f"horizon has {reason}. Write XYZ.")
    x, y, z = horizon.x, horizon.y, horizon.z
    along, across = _steps(x, y)
    if along[0] * across[1] - along[1] * across[0] < 0:  # columns must lie to the left of rows
        x, y, z, along, across = x.T, y.T, z.T, across, along
    step = np.hypot(*along), np.hypot(*across)
    rotation = np.degrees(np.arctan2(along[1], along[0]))
    n, m = z.shape
    ends = x[0, 0] + step[0] * (n - 1), y[0, 0] + step[1] * (m - 1)
    header = (
        f"-996 {m} {step[0]:.6f} {step[1]:.6f}\n{x[0, 0]:.6f} {ends[0]:.6f} {y[0, 0]:.6f} {ends[1]:.6f}\n"
        f"{n} {rotation:.6f} {x[0, 0]:.6f} {y[0, 0]:.6f}\n0 0 0 0 0 0 0\n"
    )
    values = np.where(np.isfinite(z), z, UNKNOWN).T.ravel()
    rows = (" ".join(f"{v:.4f}" for v in values[k : k + 6]) for k in range(0, len(values), 6))
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write((header + "\n".join(rows) + "\n").encode())
