"""``seismo3d score``: a run of faults or tracks beside an interpreter's picks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import Columns, Json, Overwrite, as_columns

EXAMPLES = (
    "seismo3d score f3-faults sticks.txt",
    "seismo3d score f3-tracks top_a.xyz top_b.xyz --columns 1,2,5 --tolerance 6",
)

_AXES = ("inline", "crossline", "sample")
# traces that lie farther off their map than this share of a bin, root mean square, are met by x and y
_CROOKED = 0.25


def run(
    folder: Path = typer.Argument(metavar="DIR", help="Folder of a faults run or of a tracks run.", show_default=False),
    picks: list[Path] = typer.Argument(
        help="Fault sticks (OpendTect, Charisma) for a faults run; horizons (XYZ, IRAP classic, Charisma) for tracks.",
        show_default=False,
    ),
    tolerance: float | None = typer.Option(
        None,
        min=0.0,
        help="Distance that counts as agreement: traces and samples (sticks) [default: 3], "
        "or ms, m, ft or samples (horizons) [default: 4]",
    ),
    columns: Columns = None,
    out: Path | None = typer.Option(None, "--out", "-o", help="Folder to make for the results. [default: DIR/score]"),
    json: Json = False,
    overwrite: Overwrite = False,
) -> None:
    """Compare a run with existing picks: distances, what was missed, what is new.

    Picks of horizons are in the cube's own unit, growing downwards, and meet the nearest trace, half a bin off at
    most; those on a 2D line meet its traces by x and y. Fault sticks are compared with the faults of a cube.

    The folder gets score.json, a picture a file of picks, and run.json. It appears when all is done, or not at all.
    """
    from seismo3d.cli._run_folder import check_run_folder, describe_run, write_record
    from seismo3d.errors import FileAccessError, ParameterError
    from seismo3d.io._files import written_aside
    from seismo3d.io.records import write_json

    is_faults, is_tracks = (folder / "faultset.npz").is_file(), (folder / "tracks.csv").is_file()
    if not (is_faults or is_tracks):
        raise FileAccessError(f"{folder} holds neither faults nor tracks. Give the folder of a faults or tracks run.")
    if columns is not None and is_faults:
        raise ParameterError("--columns is given for fault sticks; it is for XYZ horizons. Leave it out.")
    final = folder / "score" if out is None else out
    check_run_folder(final, command="score", inputs=[folder, *picks], overwrite=overwrite)
    with written_aside(final, folder=True) as aside:
        aside.mkdir()
        if is_faults:
            scores = _score_faults(folder, picks, aside, 3.0 if tolerance is None else tolerance)
        else:
            chosen = as_columns(columns)
            scores = _score_tracks(folder, picks, aside, 4.0 if tolerance is None else tolerance, chosen)
        write_json(aside / "score.json", {"scores": scores})
        asked = {"picks": picks, "tolerance": tolerance, "columns": columns}
        source = folder / ("faultset.npz" if is_faults else "tracks.csv")
        write_record(aside, describe_run(source, command="score", options=asked))
    _say(final, scores, as_json=json)


def _score_faults(folder: Path, picks: list[Path], aside: Path, tolerance: float) -> list[dict[str, Any]]:
    from dataclasses import asdict

    from matplotlib.figure import Figure

    from seismo3d.io.fault_sticks import read_sticks
    from seismo3d.plot.pick_pictures import picked_faults_map
    from seismo3d.seismic.faultset import FaultSet
    from seismo3d.seismic.stick_scores import score_sticks

    faults = FaultSet.load(folder)
    scores = []
    for number, file in enumerate(picks, start=1):
        sticks = read_sticks(file)
        score = score_sticks(faults, sticks, tolerance=tolerance)
        scores.append({"picks": file.name, **asdict(score)})
        figure = Figure(figsize=(7.5, 7.0), layout="constrained")
        picked_faults_map(faults, sticks, score, ax=figure.add_subplot())
        figure.savefig(aside / f"score_{number:02d}.png", dpi=130, bbox_inches="tight", pad_inches=0.08)
    return scores


def _score_tracks(
    folder: Path, picks: list[Path], aside: Path, tolerance: float, columns: tuple[int, ...] | None
) -> list[dict[str, Any]]:
    from dataclasses import asdict, replace

    from matplotlib.figure import Figure

    from seismo3d.io.horizons import read_horizon
    from seismo3d.plot.pick_pictures import pick_distance_map
    from seismo3d.seismic.horizon_scores import same_trace_distance, score_horizon

    # a 2D line has no inlines and crosslines, and so no Charisma: x and y tell its traces
    files = sorted(folder.glob("track_*.charisma.txt")) or sorted(folder.glob("track_*.xyz"))
    tracks = [replace(read_horizon(file), name=file.name.split(".")[0]) for file in files]
    unit, extent, survey = _unit_of(folder), _extent_of(folder), _survey_of(folder)
    apart = same_trace_distance(tracks)
    scores = []
    for number, file in enumerate(picks, start=1):
        horizon = read_horizon(file, columns=columns)
        score = score_horizon(tracks, horizon, tolerance=tolerance, cube=survey, apart=apart, extent=extent)
        scores.append({"picks": file.name, "unit": unit, **asdict(score)})
        figure = Figure(figsize=(7.5, 6.5), layout="constrained")
        track = next(track for track in tracks if track.name == score.track)
        pick_distance_map(track, horizon, unit=unit, cube=survey, apart=apart, ax=figure.add_subplot())
        figure.savefig(aside / f"score_{number:02d}.png", dpi=130, bbox_inches="tight", pad_inches=0.08)
    return scores


def _unit_of(folder: Path) -> str:
    import csv

    with (folder / "tracks.csv").open(encoding="utf-8") as file:
        return next((row["unit"] for row in csv.DictReader(file)), "samples")


def _extent_of(folder: Path) -> tuple[float, float] | None:
    """Return the times or depths of a run's cube; None where its record does not tell them."""
    from seismo3d.cli._run_folder import read_record

    try:
        low, high = (read_record(folder) or {})["extent"]
        return float(low), float(high)
    except (ValueError, KeyError, TypeError):
        return None


