"""Wall and CPU time of the local stage against small_gicp, from raw arrays to the transform, in the same run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import MissingDependencyError
from seismo3d.io.points import read_points
from seismo3d.registration.register import register

PAIRS = {
    "lidar_pair": ("lidar_pair/target.ply", "lidar_pair/source.ply", 0.25, 1.0, 1.0),
    "room": ("room/room_scan1.pcd", "room/room_scan2.pcd", 0.05, 0.2, 0.2),
    "bunny": ("bunny/bun000.ply", "bunny/bun045.ply", 0.001, 0.004, 0.01),
}
"""Files, downsampling, voxels of VGICP and largest distance of pairs, in the files' units (metres)."""
BURST = 4
"""Calls of one method in a row."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Median and least wall time and median CPU time of a method on a pair, in milliseconds."""

    pair: str
    method: str
    wall_ms: float
    least_ms: float
    cpu_ms: float


def time_pair(folder: Path, name: str, *, rounds: int = 15, n_threads: int = 2) -> list[Timing]:
    """Time all methods on one pair, taking turns so that all see the same load.

    A turn is a burst of calls of which the first does not count: it meets the threads that another library's pool left
    spinning, or asleep.
    """
    try:
        import small_gicp
    except ImportError as error:
        raise MissingDependencyError("small_gicp is not installed. Install the dependency group 'bench'.") from error
    target_file, source_file, voxel, gicp_voxel, reach = PAIRS[name]
    target, source = read_points(folder / target_file).points, read_points(folder / source_file).points

    def peer(kind: str) -> Callable[[], object]:
        return lambda: small_gicp.align(
            target,
            source,
            registration_type=kind,
            voxel_resolution=gicp_voxel,
            downsampling_resolution=voxel,
            max_correspondence_distance=reach,
            num_threads=n_threads,
        )

    jobs = {
        "seismo3d": lambda: register(target, source, stages=("local",), voxel_size=voxel, n_threads=n_threads),
        "PLANE_ICP": peer("PLANE_ICP"),
        "VGICP": peer("VGICP"),
    }
    wall: dict[str, list[float]] = {method: [] for method in jobs}
    cpu: dict[str, list[float]] = {method: [] for method in jobs}
    for turn in range(rounds + 2):
        for method, job in jobs.items():
            for call in range(BURST):
                start, start_cpu = time.perf_counter(), time.process_time()
                job()
                if turn >= 2 and call > 0:
                    wall[method].append(1e3 * (time.perf_counter() - start))
                    cpu[method].append(1e3 * (time.process_time() - start_cpu))
    return [Timing(name, m, float(np.median(wall[m])), float(np.min(wall[m])), float(np.median(cpu[m]))) for m in jobs]


def report(folder: Path, *, rounds: int = 15) -> list[Timing]:
    """Print and return the timings of all pairs."""
    rows: list[Timing] = []
    print(f"{'pair':12} {'method':10} {'wall ms':>8} {'least':>8} {'CPU ms':>8} {'ours / it':>9}")
    for name in PAIRS:
        timings = time_pair(folder, name, rounds=rounds)
        own = timings[0].wall_ms
        for t in timings:
            print(
                f"{t.pair:12} {t.method:10} {t.wall_ms:8.1f} {t.least_ms:8.1f} {t.cpu_ms:8.1f} {own / t.wall_ms:9.2f}"
            )
        rows += timings
    return rows


def distance_of(T: Float64Array, truth: Float64Array, points: Float64Array) -> tuple[float, float]:
    """Return the angle in radians and the displacement of the points' centre between two transforms."""
    from seismo3d.geometry.rotations import nearest_rotation, rotation_angle

    d = points.shape[1]
    angle = rotation_angle(nearest_rotation(T[:d, :d] @ np.linalg.inv(truth[:d, :d])))
    centre = np.append(points.mean(axis=0), 1.0)
    return angle, float(np.linalg.norm(((T - truth) @ centre)[:d]))
