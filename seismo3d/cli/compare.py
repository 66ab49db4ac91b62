"""``seismo3d compare``: what changed between two elevation maps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import Json, Overwrite, refuse_unused

EXAMPLES = (
    "seismo3d compare before.tif after.tif -o change",
    "seismo3d compare before.tif after.tif -o change --vertical tilt --confidence 0.99 --json",
)


def run(
    before: Path = typer.Argument(help="Elevation map: GeoTIFF, ESRI ASCII, .npz or .npy.", show_default=False),
    after: Path = typer.Argument(help="The later one, in the same reference system.", show_default=False),
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    align: bool = typer.Option(True, help="Register the later map on the earlier one first."),
    vertical: str | None = typer.Option(
        None, help="What the registration may do to elevations: offset, tilt or scaled. [default: offset]"
    ),
    sigma_before: float | None = typer.Option(
        None, help="Noise of the earlier map (m). [default: from the difference]"
    ),
    sigma_after: float | None = typer.Option(None, help="Noise of the later map (m)."),
    confidence: float = typer.Option(0.95, help="Of the level of detection."),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Subtract two elevation maps; tell change from noise.

    The folder gets difference.tif, detection.tif and significant.tif (1 where the change is significant, 0 where not,
    255, as nodata, where a map is unknown) on the earlier map's grid (.npz where rasterio is not installed), change.png
    and run.json.
    """
    import matplotlib.pyplot as plt

    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import check_run_folder, describe_run, print_json, write_record
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.geometry.map_grid import MapGrid, refuse_apart, refuse_other_systems
    from seismo3d.io._files import written_aside
    from seismo3d.io.elevation import raster_suffix, read_elevation, write_elevation
    from seismo3d.plot.terrain_maps import change_map
    from seismo3d.terrain.alignment import register
    from seismo3d.terrain.change import compare

    if not align:
        refuse_unused("--no-align", {"--vertical": vertical})
    elif vertical is None:
        vertical = "offset"
    check_run_folder(out, command="compare", inputs=[before, after], overwrite=overwrite)
    first, second = read_elevation(before), read_elevation(after)
    grids = MapGrid.from_elevation(first), MapGrid.from_elevation(second)
    refuse_other_systems(*grids, ("before", "after"))
    refuse_apart(*grids, ("before", "after"))
    with written_aside(out, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        clock = StageClock(show)
        registration = None
        if vertical is not None:
            clock("align", 0.0)
            registration = register(first, second, vertical=vertical)
        clock("compare", 0.0)
        change = compare(
            first, second, registration=registration, sigma_before=sigma_before, sigma_after=sigma_after,
            confidence=confidence,
        )  # fmt: skip
        clock("export", 0.0)
        written = {"difference": change.difference, "detection": change.detection, "significant": change.codes}
        for name, values in written.items():
            write_elevation(aside / f"{name}{raster_suffix()}", values)
        ax = change_map(change)
        ax.figure.savefig(aside / "change.png", dpi=130)
        plt.close(ax.figure)
        asked = {"align": align, "vertical": vertical, "sigma_before": sigma_before, "sigma_after": sigma_after}
        facts, timings = _facts(change, registration), clock.stop()
        record = describe_run(before, after, command="compare", options={**asked, "confidence": confidence})
        write_record(aside, {**record, **facts, "timings_s": timings})
    if json:
        print_json({"folder": out, **facts, "timings_s": timings})
    else:
        _say(out, change, registration)
    say_timings(timings)


def _facts(change: Any, registration: Any) -> dict[str, Any]:
    facts = {
        "gained_m3": change.gained,
        "gained_sigma_m3": change.gained_sigma,
        "lost_m3": change.lost,
        "lost_sigma_m3": change.lost_sigma,
    }
    if registration is not None:
        facts |= {"shift_m": registration.shift, "registration_state": registration.state}
    return facts


def _say(out: Path, change: Any, registration: Any) -> None:
    if registration is not None:
        x, y, z = registration.shift
        typer.echo(f"moved    {x:.3f} {y:.3f} {z:.3f} m first ({registration.state})")
    typer.echo(f"gained   {change.gained:.6g} m3, standard deviation {change.gained_sigma:.2g}")
    typer.echo(f"lost     {change.lost:.6g} m3, standard deviation {change.lost_sigma:.2g}")
    typer.echo(str(out / "change.png"))