def _survey_of(folder: Path) -> Any:
    """Return an empty cube where a run's cube lies; None where its record does not tell, or no map holds its traces."""
    import numpy as np
    import xarray as xr

    from seismo3d.cli._run_folder import read_record

    try:
        survey = (read_record(folder) or {})["survey"]
        axes = {name: (float(survey[name][0]), float(survey[name][1]), int(survey[name][2])) for name in _AXES}
        fit = survey.get("map")
        if fit is not None:
            steps = [float(np.hypot(*fit[name])) for name in ("inline_step", "crossline_step")]
            if float(fit["rms"]) > _CROOKED * min(steps):
                return None
        values = np.broadcast_to(np.float32(0.0), [n for _, _, n in axes.values()])
        lines = {name: first + step * np.arange(n) for name, (first, step, n) in axes.items()}
        return xr.DataArray(values, dims=_AXES, coords=lines, attrs={"survey": survey})
    except (ValueError, KeyError, TypeError):
        return None


def _say(out: Path, scores: list[dict[str, Any]], *, as_json: bool) -> None:
    if as_json:
        from seismo3d.cli._run_folder import print_json

        print_json({"scores": scores})
        return
    for score in scores:
        if "track" in score:
            typer.echo(
                f"{score['picks']}: {score['track']}  median {score['median']:.2f}  90 % {score['p90']:.2f} "
                f"{score['unit']}  within {score['tolerance']:g}: {100 * score['within']:.0f} %  "
                f"missed {100 * score['missed']:.0f} % of {score['n_picks']} picks  new at {score['new']} places"
            )
            continue
        typer.echo(
            f"{score['picks']}: median {score['median']:.2f}  90 % {score['p90']:.2f} traces and samples  "
            f"within {score['tolerance']:g}: {100 * score['within']:.0f} %"
        )
        for row in score["faults"]:
            found = f"fault {row['traced_as']}" if row["traced_as"] else "missed"
            typer.echo(
                f"  {row['name']:<24} {row['n_sticks']:3d} sticks  median {row['median']:6.2f}  "
                f"90 % {row['p90']:6.2f}  within {100 * row['within']:3.0f} %  {found}"
            )
        new = ", ".join(str(label) for label in score["new"]) or "none"
        typer.echo(f"  missed {len(score['missed'])} of {len(score['faults'])}; new: {new}")
        if score["outside"]:
            wholly = f", all of {', '.join(score['elsewhere'])}" if score["elsewhere"] else ""
            typer.echo(f"  not counted: {100 * score['outside']:.1f} % of the nodes lie outside the cube{wholly}")
    typer.echo(str(out))
