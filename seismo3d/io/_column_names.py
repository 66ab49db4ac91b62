"""The header of a text file of points: which columns hold coordinates, by names with or without units."""

from __future__ import annotations

import re

from seismo3d.errors import FormatError

_AXES = {
    "x": ("x", "easting", "east"),
    "y": ("y", "northing", "north"),
    "z": ("z", "height", "elevation", "altitude", "elev", "alt", "h"),
}
_UNIT = re.compile(r"\s*[\[(][^\])]*[\])]")
_COMMENT = ("#", "//")


def find_names(header: list[str], n_columns: int, file: str) -> list[str]:
    """Return the names of the columns, those of the coordinates as x, y and z; none where no line names them.

    Parameters
    ----------
    header : list of str
        Lines before the first row of numbers, comments among them.
    n_columns : int
        Numbers a row.
    file : str
        For the errors.

    Raises
    ------
    FormatError
        If a line names as many columns as there are, and none of them as coordinates, or names more.
    """
    for line in reversed(header):
        is_comment = line.lstrip().startswith(_COMMENT)
        given, are_parted = _split(line)
        names = _with_axes(given)
        if {"x", "y"} <= set(names):
            if len(names) <= n_columns:
                return names
            if not is_comment:
                raise FormatError(
                    f"{file} names {len(names)} columns, {', '.join(given)}, and its rows have {n_columns} numbers; "
                    "expected a number for each name. Drop the columns that are no numbers."
                )
        elif len(names) == n_columns and (are_parted or not is_comment) and not any(" " in name for name in names):
            raise FormatError(
                f"{file} names its columns {', '.join(given)}; expected x, y and z, or easting, northing and height, "
                "among them. Rename them, or begin a line of other words with #."
            )
    return []


def _split(line: str) -> tuple[list[str], bool]:
    """Return the names on a line, without units, quotes and the mark of a comment, and whether signs part them."""
    text = _UNIT.sub("", line.strip().lstrip("#/")).lower()
    sign = next((sign for sign in (";", ",", "\t") if sign in text), None)
    names = [name.strip(' "') for name in text.split(sign)]
    return [name for name in names if name], sign is not None


def _with_axes(names: list[str]) -> list[str]:
    """Return names with x, y and z in place of the first word that each axis is called by."""
    found = list(names)
    for axis, words in _AXES.items():
        word = next((word for word in words if word in names), None)
        if word is not None:
            found[names.index(word)] = axis
    return found
