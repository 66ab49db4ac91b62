"""``seismo3d demo``: a realistic synthetic cube as SEG-Y."""

from __future__ import annotations

from pathlib import Path

import typer

from seismo3d.cli._options import Json

EXAMPLES = ("seismo3d demo -o demo.sgy", "seismo3d demo -o noisy.sgy --kind noise --seed 7")


def run(
    out: Path = typer.Option(..., "--out", "-o", help="SEG-Y file to write.", show_default=False),
    kind: str = typer.Option("demo", help="demo, or a kind of the benchmark suite: clean, folded, noise, ..."),
    seed: int = typer.Option(0, min=0, help="Seed of all that is random: same seed, same cube."),
    overwrite: bool = typer.Option(False, "--overwrite", help="Replace the file where it is there already."),
    json: Json = False,
) -> None:
    """Write a synthetic cube with known faults as SEG-Y, to try the other commands on."""
    from seismo3d._stages import StageClock
    from seismo3d.cli._run_folder import print_json
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.errors import FileAccessError
    from seismo3d.io._files import check_output
    from seismo3d.io.segy import write_segy
    from seismo3d.synthetic import fault_cube

    check_output(out, endings=(".sgy", ".segy"))
    if out.exists() and not overwrite:
        raise FileAccessError(f"{out} exists already. Choose another name, or replace it with --overwrite.")
    with shown_progress() as show:
        clock = StageClock(show)
        clock("cube", 0.0)
        made = fault_cube(kind, seed=seed, progress=clock)
        write_segy(
            out,
            made.to_dataarray(),
            like=None,
            title=f"seismo3d synthetic cube: {kind}, seed {seed}",
            progress=clock,
        )
        timings = clock.stop()
    if json:
        shape = list(made.seismic.shape)
        print_json({"file": out, "shape": shape, "n_faults": len(made.fault_list), "timings_s": timings})
    else:
        typer.echo(f"{out}: {' x '.join(str(n) for n in made.seismic.shape)} samples, {len(made.fault_list)} faults")
    say_timings(timings)
