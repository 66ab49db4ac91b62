"""The report of a mapping run: one HTML file that holds everything it shows."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from seismo3d.io._files import written_aside


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
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("seismo3d.plot"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    shown = [{"data": base64.b64encode(file.read_bytes()).decode(), "caption": caption} for file, caption in pictures]
    text = environment.get_template("map.html.jinja").render(
        title=title,
        facts=[(name.replace("_", " "), str(value)) for name, value in facts.items()],
        timings=[(name, f"{seconds:.1f} s") for name, seconds in timings.items()],
        pictures=shown,
    )
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(text.encode())
    return Path(path)
