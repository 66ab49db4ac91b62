"""How well sequences are mapped, part by part: ``python -m seismo3d.experiments.mapping SEQUENCE``.

The sequence has ``groundtruth.txt`` (TUM format) beside its images. Each row maps it anew with one part changed and
prints: frames located, absolute trajectory error after the best rigid alignment, rotation error with the first frames
aligned, errors relative over 30 frames, milliseconds a frame.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import FormatError
from seismo3d.experiments._command import run_command
from seismo3d.geometry.rotations import invert_transform, make_transform, rotation_angle, rotation_from_quaternion
from seismo3d.io.records import write_json
from seismo3d.registration.align import align_pairs
from seismo3d.robot.calibration import calibrate_timing
from seismo3d.robot.camera import Camera
from seismo3d.robot.mapper import Mapper
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.sequence import RgbdSequence, read_sequence


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """Errors of a trajectory.

    Attributes
    ----------
    position : float
        Root mean square distance after the rigid alignment that makes it least, metres.
    rotation : float
        Root mean square angle with the first poses aligned, radians.
    step_position, step_rotation : float
        Root mean square errors of the motion over some frames, metres and radians; NaN for a shorter trajectory.
    """

    position: float
    rotation: float
    step_position: float
    step_rotation: float


def measure_trajectory(truth: Float64Array, found: Float64Array, *, step: int = 30) -> TrajectoryErrors:
    """Compare poses with the truth, row by row.

    Parameters
    ----------
    truth, found : ndarray of shape (n, 4, 4), float64
    step : int
        Frames of relative motion.

    Returns
    -------
    TrajectoryErrors
    """
    p, q = truth[:, :3, 3], found[:, :3, 3]
    T = align_pairs(p, q).T_target_source
    miss = q @ T[:3, :3].T + T[:3, 3] - p
    start = truth[0] @ invert_transform(found[0])
    turns = [rotation_angle(a[:3, :3].T @ (start @ b)[:3, :3]) for a, b in zip(truth, found)]
    steps = [
        invert_transform(invert_transform(a0) @ a1) @ invert_transform(b0) @ b1
        for a0, a1, b0, b1 in zip(truth, truth[step:], found, found[step:])
    ]
    return TrajectoryErrors(
        _rms(np.linalg.norm(miss, axis=1)),
        _rms(np.array(turns)),
        _rms(np.array([np.linalg.norm(T[:3, 3]) for T in steps])),
        _rms(np.array([rotation_angle(T[:3, :3]) for T in steps])),
    )


def read_truth(path: Path, times: Float64Array, *, max_difference: float = 0.02) -> tuple[Float64Array, Any]:
    """Return the poses (n, 4, 4) of a file in TUM format nearest to some times, and which of them have one.

    Raises
    ------
    FormatError
        If the file has other than eight columns, or no pose near any time.
    """
    rows = np.loadtxt(path, ndmin=2)
    if rows.shape[1] != 8:
        raise FormatError(f"{path} has {rows.shape[1]} columns; expected 8: time tx ty tz qx qy qz qw.")
    nearest = np.abs(times[:, None] - rows[None, :, 0]).argmin(axis=1)
    near = np.abs(rows[nearest, 0] - times) <= max_difference
    if not near.any():
        raise FormatError(f"{path} has no pose within {max_difference} s of any frame; expected the same clock.")
    poses = [make_transform(rotation_from_quaternion([r[7], r[4], r[5], r[6]]), r[1:4]) for r in rows[nearest[near]]]
    return np.array(poses), near


def map_once(
    sequence: RgbdSequence, cameras: Sequence[Camera], settings: MapperSettings, *, close_loops: bool = False
) -> dict[str, Any]:
    """Map a sequence and measure it against its ``groundtruth.txt``; return a row of the table."""
    mapper = Mapper(list(cameras), settings=settings)
    seconds = 0.0
    for frame in sequence:
        since = time.perf_counter()
        mapper.add(frame)
        seconds += time.perf_counter() - since
    if close_loops:
        mapper.close_loops()
    found = mapper.trajectory
    truth, near = read_truth(sequence.path / "groundtruth.txt", found.times)
    errors = measure_trajectory(truth, found.T_world_camera[near])
    return {
        "located": len(found),
        "frames": len(sequence),
        "position_cm": 100.0 * errors.position,
        "rotation_deg": float(np.degrees(errors.rotation)),
        "step_cm": 100.0 * errors.step_position,
        "step_deg": float(np.degrees(errors.step_rotation)),
        "ms_a_frame": 1e3 * seconds / len(sequence),
    }


def run_table(path: str | Path, *, n_frames: int | None = None) -> dict[str, dict[str, Any]]:
    """Map a sequence once for each part of the mapper; print and return the table."""
    sequence = read_sequence(path)[:n_frames]
    open_cameras = [replace(c, readout=c.readout or 0.0, depth_delay=c.depth_delay or 0.0) for c in sequence.cameras]
    cameras = [
        calibrate_timing([f for f in sequence[:90] if f.camera == k], c).applied(c)
        for k, c in enumerate(sequence.cameras)
    ]
    table = {"camera taken as static": _static(sequence)}
    print(_line("", table["camera taken as static"], heading=True))
    print(_line("camera taken as static", table["camera taken as static"]), flush=True)
    base = MapperSettings()
    rows: dict[str, tuple[Sequence[Camera], MapperSettings, bool]] = {
        "fused": (cameras, base, False),
        "planes only": (cameras, replace(base, terms="planes"), False),
        "features only": (cameras, replace(base, terms="features"), False),
        "features, then planes": (cameras, replace(base, terms="two_stage"), False),
        "without the filter": (cameras, replace(base, filtered=False), False),
        "without timing": (open_cameras, base, False),
        "with loop closure": (cameras, base, True),
        "voxels of 5 mm": (cameras, replace(base, voxel_size=0.005), False),
    }
    for name, (used, settings, close) in rows.items():
        table[name] = map_once(sequence, used, settings, close_loops=close)
        print(_line(name, table[name]), flush=True)
    return table


def _static(sequence: RgbdSequence) -> dict[str, Any]:
    truth, _ = read_truth(sequence.path / "groundtruth.txt", sequence.times)
    p = truth[:, :3, 3]
    turns = [rotation_angle(truth[0, :3, :3].T @ T[:3, :3]) for T in truth]
    return {
        "located": 0,
        "frames": len(sequence),
        "position_cm": 100.0 * _rms(np.linalg.norm(p - p.mean(axis=0), axis=1)),
        "rotation_deg": float(np.degrees(_rms(np.array(turns)))),
    }


def _rms(values: Float64Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _line(name: str, row: dict[str, Any], *, heading: bool = False) -> str:
    columns = ("position_cm", "rotation_deg", "step_cm", "step_deg", "ms_a_frame")
    if heading:
        return f"{'':24}{'located':>12}" + "".join(f"{column:>14}" for column in columns)
    located = f"{row['located']}/{row['frames']}"
    cells = "".join(f"{row[column]:14.2f}" if column in row else f"{'':14}" for column in columns)
    return f"{name:24}{located:>12}{cells}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of a sequence."""
    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.mapping", description=__doc__)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--frames", type=int, default=None, help="use so many frames only")
    parser.add_argument("--json", type=Path, default=None, help="write the table here, too")
    given = parser.parse_args(arguments)
    table = run_table(given.sequence, n_frames=given.frames)
    if given.json is not None:
        write_json(given.json, table)


if __name__ == "__main__":
    run_command(main)
