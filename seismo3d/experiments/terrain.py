"""All measurements of the terrain side, for anyone to run: ``python -m seismo3d.experiments.terrain --terrain FOLDER``.

Parts: ``shift`` (a map shifted by a known amount, against Nuth and Kaab's method), ``trials`` (random shifts with tilt,
noise and holes), ``srtm`` (a pair with a known shift), ``points`` (laser scans of other density and scale),
``lineaments`` (maps with known faults), ``scarps`` (made-up scarps of many kinds), ``valleys`` (worn mountains with a
fault in them), ``nothing`` (terrain without faults) and ``refusals`` (what cannot be done, and what is said).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.errors import Seismo3dError
from seismo3d.experiments._command import run_command
from seismo3d.experiments.terrain_lines import report_lineaments, report_nothing, report_scarps, report_valleys
from seismo3d.io.elevation import make_elevation, read_elevation
from seismo3d.terrain import compare, lineaments, register

PARTS = ("shift", "trials", "srtm", "points", "lineaments", "scarps", "valleys", "nothing", "refusals")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts that are asked for and print their figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="parts to run; all by default")
    parser.add_argument("--terrain", type=Path, required=True, help="folder with the maps")
    parser.add_argument("--trials", type=int, default=100, help="random trials")
    parser.add_argument("--seeds", type=int, default=5, help="made-up maps of each kind")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of the maps with their lines")
    given = parser.parse_args(arguments)
    parts = given.parts or PARTS
    runs: dict[str, Any] = {
        "shift": lambda: report_shift(given.terrain),
        "trials": lambda: report_trials(given.terrain, given.trials),
        "srtm": lambda: report_srtm(given.terrain),
        "points": lambda: report_points(given.terrain),
        "lineaments": lambda: report_lineaments(given.terrain, given.pictures),
        "scarps": lambda: report_scarps(given.seeds),
        "valleys": lambda: report_valleys(given.seeds),
        "nothing": lambda: report_nothing(given.seeds),
        "refusals": lambda: report_refusals(given.terrain),
    }
    for part in parts:
        runs[part]()


def moved(z: Float64Array, columns: float, rows: float) -> Float64Array:
    """Return a map whose content lies so many columns to the right and rows down; NaN where it came from off it."""
    i, j = np.indices(z.shape, dtype=np.float64)
    known = np.isfinite(z)
    values = ndimage.map_coordinates(np.where(known, z, 0.0), [i - rows, j - columns], order=1, mode="nearest")
    weight = ndimage.map_coordinates(known.astype(float), [i - rows, j - columns], order=1, mode="constant", cval=0.0)
    return np.where(weight > 0.999, values / np.maximum(weight, 1e-9), np.nan)


def report_shift(folder: Path) -> None:
    """Print the error and time for a shift of (+37, -52) m, +4 m, noise of 1 m; beside xdem's where it is installed."""
    target = read_elevation(folder / "topotoolbox" / "bigtujunga.tif")
    noise = np.random.default_rng(0).normal(0.0, 1.0, target.shape)
    source = target.copy(data=(moved(np.asarray(target, float), 37.0 / 30.0, 52.0 / 30.0) + 4.0 + noise).astype("f4"))
    register(target[:100, :100], source[:100, :100])  # compiled before the clock starts
    start = time.perf_counter()
    found = register(target, source)
    seconds = time.perf_counter() - start
    error = found.shift - np.array([-37.0, 52.0, -4.0])
    print(
        f"shift: error {error[0]:+.4f} {error[1]:+.4f} {error[2]:+.4f} m, NMAD {found.nmad_after:.3f}, {seconds:.2f} s"
    )
    try:
        import rasterio
        import xdem
    except ImportError:
        print("shift: xdem is not installed")
        return
    crs = rasterio.crs.CRS.from_string(target.attrs["crs"])
    transform = rasterio.Affine(*target.attrs["transform"])
    maps = [xdem.DEM.from_array(np.asarray(m, "f4"), transform, crs, nodata=-9999.0) for m in (target, source)]
    start = time.perf_counter()
    fitted = xdem.coreg.NuthKaab()
    fitted.fit(*maps, random_state=0)
    seconds = time.perf_counter() - start
    x, y, z = (fitted.meta["outputs"]["affine"][f"shift_{axis}"] for axis in "xyz")
    print(f"shift: xdem {xdem.__version__} error {x + 37:+.4f} {y - 52:+.4f} {z + 4:+.4f} m, {seconds:.2f} s")


