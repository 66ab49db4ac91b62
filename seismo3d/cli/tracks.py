"""``seismo3d tracks``: horizons from seeds, through a cube and across its faults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import CrosslineByte, Cube, Domain, InlineByte, XByte, YByte


def run(
    cube: Cube,
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    seed: list[str] = typer.Option(
        [], help="INLINE,CROSSLINE,TIME of a point on a horizon; several times for several. [default: find horizons]"
    ),
    faults: Path | None = typer.Option(None, help="Folder of a faults run of this cube. [default: no faults]"),
    event: str | None = typer.Option(None, help="peak, trough or zero. [default: the seed's own phase]"),
    count: int = typer.Option(5, min=1, help="Number of horizons to find where no seed is given."),
    inline_byte: InlineByte = None,
    crossline_byte: CrosslineByte = None,
    x_byte: XByte = None,
    y_byte: YByte = None,
    domain: Domain = None,
    overwrite: bool = typer.Option(False, "--overwrite", help="Replace the results of an earlier run in the folder."),
) -> None:
    """Follow horizons from seeds through a cube and across its faults: grids, points, table and pictures.

    The folder gets each track as XYZ, Charisma and IRAP classic text, tracks.csv, a depth map of each track, a section
    with all of them, and run.json. It appears when all is done, or not at all.
    """
    from seismo3d.cli._run_folder import RECORD, check_run_folder, describe_run, write_record
    from seismo3d.cli._stages import StageClock
    from seismo3d.cli.app import shown_progress
    from seismo3d.io._files import written_aside
    from seismo3d.io.cubes import open_cube
    from seismo3d.seismic.faultset import FaultSet
    from seismo3d.seismic.track_exports import write_tracks
    from seismo3d.seismic.tracks import trace_tracks

    points = [_as_seed(text) for text in seed]
    check_run_folder(out, inputs=[cube, *([faults] if faults else [])], overwrite=overwrite)
    options: dict[str, Any] = {
        "inline_byte": inline_byte,
        "crossline_byte": crossline_byte,
        "x_byte": x_byte,
        "y_byte": y_byte,
        "domain": domain,
    }
    opened = open_cube(cube, **options).load()
    known = None if faults is None else FaultSet.load(faults)
    with written_aside(out, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        clock = StageClock(show)
        tracks = trace_tracks(opened, points or None, faults=known, event=event, count=count, progress=clock)
        clock("export", 0.0)
        write_tracks(tracks, opened, directory=aside)
        _draw(opened, tracks, known, aside)
        asked = {**options, "seed": seed, "faults": faults, "event": event, "count": count}
        write_record(aside / RECORD, {**describe_run(cube, asked), "timings_s": clock.stop()})
    for number, track in enumerate(tracks, start=1):
        typer.echo(f"{number:4d}  traced on {100 * track.share:3.0f} % of the traces")
    typer.echo(str(out))


def _as_seed(text: str) -> tuple[float, ...]:
    from seismo3d.errors import ParameterError

    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 3:
        raise ParameterError(f"--seed is {text!r}; expected INLINE,CROSSLINE,TIME, such as 1040,2060,812.")
    return values


def _draw(cube: Any, tracks: list[Any], faults: Any, folder: Path) -> None:
    """Draw the map of each track, and both sections through the first seed."""
    from matplotlib.figure import Figure

    from seismo3d.plot.track_pictures import track_map, track_section

    if not tracks:
        return
    inline, crossline, _ = tracks[0].seeds[0]
    for number, track in enumerate(tracks, start=1):
        figure = Figure(figsize=(8.0, 6.0), layout="constrained")
        track_map(track, cube, ax=figure.add_subplot())
        figure.savefig(folder / f"track_{number:02d}_map.png", dpi=150)
    for name, where in (("inline", {"inline": inline}), ("crossline", {"crossline": crossline})):
        figure = Figure(figsize=(10.0, 5.5), layout="constrained")
        track_section(cube, tracks, faults=faults, ax=figure.add_subplot(), **where)
        figure.savefig(folder / f"tracks_{name}.png", dpi=150)
