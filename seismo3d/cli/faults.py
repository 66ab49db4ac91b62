"""``seismo3d faults``: the main job, from a cube to fault surfaces, volumes, pictures and a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from seismo3d.cli._options import CrosslineByte, Cube, Domain, InlineByte, XByte, YByte

if TYPE_CHECKING:
    from seismo3d._typing import Progress


def run(
    cube: Cube,
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    attributes: bool = typer.Option(False, "--attributes", help="Write dip, azimuth, semblance and curvature too."),
    smooth_tv: float | None = typer.Option(
        None, help="With --attributes: weight of a total-variation smoothing, such as 0.1. [default: none]"
    ),
    inline_byte: InlineByte = None,
    crossline_byte: CrosslineByte = None,
    x_byte: XByte = None,
    y_byte: YByte = None,
    domain: Domain = None,
    overwrite: bool = typer.Option(False, "--overwrite", help="Replace the results of an earlier run in the folder."),
) -> None:
    """Trace the faults of a cube or line: surfaces, sticks, table, SEG-Y volumes, pictures and report.html.

    The folder gets surfaces.vtp (VTK), surfaces.ts (GOCAD), sticks_opendtect.txt, sticks_petrel.txt, faults.csv,
    likelihood.sgy and labels.sgy on the input's own geometry, PNG pictures, report.html, run.json and faultset.npz. It
    appears when all is done, or not at all.
    """
    from seismo3d.cli._run_folder import check_run_folder
    from seismo3d.cli._stages import StageClock
    from seismo3d.cli.app import shown_progress
    from seismo3d.errors import ParameterError
    from seismo3d.io._files import written_aside
    from seismo3d.io.cubes import open_cube

    if smooth_tv is not None and not attributes:
        raise ParameterError("--smooth-tv is given without --attributes; it smooths those. Add --attributes.")
    check_run_folder(out, inputs=[cube], overwrite=overwrite)
    options: dict[str, Any] = {
        "inline_byte": inline_byte,
        "crossline_byte": crossline_byte,
        "x_byte": x_byte,
        "y_byte": y_byte,
        "domain": domain,
    }
    opened = open_cube(cube, **options)
    with written_aside(out, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        clock = StageClock(show)
        if opened.chunks is not None:
            clock("live traces", 0.0)
            opened = opened.assign_coords(live=opened["live"].compute())
        faults = _trace(opened, aside, clock)
        if attributes:
            _write_attributes(opened, aside, smooth_tv, clock)
        asked = {**options, "attributes": attributes, "smooth_tv": smooth_tv}
        _report(opened, faults, aside, clock, path=cube, asked=asked)
    _say(out, faults, opened)


def _trace(cube: Any, folder: Path, clock: Progress) -> Any:
    """Trace the faults and write everything that follows from them alone."""
    from seismo3d.io.segy import write_segy
    from seismo3d.seismic.exports import write_faults
    from seismo3d.seismic.faults import trace_faults

    faults = trace_faults(cube, progress=clock)
    clock("export", 0.0)
    faults.save(folder)
    write_faults(faults, cube, directory=folder)
    for number, name in enumerate(("likelihood", "labels"), start=1):
        values = getattr(faults, name)
        write_segy(folder / f"{name}.sgy", cube.copy(data=getattr(values, "data", values)))
        clock("export", number / 2)
    return faults


def _write_attributes(cube: Any, folder: Path, smooth_tv: float | None, clock: Progress) -> None:
    from seismo3d.io.segy import write_segy
    from seismo3d.seismic.attributes import compute_attributes

    found = compute_attributes(
        cube, smooth_tv=smooth_tv, progress=lambda stage, share: clock(f"attributes: {stage}", share)
    )
    for number, (name, values) in enumerate(found.items(), start=1):
        write_segy(folder / f"attribute_{name}.sgy", cube.copy(data=values.data))
        clock("attributes: write", number / len(found))


def _report(cube: Any, faults: Any, folder: Path, clock: Any, *, path: Path, asked: dict[str, Any]) -> None:
    """Draw the pictures, and write the report and the record of the run."""
    from seismo3d.cli._run_folder import RECORD, describe_run, write_record
    from seismo3d.io.summary import summarise
    from seismo3d.plot.picture_set import save_pictures
    from seismo3d.plot.reports import write_report

    pictures = save_pictures(folder, cube, faults=faults, progress=clock)
    clock("report", 0.0)
    record = describe_run(path, asked)
    settings, timings = faults.settings, clock.stop()
    write_report(
        folder / "report.html",
        cube,
        faults=faults,
        title=f"Faults in {path.name}",
        pictures=pictures,
        run={**record, "versions": ", ".join(f"{k} {v}" for k, v in record["versions"].items()), "timings_s": timings},
    )
    notes = [picture.note for picture in pictures if picture.note]
    extra = {"geometry": summarise(cube), "settings": settings, "n_faults": len(faults.surfaces), "notes": notes}
    write_record(folder / RECORD, {**record, **extra, "timings_s": timings})


def _say(out: Path, faults: Any, cube: Any) -> None:
    """Print the largest faults and where the report is."""
    from seismo3d.seismic.fault_table import tabulate_faults

    rows = tabulate_faults(faults, cube)
    typer.echo(f"{len(rows)} {'fault' if len(rows) == 1 else 'faults'}")
    for row in rows[:10]:
        unit = next((u for u in ("ms", "m") if f"throw_mean_{u}" in row), "samples")
        strike = f"strike {row['strike_deg']:5.0f}  " if "strike_deg" in row else ""
        throws = f"throw {row[f'throw_mean_{unit}']:7.1f} mean {row[f'throw_max_{unit}']:7.1f} largest ({unit})"
        typer.echo(
            f"{row['fault']:4d}  {strike}dip {row['dip_deg']:3.0f}  {throws}  confidence {row['confidence']:.2f}"
        )
    if len(rows) > 10:
        typer.echo(f"... {len(rows) - 10} more in {out / 'faults.csv'}")
    typer.echo(str(out / "report.html"))
