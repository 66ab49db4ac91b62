"""``seismo3d map``: a dense map and the trajectory from an RGB-D sequence."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from seismo3d.cli._options import Json, Overwrite

if TYPE_CHECKING:
    from seismo3d._typing import Progress
    from seismo3d.robot.mapper import Mapper
    from seismo3d.robot.mesh import Mesh
    from seismo3d.robot.results import Closed, Tracked
    from seismo3d.robot.sequence import RgbdSequence
    from seismo3d.robot.trajectory import Trajectory

EXAMPLES = (
    "seismo3d map desk -o desk-map",
    "seismo3d map desk -o desk-map --voxel-size 0.005 --far 3",
)

_CALIBRATED = 90
"""Frames from which open timing is found."""


def run(
    sequence: Path = typer.Argument(
        help="Folder of colour and depth images: TUM, 7-Scenes, Open3D, or color and depth; with camera.json.",
        show_default=False,
    ),
    out: Path = typer.Option(..., "--out", "-o", help="Folder to make for the results.", show_default=False),
    voxel_size: float = typer.Option(0.01, help="Edge of the map's voxels, metres."),
    far: float = typer.Option(4.0, help="Depth beyond is left out, metres."),
    total_variation: float = typer.Option(0.0, help="Strength of total-variation denoising of depth, metres."),
    cell: float = typer.Option(0.05, help="Side of the cells of the maps from above, metres."),
    up: str = typer.Option("0,-1,0", help="Up, nearly, in the first camera's axes: right, down, ahead."),
    max_difference: float = typer.Option(0.02, help="Stamps of colour and depth farther apart are no pair, seconds."),
    close_loops: bool = typer.Option(True, help="Find places seen twice, and make the map anew from corrected poses."),
    threads: int = typer.Option(0, help="Threads to work on. [default: one a core]", show_default=False),
    json: Json = False,
    overwrite: Overwrite = False,
) -> None:
    """Map an RGB-D sequence: where the camera was, and the surface that it saw.

    The folder gets trajectory.txt (TUM format, a row a located frame), states.csv (what became of each frame, and its
    local map), mesh.ply, graph.g2o, occupancy.npz, elevation.tif (.npz where rasterio is not installed), map.npz to go
    on from, trajectory.png, occupancy.png, map.png, report.html and run.json.
    """
    from seismo3d._stages import StageClock
    from seismo3d._validate import as_number
    from seismo3d.cli._run_folder import check_run_folder, describe_run, print_json, write_record
    from seismo3d.cli._timings import say_timings
    from seismo3d.cli.app import shown_progress
    from seismo3d.errors import GeometryError
    from seismo3d.io._files import written_aside
    from seismo3d.robot.frames import MeasureSettings
    from seismo3d.robot.ground import as_up
    from seismo3d.robot.mapper import Mapper
    from seismo3d.robot.results import MapperSettings
    from seismo3d.robot.sequence import read_sequence

    check_run_folder(out, command="map", inputs=[sequence], overwrite=overwrite)
    as_number(cell, "cell", low=0.0, strict=True)
    upward = as_up(up.split(","))
    opened = read_sequence(sequence, max_difference=max_difference)
    settings = MapperSettings(
        voxel_size=voxel_size, measure=MeasureSettings(far=far, total_variation=total_variation), n_threads=threads
    )
    with written_aside(out, folder=True) as aside, shown_progress() as show:
        aside.mkdir()
        clock = StageClock(show)
        mapper = Mapper(_calibrated(opened, clock), settings=settings)
        found = []
        for number, frame in enumerate(opened):
            clock("map", number / len(opened))
            found.append(mapper.add(frame))
        if len(mapper.trajectory) == 0:
            raise GeometryError(f"no frame of {sequence} has depth to map; expected depth images in depth_scale units.")
        closed = None
        if close_loops:
            clock("loops", 0.0)
            closed = mapper.close_loops()
        clock("export", 0.0)
        shown, mesh = _shown(mapper)
        facts = {**_facts(mapper, opened, found, closed), "shown_map": shown}
        if len(mesh.triangles) == 0:
            raise GeometryError(
                f"{sequence} has {facts['frames']} frames, {facts['located']} of them located, which is too little to "
                "show a surface; expected frames that overlap. Check the intrinsics and depth_scale in camera.json, or "
                "give the frames between these."
            )
        _write(mapper, mesh, shown, opened, found, aside, cell, upward)
        timings = clock.stop()
        asked = {
            "voxel_size": voxel_size, "far": far, "total_variation": total_variation, "cell": cell, "up": up,
            "max_difference": max_difference, "close_loops": close_loops,
        }  # fmt: skip
        record = describe_run(sequence, command="map", options=asked)
        _report(aside, str(sequence.name), facts, timings)
        write_record(aside, {**record, **facts, "timings_s": timings})
    if json:
        print_json({"folder": out, **facts, "timings_s": timings})
    else:
        for name, value in facts.items():
            typer.echo(f"{name.replace('_', ' '):<20}{value}")
        typer.echo(str(out))
    say_timings(timings)


def _calibrated(opened: RgbdSequence, show: Progress) -> list[Any]:
    """Find the timing that cameras leave open from their first frames."""
    from itertools import islice

    from seismo3d.robot.calibration import calibrate_timing

    cameras = []
    for number, camera in enumerate(opened.cameras):
        if camera.readout is None or camera.depth_delay is None:
            frames = list(islice((f for f in opened if f.camera == number), _CALIBRATED))
            camera = calibrate_timing(frames, camera, progress=show).applied(camera)
        cameras.append(camera)
    return cameras


def _shown(mapper: Mapper) -> tuple[int, Mesh]:
    """Return the number and mesh of the local map that is drawn: the current one, or the last before it with a surface.

    A map that was begun by the last frames shows none yet.
    """
    from seismo3d.robot.mesh import extract_mesh

    before = [state for state in reversed(mapper.maps.every) if state is not mapper.state]
    for state in (mapper.state, *before):
        mesh = extract_mesh(state.surface)
        if len(mesh.triangles):
            return state.number, mesh
    return mapper.state.number, mesh


def _states(mapper: Mapper, found: list[Tracked]) -> list[tuple[str, int | None]]:
    """Return each frame's state and local map; one that was located in a local map that was given up is dropped."""
    path = mapper.trajectory
    map_of = dict(zip(path.frames.tolist(), path.maps.tolist()))
    return [
        ("dropped" if tracked.is_located and frame not in map_of else tracked.state, map_of.get(frame))
        for frame, tracked in enumerate(found)
    ]


