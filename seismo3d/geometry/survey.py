"""Where a cube lies: fractional indices, line numbers, and coordinates on the map.

Frame and sign conventions, here once:

- Index space is ``(inline, crossline, sample)``, fractional and zero-based; a section's is ``(trace, sample)``.
- The *inline axis* is axis 0: the direction in which the inline *number* grows. (An inline itself, the line that a boat
  shoots, runs along the crossline axis.)
- Map coordinates are ``(x, y)`` = (east, north) in metres or, where the survey is in feet, in feet, as in ``cdp_x`` and
  ``cdp_y``; z is the sample coordinate in ms, m or ft, positive downwards.
- Azimuths are in degrees, clockwise from north; without map coordinates they are counted from the inline axis towards
  the crossline axis. Surveys may be rotated, sheared and of either handedness: all goes through one 2 x 2 matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import as_points
from seismo3d.errors import GeometryError
from seismo3d.geometry.axis import Axis, depth_scale, length_unit_of, unit_of
from seismo3d.geometry.bearings import bearing_deg, wrap_deg
from seismo3d.geometry.map_fit import MapFit, fit_map
from seismo3d.geometry.section import SectionGeometry

__all__ = ["Axis", "MapFit", "SectionGeometry", "SurveyGeometry", "fit_map", "geometry_of"]

# how far coordinates may lie from a map that is theirs, root mean square: in steps of it, and in its own misfit
_ROUNDING, _CROOKED = 0.01, 4.0


@dataclass(frozen=True, slots=True)
class SurveyGeometry:
    """Geometry of a cube: its three axes and, where it is known, its place on the map.

    Attributes
    ----------
    inline, crossline, sample : Axis
        Line numbers, and the sample coordinate in ``unit``.
    unit : str
        "ms", "m", "ft" or "samples"; any other word of the cube as it is.
    map_fit : MapFit or None
        None where the cube has no map coordinates.
    length_unit : {"m", "ft"}
        Of map coordinates.
    """

    inline: Axis
    crossline: Axis
    sample: Axis
    unit: str = "samples"
    map_fit: MapFit | None = None
    length_unit: str = "m"

    @classmethod
    def from_cube(cls, cube: Any) -> SurveyGeometry:
        """Return the geometry of a cube: a DataArray as ``open_cube`` gives it, or a bare array of 3 axes.

        Raises
        ------
        GeometryError
            If it is a section, or if an axis is not evenly spaced.
        """
        dims = getattr(cube, "dims", None)
        if dims is None:
            shape = np.shape(cube)
            if len(shape) != 3:
                raise GeometryError(f"cube has shape {shape}; expected 3 axes (inline, crossline, sample).")
            axes = [Axis(0.0, 1.0, n) for n in shape]
            return cls(axes[0], axes[1], axes[2])
        if len(dims) != 3:
            raise GeometryError(
                f"cube has dimensions {dims}; expected inline, crossline and time or depth. A section has no survey."
            )
        axes = [
            Axis.from_coordinates(cube[d].values if d in cube.coords else np.arange(cube.sizes[d]), str(d))
            for d in dims
        ]
        return cls(axes[0], axes[1], axes[2], unit_of(cube), _map_of(cube, axes), length_unit_of(cube))

    @property
    def has_map(self) -> bool:
        """Whether map coordinates are known."""
        return self.map_fit is not None

    @property
    def depth_scale(self) -> float | None:
        """Lengths on the map that one unit of depth is; None where the cube is not in depth."""
        return depth_scale(self.unit, self.length_unit)

    @property
    def bin_size(self) -> tuple[float, float]:
        """Lengths on the map to the next index along the inline and along the crossline axis; NaN without a map."""
        if self.map_fit is None:
            return (float("nan"), float("nan"))
        return (float(np.hypot(*self.map_fit.inline_step)), float(np.hypot(*self.map_fit.crossline_step)))

    @property
    def east_north(self) -> Float64Array:
        """Carries steps of traces to (east, north), shape (2, 2).

        Without a map the numbers of inlines grow north and those of crosslines east, in whatever order they are held.
        """
        if self.map_fit is not None:
            return self.map_fit.matrix
        return np.array([[0.0, np.sign(self.crossline.step)], [np.sign(self.inline.step), 0.0]])

    @property
    def inline_axis_azimuth_deg(self) -> float:
        """Azimuth from north of the direction in which the inline index grows; 0 without a map, 180 if numbers fall."""
        return float(self.azimuth_deg([[1.0, 0.0]])[0])

    @property
    def crossline_axis_azimuth_deg(self) -> float:
        """Azimuth from north of the direction in which the crossline index grows; without a map 90, or 270."""
        return float(self.azimuth_deg([[0.0, 1.0]])[0])

    @property
    def is_right_handed(self) -> bool:
        """Whether the crossline axis lies clockwise of the inline axis, seen from above: right-handed, samples down."""
        return float(np.linalg.det(self.east_north)) < 0

    @property
    def inlines_up(self) -> bool:
        """Whether inline indices grow upwards on a view from above that has crosslines to the right.

        So that it is no mirror image of the map; without a map inlines go downwards, as rows do.
        """
        return self.has_map and self.is_right_handed

    def index_to_map(self, points: ArrayLike) -> Float64Array:
        """Carry fractional index points to (x, y, z).

        Parameters
        ----------
        points : array of shape (n, 3)
            (inline, crossline, sample) indices.

        Returns
        -------
        ndarray of shape (n, 3), float64
            x, y on the map (inline and crossline numbers where there is no map), z in ``unit``, positive down.
        """
        p = as_points(points, "points", dim=3, finite=False)
        out = np.empty_like(p)
        if self.map_fit is None:
            out[:, 0], out[:, 1] = self.inline.coordinate(p[:, 0]), self.crossline.coordinate(p[:, 1])
        else:
            out[:, :2] = p[:, :2] @ self.map_fit.matrix.T + np.array(self.map_fit.origin)
        out[:, 2] = self.sample.coordinate(p[:, 2])
        return out

    def map_to_index(self, points: ArrayLike) -> Float64Array:
        """Carry (x, y, z) to fractional indices; the inverse of :meth:`index_to_map`."""
        p = as_points(points, "points", dim=3, finite=False)
        out = np.empty_like(p)
        if self.map_fit is None:
            out[:, 0], out[:, 1] = self.inline.index(p[:, 0]), self.crossline.index(p[:, 1])
        else:
            out[:, :2] = np.linalg.solve(self.map_fit.matrix, (p[:, :2] - np.array(self.map_fit.origin)).T).T
        out[:, 2] = self.sample.index(p[:, 2])
        return out

    def index_to_lines(self, points: ArrayLike) -> Float64Array:
        """Carry fractional indices to (inline number, crossline number, sample coordinate), shape (n, 3)."""
        p = as_points(points, "points", dim=3, finite=False)
        columns = [axis.coordinate(p[:, k]) for k, axis in enumerate((self.inline, self.crossline, self.sample))]
        return np.stack(columns, axis=1)

    def lines_to_index(self, points: ArrayLike) -> Float64Array:
        """Carry (inline number, crossline number, sample coordinate) to fractional indices, shape (n, 3)."""
        p = as_points(points, "points", dim=3, finite=False)
        columns = [axis.index(p[:, k]) for k, axis in enumerate((self.inline, self.crossline, self.sample))]
        return np.stack(columns, axis=1)

    def azimuth_deg(self, directions: ArrayLike) -> Float64Array:
        """Azimuth of directions given in index steps.

        Parameters
        ----------
        directions : array of shape (n, 2) or (n, 3)
            (inline, crossline[, sample]) components; the sample component does not matter.

        Returns
        -------
        ndarray of shape (n,), float64
            Degrees in [0, 360), clockwise from north; without a map, from where inline numbers grow towards where
            crossline numbers do.
        """
        east_north = as_points(directions, "directions", finite=False)[:, :2] @ self.east_north.T
        return bearing_deg(east_north[:, 0], east_north[:, 1])

    def strike_deg(self, normals: ArrayLike) -> Float64Array:
        """Strike of planes by the right-hand rule: looking along it, the plane dips to the right.

        Normals are covectors: they go to the map by the inverse transpose of M, so that bins that are not square, and
        sheared surveys, give the true strike.

        Parameters
        ----------
        normals : array of shape (n, 3)
            Normals in index coordinates, of any length; those that point down are turned up first.

        Returns
        -------
        ndarray of shape (n,), float64
            Degrees in [0, 360); NaN where the plane is level.
        """
        normal = as_points(normals, "normals", dim=3, finite=False)
        horizontal = np.where(normal[:, 2:] > 0, -normal[:, :2], normal[:, :2])
        dip_direction = np.linalg.solve(self.east_north.T, horizontal.T).T
        dip_azimuth = bearing_deg(dip_direction[:, 0], dip_direction[:, 1])
        level = np.hypot(horizontal[:, 0], horizontal[:, 1]) == 0
        return np.where(level, np.nan, wrap_deg(dip_azimuth - 90.0))

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and lists, for JSON and for a cube's attributes."""
        out: dict[str, Any] = {
            name: [axis.first, axis.step, axis.n]
            for name, axis in (("inline", self.inline), ("crossline", self.crossline), ("sample", self.sample))
        }
        out |= {"unit": self.unit, "length_unit": self.length_unit}
        if self.map_fit is not None:
            fit = self.map_fit
            out["map"] = {
                "origin": list(fit.origin),
                "inline_step": list(fit.inline_step),
                "crossline_step": list(fit.crossline_step),
                "rms": fit.rms,
            }
        return out


