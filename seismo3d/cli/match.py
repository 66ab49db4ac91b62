"""``seismo3d match``: places that two images, sections or cubes have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import Json, Reading, reads_cube

EXAMPLES = (
    "seismo3d match a.png b.png -o matches.png",
    "seismo3d match a.sgy b.sgy --points 200 --json",
)


@reads_cube
def run(
    target: Path = typer.Argument(help="Image (PNG, JPEG, TIFF), .npy, .npz, SEG-Y or Zarr.", show_default=False),
    source: Path = typer.Argument(help="The other one, of the same kind.", show_default=False),
    out: Path | None = typer.Option(None, "--out", "--output", "-o", help="Picture to write: .png, .pdf or .svg."),
    points: int | None = typer.Option(None, "--points", min=1, help="Points compared. [default: 500, cubes 300]"),
    tilts: str = typer.Option("auto", help="Compare images as seen from the side: auto, always or never."),
    json: Json = False,
    *,
    reading: Reading,
) -> None:
    """Match two images or cubes that are rotated, tilted, scaled or displaced, and draw the matches.

    Options on how a cube is read are for both.
    """
    from seismo3d.features.matching import match
    from seismo3d.io._files import check_output
    from seismo3d.io.grids import read_grid

    if out is not None:
        from seismo3d.plot.picture_files import PICTURES

        check_output(out, endings=PICTURES, inputs=(target, source))
    first, second = read_grid(target, **reading), read_grid(source, **reading)
    found = match(first, second, n_points=points, tilts=tilts)
    if out is not None:
        from seismo3d.plot.match_pictures import save_matches

        save_matches(out, first, second, found)
    typer.echo(_as_json(found) if json else _as_text(found))
    if out is not None and not json:
        typer.echo(f"picture  {out}")


def _as_text(found: Any) -> str:
    import numpy as np

    lines = [f"matches  {len(found)} of {found.n_points[0]} points in the target, {found.n_points[1]} in the source"]
    if len(found):
        angle = np.degrees(np.angle(np.exp(1j * found.angle).mean()))
        lines += [
            f"angle    {angle:.2f} deg, source to target",
            f"scale    {np.median(found.scale):.4f}, target over source",
            f"score    {np.median(found.score):.3f} at the median",
        ]
    return "\n".join(lines)


def _as_json(found: Any) -> str:
    from json import dumps

    names = ("points_target", "points_source", "score", "angle", "scale")
    return dumps({"n_points": list(found.n_points), **{name: getattr(found, name).tolist() for name in names}})