def _facts(mapper: Mapper, opened: RgbdSequence, found: list[Tracked], closed: Closed | None) -> dict[str, Any]:
    from collections import Counter

    states = Counter(state for state, _ in _states(mapper, found))
    return {
        "frames": len(opened),
        "located": len(mapper.trajectory),
        "sliding": states["sliding"],
        "lost": states["lost"],
        "empty": states["empty"],
        "dropped": states["dropped"],
        "local_maps": len(mapper.maps.every),
        "keyframes": sum(len(state.views) for state in mapper.maps.every),
        "closures": 0 if closed is None else closed.n_agreeing,
        "path_m": round(mapper.trajectory.length, 3),
        "readout_ms": [round(1e3 * (camera.readout or 0.0), 2) for camera in mapper.cameras],
        "depth_delay_ms": [round(1e3 * (camera.depth_delay or 0.0), 2) for camera in mapper.cameras],
        "map_mb": round(mapper.state.surface.n_bytes / 1e6, 1),
    }


def _write(
    mapper: Mapper,
    mesh: Mesh,
    shown: int,
    opened: RgbdSequence,
    found: list[Tracked],
    folder: Path,
    cell: float,
    up: Any,
) -> None:
    from seismo3d.graph.poses import write_g2o
    from seismo3d.io.elevation import raster_suffix, write_elevation
    from seismo3d.robot.ground import make_ground, make_occupancy

    mapper.trajectory.save_tum(folder / "trajectory.txt")
    write_g2o(folder / "graph.g2o", mapper.graph)
    mapper.save(folder / "map.npz")
    lines = ["time,state,planes,landmarks,plane_spread,landmark_spread_px,local_map"]
    for time, tracked, (state, local_map) in zip(opened.times, found, _states(mapper, found)):
        located, measures = tracked.located, ",,,"
        if located is not None:
            spreads = f"{located.plane_spread:.3f},{located.landmark_spread:.3f}"
            measures = f"{located.n_planes},{located.n_landmarks},{spreads}"
        lines.append(f"{time:.6f},{state},{measures},{'' if local_map is None else local_map}")
    (folder / "states.csv").write_text("\n".join(lines) + "\n", encoding="ascii")
    mesh.save(folder / "mesh.ply")
    occupancy = make_occupancy(mesh, cell=cell, up=up)
    occupancy.save(folder / "occupancy.npz")
    elevation = make_ground(mesh, cell=cell, up=up)
    write_elevation(folder / f"elevation{raster_suffix()}", elevation)
    _draw(mapper.trajectory, mesh, shown, occupancy, folder)


def _draw(path: Trajectory, mesh: Mesh, shown: int, occupancy: Any, folder: Path) -> None:
    import cv2
    from matplotlib.figure import Figure

    from seismo3d.plot.map_pictures import surface_picture, trajectory_plot
    from seismo3d.plot.robot_maps import occupancy_map

    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    trajectory_plot(path, ax=figure.add_subplot())
    figure.savefig(folder / "trajectory.png", dpi=130)
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    occupancy_map(occupancy, ax=figure.add_subplot())
    figure.savefig(folder / "occupancy.png", dpi=130)
    image = surface_picture(mesh, T_world_map=occupancy.T_world_map, trajectory=path.of_map(shown))
    cv2.imwrite(str(folder / "map.png"), image[:, :, ::-1])


def _report(folder: Path, name: str, facts: dict[str, Any], timings: dict[str, float]) -> None:
    from seismo3d.plot.map_report import write_map_report

    pictures = [
        (folder / "map.png", "The mapped surface from behind and above; the camera's path in red."),
        (folder / "trajectory.png", "Where the camera was, in the first frame's axes."),
        (folder / "occupancy.png", "From above: free, occupied and unknown cells."),
    ]
    write_map_report(folder / "report.html", name, facts=facts, timings=timings, pictures=pictures)
