"""Tables of points: numbers as text, and points and normals from named columns."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import FormatError

_NORMAL_NAMES = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))


def pick_columns(table: dict[str, AnyArray], path: Path) -> tuple[AnyArray, AnyArray | None]:
    """Return points, and normals where there are any, from named columns."""
    axes = ("x", "y", "z") if "z" in table else ("x", "y")
    if not all(axis in table for axis in axes):
        raise FormatError(f"{path.name} has fields {', '.join(table)}; expected x, y and z among them.")
    points = np.column_stack([table[axis].astype(np.float64) for axis in axes])
    for names in _NORMAL_NAMES:
        if all(name in table for name in names[: len(axes)]):
            return points, np.column_stack([table[name].astype(np.float64) for name in names[: len(axes)]])
    return points, None


def text_table(lines: list[str], names: list[str], count: int, path: Path) -> dict[str, AnyArray]:
    """Return named columns of numbers as text, or refuse rows that are too few or too short."""
    table = parse_numbers(lines, path)
    if table.shape[0] < count or table.shape[1] < len(names):
        raise FormatError(
            f"{path.name} is cut short: {table.shape[0]} rows of {table.shape[1]} numbers; "
            f"expected {count} rows of {len(names)}."
        )
    return {name: table[:, k] for k, name in enumerate(names)}


def parse_numbers(lines: list[str], path: Path) -> Float64Array:
    """Return rows of numbers that commas, semicolons or blanks part."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # numpy's remark on empty input: shapes are checked by the callers
        try:
            text = [line.replace(",", " ").replace(";", " ") for line in lines]
            return np.loadtxt(text, ndmin=2, dtype=np.float64, comments=("#", "//"))
        except ValueError as error:
            raise FormatError(f"{path.name} holds a row that is not numbers: {error}. Take it out.") from error
