"""Where a section lies: its traces on the map, and its sample axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_points
from seismo3d.errors import GeometryError
from seismo3d.geometry.axis import Axis, depth_scale, length_unit_of, unit_of


@dataclass(frozen=True, slots=True, eq=False)
class SectionGeometry:
    """Geometry of a section: where its traces lie, and its sample axis.

    Attributes
    ----------
    xy : ndarray of shape (n, 2), float64, or None
        Map coordinates of the traces; a trace without any lies in line with the nearest ones that have them.
    sample : Axis
        The sample coordinate in ``unit``.
    unit : str
        "ms", "m", "ft" or "samples"; any other word of the section as it is.
    length_unit : {"m", "ft"}
        Of map coordinates.
    numbers : ndarray of shape (n,), float64, or None
        Numbers of the traces; None where they are their indices.
    """

    xy: Float64Array | None
    sample: Axis
    unit: str = "samples"
    length_unit: str = "m"
    numbers: Float64Array | None = None

    @classmethod
    def from_cube(cls, section: Any) -> SectionGeometry:
        """Return the geometry of a section: a DataArray with dims (trace, time or depth), or a bare array of 2 axes."""
        shape = np.shape(section)
        if len(shape) != 2:
            raise GeometryError(f"section has shape {shape}; expected 2 axes (trace, sample).")
        if not hasattr(section, "dims"):
            return cls(None, Axis(0.0, 1.0, shape[1]))
        vertical = section.dims[1]
        values = section[vertical].values if vertical in section.coords else np.arange(shape[1])
        xy = None
        if "cdp_x" in section.coords and "cdp_y" in section.coords:
            xy = _all_places(
                np.stack([np.asarray(section[name].values, dtype=np.float64) for name in ("cdp_x", "cdp_y")], axis=1)
            )
        along = section.dims[0]
        numbers = np.asarray(section[along].values, dtype=np.float64) if along in section.coords else None
        sample = Axis.from_coordinates(values, str(vertical))
        return cls(xy, sample, unit_of(section), length_unit_of(section), numbers)

    @property
    def has_map(self) -> bool:
        """Whether map coordinates are known."""
        return self.xy is not None

    @property
    def depth_scale(self) -> float | None:
        """Lengths on the map that one unit of depth is; None where the section is not in depth."""
        return depth_scale(self.unit, self.length_unit)

    def index_to_map(self, points: ArrayLike) -> Float64Array:
        """Carry (trace, sample) indices to (x, y, z); x is the trace's number and y 0 where there is no map.

        Between traces x and y are interpolated; beyond the first and the last trace they stay at those traces.
        """
        p = as_points(points, "points", dim=2, finite=False)
        z = self.sample.coordinate(p[:, 1])
        if self.xy is not None:
            x, y = (np.interp(p[:, 0], np.arange(len(self.xy)), column) for column in self.xy.T)
        elif self.numbers is not None:
            x, y = np.interp(p[:, 0], np.arange(len(self.numbers)), self.numbers), np.zeros(len(p))
        else:
            x, y = p[:, 0], np.zeros(len(p))
        return np.stack([x, y, z], axis=1)


def _all_places(xy: Float64Array) -> Float64Array | None:
    """Place traces whose coordinates are not finite in line with the nearest known ones; None where none are known."""
    known = np.isfinite(xy).all(axis=1)
    if known.all():
        return xy
    at = np.flatnonzero(known)
    if at.size < 2:
        return np.broadcast_to(xy[at], xy.shape) if at.size else None
    traces = np.arange(len(xy))
    k = np.clip(np.searchsorted(at, traces), 1, at.size - 1)
    share = ((traces - at[k - 1]) / (at[k] - at[k - 1]))[:, None]
    return (1.0 - share) * xy[at[k - 1]] + share * xy[at[k]]
