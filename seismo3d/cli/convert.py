"""``seismo3d convert``: between SEG-Y, Zarr and NPY."""

from __future__ import annotations

from pathlib import Path

import typer

from seismo3d.cli._options import Cube, Json, Reading, reads_cube

EXAMPLES = (
    "seismo3d convert f3.sgy f3.zarr",
    "seismo3d convert f3.zarr f3-again.sgy",
    "seismo3d convert migrated.sgy migrated.zarr --domain depth",
    "seismo3d convert dense.sgy thinned.sgy --every 3",
    "seismo3d convert cube.npy cube.sgy --interval 4 --start 400",
)


@reads_cube
def run(
    cube: Cube,
    out: Path = typer.Argument(help="File or folder to write: .sgy, .segy, .zarr or .npy tells the format."),
    overwrite: bool = typer.Option(False, "--overwrite", help="Replace the file or folder where it is there already."),
    every: int = typer.Option(1, help="Keep every so many samples alone, where traces are denser than they need."),
    json: Json = False,
    *,
    reading: Reading,
) -> None:
    """Convert a cube between SEG-Y, Zarr and NPY, in blocks, so that its size does not matter."""
    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import print_json
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.io.cubes import convert_cube

    with shown_progress() as show:
        clock = StageClock(show)
        clock("open", 0.0)
        written = convert_cube(cube, out, overwrite=overwrite, every=every, progress=clock, **reading)
        timings = clock.stop()
    if json:
        print_json({"file": written, "timings_s": timings})
    else:
        typer.echo(str(written))
    say_timings(timings)
