"""``seismo3d paper``: the paper's experiments."""

from __future__ import annotations

from pathlib import Path

import typer

_EXPERIMENTS = ("table1", "figure3")


def run(
    experiment: str = typer.Argument(
        help="table1 or figure3: registration of rotated depth frames.", show_default=False
    ),
    data: Path | None = typer.Argument(
        None, help="RGB-D sequence in the TUM layout with camera.json. [default: drawn rooms]", show_default=False
    ),
    output: Path | None = typer.Option(None, "--output", "-o", help="Folder for the figure and the table."),
    frames: int = typer.Option(4, min=1, help="Frames that are rotated."),
    angles: str = typer.Option("5,10,15,20,25,30,45,60,75,90", help="Rotations in degrees, with commas."),
) -> None:
    """Run an experiment of the paper and print its table."""
    from seismo3d.errors import ParameterError
    from seismo3d.experiments.registration_table import draw_figure, format_table, load_frames, make_table

    if experiment not in _EXPERIMENTS:
        raise ParameterError(f"experiment is {experiment!r}; expected {' or '.join(_EXPERIMENTS)}.")
    try:
        degrees = tuple(int(word) for word in angles.split(","))
    except ValueError as error:
        raise ParameterError(f"angles is {angles!r}; expected whole degrees with commas.") from error
    chosen = degrees if experiment == "table1" else (20,)
    made = make_table(load_frames(data, n_frames=frames), angles_deg=chosen, figure_angle_deg=20)
    text = format_table(made)
    if experiment == "table1":
        typer.echo("accuracy in percent / seconds, by rotation in degrees")
        typer.echo(text)
    folder = output
    if experiment == "figure3":
        folder = Path() if output is None else output
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        if experiment == "table1":
            (folder / "table1.txt").write_text(text + "\n")
        if 20 in chosen:
            typer.echo(str(draw_figure(made, folder / "figure3.png")))
