"""Scarps: how high and how steep the step across each lineament is, place by place along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._settings import as_settings
from seismo3d._typing import Float64Array
from seismo3d._validate import as_kind, as_number, freeze
from seismo3d.geometry.bearings import bearing_deg
from seismo3d.geometry.map_grid import MapGrid, elevation_values
from seismo3d.terrain.diffusion import WornStep, fit_form, fit_worn_step
from seismo3d.terrain.evidence import fill_smoothly
from seismo3d.terrain.lineament_search import Lineament, LineamentSet, LineamentSettings, lineaments

_REACHES = (24, 34, 48, 68, 96)
"""Lengths of a profile on each side, in cells, that are tried until it reaches both far fields."""
_FAR = 2.4
"""Length of a profile over the width of its worn step, at which both sides are level with their far fields."""
_MOST_MISFIT = 0.5
"""Largest misfit of a worn step: beyond it the profile is of another form."""
_ASIDE = 6.0
"""Cells that a step's middle may lie from the lineament."""
_FLANK = 0.15
"""Share of the steepest slope, above that of the flanks, at which a scarp ends and its flanks begin."""
_LEAST_HEIGHT = 2.0
"""Height, in its own standard deviations, that a scarp has at least."""
_LEAST_SHARE = 0.35
"""Height over the relief of the mean profile, about its flanks' slope, that a scarp has at least: across a valley or
ridge it is small."""


@dataclass(frozen=True, slots=True, eq=False)
class Scarp:
    """A step in the terrain along a lineament.

    Attributes
    ----------
    lineament : Lineament
    distance : ndarray of shape (n,), float64
        Along the lineament, in metres (cells).
    height : ndarray of shape (n,), float64
        Vertical separation of the surfaces on both sides at each place, in metres, positive; NaN where it is not known.
    slope_deg : ndarray of shape (n,), float64
        Steepest slope down the scarp at each place.
    offset : ndarray of shape (m,), float64
        Across the lineament, in metres, growing towards the lower side.
    profile, slope_profile_deg : ndarray of shape (m,), float64
        Mean elevation and slope across, in metres and degrees; the elevation about its mean.
    height_m, height_sigma : float
        Of the mean profile, and its standard deviation along the lineament's independent stretches.
    width : float
        From the foot to the top of the mean profile, in metres: where it is a seventh as steep as at its steepest.
    morphologic_age : float
        Diffusivity of soil times age, in square metres (cells): of the step of an error function that the mean profile
        is; NaN where it is not.
    facing_deg : float
        Azimuth towards the lower side.
    """

    lineament: Lineament
    distance: Float64Array
    height: Float64Array
    slope_deg: Float64Array
    offset: Float64Array
    profile: Float64Array
    slope_profile_deg: Float64Array
    height_m: float
    height_sigma: float
    width: float
    morphologic_age: float
    facing_deg: float


def scarps(
    elevation: Any,
    found: LineamentSet | None = None,
    *,
    half_width: float | None = None,
    settings: LineamentSettings | None = None,
) -> tuple[Scarp, ...]:
    """Measure the scarps among a map's lineaments: height, steepest slope and profile across each.

    Profiles are taken across the lineament and averaged over a window along it. The mean profile is fitted by a step
    that soil's creep has worn [1]_, on longer and longer profiles until they reach the far fields on both sides of a
    step as wide as this one; the far fields' separation is the height. Where the mean profile is no such step, as on a
    valley's side, the scarp is where it is steeper than its flanks; one slope is fitted to both flanks, and their
    separation is the height.

    Parameters
    ----------
    elevation : DataArray or array_like of shape (rows, columns)
    found : LineamentSet, optional
        Of this map; found by :func:`lineaments` where not given.
    half_width : float, optional
        Length of a profile on each side, in metres (cells). Default: 24 cells, and up to 96 for wide scarps.
    settings : LineamentSettings, optional

    Returns
    -------
    tuple of Scarp
        Highest first. Lineaments without a step that stands out from its scatter are left out.

    References
    ----------
    .. [1] T. C. Hanks et al., J. Geophys. Res. 89(B7), 5771-5790, 1984. :doi:`10.1029/JB089iB07p05771`
    """
    z = elevation_values(elevation)
    grid = MapGrid.from_elevation(elevation)
    settings = as_settings(settings, LineamentSettings)
    found = lineaments(elevation, settings=settings) if found is None else found
    as_kind(found, LineamentSet, "found", remedy="Give what lineaments returned, or leave it out.")
    reaches = [n * grid.cell_m for n in _REACHES]
    if half_width is not None:
        reaches = [as_number(half_width, "half_width", low=0.0, strict=True)]
    filled = np.where(np.isfinite(z), z, np.nan)
    if not np.isfinite(z).all():
        near = ndimage.binary_dilation(np.isfinite(z), iterations=2)
        filled = np.where(near, fill_smoothly(z, np.isfinite(z)), np.nan)
    made = [_measure(filled, grid, line, reaches, settings.length * grid.cell_m) for line in found.lines]
    return tuple(sorted((scarp for scarp in made if scarp is not None), key=lambda scarp: -scarp.height_m))