def geometry_of(cube: Any) -> SurveyGeometry | SectionGeometry:
    """Return where a cube lies, or a section of two axes."""
    return SectionGeometry.from_cube(cube) if np.ndim(cube) == 2 else SurveyGeometry.from_cube(cube)


def usual_spacing(places: Float64Array) -> float:
    """Return how far apart neighbours usually lie, along the axis where they lie closest; infinite if on one place.

    Parameters
    ----------
    places : ndarray of shape (..., 2), float64
        x and y of traces on their grid; NaN where they are not known.
    """
    steps = (np.linalg.norm(np.diff(places, axis=axis), axis=-1) for axis in range(places.ndim - 1))
    # not the least: a crooked line may all but meet itself
    return min((float(np.median(step[step > 0.0])) for step in steps if (step > 0.0).any()), default=np.inf)


def _map_of(cube: Any, axes: list[Axis]) -> MapFit | None:
    """Take the fit made when the cube was opened where it still applies, else fit the cube's own coordinates."""
    stored = _stored_map(cube, axes)
    if "cdp_x" not in cube.coords or "cdp_y" not in cube.coords:
        return stored
    # a few lines each way tell whether a map is theirs, and a few hundred pin an affine one
    if stored is not None and _agrees(stored, *_some_places(cube, 30)):
        return stored
    return fit_map(*_some_places(cube, 300))


