"""How fast frames are mapped, beside open3d: ``python -m seismo3d.experiments.mapping_speed SEQUENCE``.

The mapper and open3d's dense frame-to-model odometry (``t.pipelines.slam.Model``: track against the ray-cast model,
integrate, ray-cast) map the same frames in the same run, one after the other, with the same voxels, band and largest
depth, on the processor, each with as many threads as it takes by itself. Printed for each: processor time and time a
frame (mean and median), and where the sequence has ``groundtruth.txt`` the position error after the best rigid
alignment. Neither knows the other's poses. What a frame leaves to be done beside the next one counts: the last one
waits for it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import MissingDependencyError
from seismo3d.experiments._command import run_command
from seismo3d.experiments.mapping import measure_trajectory, read_truth
from seismo3d.io.records import write_json
from seismo3d.robot.calibration import calibrate_timing
from seismo3d.robot.camera import Camera, RgbdFrame
from seismo3d.robot.mapper import Mapper
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.sequence import read_sequence

Step = Callable[[RgbdFrame], Float64Array]
"""Maps a frame and returns its pose (4, 4)."""
Ending = Callable[[], None]
"""Waits until what a step has left to be done beside the next one has ended."""


def make_ours(camera: Camera, settings: MapperSettings, shape: tuple[int, int]) -> tuple[Step, Ending]:
    """Return what maps a frame of a shape by the mapper, and what ends it."""
    del shape  # it asks each frame
    mapper = Mapper(camera, settings=settings)
    return lambda frame: mapper.add(frame).T_world_camera, mapper.settle


def make_open3d(camera: Camera, settings: MapperSettings, shape: tuple[int, int]) -> tuple[Step, Ending]:
    """Return what maps a frame by open3d's dense frame-to-model odometry, as its example does, and what ends it.

    Raises
    ------
    MissingDependencyError
        If open3d is not installed.
    """
    try:
        o3d: Any = import_module("open3d")
    except ImportError as error:
        raise MissingDependencyError(
            f"open3d, with which mapping is compared, cannot be loaded: {error}. Install it and what it needs."
        ) from error
    lens, slam = camera.lens, o3d.t.pipelines.slam
    device = o3d.core.Device("CPU:0")
    intrinsics = o3d.core.Tensor(np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]]))
    scale, far, near, band = lens.depth_scale, settings.measure.far, settings.measure.near, settings.band_voxels
    model = slam.Model(settings.voxel_size, 16, 40_000, o3d.core.Tensor(np.eye(4)), device)
    given, seen = (slam.Frame(*shape, intrinsics, device) for _ in range(2))
    held: dict[str, Any] = {"T": np.eye(4), "number": 0}

    def step(frame: RgbdFrame) -> Float64Array:
        depth = np.ascontiguousarray(frame.depth)
        given.set_data_from_image("depth", o3d.t.geometry.Image(o3d.core.Tensor(depth)))
        if frame.rgb is not None:
            given.set_data_from_image("color", o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(frame.rgb))))
        if held["number"]:
            found = model.track_frame_to_model(given, seen, scale, far, 0.07)
            held["T"] = held["T"] @ found.transformation.cpu().numpy()
        model.update_frame_pose(held["number"], o3d.core.Tensor(held["T"]))
        model.integrate(given, scale, far, band)
        model.synthesize_model_frame(seen, scale, near, far, band, False)
        held["number"] += 1
        return np.array(held["T"])

    return step, lambda: None  # its steps leave nothing


def compare_speed(path: str | Path, *, n_frames: int = 60, voxel_size: float = 0.005) -> dict[str, dict[str, float]]:
    """Map the first frames of a sequence by both, one after the other.

    Parameters
    ----------
    path : str or Path
    n_frames : int
        Frames that are timed; two more before them, mapped apart, load what is compiled.
    voxel_size : float

    Returns
    -------
    dict of str to dict
        For ``mapper`` and ``open3d``: ``cpu_ms`` and ``ms`` a frame with their medians, and ``position_cm``.
    """
    sequence = read_sequence(path)[:n_frames]
    frames = list(sequence)
    camera = sequence.cameras[0]
    if camera.readout is None or camera.depth_delay is None:
        camera = calibrate_timing(frames, camera).applied(camera)
    settings = MapperSettings(voxel_size=voxel_size)
    shape = frames[0].depth.shape
    makers = {"mapper": make_ours, "open3d": make_open3d}
    for make in makers.values():
        warm, end = make(camera, settings, shape)
        for frame in frames[:2]:
            warm(frame)
        end()
    steps = {name: make(camera, settings, shape) for name, make in makers.items()}
    poses: dict[str, list[Float64Array]] = {name: [] for name in steps}
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in steps}
    for name, (step, end) in steps.items():
        for frame in frames:
            cpu, wall = time.process_time(), time.perf_counter()
            poses[name].append(step(frame))
            if frame is frames[-1]:
                end()
            spent[name].append((time.process_time() - cpu, time.perf_counter() - wall))
    times = np.array([frame.time for frame in frames])
    return {name: _row(np.array(spent[name]), np.array(poses[name]), times, sequence.path) for name in steps}


def _row(spent: Float64Array, poses: Float64Array, times: Float64Array, path: Path) -> dict[str, float]:
    (cpu, wall), (cpu_median, wall_median) = 1e3 * spent.mean(axis=0), 1e3 * np.median(spent, axis=0)
    row = {"cpu_ms": float(cpu), "ms": float(wall), "cpu_median": float(cpu_median), "median": float(wall_median)}
    truth_file = path / "groundtruth.txt"
    if truth_file.is_file():
        truth, near = read_truth(truth_file, times)
        row["position_cm"] = 100.0 * measure_trajectory(truth, poses[near]).position
    return row


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of a sequence."""
    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.mapping_speed", description=__doc__)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--voxel-size", type=float, default=0.005)
    parser.add_argument("--json", type=Path, default=None, help="write the table here, too")
    given = parser.parse_args(arguments)
    table = compare_speed(given.sequence, n_frames=given.frames, voxel_size=given.voxel_size)
    print(f"{'':10}{'cpu_ms':>12}{'cpu_median':>12}{'ms':>12}{'median':>12}{'position_cm':>14}")
    for name, row in table.items():
        error = f"{row['position_cm']:14.2f}" if "position_cm" in row else ""
        print(f"{name:10}{row['cpu_ms']:12.1f}{row['cpu_median']:12.1f}{row['ms']:12.1f}{row['median']:12.1f}{error}")
    ratios = [table["open3d"][key] / table["mapper"][key] for key in ("ms", "cpu_ms")]
    print(f"open3d takes {ratios[0]:.1f} times as long as the mapper, and {ratios[1]:.1f} times its processor time")
    if given.json is not None:
        write_json(given.json, table)


if __name__ == "__main__":
    run_command(main)