def _measure(z: Float64Array, grid: MapGrid, line: Lineament, reaches: list[float], window: float) -> Scarp | None:
    taken = _take_profiles(z, grid, line, reaches)
    if taken is None:
        return None
    distance, offset, profiles, normal, worn = taken
    mean = _mean_profile(profiles)
    low, high, form = _form(offset, mean, worn)
    flank, step, _ = fit_form(offset, mean, form)
    if step > 0.0:
        # the offset grows towards the lower side
        profiles, mean, normal, form, low, high = profiles[:, ::-1], mean[::-1], -normal, -form[::-1], -high, -low
        flank, step, _ = fit_form(offset, mean, form)
    smooth = _along(profiles, window / (distance[1] - distance[0]))
    heights = np.array([-fit_form(offset, row, form)[1] for row in smooth])
    known = heights[np.isfinite(heights)]
    if len(known) == 0:
        return None
    height, sigma = -step, float(known.std() / np.sqrt(max(line.length / (2.0 * window), 1.0)))
    # at the mean profile's own roughness a step is nothing
    if height <= _LEAST_HEIGHT * sigma or height < _LEAST_SHARE * float(np.ptp(mean - flank * offset)):
        return None
    slopes = np.degrees(np.arctan(-np.gradient(smooth, offset, axis=1)[:, (offset >= low) & (offset <= high)]))
    steepest = np.full(len(slopes), np.nan)
    full = np.isfinite(slopes).all(axis=1)
    steepest[full] = slopes[full].max(axis=1)
    north = normal[:, 1].mean() if grid.has_place else -normal[:, 1].mean()
    return Scarp(
        line, freeze(distance), freeze(heights), freeze(steepest), freeze(offset), freeze(mean.copy()),
        freeze(np.degrees(np.arctan(-np.gradient(mean, offset)))), float(height), sigma, float(high - low),
        float("nan") if worn is None else 0.25 * worn.width**2,
        float(bearing_deg(normal[:, 0].mean(), north)),
    )  # fmt: skip


def _take_profiles(
    z: Float64Array, grid: MapGrid, line: Lineament, reaches: list[float]
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array, WornStep | None] | None:
    """Return the shortest profiles that reach both far fields of their worn step; without one the first, or None."""
    first = None
    for reach in reaches:
        distance, offset, profiles, normal = _profiles(z, grid, line, reach)
        if np.isfinite(profiles).mean() < 0.3:
            break
        mean = _mean_profile(profiles)
        if not np.isfinite(mean).all():
            break
        worn = fit_worn_step(offset, mean, aside=min(_ASIDE * grid.cell_m, 0.25 * offset[-1]))
        if worn.misfit <= _MOST_MISFIT and offset[-1] >= _FAR * worn.width:
            return distance, offset, profiles, normal, worn
        first = first or (distance, offset, profiles, normal, None)
    return first


