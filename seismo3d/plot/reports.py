"""The report of a faults run: one HTML file that holds everything it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from seismo3d.io._files import written_aside
from seismo3d.plot.pages import embed_picture, fill_template, in_words
from seismo3d.plot.picture_set import PictureFile, save_pictures
from seismo3d.plot.pictures import name_axes
from seismo3d.plot.report_facts import key_numbers, survey_facts, table_cell, table_columns
from seismo3d.plot.traces_of_faults import SURFACE_COLOURS
from seismo3d.seismic.cube_checks import check_faults_of
from seismo3d.seismic.fault_table import tabulate_faults

_MOST_ROWS = 300


def write_report(
    path: str | Path,
    cube: Any,
    *,
    faults: Any,
    title: str = "Faults",
    pictures: Sequence[PictureFile] | None = None,
    run: Mapping[str, Any] | None = None,
) -> Path:
    """Write a report on faults as one self-contained HTML file.

    It has no links to other files or hosts: pictures are inside it. It prints on A4 and letter paper.

    Parameters
    ----------
    path : str or Path
        The file; replaced in one step where it is there already.
    cube : DataArray or ndarray
        The cube or section.
    faults : FaultSet
        Its faults.
    title : str
        Heading of the page.
    pictures : sequence of PictureFile, optional
        What :func:`seismo3d.plot.picture_set.save_pictures` gave; drawn anew by default.
    run : mapping, optional
        What else to record: ``input``, ``timings_s`` (seconds by stage), ``versions`` and so on, as in ``run.json``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ShapeError
        If the faults are of another cube.
    FileAccessError
        If the folder cannot be written to.
    """
    check_faults_of(cube, faults)
    if pictures is None:
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            shown = embed_pictures(save_pictures(folder, cube, faults=faults))
    else:
        shown = embed_pictures(pictures)
    text = _page(cube, faults, title, shown, dict(run or {}))
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(text.encode())
    return Path(path)


def _page(cube: Any, faults: Any, title: str, pictures: list[dict[str, str]], run: dict[str, Any]) -> str:
    rows = tabulate_faults(faults, cube)
    columns = table_columns(rows)
    table = [
        {
            "colour": SURFACE_COLOURS[(row["fault"] - 1) % len(SURFACE_COLOURS)],
            "cells": [table_cell(key, row[key]) for key, _ in columns],
        }
        for row in rows[:_MOST_ROWS]
    ]
    timings = run.pop("timings_s", {})
    section = len(name_axes(cube)) == 2
    return fill_template(
        "report.html.jinja",
        title=title,
        section=section,
        slice="" if section else "depth slice" if name_axes(cube)[2] == "depth" else "time slice",
        survey=survey_facts(cube),
        numbers=key_numbers(faults, cube, rows),
        headings=[heading for _, heading in columns],
        table=table,
        n_faults=len(rows),
        pictures=pictures,
        timings=[(name, f"{seconds:.1f} s") for name, seconds in timings.items()],
        settings=_lines(faults.settings),
        run=[(name, _lines(value)) for name, value in run.items()],
    )


def embed_pictures(pictures: Sequence[PictureFile]) -> list[dict[str, str]]:
    """Return what a template needs of pictures: their bytes in base 64, captions, notes and widths."""
    return [embed_picture(entry.path, entry.caption, note=entry.note, kind=entry.kind) for entry in pictures]


def _lines(value: Any) -> list[tuple[str, str]]:
    """Turn a mapping into names and values in words; anything else as one value."""
    if isinstance(value, Mapping):
        return [(str(name), in_words(item)) for name, item in value.items()]
    return [("", in_words(value))]