def report_trials(folder: Path, n: int) -> None:
    """Print errors over random shifts of up to 40 cells with tilt, noise of 1 m and 30 % of the cells missing."""
    z = np.asarray(read_elevation(folder / "topotoolbox" / "bigtujunga.tif"), float)
    rng = np.random.default_rng(7)
    errors, seconds = [], []
    for trial in range(n):
        reach = 1.0 if trial % 2 else 40.0
        columns, rows = rng.uniform(-reach, reach, 2)
        tilt = rng.uniform(-0.002, 0.002, 2)
        i, j = np.indices(z.shape)
        source = moved(z, columns, rows) + 30.0 * (tilt[0] * j + tilt[1] * i) + rng.normal(0.0, 1.0, z.shape)
        target = z.copy()
        for one in (target, source):
            one[rng.random(z.shape) < 0.3] = np.nan
        start = time.perf_counter()
        found = register(target, source, vertical="tilt")
        seconds.append(time.perf_counter() - start)
        # bare arrays are in cells; rows run down
        errors.append(float(np.hypot(found.shift[0] + columns, found.shift[1] + rows)))
    share = np.mean(np.array(errors) <= 0.02)
    print(
        f"trials: {n}, horizontal error at most 0.02 cells in {100 * share:.0f} %; median {np.median(errors):.5f}, "
        f"95 % {np.percentile(errors, 95):.5f}, largest {max(errors):.5f} cells; {np.median(seconds):.2f} s each"
    )


def report_srtm(folder: Path) -> None:
    """Print the shift found between the SRTM pair, in pixels; the truth is 3 and 5."""
    reference = read_elevation(folder / "demcompare" / "srtm_ref.tif")
    shifted = read_elevation(folder / "demcompare" / "srtm_blurred_and_shifted.tif")
    start = time.perf_counter()
    found = register(reference, shifted)
    seconds = time.perf_counter() - start
    # T carries degrees; a pixel is three seconds of arc
    x, y = 1200.0 * found.T_target_source[:2, 3]
    print(f"srtm: {x:+.4f} {y:+.4f} pixels, error {x - 3:+.4f} {y + 5:+.4f}, {seconds:.2f} s")


def report_points(folder: Path) -> None:
    """Print how well a laser scan of a tenth of the points, and of 1.5 times the size, is registered."""
    from seismo3d.io.points import read_points
    from seismo3d.registration.register import register as register_scans

    rng = np.random.default_rng(0)
    angle = np.radians(5.0)
    R = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    t = np.array([8.0, -5.0, 3.0])
    for name in ("samp11-utm", "samp53-utm", "FSite8_red2-utm"):
        points = read_points(folder / "pcl_isprs" / f"{name}.pcd").points
        points = points - np.median(points, axis=0)
        thin = points[rng.permutation(len(points))[: len(points) // 10]]
        for scale in (1.0, 1.5, 1 / 1.5):
            truth = np.eye(4)
            truth[:3, :3], truth[:3, 3] = scale * R, t
            model = "rigid" if scale == 1.0 else "similarity"
            found = register_scans(points, ((thin - t) @ R) / scale, model=model)
            miss = thin @ (found.T_target_source @ np.linalg.inv(truth))[:3, :3].T - thin
            miss += (found.T_target_source @ np.linalg.inv(truth))[:3, 3]
            print(
                f"points: {name}, 1:10, {scale:.3f} times, {found.state}: scale off by "
                f"{float(found.scale[0]) / scale - 1.0:+.5f}, points by {np.median(np.linalg.norm(miss, axis=1)):.3f} m"
            )


def report_refusals(folder: Path) -> None:
    """Print what is said of maps that cannot be aligned, compared or searched."""
    target = read_elevation(folder / "topotoolbox" / "bigtujunga.tif")[:200, :200]
    z = np.asarray(target, np.float32)
    cells = target.attrs["transform"]
    far = (cells[0], cells[1], cells[2] + 1e6, *cells[3:])
    others = {
        "different projections": make_elevation(z, cells, crs="EPSG:32612"),
        "no georeference": z,
        "all nodata": target.copy(data=np.full(target.shape, np.nan, np.float32)),
        "no overlap": make_elevation(z, far, crs=target.attrs["crs"]),
    }
    for name, other in others.items():
        print(f"refusals: register, {name}: {_said(register, target, other)}")
        print(f"refusals: compare, {name}: {_said(compare, target, other)}")
    print(f"refusals: lineaments, all nodata: {_said(lineaments, others['all nodata'])}", flush=True)


def _said(work: Any, *maps: Any) -> str:
    try:
        work(*maps)
    except Seismo3dError as error:
        return f"{type(error).__name__}: {error}"
    return "nothing"


if __name__ == "__main__":
    run_command(main)
