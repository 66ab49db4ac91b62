"""``seismo3d tracks``: horizons from seeds, through a cube and across its faults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import (
    Columns,
    Cube,
    Json,
    Memory,
    Overwrite,
    Reading,
    Scheduler,
    as_columns,
    reads_cube,
)

EXAMPLES = (
    "seismo3d tracks f3.sgy -o f3-tracks --seed 420,880,812",
    "seismo3d tracks f3.sgy -o f3-tracks --faults f3-faults --seed 420,880,812 --seed 420,880,1104 --event peak",
    "seismo3d tracks f3.sgy -o f3-tracks --count 8",
    "seismo3d tracks large.zarr -o large-tracks --faults large-faults --memory 8GB",
    "seismo3d tracks large.zarr -o large-tracks --memory 8GB --scheduler tcp://node1:8786",
)


@reads_cube
def run(
    cube: Cube,
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    seed: list[str] = typer.Option(
        [],
        help="INLINE,CROSSLINE,TIME (of a 2D line TRACE,TIME) of a point on a horizon; several times for several. "
        "[default: find horizons]",
    ),
    horizon: list[Path] = typer.Option(
        [],
        help="File of a picked horizon (XYZ, IRAP classic, Charisma): points spread over it are the seeds of one "
        "track; several times for several.",
    ),
    columns: Columns = None,
    faults: Path | None = typer.Option(None, help="Folder of a faults run of this cube. [default: no faults]"),
    event: str | None = typer.Option(None, help="peak, trough or zero. [default: the seed's own phase]"),
    count: int = typer.Option(5, min=1, help="Number of horizons to find where no seed is given."),
    memory: Memory = None,
    scheduler: Scheduler = None,
    overwrite: Overwrite = False,
    json: Json = False,
    *,
    reading: Reading,
) -> None:
    """Follow horizons from seeds through a cube or line and across its faults: points, grids, table and pictures.

    The folder gets each track as XYZ, Charisma and IRAP classic text, tracks.csv, a depth map of each track, sections
    with all of them, report.html and run.json; of a 2D line XYZ, table, section and report. IRAP is left out where the
    survey's lines do not meet at right angles, which it cannot hold. The folder appears when all is done, or not at
    all.

    Work in blocks (--memory, --scheduler) goes on in a folder beside it, whose name ends in .unfinished: after a
    crash the same command goes on where it was. Layer time is kept as Zarr then: layer_time.zarr.
    """
    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import check_run_folder, kept_aside, open_told, print_json, settle_live
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.errors import ParameterError
    from seismo3d.io._files import written_aside
    from seismo3d.io.horizons import read_horizon
    from seismo3d.seismic.faultset import FaultSet
    from seismo3d.seismic.loop_closure import tabulate_loops
    from seismo3d.seismic.picks import horizon_seeds
    from seismo3d.seismic.track_events import check_event
    from seismo3d.seismic.track_exports import irap_note, tabulate_tracks
    from seismo3d.seismic.tracks import index_seeds

    points: list[Any] = [_as_seed(text) for text in seed]
    if columns is not None and not horizon:
        raise ParameterError("--columns is given without --horizon; it says what its file holds. Leave it out.")
    picked = [read_horizon(file, columns=as_columns(columns)) for file in horizon]
    check_run_folder(out, command="tracks", inputs=[cube, *horizon, *([faults] if faults else [])], overwrite=overwrite)
    is_bounded = memory is not None or scheduler is not None
    opened = open_told(cube, **reading, lazy=True if is_bounded else None)
    in_blocks = is_bounded and _asks_for_blocks(opened, memory, scheduler, out)
    if not in_blocks:
        opened = opened.load()
    _check_seeds(points, picked, opened)
    points += [horizon_seeds(entry, opened) for entry in picked]
    check_event(event)
    if opened.ndim == 3:
        index_seeds(opened, points)
    known = None if faults is None else FaultSet.load(faults)
    asked = {
        **reading, "seed": seed, "horizon": horizon, "columns": columns, "faults": faults, "event": event,
        "count": count, "memory": memory, "scheduler": scheduler,
    }  # fmt: skip
    folder = kept_aside(out) if in_blocks else written_aside(out, folder=True)
    with folder as aside, shown_progress() as show:
        aside.mkdir(exist_ok=in_blocks)
        clock = StageClock(show)
        opened = settle_live(opened, clock)
        larger: dict[str, Any] = {"memory": memory, "scheduler": scheduler, "folder": aside} if in_blocks else {}
        tracks, closure = _trace(opened, points, count, known, event, clock=clock, larger=larger)
        timings = _report(tracks, closure, opened, aside, clock, faults=known, path=cube, asked=asked)
    if json:
        found = {"folder": out, "tracks": tabulate_tracks(tracks), "loops": tabulate_loops(closure)}
        print_json({**found, "timings_s": timings})
    else:
        _say(out, tracks, closure)
    note = irap_note(opened)
    if note is not None:
        typer.echo(f"seismo3d: {note}", err=True)
    say_timings(timings)


def _asks_for_blocks(cube: Any, memory: str | None, scheduler: str | None, out: Path) -> bool:
    from seismo3d.seismic.blocks.layering import whole_layers_bytes
    from seismo3d.seismic.blocks.tracing import asks_for_blocks

    return asks_for_blocks(cube, memory, folder=out, scheduler=scheduler, whole_bytes=whole_layers_bytes)


def _trace(
    cube: Any, points: list[Any], count: int, faults: Any, event: str | None, *, clock: Any, larger: dict[str, Any]
) -> tuple[list[Any], Any]:
    """Follow the seeds, or find horizons where there are none; return the tracks and how well shifts close loops."""
    from seismo3d.seismic.horizon_search import find_horizons
    from seismo3d.seismic.tracks import trace_tracks

    layers = _model(cube, faults, clock, larger) if cube.ndim == 3 else None
    how: dict[str, Any] = {"faults": faults, "event": event, "layers": layers, "progress": clock}
    tracks = trace_tracks(cube, points, **how) if points else find_horizons(cube, count, **how)
    return tracks, None if layers is None else layers.closure


def _model(cube: Any, faults: Any, clock: Any, larger: dict[str, Any]) -> Any:
    """Return the layer model; `larger` says how that of a cube beyond memory is found."""
    from seismo3d.seismic.layer_graph import LayerTimeSettings
    from seismo3d.seismic.layer_time import model_layers

    if not larger:
        return model_layers(cube, faults=faults, progress=clock)
    from seismo3d.seismic.blocks.stored_layers import layers_within

    return layers_within(cube, faults, **larger, settings=LayerTimeSettings(), progress=clock)


def _report(
    tracks: list[Any], closure: Any, cube: Any, folder: Path, clock: Any, *, faults: Any, path: Path,
    asked: dict[str, Any],
) -> dict[str, float]:  # fmt: skip
    """Write tracks, pictures, report and the record of the run, and return the seconds of each stage."""
    from seismo3d.cli._run_folder import describe_run, write_record
    from seismo3d.geometry.survey import SurveyGeometry
    from seismo3d.plot.run_reports import tracks_page, write_page
    from seismo3d.plot.track_pictures import save_track_pictures
    from seismo3d.seismic.horizon_scores import sample_extent
    from seismo3d.seismic.loop_closure import tabulate_loops
    from seismo3d.seismic.track_exports import write_tracks

    clock("export", 0.0)
    write_tracks(tracks, cube, directory=folder)
    clock("pictures", 0.0)
    pictures = save_track_pictures(folder, cube, tracks, faults=faults, closure=closure)
    timings: dict[str, float] = clock.stop()
    record = {
        **describe_run(path, command="tracks", options=asked),
        "extent": sample_extent(cube),
        "survey": SurveyGeometry.from_cube(cube).to_dict() if cube.ndim == 3 else None,
        "loops": tabulate_loops(closure),
        "timings_s": timings,
    }
    title = f"Horizons in {path.name}"
    page = tracks_page(tracks, cube, title=title, pictures=pictures, run=record, closure=closure)
    write_page(folder / "report.html", page)
    write_record(folder, record)
    return timings


def _say(out: Path, tracks: list[Any], closure: Any) -> None:
    for number, track in enumerate(tracks, start=1):
        typer.echo(f"{number:4d}  traced on {100 * track.share:3.0f} % of the traces")
    if closure is not None and closure.n_loops:
        typer.echo(
            f"loops of {closure.length} traces miss by {closure.median:.2f} samples (median), "
            f"{100 * closure.over_one:.1f} % by more than one"
        )
    typer.echo(str(out))


def _as_seed(text: str) -> tuple[float, ...]:
    from seismo3d.errors import ParameterError

    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (2, 3):
        raise ParameterError(
            f"--seed is {text!r}; expected INLINE,CROSSLINE,TIME, such as 1040,2060,812, or of a 2D line TRACE,TIME."
        )
    return values


def _check_seeds(points: list[tuple[float, ...]], picked: list[Any], cube: Any) -> None:
    """Refuse seeds that do not fit a cube or a line."""
    from seismo3d.errors import ParameterError

    wanted = "INLINE,CROSSLINE,TIME" if cube.ndim == 3 else "TRACE,TIME"
    for point in points:
        if len(point) != cube.ndim:
            text = ",".join(f"{value:.8g}" for value in point)
            raise ParameterError(f"--seed is {text!r}; expected {wanted} in a file of {cube.ndim} axes.")
    if picked and cube.ndim == 2:
        raise ParameterError("--horizon is given for a 2D line; it is for cubes. Give --seed TRACE,TIME.")
