"""``seismo3d lineaments``: lines and scarps of an elevation map, as georeferenced files and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import Json, Overwrite

EXAMPLES = (
    "seismo3d lineaments dem.tif -o lines",
    "seismo3d lineaments dem.tif -o lines --length 40 --levels 3 --json",
)


def run(
    dem: Path = typer.Argument(help="Elevation map: GeoTIFF, ESRI ASCII, .npz or .npy.", show_default=False),
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    length: float = typer.Option(24.0, help="Cells along which a line must be straight."),
    levels: int = typer.Option(2, min=1, max=6, help="Levels of halved resolution that are searched."),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Find lineaments and fault scarps in an elevation map.

    The folder gets lineaments.geojson, lineaments.csv, scarp_profiles.csv, likelihood.tif, map.png, rose.png and
    run.json. It appears when all is done, or not at all.
    """
    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import check_run_folder, describe_run, print_json, write_record
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.io._files import written_aside
    from seismo3d.io.elevation import read_elevation
    from seismo3d.terrain.exports import write_lineaments
    from seismo3d.terrain.lineament_search import LineamentSettings, lineaments
    from seismo3d.terrain.scarp_profiles import scarps

    check_run_folder(out, command="lineaments", inputs=[dem], overwrite=overwrite)
    elevation = read_elevation(dem)
    with written_aside(out, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        settings = LineamentSettings(length=length, n_levels=levels)
        clock = StageClock(show)
        found = lineaments(elevation, settings=settings, progress=clock)
        clock("scarps", 0.0)
        steps = scarps(elevation, found, settings=settings)
        clock("export", 0.0)
        write_lineaments(aside, found, scarps=steps)
        _draw(aside, elevation, found)
        timings = clock.stop()
        counts = {"n_lineaments": len(found), "n_scarps": len(steps)}
        record = describe_run(dem, command="lineaments", options={"length": length, "levels": levels})
        write_record(aside, {**record, "settings": found.settings, **counts, "timings_s": timings})
    if json:
        print_json({"folder": out, **counts, "lineaments": _tabulate(found, steps), "timings_s": timings})
    else:
        _say(out, found, steps)
    say_timings(timings)


def _tabulate(found: Any, steps: Any) -> list[dict[str, Any]]:
    """Return a row a lineament, with its scarp where it has one."""
    heights = {id(scarp.lineament): scarp for scarp in steps}
    rows = []
    for line in found.lines:
        row = {"strike_deg": line.strike_deg, "length": line.length, "confidence": line.confidence}
        scarp = heights.get(id(line))
        rows.append(row if scarp is None else {**row, "height_m": scarp.height_m, "facing_deg": scarp.facing_deg})
    return rows


def _draw(folder: Path, elevation: Any, found: Any) -> None:
    import matplotlib.pyplot as plt

    from seismo3d.plot.terrain_maps import lineament_rose, terrain

    for name, ax in (("map.png", terrain(elevation, lines=found)), ("rose.png", lineament_rose(found))):
        ax.figure.savefig(folder / name, dpi=130)
        plt.close(ax.figure)


def _say(out: Path, found: Any, steps: Any) -> None:
    from seismo3d.geometry.bearings import whole_deg

    unit = "m" if found.grid.has_place else "cells"
    heights = {id(scarp.lineament): scarp for scarp in steps}
    typer.echo(f"{len(found)} {'lineament' if len(found) == 1 else 'lineaments'}")
    for number, line in enumerate(found.lines[:10], start=1):
        scarp = heights.get(id(line))
        step = "" if scarp is None else f"  scarp {scarp.height_m:.2f} m facing {whole_deg(scarp.facing_deg):.0f}"
        strike = f"{number:4d}  strike {whole_deg(line.strike_deg, turn=180.0):4.0f}  length {line.length:9.0f} {unit}"
        typer.echo(f"{strike}  confidence {line.confidence:.2f}{step}")
    if len(found) > 10:
        typer.echo(f"... {len(found) - 10} more in {out / 'lineaments.csv'}")
    typer.echo(str(out / "map.png"))
