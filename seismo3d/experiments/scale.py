"""Work in blocks measured: equal to one piece, within its memory, after kills, and on two workers against one.

Run ``python -m seismo3d.experiments.scale equal``, ``part``, ``kills`` or ``workers``; each prints what it measured as
JSON. On a busy machine compare seconds of processor time, which every measurement has, not of the clock.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._stages import StageClock, no_progress
from seismo3d._typing import Float32Array
from seismo3d.errors import MissingDependencyError
from seismo3d.experiments._command import run_command
from seismo3d.io.cubes import open_cube
from seismo3d.io.records import to_json
from seismo3d.io.zarr_store import write_zarr
from seismo3d.seismic.blocks.plan import parse_memory, plan_blocks
from seismo3d.seismic.blocks.tracing import trace_in_blocks
from seismo3d.seismic.faults import FaultSettings, trace_faults

LARGE = (1712, 1712, 1706)
"""A cube of 20 GB."""


def large_block(i0: int, j0: int, shape: tuple[int, int, int]) -> Float32Array:
    """Return a block of an endless cube: folded layers, a fault every two hundred traces, and mild noise.

    The faults dip 60 degrees, alternately either way, with throws that change along strike; any block is the same
    whichever others are made.
    """
    i, j = (first + np.arange(n)[..., None] for first, n in ((i0, shape[0]), (j0, shape[1])))
    i, j = i[:, None, :].astype(np.float64), j[None, :, :].astype(np.float64)
    k = np.arange(shape[2], dtype=np.float64)[None, None, :]
    depth = k + 18.0 * np.sin(i / 170.0) * np.cos(j / 210.0) + 9.0 * np.sin((i + 2.0 * j) / 330.0)
    for number in range((i0 - 1100) // 200, (i0 + shape[0] + 1100) // 200 + 1):
        side = 1.0 if number % 2 else -1.0
        surface = 200.0 * number + 0.15 * j + side * (k - 0.5 * shape[2]) / np.tan(np.radians(60.0))
        throw = 14.0 + 8.0 * np.sin(0.01 * j + number)
        depth -= np.where(side * (i - surface) > 0.0, throw, 0.0)
    layers = np.random.default_rng(11)
    trace = np.convolve(layers.normal(size=shape[2] + 8192), _ricker(16.0), "same").astype(np.float32)
    values = np.interp(depth.ravel(), np.arange(len(trace)) - 4096.0, trace).reshape(shape).astype(np.float32)
    noise = np.random.default_rng([7, i0, j0]).standard_normal(shape, dtype=np.float32)
    return np.asarray(values + np.float32(0.15 * trace.std()) * noise, np.float32)


def _ricker(period: float) -> Any:
    t = np.arange(-3.0 * period, 3.0 * period + 1.0) / period
    return (1.0 - 2.0 * (np.pi * t) ** 2) * np.exp(-((np.pi * t) ** 2))


def large_cube(shape: tuple[int, int, int], *, brick: int = 32) -> Any:
    """Return a part of the endless cube, lazy: made a brick at a time when it is read."""
    import dask.array as da

    def make(block_info: Any = None) -> Float32Array:
        (i0, _), (j0, _), _ = block_info[None]["array-location"]
        return large_block(i0, j0, tuple(block_info[None]["chunk-shape"]))

    chunks = tuple(tuple(min(brick, n - s) for s in range(0, n, brick)) for n in shape[:2])
    return da.map_blocks(make, chunks=(*chunks, (shape[2],)), dtype=np.float32, meta=np.empty((0, 0, 0), np.float32))


def measure_equal(size: int, *, edge: int) -> dict[str, Any]:
    """Trace a cube in one piece and in blocks, and compare."""
    from seismo3d.synthetic import fault_cube

    cube = fault_cube("clean", seed=1, shape=(size, size, size), noise=0.2).seismic
    trace_faults(cube[:32, :32, :64])
    start, wall = time.process_time(), time.perf_counter()
    whole = trace_faults(cube)
    found: dict[str, Any] = {"size": size, "whole_cpu_s": time.process_time() - start}
    found["whole_wall_s"] = time.perf_counter() - wall
    with tempfile.TemporaryDirectory(dir=_scratch()) as folder:
        settings = FaultSettings()
        plan = plan_blocks((size, size, size), parse_memory("2GB"), settings, edge=edge)
        start, wall = time.process_time(), time.perf_counter()
        blocks = trace_in_blocks(cube, plan, settings, folder=Path(folder) / "run", progress=no_progress)
        found |= {"blocks_cpu_s": time.process_time() - start, "blocks_wall_s": time.perf_counter() - wall}
        found |= {"edges": plan.edges, "n_surfaces": [len(whole.surfaces), len(blocks.surfaces)]}
        for name in ("likelihood", "labels", "throw"):
            one, other = np.asarray(getattr(whole, name)), np.asarray(getattr(blocks, name))
            found[f"{name}_same_bits"] = bool(np.array_equal(one, other, equal_nan=name == "throw"))
    return found


def measure_part(part: tuple[int, int], *, memory: str) -> dict[str, Any]:
    """Trace a part of a 20 GB cube, in the blocks that the whole would be traced in, and 256^3 of it in one piece."""
    settings = FaultSettings()
    plan = plan_blocks(LARGE, parse_memory(memory), settings)
    shape = (*part, LARGE[2])
    stages: dict[str, float] = {}
    clock = StageClock(lambda stage, _: stages.__setitem__(stage, _peak_gb()))
    with tempfile.TemporaryDirectory(dir=_scratch()) as folder:
        cube = open_cube(write_zarr(Path(folder) / "cube.zarr", large_cube(shape)), lazy=True)
        start = time.process_time()
        plan = replace(plan, shape=shape)
        faults = trace_in_blocks(cube, plan, settings, folder=Path(folder) / "run", progress=clock)
        n_ridges = _count_ridges(Path(folder) / "run" / "work")
    spent, seconds, n = time.process_time() - start, clock.stop(), int(np.prod(shape))
    whole, peak = float(np.prod(LARGE, dtype=np.float64)), _peak_gb()
    small = np.asarray(large_cube((256, 256, 256)))
    start = time.process_time()
    trace_faults(small)
    one_piece = (time.process_time() - start) / small.size
    return {
        "shape": shape, "memory": memory, "edges": plan.edges, "peak_rss_gb": peak, "peak_by_stage_gb": stages,
        "cpu_us_a_voxel": 1e6 * spent / n, "one_piece_256_cpu_us_a_voxel": 1e6 * one_piece,
        "cpu_over_one_piece": spent / n / one_piece, "wall_us_a_voxel": 1e6 * sum(seconds.values()) / n,
        "wall_s": seconds,
        "n_surfaces": len(faults.surfaces), "share_of_20_gb": n / whole, "strong_ridges": n_ridges,
        "whole_20_gb_cpu_hours": spent / n * whole / 3600.0, "whole_20_gb_strong_ridges": n_ridges / n * whole,
    }  # fmt: skip


def _count_ridges(work: Path) -> int:
    from seismo3d.io.archive import read_archive

    return sum(len(read_archive(part)[0]["score"]) for part in (work / "parts" / "thin").glob("*.npz"))


def measure_kills(times: int, *, size: int) -> dict[str, Any]:
    """Kill a run at random moments, let it go on each time, and compare its end with an undisturbed run's."""
    rng = np.random.default_rng(3)
    with tempfile.TemporaryDirectory(dir=_scratch()) as folder:
        undisturbed, disturbed = Path(folder) / "undisturbed", Path(folder) / "disturbed"
        start = time.perf_counter()
        _child(undisturbed, size).wait()
        alone = time.perf_counter() - start
        # what is finished is not done again: so long it takes to begin
        start = time.perf_counter()
        _child(undisturbed, size).wait()
        begin = time.perf_counter() - start
        n_killed = 0
        while n_killed < times:
            child = _child(disturbed, size)
            try:
                # a run that gets on a little each time is killed at many of its places
                child.wait(timeout=float(rng.uniform(0.7, 1.0)) * begin + float(rng.uniform(0.0, 0.8)) * alone / times)
            except subprocess.TimeoutExpired:
                child.send_signal(signal.SIGKILL)
                child.wait()
                n_killed += 1
            else:
                break
        code = _child(disturbed, size).wait()
        same = {name: _same_files(undisturbed / name, disturbed / name) for name in _VOLUMES}
    return {"size": size, "undisturbed_wall_s": alone, "n_killed": n_killed, "exit_code": code, "same_bytes": same}


