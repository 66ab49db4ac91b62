"""How well scenes are mapped whose every surface is known: ``python -m seismo3d.experiments.mapping_synthetic``.

Each row renders a sequence with the noise of a structured-light camera and maps it: as it is, with something that
crosses up to 30 % of the view, with a second in the dark, and with every fourth frame only. Printed: frames located,
position error after the best rigid alignment (cm, and as a share of the path) before and after loop closure, distance
of the mesh from the true surface (median), share of mesh points farther from it than 3 cm (ghosts), milliseconds of
processor time a frame, and the map's size. Rows of the terrain also print the median error of the mapped elevation,
and how far ``register`` puts it from the truth in a second, sparser survey of the same ground, from a start that a
compass and a satellite fix would give.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.experiments._command import run_command
from seismo3d.experiments.mapping import measure_trajectory
from seismo3d.geometry.rotations import exp_rotation, invert_transform, make_transform, rotation_angle
from seismo3d.io.records import write_json
from seismo3d.robot.camera import Camera, RgbdFrame
from seismo3d.robot.mapper import Mapper
from seismo3d.robot.results import MapperSettings
from seismo3d.synthetic.rgbd import RgbdSequence, rgbd_sequence

CASES: dict[str, dict[str, Any]] = {
    "room": {"kind": "room"},
    "room, something moves": {"kind": "room", "moving": "sphere"},
    "room, a second dark": {"kind": "room", "blackout": True},
    "room, every 4th frame": {"kind": "room", "every": 4},
    "terrain": {"kind": "terrain"},
    "terrain, something moves": {"kind": "terrain", "moving": "box"},
    "terrain, a second dark": {"kind": "terrain", "blackout": True},
    "terrain, every 4th frame": {"kind": "terrain", "every": 4},
}
# metres off the true surface from which on a vertex of the mesh shows nothing that is there
_GHOST = 0.03
_SURVEY_CELL, _SURVEY_NOISE = 0.2, 0.01
"""Of the second survey: spacing and standard deviation of its heights, metres."""
_COMPASS, _FIX = 0.15, np.array([0.4, -0.3, 0.2])
"""How far off a compass and a satellite fix put the map in the survey before it is registered, rad and m."""


def run_case(
    name: str,
    *,
    frames: int,
    size: tuple[int, int],
    voxel_size: float,
    period: float | None = None,
    seed: int = 0,
    n_threads: int = 0,
) -> dict[str, Any]:
    """Map one of the ``CASES``; return a row of the table.

    Parameters
    ----------
    name : str
    frames : int
    size : (int, int)
        Width and height of the images.
    voxel_size : float
    period : float, optional
        Seconds for one round. By default it takes nine in ten of the frames, so that the rest sees its start again.
    seed, n_threads : int
    """
    case = dict(CASES[name])
    every = case.pop("every", 1)
    seconds = frames / 30.0
    if case.pop("blackout", False):
        case["blackout"] = (0.5 * seconds, 0.5 * seconds + 1.0)
    sequence = rgbd_sequence(frames=frames, size=size, period=period or 0.9 * seconds, seed=seed, **case)
    settings = MapperSettings(voxel_size=voxel_size, n_threads=n_threads)
    mapper = Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)
    spent, states = 0.0, []
    for number in range(0, frames, every):
        frame = sequence[number]
        since = time.process_time()
        states.append(mapper.add(RgbdFrame.of(frame.colour, frame.depth, frame.stamp)).state)
        mapper.settle()
        spent += time.process_time() - since
    row: dict[str, Any] = {
        "frames": len(states),
        "located": len(mapper.trajectory),
        "ms_a_frame": 1e3 * spent / len(states),
    }
    row |= {"path_m": sequence.path_length, "before": _trajectory_row(mapper, sequence, every)}
    closed = mapper.close_loops()
    row |= {"after": _trajectory_row(mapper, sequence, every), "closures": closed.n_agreeing}
    row |= _surface_row(mapper, sequence)
    if sequence.kind == "terrain":
        row |= measure_elevation(mapper, sequence)
    return row


def measure_elevation(mapper: Mapper, sequence: RgbdSequence, *, cell: float = 0.05) -> dict[str, float]:
    """Compare the mapped elevation with the true ground, and register it to a sparser survey of it.

    Returns
    -------
    dict
        ``elevation_cm``, the median distance of its cells from the true surface; ``survey_cm`` and ``survey_deg``, how
        far the registration to the survey is from the true place of the map's middle, and its turn from the true one.
    """
    from seismo3d.registration.register import register
    from seismo3d.scan import Scan

    ground = mapper.elevation(cell=cell)
    rows, columns = np.nonzero(np.isfinite(ground.values))
    xyz = np.column_stack([ground.x.values[columns], ground.y.values[rows], ground.values[rows, columns]])
    truth = sequence.poses[0] @ ground.attrs["T_world_map"]
    world = xyz @ truth[:3, :3].T + truth[:3, 3]
    height = np.median(np.abs(sequence.scene.distance_to_surface(world[:: max(1, len(world) // 20000)])))
    low, high = world[:, :2].min(axis=0) - 1.0, world[:, :2].max(axis=0) + 1.0
    x, y = (np.arange(low[k], high[k], _SURVEY_CELL) for k in range(2))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    survey = sequence.scene.ground_height(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    survey = survey + _SURVEY_NOISE * np.random.default_rng(sequence.seed).standard_normal(survey.shape)
    target = Scan.from_elevation(survey, _SURVEY_CELL)
    source = Scan.from_elevation(ground.values[::-1], cell)
    # scans begin at their own first cell
    T_world_target, T_map_source = np.eye(4), np.eye(4)
    T_world_target[:2, 3] = low
    T_map_source[:2, 3] = ground.x.values[0], ground.y.values[-1]
    middle = np.append(xyz.mean(axis=0), 1.0)
    guess = _turned_about(truth, middle) @ T_map_source
    found = register(target, source, voxel_size=_SURVEY_CELL, start=invert_transform(T_world_target) @ guess)
    T = T_world_target @ found.T_target_source @ invert_transform(T_map_source)
    return {
        "elevation_cm": 100.0 * float(height),
        "survey_cm": 100.0 * float(np.linalg.norm((T - truth) @ middle)),
        "survey_deg": float(np.degrees(rotation_angle(T[:3, :3].T @ truth[:3, :3]))),
    }


def _turned_about(truth: Float64Array, middle: Float64Array) -> Float64Array:
    """Return the truth turned about the plumb line through a point of the map, and shifted, as a start."""
    centre = (truth @ middle)[:3]
    turn = make_transform(exp_rotation([0.0, 0.0, _COMPASS]), np.zeros(3))
    there, back = make_transform(np.eye(3), centre + _FIX), make_transform(np.eye(3), -centre)
    return np.asarray(there @ turn @ back @ truth)


def _trajectory_row(mapper: Mapper, sequence: RgbdSequence, every: int) -> dict[str, float]:
    found = mapper.trajectory
    errors = measure_trajectory(sequence.poses[found.frames * every], found.T_world_camera)
    share = 100.0 * errors.position / sequence.path_length
    return {"position_cm": 100.0 * errors.position, "share": share, "rotation_deg": float(np.degrees(errors.rotation))}


def _surface_row(mapper: Mapper, sequence: RgbdSequence) -> dict[str, float]:
    points: Float64Array = mapper.mesh().points
    T = sequence.poses[0]
    some = points[:: max(1, len(points) // 100_000)]
    off = np.abs(sequence.scene.distance_to_surface(some @ T[:3, :3].T + T[:3, 3]))
    surface = mapper.state.surface
    return {
        "mesh_mm": 1e3 * float(np.median(off)),
        "ghosts": 100.0 * float((off > _GHOST).mean()),
        "map_mb": surface.n_bytes / 1e6,
    }


def _line(name: str, row: dict[str, Any]) -> str:
    before, after = row["before"], row["after"]
    text = (
        f"{name:26}{row['located']:5}/{row['frames']:<5}{before['position_cm']:7.2f} cm {before['share']:6.3f} %"
        f"{after['position_cm']:8.2f} cm {after['share']:6.3f} %{row['mesh_mm']:8.2f} mm{row['ghosts']:7.2f} %"
        f"{row['ms_a_frame']:8.1f} ms{row['map_mb']:8.0f} MB"
    )
    if "elevation_cm" in row:
        text += f"{row['elevation_cm']:8.2f} cm{row['survey_cm']:8.2f} cm {row['survey_deg']:5.2f} deg"
    return text


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.mapping_synthetic", description=__doc__)
    parser.add_argument("--cases", nargs="*", choices=list(CASES), default=list(CASES))
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--voxel-size", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--json", type=Path, default=None, help="write the table here, too")
    given = parser.parse_args(arguments)
    titles = f"{'':26}{'located':11}{'before closure':>20}{'after closure':>20}{'mesh':>11}{'ghosts':>9}{'time':>11}"
    print(titles + f"{'map':>11}{'elevation':>11}{'registered':>19}")
    table = {}
    for name in given.cases:
        table[name] = run_case(
            name, frames=given.frames, size=tuple(given.size), voxel_size=given.voxel_size, seed=given.seed,
            n_threads=given.threads,
        )  # fmt: skip
        print(_line(name, table[name]), flush=True)
    if given.json is not None:
        write_json(given.json, table)


if __name__ == "__main__":
    run_command(main)
