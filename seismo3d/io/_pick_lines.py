"""Lines of text files of picks: read, counted and refused by number."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NoReturn

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.errors import FormatError
from seismo3d.io._decimal_commas import may_have_decimal_commas
from seismo3d.io._files import as_readable_file, refuse_os_errors

_COMMENTS = ("#", "!")
UNKNOWN = 9999900.0
"""What an IRAP grid holds where it has no value."""
_NULLS = (UNKNOWN, -999.25, -9999.0, -99999.0)
"""What programs write in place of a value."""
_LARGEST = 1e29
"""So is what is larger: OpendTect's is 1e30."""


def read_lines(path: str | Path) -> list[tuple[int, str]]:
    """Return number, from 1, and text of every line that is neither blank nor a comment (# or !).

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    FormatError
        If it is not text, or no line is left.
    """
    file = as_readable_file(path)
    with refuse_os_errors(file, "read"):
        raw = file.read_bytes()
    if b"\0" in raw[:4096]:
        raise FormatError(f"{file} is not text; expected picks as ASCII. Export them as text.")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    kept = [(number, line) for number, line in lines if line and not line.startswith(_COMMENTS)]
    if not kept:
        raise FormatError(f"{file} holds no picks; expected at least one line. Check the export.")
    return kept


def fields_of(path: str | Path, number: int, line: str) -> list[str]:
    """Return the fields of a line of numbers, which semicolons, blanks or commas part.

    A comma is a decimal sign where others part the numbers. A line that may be meant either way is refused.
    """
    line_of_fields = line.strip("; \t")
    with_semicolons = ";" in line_of_fields
    words = [word.strip() for word in line_of_fields.split(";")] if with_semicolons else line_of_fields.split()
    alone = len(words) == 1
    if "," not in line or (not alone and may_have_decimal_commas(words)):
        return words
    if with_semicolons or (not alone and any("," in word and may_have_decimal_commas([word]) for word in words)):
        refuse_line(path, number, line, "either commas alone between numbers, or decimal commas alone in them")
    return line.replace(",", " ").split()


def numbers_of(words: list[str], *, nan: bool = False) -> list[float] | None:
    """Return the words as finite numbers, or NaN where that may be; None where one is none.

    They have decimal points or decimal commas, not both.
    """
    if any("," in word for word in words):
        if not may_have_decimal_commas(words):
            return None
        words = [word.replace(",", ".") for word in words]
    try:
        values = [float(word) for word in words]
    except ValueError:
        return None
    return values if all(math.isfinite(value) or (nan and math.isnan(value)) for value in values) else None


def has_value(z: Float64Array) -> BoolArray:
    """Tell which times or depths of picks are values, and none of those that programs write in place of one."""
    return np.asarray((np.abs(z) < _LARGEST) & ~np.isin(z, _NULLS))


def leading_numbers(words: list[str]) -> int:
    """Count the words at the beginning that are finite numbers or NaN."""
    return next((n for n, word in enumerate(words) if numbers_of([word], nan=True) is None), len(words))


def refuse_line(path: str | Path, number: int, line: str, expected: str) -> NoReturn:
    """Raise the error about one line."""
    shown = line if len(line) <= 80 else line[:77] + "..."
    raise FormatError(f"{path}, line {number}: {shown!r}; expected {expected}. Correct or remove the line.")
