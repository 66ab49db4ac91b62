"""``seismo3d view``: look at a cube with its faults and horizons in the browser, trace from clicks, edit."""

from __future__ import annotations

from pathlib import Path

import typer

from seismo3d.cli._options import Reading, reads_cube

EXAMPLES = (
    "seismo3d view f3.sgy",
    "seismo3d view f3-faults",
    "seismo3d view f3-faults --cube /data/f3.sgy -o f3-edited --port 8123 --no-browser",
)


@reads_cube
def run(
    path: Path = typer.Argument(
        help="A cube (SEG-Y, Zarr, .npy, .npz), or the folder of a faults run or of an earlier view.",
        show_default=False,
    ),
    cube: Path | None = typer.Option(
        None, help="The cube that a folder's faults were traced in. [default: the file that the folder names]"
    ),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="Folder that Save writes. [default: the name with -edited, in the current folder]"
    ),
    port: int = typer.Option(
        0,
        min=0,
        max=65535,
        show_default=False,
        help="Port to listen on, on this machine only. [default: a free one]",
    ),
    browser: bool = typer.Option(True, help="Open the page; without it only its address is printed."),
    overwrite: bool = typer.Option(
        False, "--overwrite", help="Let Save replace the files of an earlier view in --out."
    ),
    *,
    reading: Reading,
) -> None:
    """Look at a cube, its faults and horizons in the browser; trace from clicks, edit, undo, save.

    The page shows slices along three axes, a 3D scene and the throw map. Its address, token included, is printed; it is
    served on this machine only, until Ctrl-C. Save writes faultset.npz, tracks.npz and the exchange formats.
    """
    from seismo3d.viewer.opening import show
    from seismo3d.viewer.server import check_installed
    from seismo3d.viewer.storage import choose_folder, open_session

    check_installed()
    folder = choose_folder(path, out, overwrite=overwrite)
    opened = open_session(path, cube=cube, **reading)
    viewer = show(
        opened.cube, opened.faults, tracks=opened.tracks, folder=folder, title=path.name, port=port,
        open_browser=browser,
    )  # fmt: skip
    typer.echo(viewer.url)
    try:
        viewer.wait()
    finally:
        viewer.stop()
        if not viewer.session.history.is_saved:
            typer.echo("seismo3d: edits since the last save are lost", err=True)
