"""The picture of the README: ``python -m seismo3d.experiments.front_picture [OUT.png]``."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray
from seismo3d.errors import FileAccessError
from seismo3d.experiments._command import run_command

_DEFAULT = Path("examples/data/faults_demo.png")


def draw_front_picture(path: str | Path, cube: Any, *, faults: Any) -> Path:
    """Draw the 3D scene and the inline that crosses most faults side by side.

    Parameters
    ----------
    path : str or Path
        The PNG file.
    cube : DataArray
        A cube of 3 axes.
    faults : FaultSet
        Its faults.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileAccessError
        If the file's folder is not there.
    RenderError
        If the machine has no usable OpenGL.
    """
    from matplotlib.figure import Figure
    from PIL import Image

    from seismo3d.plot.rendering import render_scene
    from seismo3d.plot.sections import most_faulted_lines, section

    path = Path(path)
    _check_folder(path)
    scene = trim(render_scene(cube, faults=faults, size=(1200, 900)))
    figure = Figure(figsize=(12.0, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1.0])
    left.imshow(scene)
    left.set_axis_off()
    line = most_faulted_lines(faults, cube)["inline"]
    section(cube, ax=right, inline=line, faults=faults, colour="throw")
    figure.savefig(path, dpi=100)
    Image.open(path).convert("RGB").save(path, optimize=True)
    return path


def _check_folder(path: Path) -> None:
    if not path.parent.is_dir():
        raise FileAccessError(f"{path.parent} is not a folder; expected one to write {path.name} into. Make it first.")


def trim(picture: AnyArray) -> AnyArray:
    """Cut the white margins off a picture of shape (height, width, 3)."""
    dark: BoolArray = np.any(np.asarray(picture) < 250, axis=2)
    rows, columns = np.flatnonzero(dark.any(axis=1)), np.flatnonzero(dark.any(axis=0))
    if rows.size == 0:
        return picture
    return picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the demo cube, write and read it as SEG-Y, trace it, and draw the picture."""
    from seismo3d.io.cubes import open_cube
    from seismo3d.io.segy import write_segy
    from seismo3d.seismic.faults import trace_faults
    from seismo3d.synthetic import fault_cube

    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.front_picture", description=__doc__)
    parser.add_argument("out", nargs="?", type=Path, default=_DEFAULT, help=f"PNG file to write, {_DEFAULT} by default")
    out = parser.parse_args(arguments).out
    _check_folder(out)
    with tempfile.TemporaryDirectory() as folder:
        path = write_segy(Path(folder) / "demo.sgy", fault_cube("demo", seed=0).to_dataarray(), like=None)
        cube = open_cube(path)
        print(draw_front_picture(out, cube, faults=trace_faults(cube)))


if __name__ == "__main__":
    run_command(main)
