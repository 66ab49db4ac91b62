"""``seismo3d demo``: a realistic synthetic cube as SEG-Y."""

from __future__ import annotations

from pathlib import Path

import typer


def run(
    out: Path = typer.Option(..., "--out", "-o", help="SEG-Y file to write.", show_default=False),
    kind: str = typer.Option("demo", help="demo, or a kind of the benchmark suite: clean, folded, noise, ..."),
    seed: int = typer.Option(0, min=0, help="Seed of all that is random: same seed, same cube."),
    overwrite: bool = typer.Option(False, "--overwrite", help="Replace the file where it is there already."),
) -> None:
    """Write a synthetic cube with known faults as SEG-Y, to try the other commands on."""
    from seismo3d.cli.app import shown_progress
    from seismo3d.errors import FileAccessError
    from seismo3d.io.segy import write_segy
    from seismo3d.synthetic import fault_cube

    if out.exists() and not overwrite:
        raise FileAccessError(f"{out} exists already. Choose another name, or replace it with --overwrite.")
    if not out.parent.is_dir():
        raise FileAccessError(f"{out.parent} is not a folder; expected one to write {out.name} into. Make it first.")
    with shown_progress() as progress:
        made = fault_cube(kind, seed=seed, progress=progress)
        write_segy(
            out,
            made.to_dataarray(),
            like=None,
            title=f"seismo3d synthetic cube: {kind}, seed {seed}",
            progress=progress,
        )
    typer.echo(f"{out}: {' x '.join(str(n) for n in made.seismic.shape)} samples, {len(made.fault_list)} faults")