def _mean_profile(profiles: Float64Array) -> Float64Array:
    """Return the mean over what is known of each profile about its own mean."""
    weight = np.isfinite(profiles)
    known = np.where(weight, profiles, 0.0)
    levelled = known - weight * (known.sum(axis=1) / np.maximum(weight.sum(axis=1), 1))[:, None]
    with np.errstate(invalid="ignore"):
        return np.asarray(levelled.sum(axis=0) / weight.sum(axis=0))


def _form(offset: Float64Array, mean: Float64Array, worn: WornStep | None) -> tuple[float, float, Float64Array]:
    """Return where a profile's step begins and ends, and a step of height one; NaN where it is not told."""
    if worn is None:
        low, high = _limits(offset, mean)
        return low, high, np.where(offset <= low, -0.5, np.where(offset >= high, 0.5, np.nan))
    half = worn.width * np.sqrt(-np.log(_FLANK))
    return worn.middle - half, worn.middle + half, worn.form(offset)


def _profiles(
    z: Float64Array, grid: MapGrid, line: Lineament, reach: float
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return distances along, offsets across, elevations (along, across) and unit normals in metres (x, y)."""
    metres = np.array(grid.metres_per_unit)
    points = line.points * metres
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    step = grid.cell_m
    distance = np.arange(0.5 * step, arc[-1], step)
    places = np.column_stack([np.interp(distance, arc, points[:, k]) for k in (0, 1)])
    smooth = np.column_stack([ndimage.gaussian_filter1d(places[:, k], 6.0, mode="nearest") for k in (0, 1)])
    way = np.gradient(smooth, axis=0)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
    normal = np.column_stack([-way[:, 1], way[:, 0]])
    n = max(int(reach / step), 4)
    offset = np.arange(-n, n + 1) * step
    across = places[:, None, :] + offset[None, :, None] * normal[:, None, :]
    at = grid.to_places(across.reshape(-1, 2) / metres)
    rows, columns = z.shape
    inside = (at[:, 0] >= 0) & (at[:, 1] >= 0) & (at[:, 0] <= columns - 1) & (at[:, 1] <= rows - 1)
    values = ndimage.map_coordinates(z, at[:, ::-1].T, order=1, mode="nearest")
    known = np.where(inside, values, np.nan).reshape(across.shape[:2])
    return np.asarray(distance), np.asarray(offset, np.float64), known, np.asarray(normal)


def _limits(offset: Float64Array, mean: Float64Array) -> tuple[float, float]:
    """Return where a profile's step begins and ends: where it is hardly steeper than its flanks."""
    slope = ndimage.gaussian_filter1d(np.gradient(mean, offset), 1.0)
    n = len(slope)
    flanks = float(np.median(np.concatenate([slope[: n // 4], slope[-(n // 4) :]])))
    rest = slope - flanks
    # the step lies near the lineament, which is known to a few cells
    inner = np.abs(offset) <= 0.5 * offset[-1]
    peak = int(np.flatnonzero(inner)[np.argmax(np.abs(rest[inner]))])
    strong = rest * np.sign(rest[peak]) > _FLANK * abs(rest[peak])
    first, last = peak, peak
    while first > 0 and strong[first - 1]:
        first -= 1
    while last < n - 1 and strong[last + 1]:
        last += 1
    # a quarter of the profile on each side is left for the flanks
    return float(max(offset[first - 1 if first else 0], offset[n // 8])), float(
        min(offset[last + 1 if last < n - 1 else n - 1], offset[n - 1 - n // 8])
    )


def _along(profiles: Float64Array, window: float) -> Float64Array:
    """Average profiles along the lineament over what is known."""
    known = np.isfinite(profiles)
    sigma = 0.5 * window
    weight = ndimage.gaussian_filter1d(known.astype(np.float64), sigma, axis=0, mode="constant")
    total = ndimage.gaussian_filter1d(np.where(known, profiles, 0.0), sigma, axis=0, mode="constant")
    return np.where(weight > 0.05, total / np.maximum(weight, 1e-9), np.nan)
