"""``seismo3d paper``: the experiments of the paper, measured anew."""

from __future__ import annotations

from pathlib import Path

import typer

from seismo3d.errors import ParameterError

_REGISTRATION = ("table1", "figure3")
"""Experiments on rotated depth frames."""
_MATCHING = ("table2", "table3", "table4")
"""Experiments on pictures: a function of the experiment's name in ``experiments.matching_tables`` gives its text."""
_EXPERIMENTS = ("table1", "figure3", *_MATCHING)
EXAMPLES = (
    "seismo3d paper table1 --frames 2 --angles 10,45,90",
    "seismo3d paper figure3 -o figures",
    "seismo3d paper table2 --images 2",
)
_ANGLES = "5,10,15,20,25,30,45,60,75,90"
_FIGURE_ANGLE_DEG = 20


def run(
    experiment: str = typer.Argument(
        help="table1 or figure3 (registration of rotated depth frames), table2, table3 or table4 (matching under "
        "rotation, tilt, scale), all of these, or f3 (faults, throws, horizons and network of a SEG-Y file).",
        show_default=False,
    ),
    data: Path | None = typer.Argument(
        None,
        help="For table1 and figure3: RGB-D sequence in the TUM layout with camera.json. [default: drawn rooms] "
        "For f3: the cube, such as the Netherlands F3 block.",
        show_default=False,
    ),
    out: Path | None = typer.Option(
        None,
        "--out",
        "--output",
        "-o",
        help="Folder for the tables' texts and the figure [default: none; the figure's is the current folder], or, for "
        "f3, the folder to make [default: f3].",
        show_default=False,
    ),
    images: int | None = typer.Option(
        None, "--images", min=1, help="For table2 to table4: use only so many images. [default: all]"
    ),
    frames: int | None = typer.Option(
        None, "--frames", min=1, help="For table1 and figure3: frames that are rotated. [default: 4]"
    ),
    angles: str | None = typer.Option(
        None, "--angles", help=f"For table1: rotations in whole degrees, with commas. [default: {_ANGLES}]"
    ),
    overwrite: bool = typer.Option(
        False, "--overwrite", help="For f3: replace the results of an earlier run in the folder."
    ),
    json: bool = typer.Option(False, "--json", help="For f3: print the results as JSON."),
) -> None:
    """Measure a table or the figure of the paper again, beside the methods that the paper compares with.

    f3 is the test on field data that the paper planned: everything that can be traced in a cube, with a report.
    """
    if experiment == "f3":
        _check_given({"--images": images, "--frames": frames, "--angles": angles}, ("f3",), ())
        _run_block(data, Path("f3") if out is None else out, overwrite=overwrite, json=json)
        return
    for name, is_given in (("--overwrite", overwrite), ("--json", json)):
        if is_given:
            raise ParameterError(f"{name} is given with {experiment}; it serves f3. Leave it out.")
    if experiment != "all" and experiment not in _EXPERIMENTS:
        raise ParameterError(f"experiment is {experiment!r}; expected one of {', '.join(_EXPERIMENTS)}, f3 or all.")
    chosen = _EXPERIMENTS if experiment == "all" else (experiment,)
    _check_given({"data": data, "--frames": frames}, chosen, _REGISTRATION)
    _check_given({"--angles": angles}, chosen, ("table1",))
    _check_given({"--images": images}, chosen, _MATCHING)
    if set(chosen) & set(_REGISTRATION):
        _measure_registration(chosen, data, 4 if frames is None else frames, _as_degrees(angles or _ANGLES), out)
    for name in chosen:
        if name in _MATCHING:
            _measure_matching(name, images, out)


def _check_given(given: dict[str, object], chosen: tuple[str, ...], served: tuple[str, ...]) -> None:
    """Refuse what none of the chosen experiments uses."""
    for name, value in given.items():
        if value is not None and not set(chosen) & set(served):
            raise ParameterError(
                f"{name} is {str(value)!r}; expected none with {chosen[0]}: it serves {', '.join(served) or 'others'}."
            )


def _as_degrees(angles: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in angles.split(","))
    except ValueError as error:
        raise ParameterError(f"--angles is {angles!r}; expected whole degrees with commas.") from error


def _measure_registration(
    chosen: tuple[str, ...], data: Path | None, n_frames: int, degrees: tuple[int, ...], output: Path | None
) -> None:
    """Print table 1 and draw figure 3, from one run."""
    from seismo3d.experiments.registration_table import draw_figure, format_table, load_frames, make_table

    if "table1" not in chosen:
        degrees = (_FIGURE_ANGLE_DEG,)
    elif "figure3" in chosen and _FIGURE_ANGLE_DEG not in degrees:
        degrees = (*degrees, _FIGURE_ANGLE_DEG)
    made = make_table(load_frames(data, n_frames=n_frames), angles_deg=degrees, figure_angle_deg=_FIGURE_ANGLE_DEG)
    if "table1" in chosen:
        text = "Table 1, rotation in degrees: accuracy in percent / seconds\n" + format_table(made)
        _give("table1", text, output)
    if "figure3" in chosen or (output is not None and _FIGURE_ANGLE_DEG in degrees):
        folder = Path() if output is None else output
        folder.mkdir(parents=True, exist_ok=True)
        typer.echo(str(draw_figure(made, folder / "figure3.png")))


def _run_block(path: Path | None, out: Path, *, overwrite: bool, json: bool) -> None:
    """Trace everything in a cube, and write it with a report."""
    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import (
        check_run_folder,
        describe_run,
        open_told,
        print_json,
        write_record,
    )
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.experiments.f3 import run_block
    from seismo3d.io._files import written_aside
    from seismo3d.seismic.horizon_scores import sample_extent
    from seismo3d.seismic.track_exports import irap_note

    if path is None:
        raise ParameterError("f3 is given no cube; expected a SEG-Y file, as in: seismo3d paper f3 F3.sgy.")
    check_run_folder(out, command="paper f3", inputs=[path], overwrite=overwrite)
    cube = open_told(path).load()
    with written_aside(out, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        clock = StageClock(show)
        record = {**describe_run(path, command="paper f3", options={}), "extent": sample_extent(cube)}
        found = run_block(cube, aside, name=path.name, record=record, progress=clock)
        timings = clock.stop()
        write_record(aside, {**record, "found": found, "timings_s": timings})
    if json:
        print_json({"folder": out, "found": found, "timings_s": timings})
    else:
        for name, value in found.items():
            shown = "unknown" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)
            typer.echo(f"{name:<26}{shown}")
        typer.echo(str(out / "report.html"))
    note = irap_note(cube)
    if note is not None:
        typer.echo(f"seismo3d: {note}", err=True)
    say_timings(timings)


def _measure_matching(name: str, n_images: int | None, output: Path | None) -> None:
    from seismo3d.cli.app import shown_progress
    from seismo3d.experiments.matching_tables import TABLES

    with shown_progress() as progress:
        text = TABLES[name](n_images=n_images, progress=progress)
    _give(name, text, output)


def _give(name: str, text: str, output: Path | None) -> None:
    """Print a table, and write it to the folder where one is given."""
    typer.echo(text + "\n")
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        (output / f"{name}.txt").write_text(text + "\n", encoding="utf-8")
