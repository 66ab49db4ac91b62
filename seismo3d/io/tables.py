"""Tables as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from seismo3d.io._files import written_aside

# least decimals, least digits, and most decimals of a number: what is smaller is the rounding of what made it
_DECIMALS, _DIGITS, _FINEST = 4, 6, 12


def write_csv(path: str | Path, rows: Sequence[Mapping[str, Any]], *, columns: Sequence[str]) -> None:
    """Write rows as comma-separated values with a header line (RFC 4180; UTF-8, lines end in LF).

    Parameters
    ----------
    path : str or Path
        The file.
    rows : sequence of mappings
        One mapping a row; numbers are rounded to four decimals, or to six digits where those are more; NaN and None as
        empty cells.
    columns : sequence of str
        The columns in order; the header is written even if there is no row.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(row.get(column)) for column in columns] for row in rows)
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(text.getvalue().encode())


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if not isinstance(value, float):
        return str(value)
    decimals = _DECIMALS if value == 0.0 else _DIGITS - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, min(max(decimals, _DECIMALS), _FINEST)) + 0.0:.15g}"
