"""The report of a mapping run: one HTML file that holds everything it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from seismo3d.io._files import written_aside
from seismo3d.plot.pages import embed_picture, fill_template


def write_map_report(
    path: str | Path,
    title: str,
    *,
    facts: Mapping[str, Any],
    timings: Mapping[str, float],
    pictures: Sequence[tuple[Path, str]],
) -> Path:
    """Write a report on a mapping run as one self-contained HTML file.

    Parameters
    ----------
    path : str or Path
        The file.
    title : str
    facts : mapping
        Names, with underscores for blanks, and values.
    timings : mapping of str to float
        Seconds by stage.
    pictures : sequence of (Path, str)
        PNG files and their captions.

    Returns
    -------
    Path
        The file.
    """
    text = fill_template(
        "map.html.jinja",
        title=title,
        facts=[(name.replace("_", " "), str(value)) for name, value in facts.items()],
        timings=[(name, f"{seconds:.1f} s") for name, seconds in timings.items()],
        pictures=[embed_picture(file, caption) for file, caption in pictures],
    )
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(text.encode())
    return Path(path)
