"""``seismo3d paper``: the experiments of the paper, measured anew."""

from __future__ import annotations

from pathlib import Path

import typer

from seismo3d.errors import ParameterError

_WHERE = {
    "table2": "seismo3d.experiments.matching_tables",
    "table3": "seismo3d.experiments.matching_tables",
    "table4": "seismo3d.experiments.matching_tables",
}
"""Module of each experiment: a function of the experiment's name in it gives its text."""


def run(
    experiment: str = typer.Argument(help="table2, table3, table4 or all.", show_default=False),
    images: int | None = typer.Option(None, "--images", min=1, help="Use only so many images. [default: all]"),
    output: Path | None = typer.Option(None, "-o", "--output", help="Write the text to this file too."),
) -> None:
    """Measure a table of the paper again: its figures stand beside ours and those of SIFT, SURF, ORB and AKAZE."""
    import importlib

    from seismo3d.cli.app import shown_progress

    if experiment != "all" and experiment not in _WHERE:
        raise ParameterError(f"experiment is {experiment!r}; expected one of {', '.join(_WHERE)} or all.")
    texts = []
    for name in _WHERE if experiment == "all" else (experiment,):
        with shown_progress() as progress:
            texts.append(getattr(importlib.import_module(_WHERE[name]), name)(n_images=images, progress=progress))
        typer.echo(texts[-1] + "\n")
    if output is not None:
        output.write_text("\n\n".join(texts) + "\n", encoding="utf-8")
