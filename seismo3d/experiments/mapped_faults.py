r"""Lines found on a map against the faults that geologists mapped there, and what chance gives.

What chance means was chosen for the reasons given here, before the outcome was seen, and all that was asked is printed:

- *Place*: the share of the lines' length within 500 m of a mapped fault (they are mapped at 1:100,000 to 1:1,000,000).
  Chance: the faults' map rolled by any amount and mirrored, so that their length, strikes and spacing stay.
- *Strike*: the common area of both length-weighted strike distributions in bins of 10 degrees, smoothed by one bin.
  Chance: every line keeps its length and takes the strike of a crest of the line scan drawn from the whole map. A line,
  not the map, is the unit: lines lie kilometres apart and were found each by itself. Strikes are drawn from the scan's
  own crests, not evenly, because drainage makes terrain anisotropic, and lines that merely followed it must not count
  as agreement. The mapped faults' own crests are among those drawn from, which makes the test harder, not easier.
- *Strike beside faults*: the mean of :math:`\cos 2 \Delta` over the lines' length within 3 km of a mapped fault, where
  :math:`\Delta` is the angle between the line and that fault, there. Mapped faults bend: a line is judged by the fault
  that it lies at, and angles have no bins. Chance: strikes drawn as above. Lines far from all faults say nothing here,
  so that it is a test of fewer lines.
- *Strike, lines turned as a whole*: the same common area, against all turns of the faults by whole degrees. With two
  distributions of one peak each this only asks how near the peaks lie, so that it can tell little: p is hardly ever
  below a tenth. It is given beside.

With few long lines all of these are coarse: they tell chance from agreement, not good agreement from better.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.geometry.map_grid import MapGrid, elevation_values
from seismo3d.plot.terrain_maps import stretch_ends, strikes_by_length
from seismo3d.terrain.evidence import measure_levels, square_map
from seismo3d.terrain.lineament_search import LineamentSet, LineamentSettings
from seismo3d.terrain.support import scan_lines

NEAR_M = 500.0
"""Distance from a mapped fault within which a line counts as on it."""
_BIN_DEG = 10.0
_BESIDE_M = 3000.0
"""Distance within which a line's strike is compared with a mapped fault's own."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """A statistic, what chance gives, and the share of chance that is at least as good.

    Attributes
    ----------
    value, by_chance, p : float
    """

    value: float
    by_chance: float
    p: float


def read_faults(path: Path, grid: MapGrid) -> list[Float64Array]:
    """Return mapped faults from GeoJSON lines in longitude and latitude, as points (x, y) on the map, a cell apart.

    Only what lies on the map is kept.
    """
    from rasterio.warp import transform

    low, high = np.sort(grid.to_map([[0.0, 0.0], [grid.shape[1] - 1.0, grid.shape[0] - 1.0]]), axis=0)
    faults = []
    for feature in json.loads(path.read_text())["features"]:
        lon, lat = np.array(feature["geometry"]["coordinates"]).T[:2]
        points = _dense(np.column_stack(transform("OGC:CRS84", grid.crs, lon.tolist(), lat.tolist())), grid.cell_m)
        inside = ((points >= low) & (points <= high)).all(axis=1)
        if inside.sum() > 1:
            faults.append(points[inside])
    return faults


def compare_places(
    found: LineamentSet, faults: list[Float64Array], *, draws: int, rng: np.random.Generator
) -> Agreement:
    """Return the share of the lines' length near mapped faults, against the faults' map rolled and mirrored."""
    near = _near_faults(found.grid, faults)
    places = np.rint(np.concatenate([line.places for line in found.lines])).astype(np.int64)
    value = float(near[places[:, 1], places[:, 0]].mean())
    chance = np.empty(draws)
    for n in range(draws):
        flip = rng.integers(2, size=2)
        other = near[:: 1 - 2 * flip[0], :: 1 - 2 * flip[1]]
        down, right = rng.integers(near.shape)
        chance[n] = other[(places[:, 1] + down) % near.shape[0], (places[:, 0] + right) % near.shape[1]].mean()
    return _agreement(value, chance)


def compare_strikes(
    elevation: Any, found: LineamentSet, faults: list[Float64Array], *, draws: int, rng: np.random.Generator
) -> tuple[Agreement, Agreement, Agreement]:
    """Return how well strikes agree: distributions and beside faults, against the terrain's own; and a common turn."""
    strike, length, owner = _segments(found)
    mapped = _fault_strikes(faults)
    value = _common_area((strike, length), mapped)
    texture = _crest_strikes(elevation, found.grid)
    means = np.array([line.strike_deg for line in found.lines])
    beside = _strikes_beside(found, faults)
    chance, chance_beside = np.empty(draws), np.empty(draws)
    for n in range(draws):
        # a line keeps its bends
        turned = strike + (rng.choice(texture, len(means)) - means)[owner]
        chance[n] = _common_area((turned, length), mapped)
        chance_beside[n] = _mean_cosine(turned, beside, length)
    whole = np.array([_common_area((strike + turn, length), mapped) for turn in range(1, 180)])
    return (
        _agreement(value, chance),
        _agreement(_mean_cosine(strike, beside, length), chance_beside),
        _agreement(value, whole),
    )


