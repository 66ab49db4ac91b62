"""``seismo3d convert``: between SEG-Y, Zarr and NPY."""

from __future__ import annotations

from pathlib import Path

import typer

from seismo3d.cli._options import CrosslineByte, Cube, Domain, InlineByte, XByte, YByte


def run(
    cube: Cube,
    out: Path = typer.Argument(help="File or folder to write: .sgy, .segy, .zarr or .npy tells the format."),
    inline_byte: InlineByte = None,
    crossline_byte: CrosslineByte = None,
    x_byte: XByte = None,
    y_byte: YByte = None,
    domain: Domain = None,
) -> None:
    """Convert a cube between SEG-Y, Zarr and NPY, in blocks, so that its size does not matter."""
    from seismo3d.cli.app import shown_progress
    from seismo3d.io.cubes import convert_cube

    with shown_progress() as progress:
        written = convert_cube(
            cube,
            out,
            progress=progress,
            inline_byte=inline_byte,
            crossline_byte=crossline_byte,
            x_byte=x_byte,
            y_byte=y_byte,
            domain=domain,
        )
    typer.echo(str(written))
