"""``seismo3d timelapse``: a monitor cube aligned with its base."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from seismo3d.cli._options import Cube, Json, Overwrite, Reading, reads_cube

EXAMPLES = (
    "seismo3d timelapse base.sgy monitor.sgy -o shifts",
    "seismo3d timelapse base.npy monitor.npy --interval 4 --start 400 -o shifts",
)
_VOLUMES = (
    "shift", "shift_std", "inline_shift", "crossline_shift", "inline_std", "crossline_std", "aligned",
)  # fmt: skip


@reads_cube
def run(
    base: Cube,
    monitor: Path = typer.Argument(help="The later cube, on the same traces and samples.", show_default=False),
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    json: Json = False,
    overwrite: Overwrite = False,
    *,
    reading: Reading,
) -> None:
    """Align a monitor cube with its base: local shifts with their uncertainty, and the aligned monitor.

    The folder gets shift.sgy and shift_std.sgy (ms, m or ft), inline_shift, crossline_shift, inline_std and
    crossline_std (traces), aligned.sgy, two pictures and run.json. It appears when all is done, or not at all.
    Options on how a cube is read are for both.
    """
    import numpy as np

    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import check_run_folder, describe_run, open_told, print_json, write_record
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.geometry.axis import unit_of
    from seismo3d.io._files import written_aside
    from seismo3d.io.segy import check_segy, write_segy
    from seismo3d.seismic.time_lapse import align_cubes

    check_run_folder(out, command="timelapse", inputs=[base, monitor], overwrite=overwrite)
    first, second = (open_told(path, **reading).load() for path in (base, monitor))
    check_segy(first)
    with written_aside(out, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        clock = StageClock(show)
        found = align_cubes(first, second, progress=clock)
        clock("export", 0.0)
        for name in _VOLUMES:
            write_segy(aside / f"{name}.sgy", getattr(found, name))
        clock("pictures", 0.0)
        _draw(first, second, found, aside)
        values, spread = (np.asarray(volume, dtype=np.float64) for volume in (found.shift, found.shift_std))
        known = np.isfinite(values)
        facts = {
            "start_traces_and_samples": found.start,
            "shift_median": np.median(values[known]),
            "shift_5_percent": np.percentile(values[known], 5.0),
            "shift_95_percent": np.percentile(values[known], 95.0),
            "shift_std_median": np.median(spread[known]),
        }
        record: dict[str, Any] = {
            **describe_run(base, monitor, command="timelapse", options=reading),
            "alignment": facts,
            "timings_s": clock.stop(),
        }
        write_record(aside, record)
    if json:
        print_json({"folder": out, "alignment": facts, "timings_s": record["timings_s"]})
    else:
        _say(out, facts, unit_of(first))
    say_timings(record["timings_s"])


def _say(out: Path, facts: dict[str, Any], unit: str) -> None:
    middle, low, high = (_told(facts[f"shift_{name}"]) for name in ("median", "5_percent", "95_percent"))
    typer.echo(
        f"monitor deeper by {middle} {unit} (median; 90 % between {low} and {high}), "
        f"standard deviation {facts['shift_std_median']:.2g} {unit}"
    )
    typer.echo(str(out))


def _told(shift: float) -> str:
    """Return a shift in three digits, or as nothing where it is less than half a thousandth."""
    return f"{shift:.3g}" if abs(shift) >= 0.0005 else "0"


def _draw(base: Any, monitor: Any, found: Any, folder: Path) -> None:
    from matplotlib.figure import Figure

    from seismo3d.plot.time_lapse_sections import time_lapse_section

    for axis, name in enumerate(base.dims[:2]):
        line = float(base[name].values[base.shape[axis] // 2])
        figure = Figure(figsize=(19.0, 5.0), layout="constrained")
        time_lapse_section(base, monitor, found, axes=figure.subplots(1, 4), **{str(name): line})
        figure.savefig(folder / f"timelapse_{name}_{line:.8g}.png", dpi=110)
