"""``seismo3d plan``: a way for a robot through a mapped place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

EXAMPLES = (
    "seismo3d plan desk-map --start 0,0 --goal 2.4,1.1",
    "seismo3d plan desk-map --start 0,0,90 --goal 2.4,1.1,0 --radius 0.3 --turning-radius 0.8",
)


def run(
    folder: Path = typer.Argument(
        help="Folder with occupancy.npz, such as seismo3d map makes, or the file itself.", show_default=False
    ),
    start: str = typer.Option(..., help="X,Y or X,Y,HEADING in map axes: metres, degrees.", show_default=False),
    goal: str = typer.Option(..., help="X,Y or X,Y,HEADING.", show_default=False),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="Folder for path.csv and path.png. [default: that of the map]"
    ),
    radius: float = typer.Option(0.25, help="Of the robot, metres."),
    turning_radius: float = typer.Option(0.5, help="Least radius of a turn, metres."),
    max_speed: float = typer.Option(0.8, help="Metres a second."),
    max_acceleration: float = typer.Option(0.5, help="Metres a second squared, along and across."),
    max_slope: float = typer.Option(20.0, help="Degrees."),
    max_step: float = typer.Option(0.08, help="Metres between neighbouring cells."),
    margin: float = typer.Option(0.2, help="Room beyond the radius that the robot likes to have, metres."),
    unknown: str = typer.Option("blocked", help="Unknown ground: blocked or passable."),
) -> None:
    """Plan a way through a map, within a robot's limits.

    Writes path.csv (time, x, y, heading, speed, curvature, world x, y, z; SI units) and path.png.
    """
    from seismo3d.errors import FileAccessError, GeometryError
    from seismo3d.io._files import refuse_os_errors
    from seismo3d.robot.occupancy import Occupancy
    from seismo3d.robot.planning import Planner
    from seismo3d.robot.traversability import RobotLimits

    robot = RobotLimits(
        radius=radius,
        max_curvature=1.0 / _positive(turning_radius, "turning-radius"),
        max_speed=max_speed,
        max_acceleration=max_acceleration,
        max_lateral_acceleration=max_acceleration,
        max_slope_deg=max_slope,
        max_step=max_step,
        margin=margin,
    )
    file = folder / "occupancy.npz" if folder.is_dir() else folder
    target = out or file.parent
    if target.exists() and not target.is_dir():
        raise FileAccessError(f"{target} is a file; expected a folder.")
    occupancy = Occupancy.load(file)
    planner = Planner(occupancy, _as_pose(start, "start"), _as_pose(goal, "goal"), robot=robot, unknown=unknown)
    path = planner.plan()
    if path.state != "found":
        raise GeometryError(
            f"there is no way from {start} to {goal} within the robot's limits. Choose another goal, a smaller "
            "--radius or --turning-radius, or --unknown passable."
        )
    with refuse_os_errors(target, "write"):
        target.mkdir(parents=True, exist_ok=True)
    _draw(target / "path.png", occupancy, path, planner.traversability)
    path.save_csv(target / "path.csv")
    typer.echo(f"length     {path.length[-1]:.2f} m")
    typer.echo(f"time       {path.times[-1]:.1f} s")
    typer.echo(f"cost       {path.cost:.2f}")
    typer.echo(f"expansions {path.expansions}")
    typer.echo(str(target / "path.csv"))


def _positive(value: float, name: str) -> float:
    from seismo3d._validate import as_number

    return as_number(value, name, low=0.0, strict=True)


def _as_pose(words: str, name: str) -> tuple[float, ...]:
    from math import isfinite, radians

    from seismo3d.errors import ParameterError

    try:
        values = [float(word) for word in words.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(isfinite(value) for value in values):
        raise ParameterError(f"{name} is {words!r}; expected X,Y or X,Y,HEADING: metres, and degrees from x.")
    return (*values[:2], *(radians(value) for value in values[2:]))


def _draw(file: Path, occupancy: Any, path: Any, traversability: Any) -> None:
    import matplotlib.pyplot as plt

    from seismo3d.plot.picture_files import save_figure
    from seismo3d.plot.robot_maps import occupancy_map

    ax = occupancy_map(occupancy, path=path, traversability=traversability)
    save_figure(ax.figure, file, dpi=130)
    plt.close(ax.figure)
