r"""What changed between two terrain scans, and from which size on a change is real.

Elevation maps are subtracted; points are compared along the normals of their surface, in the manner of [2]_. A change
counts where it exceeds the level of detection [1]_, 1.96 standard deviations at 95 %: of both scans' noise, and of the
registration between them.

References
----------
.. [1] S. N. Lane, R. M. Westaway, D. M. Hicks, Earth Surf. Process. Landforms 28, 249-271, 2003.
   :doi:`10.1002/esp.483`
.. [2] D. Lague, N. Brodu, J. Leroux, ISPRS J. Photogramm. 82, 10-26, 2013. :doi:`10.1016/j.isprsjprs.2013.04.009`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.special import ndtri

from seismo3d._typing import ArrayLike, BoolArray, Float64Array
from seismo3d._validate import as_kind, as_number, as_points, as_whole_number, freeze
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.geometry.map_grid import MapGrid, elevation_values, like_map, refuse_apart, refuse_other_systems
from seismo3d.geometry.voxels import downsample_points
from seismo3d.registration.robust import robust_scale
from seismo3d.terrain.alignment import ElevationRegistration
from seismo3d.terrain.fitting import measure_slopes

UNKNOWN = 255
"""What stands for nothing among :attr:`Change.codes`."""
# classes of slope, of as many cells each, in which noise is told; and cells that a class has at least
_SLOPE_CLASSES = 8
_LEAST_CLASS = 50


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """The change of an elevation map.

    Attributes
    ----------
    difference : DataArray or ndarray, float32
        After minus before, on the grid of before; NaN where either is unknown.
    detection : DataArray or ndarray, float32
        Level of detection at each cell, in metres.
    significant : DataArray or ndarray, bool
        Where the difference exceeds it, together with enough neighbours of its sign.
    gained, lost : float
        Volume of the significant change up and down, in cubic metres (cells squared times metres).
    gained_sigma, lost_sigma : float
        Their standard deviations, with errors taken as alike over a correlation length of the difference.
    confidence : float
        Of the level of detection.
    """

    difference: Any
    detection: Any
    significant: Any
    gained: float
    lost: float
    gained_sigma: float
    lost_sigma: float
    confidence: float

    @property
    def codes(self) -> Any:
        """What a file of the significant change holds: 1 where it is, 0 where not, 255, as nodata, where unknown."""
        unknown = np.isnan(np.asarray(self.difference))
        values = np.where(unknown, np.uint8(UNKNOWN), np.asarray(self.significant, np.uint8))
        return like_map(self.difference, values, "significant", nodata=UNKNOWN)


@dataclass(frozen=True, slots=True, eq=False)
class PointChange:
    """The change of a surface of points along its normals.

    Attributes
    ----------
    points, normals : ndarray of shape (n, 3), float64
        Where it is measured, and along what; normals point up.
    distance : ndarray of shape (n,), float64
        After minus before, along the normal; NaN where either has fewer than four points within reach.
    detection : ndarray of shape (n,), float64
        Level of detection.
    significant : ndarray of shape (n,), bool
    """

    points: Float64Array
    normals: Float64Array
    distance: Float64Array
    detection: Float64Array
    significant: BoolArray


def compare(
    before: Any,
    after: Any,
    *,
    registration: ElevationRegistration | None = None,
    sigma_before: float | None = None,
    sigma_after: float | None = None,
    confidence: float = 0.95,
    least_patch: int = 8,
) -> Change:
    """Subtract two elevation maps, with the level from which on a difference is a change.

    Parameters
    ----------
    before, after : DataArray or array_like of shape (rows, columns)
        Maps of one reference system, perhaps of different grids; or bare arrays of the same cells.
    registration : ElevationRegistration, optional
        ``register(before, after)``: carries `after` onto `before` first, and its covariance joins the level of
        detection by the slope at each cell. Without it the maps are taken as they lie.
    sigma_before, sigma_after : float, optional
        Standard deviations of the maps' elevations. Where neither is given, that of the difference is estimated from
        itself, robustly and by classes of slope: it holds where less than half of each class has changed.
    confidence : float
        Of the level of detection.
    least_patch : int
        Fewest cells of one sign, in touch with each other, that count: of cells without change one in twenty exceeds
        the level at 95 % by chance, and alone.

    Returns
    -------
    Change

    Raises
    ------
    GeometryError
        If the reference systems differ, only one map has a georeference, the maps have no common area, or the
        registration is a poor fit.
    ParameterError
        If the confidence is not between 0 and 1, or `least_patch` is no whole number from 1 on.
    """
    level = as_number(confidence, "confidence", low=0.0, high=1.0, strict=True)
    least = as_whole_number(least_patch, "least_patch", low=1)
    if registration is not None:
        as_kind(
            registration, ElevationRegistration, "registration", remedy="Give what register(before, after) returned."
        )
        _refuse_poor_fit(registration)
    here, there = MapGrid.from_elevation(before), MapGrid.from_elevation(after)
    refuse_other_systems(here, there, ("before", "after"))
    z = elevation_values(before, "before")
    elevation_values(after, "after", least=2)
    if registration is None:
        refuse_apart(here, there, ("before", "after"))
    moved = (registration or _as_they_lie()).apply(after, before)
    difference = np.asarray(moved, np.float64) - z
    known = np.isfinite(difference)
    if not known.any():
        raise GeometryError("before and after have no common area with elevations. Check their georeference.")
    slope, carried = _slope_and_registration(z, here, registration)
    noise = _noise(difference, slope, sigma_before, sigma_after)
    quantile = float(ndtri(0.5 + 0.5 * level))
    detection = quantile * np.sqrt(noise**2 + carried)
    with np.errstate(invalid="ignore"):
        risen, fallen = difference > detection, difference < -detection
    significant = _in_patches(risen, least) | _in_patches(fallen, least)
    area = here.cell_m**2
    up, down = significant & (difference > 0), significant & (difference < 0)
    alike = _alike_cells(difference, noise)
    volumes = [(float(area * np.abs(difference[part]).sum()), part) for part in (up, down)]
    # independent noise adds by its squares, over patches of cells that err alike; registration errs as one
    errors = [
        area * float(np.sqrt(alike * (noise[part] ** 2).sum() + np.sqrt(carried[part]).sum() ** 2))
        for part in (up, down)
    ]
    detection = np.where(known, detection, np.nan)
    return Change(
        like_map(before, difference.astype(np.float32), "difference"),
        like_map(before, detection.astype(np.float32), "detection"),
        like_map(before, significant, "significant"),
        volumes[0][0], volumes[1][0], errors[0], errors[1], level,
    )  # fmt: skip


def _refuse_poor_fit(registration: ElevationRegistration) -> None:
    if registration.state == "poor_fit":
        x, y, _ = registration.shift
        raise GeometryError(
            f"the registration of after on before is a poor fit, which moves it by {x:.5g}, {y:.5g}; expected one that "
            "explains the relief. Compare the maps as they lie, without it (--no-align), or register them from matches."
        )


def compare_points(
    before: ArrayLike,
    after: ArrayLike,
    *,
    spacing: float,
    normal_radius: float | None = None,
    cylinder_radius: float | None = None,
    reach: float | None = None,
    registration_sigma: float = 0.0,
    confidence: float = 0.95,
) -> PointChange:
    """Measure the change between two point clouds along the normals of the first.

    At points a spacing apart, the mean position along the normal of each cloud's points within a cylinder is taken;
    their difference is the change, and their scatter its uncertainty.

    Parameters
    ----------
    before, after : array_like of shape (n, 3)
        Points in one frame, in metres.
    spacing : float
        Distance of the places at which change is measured.
    normal_radius : float, optional
        Of the neighbourhood that a normal is fitted to. Default: twice the spacing.
    cylinder_radius : float, optional
        Default: the spacing.
    reach : float, optional
        Half length of the cylinder: larger changes are not seen. Default: four spacings.
    registration_sigma : float
        Standard deviation of the registration between the clouds.
    confidence : float

    Returns
    -------
    PointChange
    """
    first, second = as_points(before, "before", dim=3), as_points(after, "after", dim=3)
    step = as_number(spacing, "spacing", low=0.0, strict=True)
    around = step * 2.0 if normal_radius is None else as_number(normal_radius, "normal_radius", low=0.0, strict=True)
    radius = step if cylinder_radius is None else as_number(cylinder_radius, "cylinder_radius", low=0.0, strict=True)
    length = 4.0 * step if reach is None else as_number(reach, "reach", low=0.0, strict=True)
    shared = as_number(registration_sigma, "registration_sigma", low=0.0)
    quantile = float(ndtri(0.5 + 0.5 * as_number(confidence, "confidence", low=0.0, high=1.0, strict=True)))
    from scipy.spatial import cKDTree

    tree = cKDTree(first)
    core = downsample_points(first, step)[0]
    normals = _normals(first, tree, core, around)
    good = np.isfinite(normals[:, 0])
    core, normals = np.ascontiguousarray(core[good]), np.ascontiguousarray(normals[good])
    if len(core) == 0:
        raise GeometryError(
            f"before has no place with a surface within normal_radius {around:g}; expected denser points."
        )
    mean, square = np.empty((2, len(core))), np.empty((2, len(core)))
    for k, (cloud, made) in enumerate(((first, tree), (second, cKDTree(second)))):
        mean[k], square[k] = _in_cylinders(cloud, made, core, normals, radius, length)
    distance = mean[1] - mean[0]
    if not np.isfinite(distance).any():
        raise GeometryError("before and after have no common area within reach. Register them first.")
    detection = quantile * (np.sqrt(square.sum(axis=0)) + shared)
    significant = np.abs(distance) > detection
    return PointChange(*(freeze(a) for a in (core, normals, distance, detection, significant)))


def _in_patches(chosen: BoolArray, least: int) -> BoolArray:
    """Keep what holds together in patches of at least so many cells."""
    parts, n = ndimage.label(chosen, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel(), minlength=n + 1)
    sizes[0] = 0
    return np.asarray(sizes[parts] >= least)


def _as_they_lie() -> ElevationRegistration:
    nothing = np.zeros((8, 8))
    return ElevationRegistration(
        np.eye(4), np.zeros(3), 0.0, 1.0, np.zeros(2), 1.0, nothing, np.nan, np.nan, np.nan, "converged", "local",
        "translation", "offset",
    )  # fmt: skip


def _slope_and_registration(
    z: Float64Array, grid: MapGrid, registration: ElevationRegistration | None
) -> tuple[Float64Array, Float64Array]:
    """Return the slope's size, and the variance of elevation that the registration's covariance makes, at each cell."""
    gx, gy = (np.nan_to_num(part) for part in measure_slopes(z, grid.steps_m))
    slope = np.hypot(gx, gy)
    if registration is None:
        return slope, np.zeros_like(z)
    rows, columns = np.indices(z.shape)
    centre = 0.5 * (np.array(grid.shape[::-1]) - 1.0)
    du, dv = columns - centre[0], rows - centre[1]
    step = grid.steps_m
    x, y = step[0, 0] * du + step[0, 1] * dv, step[1, 0] * du + step[1, 1] * dv
    middle = float(np.nanmedian(z))
    one = np.ones_like(z)
    parts = (-gx, -gy, gx * y - gy * x, -(gx * x + gy * y), one, x, y, np.nan_to_num(z - middle))
    C = registration.covariance
    total = np.zeros_like(z)
    for a, first in enumerate(parts):
        for b, second in enumerate(parts):
            if C[a, b] != 0.0:
                total += C[a, b] * first * second
    return slope, np.maximum(total, 0.0)


def _noise(
    difference: Float64Array, slope: Float64Array, sigma_before: float | None, sigma_after: float | None
) -> Float64Array:
    """Return the standard deviation of the difference at each cell."""
    if sigma_before is not None or sigma_after is not None:
        if sigma_before is None or sigma_after is None:
            raise ParameterError("one of sigma_before and sigma_after is given; expected both or neither.")
        first = as_number(sigma_before, "sigma_before", low=0.0)
        second = as_number(sigma_after, "sigma_after", low=0.0)
        return np.full(difference.shape, float(np.hypot(first, second)))
    known = np.isfinite(difference)
    values, steep = difference[known], slope[known]
    edges = np.unique(np.quantile(steep, np.linspace(0.0, 1.0, _SLOPE_CLASSES + 1)))
    number = np.clip(np.searchsorted(edges, steep, side="right") - 1, 0, max(len(edges) - 2, 0))
    places, sigmas = [], []
    for k in range(max(len(edges) - 1, 1)):
        part = values[number == k]
        if len(part) >= _LEAST_CLASS:
            sigmas.append(robust_scale(part - np.median(part)))
            places.append(float(np.median(steep[number == k])))
    if not sigmas:
        sigmas, places = [float(values.std())], [0.0]
    return np.asarray(np.interp(slope, places, sigmas))


def _alike_cells(difference: Float64Array, noise: Float64Array) -> float:
    """Return how many cells err alike: the sum of the autocorrelation of the clipped difference, at least 1."""
    known = np.isfinite(difference)
    scale = np.maximum(noise, 1e-12)
    unit = np.where(known, np.clip((np.where(known, difference, 0.0)) / scale, -1.96, 1.96), 0.0)
    total = 1.0
    variance = max(float((unit[known] ** 2).mean()), 1e-12)
    for axis in (0, 1):
        length = 1.0
        for lag in range(1, min(33, unit.shape[axis])):
            a = np.take(unit, range(unit.shape[axis] - lag), axis)
            b = np.take(unit, range(lag, unit.shape[axis]), axis)
            both = np.take(known, range(known.shape[axis] - lag), axis) & np.take(
                known, range(lag, known.shape[axis]), axis
            )
            if not both.any():
                break
            r = float((a * b)[both].mean()) / variance
            if r < 0.05:
                break
            length += 2.0 * r
        total *= length
    return total


def _normals(points: Float64Array, tree: Any, core: Float64Array, radius: float) -> Float64Array:
    out = np.full(core.shape, np.nan)
    for row, near in enumerate(tree.query_ball_point(core, radius)):
        if len(near) >= 6:
            part = points[near] - points[near].mean(axis=0)
            normal = np.linalg.eigh(part.T @ part)[1][:, 0]
            out[row] = normal if normal[2] >= 0 else -normal
    return out


def _in_cylinders(
    points: Float64Array, tree: Any, core: Float64Array, normals: Float64Array, radius: float, reach: float
) -> tuple[Float64Array, Float64Array]:
    """Return the mean place along the normal of the points in each cylinder, and its squared standard error."""
    mean, square = np.full(len(core), np.nan), np.full(len(core), np.nan)
    beyond = float(np.hypot(radius, reach))
    for start in range(0, len(core), 1024):
        part = slice(start, start + 1024)
        for row, near in enumerate(tree.query_ball_point(core[part], beyond), start=start):
            offset = points[near] - core[row]
            along = offset @ normals[row]
            aside = np.linalg.norm(offset - along[:, None] * normals[row], axis=1)
            held = along[(aside <= radius) & (np.abs(along) <= reach)]
            if len(held) >= 4:
                mean[row], square[row] = held.mean(), held.var(ddof=1) / len(held)
    return mean, square