def _some_places(cube: Any, most: int) -> tuple[AnyArray, Float64Array]:
    """Return indices and map coordinates of traces on at most so many lines each way, the outer ones among them."""
    rows, columns = (np.unique(np.linspace(0, n - 1, min(n, most)).astype(int)) for n in cube.shape[:2])
    x, y = (cube.coords[name][rows, columns].values.astype(np.float64).ravel() for name in ("cdp_x", "cdp_y"))
    ij = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    return ij, np.stack([x, y], axis=1)


def _stored_map(cube: Any, axes: list[Axis]) -> MapFit | None:
    """Return the fit of the file's lines, on the cube's."""
    stored = cube.attrs.get("survey") or {}
    if "map" not in stored:
        return None
    (il0, dil, _), (xl0, dxl, _) = stored["inline"], stored["crossline"]
    kept = stored["map"]
    M = np.array([kept["inline_step"], kept["crossline_step"]], dtype=np.float64).T / [dil, dxl]
    origin = np.array(kept["origin"]) + M @ [axes[0].first - il0, axes[1].first - xl0]
    u, v = M[:, 0] * axes[0].step, M[:, 1] * axes[1].step
    pairs = [(float(a), float(b)) for a, b in (origin, u, v)]
    return MapFit(pairs[0], pairs[1], pairs[2], float(kept["rms"]))


def _agrees(fit: MapFit, indices: AnyArray, xy: Float64Array) -> bool:
    """Tell whether a map gives the coordinates of the traces that have any, as far as it gave the file's."""
    known = np.isfinite(xy).all(axis=1)
    if not known.any():
        return True
    off = fit.distances(indices[known], xy[known])
    # the mean square, so that a part of a crooked survey has no more than its share of the misfit
    return float(np.sqrt((off**2).mean())) <= max(_ROUNDING * fit.shorter_step, _CROOKED * fit.rms)
