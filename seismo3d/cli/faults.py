"""``seismo3d faults``: the main job, from a cube to fault surfaces, volumes, pictures and a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from seismo3d.cli._options import Cube, Json, Memory, Overwrite, Reading, Scheduler, reads_cube

if TYPE_CHECKING:
    from seismo3d._typing import Progress

EXAMPLES = (
    "seismo3d faults f3.sgy -o f3-faults",
    "seismo3d faults f3.sgy -o f3-faults --inline-byte 9 --crossline-byte 21 --attributes",
    "seismo3d faults line.sgy -o line-faults --json",
    "seismo3d faults large.zarr -o large-faults --memory 8GB",
    "seismo3d faults large.zarr -o large-faults --memory 8GB --scheduler tcp://node1:8786",
)


@reads_cube
def run(
    cube: Cube,
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    evidence: str | None = typer.Option(
        None,
        help="What shows a fault: semblance, registration, or both. [default: both]",
        metavar="KIND",
    ),
    attributes: bool = typer.Option(False, "--attributes", help="Write dip, azimuth, semblance and curvature too."),
    smooth_tv: float | None = typer.Option(
        None, help="With --attributes: weight of a total-variation smoothing, such as 0.1. [default: none]"
    ),
    unfault: bool = typer.Option(
        False, "--unfault", help="Write the cube with the slip taken out, and a picture of it."
    ),
    memory: Memory = None,
    scheduler: Scheduler = None,
    overwrite: Overwrite = False,
    json: Json = False,
    *,
    reading: Reading,
) -> None:
    """Trace the faults of a cube or line: surfaces, sticks, table, SEG-Y volumes, pictures and report.html.

    The folder gets surfaces.vtp (VTK), surfaces.ts (GOCAD; surfaces.pl of a 2D line), sticks_opendtect.txt,
    sticks_petrel.txt, faults.csv, likelihood.sgy and labels.sgy on the input's own geometry, PNG pictures, report.html,
    run.json and faultset.npz; with --unfault, unfaulted.sgy. It appears when all is done, or not at all.

    Work in blocks (--memory, --scheduler) goes on in a folder beside it, whose name ends in .unfinished: after a
    crash the same command goes on where it was. The volumes are Zarr too then: likelihood.zarr, labels.zarr and
    throw.zarr.
    """
    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import check_run_folder, kept_aside, open_told, settle_live
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.errors import ParameterError, ShapeError
    from seismo3d.io._files import written_aside
    from seismo3d.io.segy import check_segy
    from seismo3d.seismic.fault_evidence import check_evidence

    if evidence is not None:
        check_evidence(evidence)
    if smooth_tv is not None and not attributes:
        raise ParameterError("--smooth-tv is given without --attributes; it smooths those. Add --attributes.")
    check_run_folder(out, command="faults", inputs=[cube], overwrite=overwrite)
    is_bounded = memory is not None or scheduler is not None
    opened = open_told(cube, **reading, lazy=True if is_bounded else None)
    if unfault and opened.ndim != 3:
        raise ParameterError("--unfault is given for a 2D line; it takes the slip out of cubes. Leave it out.")
    check_segy(opened)
    in_blocks = is_bounded and _asks_for_blocks(opened, memory, scheduler, out)
    _refuse_whole(in_blocks, attributes=attributes, unfault=unfault)
    folder = kept_aside(out) if in_blocks else written_aside(out, folder=True)
    with folder as aside, shown_progress() as show:
        aside.mkdir(exist_ok=in_blocks)
        clock = StageClock(show)
        opened = settle_live(opened, clock)
        if "live" in opened.coords and not opened["live"].values.any():
            raise ShapeError(f"{cube} has no live trace. Give a file with data.")
        larger: dict[str, Any] = {"memory": memory, "scheduler": scheduler, "folder": aside} if in_blocks else {}
        faults = _trace(opened, aside, clock=clock, evidence=evidence, larger=larger)
        if attributes:
            _write_attributes(opened, aside, smooth_tv, clock)
        if unfault:
            _write_unfaulted(opened, faults, aside, clock)
        asked = {**reading, "evidence": faults.settings["evidence"], "attributes": attributes, "smooth_tv": smooth_tv}
        if unfault:
            asked["unfault"] = True
        asked |= {name: value for name, value in (("memory", memory), ("scheduler", scheduler)) if value is not None}
        timings = _report(opened, faults, aside, clock, path=cube, asked=asked)
    if json:
        _print_json(out, faults, opened, timings)
    else:
        _say(out, faults, opened)
    say_timings(timings)


def _asks_for_blocks(cube: Any, memory: str | None, scheduler: str | None, out: Path) -> bool:
    from seismo3d.seismic.blocks.tracing import asks_for_blocks

    return asks_for_blocks(cube, memory, folder=out, scheduler=scheduler)


def _refuse_whole(in_blocks: bool, *, attributes: bool, unfault: bool) -> None:
    """Refuse what takes the cube in one piece, where that is worked on in blocks."""
    from seismo3d.errors import ParameterError

    for asked, name in ((attributes, "--attributes"), (unfault, "--unfault")):
        if in_blocks and asked:
            raise ParameterError(f"{name} takes the cube in one piece, which needs more memory. Leave it out.")


def _trace(cube: Any, out: Path, *, clock: Progress, evidence: str | None, larger: dict[str, Any]) -> Any:
    """Trace the faults and write everything that follows from them alone; `larger` says how a cube beyond memory is."""
    from seismo3d.io.segy import write_segy
    from seismo3d.seismic.exports import write_faults
    from seismo3d.seismic.faults import trace_faults

    faults = trace_faults(cube, evidence=evidence, progress=clock, **larger)
    clock("export", 0.0)
    faults.save(out)
    write_faults(faults, cube, directory=out)
    for number, name in enumerate(("likelihood", "labels"), start=1):
        values = getattr(faults, name)
        write_segy(out / f"{name}.sgy", cube.copy(data=getattr(values, "data", values)))
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


def _write_unfaulted(cube: Any, faults: Any, folder: Path, clock: Progress) -> None:
    """Write the unfaulted cube, and its most faulted lines beside the same lines today."""
    from matplotlib.figure import Figure

    from seismo3d.io.segy import write_segy
    from seismo3d.plot.sections import most_faulted_lines
    from seismo3d.plot.unfaulted_sections import unfaulted_section
    from seismo3d.seismic.unfaulting import unfault

    found = unfault(cube, faults, progress=clock)
    write_segy(folder / "unfaulted.sgy", found)
    for name, line in list(most_faulted_lines(faults, cube).items())[:2]:
        figure = Figure(figsize=(14.0, 5.6), layout="constrained")
        unfaulted_section(cube, found, faults=faults, axes=figure.subplots(1, 2), **{name: line})
        figure.savefig(folder / f"unfaulted_{name}_{line:.8g}.png", dpi=110)


def _report(cube: Any, faults: Any, folder: Path, clock: Any, *, path: Path, asked: dict[str, Any]) -> dict[str, float]:
    """Draw the pictures, write the report and the record of the run, and return the seconds of each stage."""
    from seismo3d.cli._run_folder import describe_run, write_record
    from seismo3d.io.summary import summarise
    from seismo3d.plot.picture_set import save_pictures
    from seismo3d.plot.reports import write_report

    pictures = save_pictures(folder, cube, faults=faults, progress=clock)
    clock("report", 0.0)
    record = describe_run(path, command="faults", options=asked)
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
    write_record(folder, {**record, **extra, "timings_s": timings})
    return dict(timings)


def _print_json(out: Path, faults: Any, cube: Any, timings: dict[str, float]) -> None:
    """Print the table of faults, where all is, and the seconds of each stage, as JSON."""
    from seismo3d.cli._run_folder import print_json
    from seismo3d.seismic.fault_table import tabulate_faults

    print_json({"folder": out, "faults": tabulate_faults(faults, cube), "timings_s": timings})


def _say(out: Path, faults: Any, cube: Any) -> None:
    """Print the largest faults and where the report is."""
    from seismo3d.geometry.bearings import whole_deg
    from seismo3d.seismic.fault_table import tabulate_faults, throw_unit

    rows = tabulate_faults(faults, cube)
    typer.echo(f"{len(rows)} {'fault' if len(rows) == 1 else 'faults'}")
    for row in rows[:10]:
        unit = throw_unit(row)
        strike = f"strike {whole_deg(row['strike_deg']):5.0f}  " if "strike_deg" in row else ""
        throws = f"throw {row[f'throw_mean_{unit}']:7.1f} mean {row[f'throw_max_{unit}']:7.1f} largest ({unit})"
        typer.echo(
            f"{row['fault']:4d}  {strike}dip {row['dip_deg']:3.0f}  {throws}  confidence {row['confidence']:.2f}"
        )
    if len(rows) > 10:
        typer.echo(f"... {len(rows) - 10} more in {out / 'faults.csv'}")
    typer.echo(str(out / "report.html"))