_VOLUMES = ("likelihood.zarr", "labels.zarr", "throw.zarr")


def measure_workers(size: int, *, edge: int, rounds: int) -> dict[str, Any]:
    """Trace a cube on one dask worker process and on two, in turns, each on one thread; medians are compared.

    Without dask's sampling of stacks.
    """
    import dask

    settings = FaultSettings()
    walls: dict[int, list[float]] = {1: [], 2: []}
    unsampled = dask.config.set({"distributed.worker.profile.enabled": False})
    with tempfile.TemporaryDirectory(dir=_scratch()) as folder, unsampled:
        cube = open_cube(write_zarr(Path(folder) / "cube.zarr", large_cube((size, size, size))), lazy=True)
        for _ in range(rounds):
            for n_workers, found in walls.items():
                run = Path(folder) / f"run{n_workers}"
                shutil.rmtree(run, ignore_errors=True)
                found.append(_time_workers(n_workers, cube, run, settings, edge))
        same = {n: _same_files(Path(folder) / "run1" / n, Path(folder) / "run2" / n) for n in _VOLUMES}
    speed_up = float(np.median(walls[1]) / np.median(walls[2]))
    return {"size": size, "wall_s_1": walls[1], "wall_s_2": walls[2], "speed_up": speed_up, "same_bytes": same}


