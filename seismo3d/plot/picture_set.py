"""The pictures of a faults run, written to files without pyplot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d.errors import RenderError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.plot.distributions import strike_rose, throw_histogram
from seismo3d.plot.maps import throw_map, time_slice
from seismo3d.plot.pictures import name_axes
from seismo3d.plot.rendering import save_scene
from seismo3d.plot.sections import most_faulted_lines, section
from seismo3d.plot.sketches import sketch_scene

_DPI = 110


@dataclass(frozen=True, slots=True)
class PictureFile:
    """One picture on disk.

    Attributes
    ----------
    path : Path
        The PNG file.
    caption : str
        What it shows.
    note : str
        What the reader must know of how it came about; "" when there is nothing.
    kind : {"wide", "half"}
        How much of a page's width it wants.
    """

    path: Path
    caption: str
    note: str = ""
    kind: str = "wide"


def save_pictures(
    directory: str | Path, cube: Any, *, faults: Any, progress: Callable[[str, float], None] | None = None
) -> list[PictureFile]:
    """Draw the pictures of a faults run.

    For a cube: ``scene.png``, ``section_inline_N.png`` and ``section_crossline_N.png`` through the most faulted lines,
    ``time_slice.png`` (or ``depth_slice.png``), ``throw_map.png``, ``strike.png`` and ``throw.png``; for a section:
    ``section_faults.png`` and ``throw.png``. Where there are no faults, pictures of their throw and strike are left
    out. Where the machine has no OpenGL, the scene is drawn with matplotlib and its ``note`` says so.

    Parameters
    ----------
    directory : str or Path
        A folder that is there.
    cube : DataArray or ndarray
        The cube or section.
    faults : FaultSet
        Its faults.
    progress : callable, optional
        Called with "pictures" and the share done.

    Returns
    -------
    list of PictureFile
        The pictures in the order in which a report shows them.
    """
    directory = Path(directory)
    jobs = _section_jobs(directory, faults) if len(name_axes(cube)) == 2 else _cube_jobs(directory, faults, cube)
    files = []
    for number, job in enumerate(jobs):
        if progress is not None:
            progress("pictures", number / len(jobs))
        files.append(job(cube, faults))
    if progress is not None:
        progress("pictures", 1.0)
    return files


_Job = Callable[[Any, Any], PictureFile]


def _cube_jobs(directory: Path, faults: Any, cube: Any) -> list[_Job]:
    lines = most_faulted_lines(faults, cube)
    inline, crossline, level = list(lines)[:3]
    slice_name = "depth_slice.png" if level == "depth" else "time_slice.png"

    def line_job(axis: str) -> _Job:
        return lambda cube, faults: _save_section(directory, cube, faults, axis, lines[axis])

    seen: list[_Job] = [
        lambda cube, faults: _save_scene(directory / "scene.png", cube, faults),
        line_job(inline),
        line_job(crossline),
        lambda cube, faults: _save_slice(directory / slice_name, cube, faults, lines[level]),
    ]
    if not faults.surfaces:
        return seen
    return [
        *seen,
        lambda cube, faults: _save_throw_map(directory / "throw_map.png", cube, faults),
        lambda cube, faults: _save_strike(directory / "strike.png", cube, faults),
        lambda _, faults: _save_throw(directory / "throw.png", faults),
    ]


def _section_jobs(directory: Path, faults: Any) -> list[_Job]:
    seen: list[_Job] = [lambda cube, faults: _save_section(directory, cube, faults, "", 0.0)]
    return [*seen, lambda _, faults: _save_throw(directory / "throw.png", faults)] if faults.surfaces else seen


def _save_scene(path: Path, cube: Any, faults: Any) -> PictureFile:
    caption = "The cube's back walls and floor."
    if faults.surfaces:
        caption = "Fault surfaces in the cube, coloured by throw, in front of its back walls and floor."
    try:
        save_scene(path, cube, faults=faults)
    except RenderError as error:
        sketch_scene(cube, faults=faults).savefig(path, dpi=_DPI)
        return PictureFile(path, caption, note=f"Drawn in simplified form without OpenGL: {error}")
    return PictureFile(path, caption)


def _save_section(directory: Path, cube: Any, faults: Any, axis: str, line: float) -> PictureFile:
    where: dict[str, Any] = {axis: line} if axis else {}
    path = directory / (f"section_{axis}_{line:.8g}.png" if axis else "section_faults.png")
    if not faults.surfaces:
        figure = _figure(9.0, 5.6)
        section(cube, ax=figure.subplots(), **where)
        return _save(figure, path, f"{axis.capitalize()} {line:.8g}." if axis else "The section.")
    figure = _figure(14.0, 5.6)
    plain, drawn = figure.subplots(1, 2, sharex=True, sharey=True)
    section(cube, ax=plain, **where)
    section(cube, ax=drawn, faults=faults, colour="throw", **where)
    drawn.set_ylabel("")
    drawn.set_title("with faults, coloured by throw", loc="left", fontsize="medium")
    caption = f"{axis.capitalize()} {line:.8g}, the one that crosses most faults" if axis else "The section"
    return _save(figure, path, f"{caption}: as recorded (left) and with faults (right).")


def _save_slice(path: Path, cube: Any, faults: Any, level: float) -> PictureFile:
    figure = _figure(7.2, 6.4)
    name = name_axes(cube)[2]
    where: dict[str, Any] = {name: level}
    ax = time_slice(cube, faults=faults, colour="surface", ax=figure.subplots(), **where)
    ax.locator_params(axis="x", nbins=6)
    colours = ": one colour a fault" if faults.surfaces else ""
    return _save(figure, path, f"{ax.get_title(loc='left')}{colours}.", kind="half")


def _save_throw_map(path: Path, cube: Any, faults: Any) -> PictureFile:
    figure = _figure(7.2, 6.4)
    throw_map(faults, cube, ax=figure.subplots()).locator_params(axis="x", nbins=6)
    return _save(figure, path, "All faults from above, coloured by throw; shallow parts lie on top.", kind="half")


def _save_strike(path: Path, cube: Any, faults: Any) -> PictureFile:
    figure = _figure(5.2, 4.6)
    from_north = hasattr(cube, "dims") and _lies_on_map(cube)
    strike_rose(faults, from_north=from_north, ax=figure.add_subplot(projection="polar"))
    origin = "from north" if from_north else "from the inline axis: the cube has no map coordinates"
    return _save(figure, path, f"Strike, {origin}. The area of a petal is its share of the fault area.", kind="half")


def _save_throw(path: Path, faults: Any) -> PictureFile:
    figure = _figure(6.4, 4.6)
    throw_histogram(faults, ax=figure.subplots())
    return _save(
        figure, path, "Throw over the fault area: positive on normal faults, negative on reverse ones.", kind="half"
    )


def _lies_on_map(cube: Any) -> bool:
    return np.ndim(cube) == 3 and SurveyGeometry.from_cube(cube).has_map


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _save(figure: Any, path: Path, caption: str, *, kind: str = "wide") -> PictureFile:
    # long, narrow surveys would leave most of a square empty
    figure.savefig(path, dpi=_DPI, bbox_inches="tight", pad_inches=0.08)
    return PictureFile(path, caption, kind=kind)