def _agreement(value: float, chance: Float64Array) -> Agreement:
    if not np.isfinite(value):
        return Agreement(value, float("nan"), float("nan"))
    return Agreement(value, float(chance.mean()), float((1 + np.sum(chance >= value)) / (1 + len(chance))))


def _dense(points: Float64Array, step: float) -> Float64Array:
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.arange(0.0, arc[-1], step)
    return np.column_stack([np.interp(at, arc, points[:, k]) for k in (0, 1)])


def _near_faults(grid: MapGrid, faults: list[Float64Array]) -> BoolArray:
    marks = np.ones(grid.shape, bool)
    places = np.rint(grid.to_places(np.concatenate(faults))).astype(np.int64)
    marks[places[:, 1], places[:, 0]] = False
    return np.asarray(ndimage.distance_transform_edt(marks) * grid.cell_m <= NEAR_M)


def _segments(found: LineamentSet) -> tuple[Float64Array, Float64Array, Any]:
    """Return strike, length and line of every segment of the lines."""
    parts = [strikes_by_length(LineamentSet((line,), None, found.grid)) for line in found.lines]
    owner = np.repeat(np.arange(len(parts)), [len(strike) for strike, _ in parts])
    strike, length = (np.concatenate(values) for values in zip(*parts, strict=True))
    return strike, length, owner


def _fault_strikes(faults: list[Float64Array]) -> tuple[Float64Array, Float64Array]:
    way = np.concatenate([np.diff(fault, axis=0) for fault in faults])
    return np.degrees(np.arctan2(way[:, 0], way[:, 1])) % 180.0, np.linalg.norm(way, axis=1)


def _strikes_beside(found: LineamentSet, faults: list[Float64Array]) -> Float64Array:
    """Return the strike of the nearest mapped fault for every segment of the lines; NaN where none is near."""
    unit = np.array(found.grid.metres_per_unit)
    parts = [stretch_ends(line) * unit for line in found.lines]
    middles = np.concatenate([0.5 * (part[1:] + part[:-1]) for part in parts])
    metres = [fault * unit for fault in faults]
    ways = np.concatenate([np.diff(fault, axis=0) for fault in metres])
    distance, nearest = cKDTree(np.concatenate([0.5 * (one[1:] + one[:-1]) for one in metres])).query(middles)
    strike = np.degrees(np.arctan2(*ways[nearest].T)) % 180.0
    return np.where(distance <= _BESIDE_M, strike, np.nan)


def _mean_cosine(strike: Float64Array, other: Float64Array, length: Float64Array) -> float:
    """Return the mean cosine of twice the angle between strikes, by length; NaN where none are known."""
    near = np.isfinite(other)
    if not near.any():
        return float("nan")
    return float(np.average(np.cos(np.radians(2.0 * (strike - other)[near])), weights=length[near]))


def _crest_strikes(elevation: Any, grid: MapGrid) -> Float64Array:
    """Return the strikes of the line scan wherever it sees enough for a crest, on all levels."""
    settings = LineamentSettings()
    steps = tuple(float(np.hypot(*column)) for column in grid.steps_m.T)
    square, _ = square_map(elevation_values(elevation), (steps[0], steps[1]))
    out = []
    for evidence in measure_levels(square, max(settings.n_levels, settings.n_valley_levels), 2.0 * settings.length):
        for support in scan_lines(evidence, length=settings.length, n_strikes=settings.n_strikes, floor=settings.floor):
            seen = (support.score >= settings.least_score) & (support.contrast >= settings.least_contrast)
            ny, nx = support.normals[support.orientation[seen]].T
            # the line runs across its normal; rows run south
            out.append(np.degrees(np.arctan2(ny, nx)) % 180.0)
    return np.concatenate(out)


def _common_area(one: tuple[Float64Array, Float64Array], other: tuple[Float64Array, Float64Array]) -> float:
    """Return the common area of two distributions of strike, each (strike in degrees, weight): 0 to 1."""
    both = []
    for strike, weight in (one, other):
        counts = np.histogram(strike % 180.0, bins=round(180.0 / _BIN_DEG), range=(0.0, 180.0), weights=weight)[0]
        both.append(ndimage.gaussian_filter1d(counts / counts.sum(), 1.0, mode="wrap"))
    return float(np.minimum(*both).sum())
