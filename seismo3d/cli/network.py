"""``seismo3d network``: how the faults of a run hang together, how they are oriented, and the ways through them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import Columns, Json, Overwrite, as_columns

EXAMPLES = (
    "seismo3d network f3-faults",
    "seismo3d network f3-faults -o f3-network --from 420,880,812 --to 300,640,1400",
)


def run(
    folder: Path = typer.Argument(metavar="DIR", help="Folder of a faults run.", show_default=False),
    out: Path | None = typer.Option(None, "--out", "-o", help="Folder to make for the results. [default: DIR/network]"),
    cell: int = typer.Option(16, min=1, help="Side, in traces and samples, of the cells in which density is counted."),
    reach: int = typer.Option(4, min=0, help="Farthest gap, in traces or samples, over which two faults meet."),
    set_angle: float = typer.Option(30.0, min=0.0, max=90.0, help="Mean angle in degrees between two sets of faults."),
    start: str | None = typer.Option(
        None, "--from", help="Start of a flow path: INLINE,CROSSLINE,TIME, or a horizon's file. [default: no path]"
    ),
    end: str | None = typer.Option(None, "--to", help="End of the flow path: a point or a horizon's file."),
    columns: Columns = None,
    contrast: float = typer.Option(50.0, min=1.0, max=1e9, help="How much better a sure fault conducts than rock."),
    json: Json = False,
    overwrite: Overwrite = False,
) -> None:
    """Build the fracture network of a cube's faults: intersections, connected zones, density, orientations, flow path.

    The folder gets network.graphml, network_faults.csv, intersections.csv, zones.csv, sets.csv, density.csv, pictures
    (map.png, density.png, stereonet.png, rose.png), flow_path.csv and flow_path.png where a path is asked for,
    report.html, and run.json with a summary. It appears when all is done, or not at all.
    """
    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import check_run_folder, describe_run, print_json, write_record
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.io._files import written_aside
    from seismo3d.plot.network_pictures import save_network_pictures
    from seismo3d.plot.run_reports import network_page, write_page
    from seismo3d.seismic.faultset import FaultSet
    from seismo3d.seismic.flow_paths import flow_path
    from seismo3d.seismic.network import fracture_network
    from seismo3d.seismic.network_exports import summarise_network, write_network, write_path

    chosen = _checked_columns(columns, start, end)
    final = folder / "network" if out is None else out
    faults = FaultSet.load(folder)
    read = [folder, *(Path(word) for word in (start, end) if word is not None)]
    check_run_folder(final, command="network", inputs=read, overwrite=overwrite)
    ends = None if start is None or end is None else [_as_end(word, faults.labels, chosen) for word in (start, end)]
    asked = {
        "cell": cell, "reach": reach, "set_angle": set_angle, "from": start, "to": end, "columns": columns,
        "contrast": contrast,
    }  # fmt: skip
    with written_aside(final, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        clock = StageClock(show)
        network = fracture_network(faults, cell=cell, reach=reach, set_angle_deg=set_angle, progress=clock)
        path = None
        if ends is not None:
            clock("flow path", 0.0)
            path = flow_path(faults, *ends, contrast=contrast)
            write_path(path, aside / "flow_path.csv")
        clock("export", 0.0)
        write_network(network, faults.labels, directory=aside)
        clock("pictures", 0.0)
        pictures = save_network_pictures(aside, network, faults, path=path)
        record = describe_run(folder / "faultset.npz", command="network", options=asked)
        found: dict[str, Any] = {"network": summarise_network(network)}
        if path is not None:
            names = ("resistance", "length", "unit", "share_on_faults", "surfaces", "straight")
            found["flow_path"] = {name: getattr(path, name) for name in names}
        timings = clock.stop()
        page = network_page(
            network, path, faults.labels, title=f"Fracture network of {folder.resolve().name}", pictures=pictures,
            run={**record, "timings_s": timings},
        )  # fmt: skip
        write_page(aside / "report.html", page)
        write_record(aside, {**record, **found, "timings_s": timings})
    if json:
        print_json({"folder": final, **found, "timings_s": timings})
    else:
        _say(final, network, path)
    say_timings(timings)


def _checked_columns(columns: str | None, start: str | None, end: str | None) -> tuple[int, ...] | None:
    """Return the columns of a horizon's file, and refuse what makes no path or names no such file."""
    from seismo3d.errors import ParameterError

    if (start is None) != (end is None):
        raise ParameterError("--from and --to make a path together; one of them is missing. Give both or neither.")
    chosen = as_columns(columns)
    if chosen is not None and all(word is None or _as_point(word) is not None for word in (start, end)):
        raise ParameterError(
            "--columns is given without a horizon's file; it says what that of --from or --to holds. Leave it out."
        )
    return chosen


def _as_point(word: str) -> tuple[float, ...] | None:
    """Return the numbers that a word spells; None of a file's name."""
    try:
        return tuple(float(part) for part in word.split(","))
    except ValueError:
        return None


def _as_end(word: str, cube: Any, columns: tuple[int, ...] | None) -> Any:
    """Return the point that a word spells, or the horizon in the file of that name."""
    values = _as_point(word)
    if values is None:
        from seismo3d.io.horizons import read_horizon
        from seismo3d.seismic.picks import grid_horizon

        return grid_horizon(read_horizon(word, columns=columns), cube)
    if len(values) != 3:
        from seismo3d.errors import ParameterError

        raise ParameterError(f"{word!r} has {len(values)} numbers; expected INLINE,CROSSLINE,TIME or a file's name.")
    return values


def _say(out: Path, network: Any, path: Any) -> None:
    from seismo3d.geometry.bearings import whole_deg

    n, n_zones, n_lines = network.graph.number_of_nodes(), len(network.zones), len(network.intersections)
    kinds = {kind: sum(line.kind == kind for line in network.intersections) for kind in ("cross", "abut", "corner")}
    typer.echo(
        f"{n} {'fault' if n == 1 else 'faults'} in {n_zones} connected {'zone' if n_zones == 1 else 'zones'}; "
        f"{n_lines} {'intersection' if n_lines == 1 else 'intersections'} ({kinds['cross']} cross, "
        f"{kinds['abut']} end at another, {kinds['corner']} both end); "
        f"intensity {network.intensity:.3g} 1/{network.unit}"
    )
    for number, entry in enumerate(network.sets, start=1):
        words = "1 fault" if len(entry.surfaces) == 1 else f"{len(entry.surfaces)} faults"
        typer.echo(
            f"set {number}: strike {whole_deg(entry.strike_deg):3.0f}  dip {entry.dip_deg:2.0f}  "
            f"spread {entry.spread_deg:2.0f}  {words}, {100 * entry.share:.0f} % of the area"
        )
    if path is not None:
        unit = "bins" if path.unit == "bin" else path.unit
        on_its_way = ", ".join(str(label) for label in path.surfaces) or "none"
        typer.echo(
            f"flow path: length {path.length:,.0f} {unit}, {100 * path.share_on_faults:.0f} % on faults "
            f"({on_its_way}), {path.straight:.1f} times easier than straight through rock"
        )
    typer.echo(str(out))