def _time_workers(n_workers: int, cube: Any, run: Path, settings: FaultSettings, edge: int) -> float:
    """Return the seconds that tracing takes on so many workers, once they have their kernels."""
    from seismo3d.seismic.blocks.scheduling import OnCluster

    try:
        from distributed import LocalCluster
    except ImportError as error:
        raise MissingDependencyError(
            "workers are measured and dask's distributed is not installed. Install it: pip install 'seismo3d[cluster]'."
        ) from error
    size, memory = cube.shape[0], parse_memory("2GB")
    options = {"n_workers": n_workers, "threads_per_worker": 1, "dashboard_address": None}
    with (
        LocalCluster(processes=True, **options) as local,
        OnCluster(local.scheduler_address) as cluster,
        tempfile.TemporaryDirectory(dir=_scratch()) as folder,
    ):
        warm = plan_blocks((64, 64, size), memory, settings, edge=32)
        small = large_cube((64, 64, size))
        trace_in_blocks(small, warm, settings, folder=Path(folder) / "warm", scheduler=cluster, progress=no_progress)
        plan = plan_blocks((size, size, size), memory, settings, edge=edge)
        wall = time.perf_counter()
        trace_in_blocks(cube, plan, settings, folder=run, scheduler=cluster, progress=no_progress)
        return time.perf_counter() - wall


def _same_files(one: Path, other: Path) -> bool:
    names = sorted(path.relative_to(one) for path in one.rglob("*") if path.is_file())
    return names == sorted(path.relative_to(other) for path in other.rglob("*") if path.is_file()) and all(
        (one / name).read_bytes() == (other / name).read_bytes() for name in names
    )


def _child(folder: Path, size: int) -> subprocess.Popen[bytes]:
    command = [
        sys.executable,
        "-m",
        "seismo3d.experiments.scale",
        "trace",
        "--size",
        str(size),
        "--folder",
        str(folder),
    ]
    return subprocess.Popen(command)  # noqa: S603 - this very module


def _trace(size: int, folder: Path) -> None:
    settings = FaultSettings()
    plan = plan_blocks((size, size, size), parse_memory("2GB"), settings, edge=32)
    trace_in_blocks(np.asarray(large_cube((size, size, size))), plan, settings, folder=folder, progress=no_progress)


def _scratch() -> str | None:
    return os.environ.get("SEISMO3D_SCRATCH")


def _peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser(description="Work in blocks, measured.")
    parser.add_argument("what", choices=("equal", "part", "kills", "workers", "trace"))
    parser.add_argument("--size", type=int, default=256, help="edge of the cube")
    parser.add_argument("--edge", type=int, default=96, help="largest edge of a block")
    parser.add_argument(
        "--part", type=int, nargs=2, default=[384, 160], help="inlines and crosslines of the part of 20 GB"
    )
    parser.add_argument("--memory", default="2GB")
    parser.add_argument("--times", type=int, default=20, help="kills")
    parser.add_argument("--rounds", type=int, default=3, help="turns of one worker and two")
    parser.add_argument("--folder", type=Path, default=Path("scale-run"))
    given = parser.parse_args()
    if given.what == "trace":
        _trace(given.size, given.folder)
        return
    found = {
        "equal": lambda: measure_equal(given.size, edge=given.edge),
        "part": lambda: measure_part((given.part[0], given.part[1]), memory=given.memory),
        "kills": lambda: measure_kills(given.times, size=given.size),
        "workers": lambda: measure_workers(given.size, edge=given.edge, rounds=given.rounds),
    }[given.what]()
    print(to_json(found))


if __name__ == "__main__":
    run_command(main)
