"""A regular axis: line numbers, or the sample coordinate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d.errors import GeometryError

METRES = {"m": 1.0, "ft": 0.3048}
"""Metres in each unit of length."""
USUAL_UNITS = {"time": "ms", "depth": "m"}
"""Unit of a last axis that states none, by its name."""
_NAMES = {
    "ms": ("ms", "msec", "millisecond", "milliseconds"),
    "m": ("m", "metre", "metres", "meter", "meters"),
    "ft": ("ft", "foot", "feet"),
}


@dataclass(frozen=True, slots=True)
class Axis:
    """A regular axis: ``first + step * index`` for ``n`` indices.

    Attributes
    ----------
    first, step : float
        Coordinate of index 0, and the difference of two neighbours; the step is not zero.
    n : int
        Number of indices, at least 1.

    Examples
    --------
    >>> axis = Axis(100, 4, 3)
    >>> axis.coordinates()
    array([100., 104., 108.])
    >>> axis.index(106)
    1.5
    """

    first: float
    step: float
    n: int

    def __post_init__(self) -> None:
        if self.n < 1 or self.step == 0 or not np.isfinite([self.first, self.step]).all():
            raise GeometryError(
                f"axis has first {self.first}, step {self.step}, n {self.n}; "
                "expected finite numbers, a step other than 0 and n >= 1."
            )

    @property
    def last(self) -> float:
        """Coordinate of the last index."""
        return self.first + self.step * (self.n - 1)

    def coordinates(self) -> Float64Array:
        """Coordinates of all indices, float64 of shape (n,)."""
        return self.first + self.step * np.arange(self.n, dtype=np.float64)

    def index(self, coordinate: Any) -> Any:
        """Fractional index of one or many coordinates; may lie outside the axis."""
        return (coordinate - self.first) / self.step

    def coordinate(self, index: Any) -> Any:
        """Coordinate of one or many fractional indices."""
        return self.first + self.step * index

    @classmethod
    def from_coordinates(cls, values: ArrayLike, name: str) -> Axis:
        """Return the axis of evenly spaced coordinates, or refuse them.

        Raises
        ------
        GeometryError
            If the coordinates are not evenly spaced (to 1e-4 of a step).
        """
        numbers = np.asarray(values, dtype=np.float64).ravel()
        if numbers.size == 0:
            raise GeometryError(f"{name} has no coordinates; expected at least one.")
        if numbers.size == 1:
            return cls(float(numbers[0]), 1.0, 1)
        step = float(numbers[-1] - numbers[0]) / (numbers.size - 1)
        ideal = numbers[0] + step * np.arange(numbers.size)
        if step == 0 or not np.isfinite(step) or not np.abs(numbers - ideal).max() <= 1e-4 * abs(step):
            raise GeometryError(
                f"{name} is not evenly spaced; expected a constant step. Interpolate it onto one first."
            )
        return cls(float(numbers[0]), step, int(numbers.size))


def check_downwards(cube: Any, name: str = "cube") -> None:
    """Refuse a DataArray whose last axis falls, as elevations do: throws and depths would have the wrong sign."""
    last = str(cube.dims[-1])
    values = np.asarray(cube[last].values) if last in cube.coords else np.empty(0)
    if len(values) and values[-1] < values[0]:
        raise GeometryError(
            f"{name} has {last} from {values[0]:g} to {values[-1]:g}; expected numbers that grow downwards. Negate "
            f"elevations, {name}.assign_coords({last}=-{name}.{last}), or turn over a cube that is upside down, "
            f"{name}.isel({last}=slice(None, None, -1))."
        )


def unit_of(cube: Any) -> str:
    """Return the unit of a cube's or section's last axis.

    What it says itself, else what its coordinates say, else ms of a time and m of a depth.
    """
    if not hasattr(cube, "dims"):
        return "samples"
    last = cube.dims[-1]
    usual = USUAL_UNITS.get(str(last), "samples")
    says = cube.coords[last].attrs.get("units", usual) if last in cube.coords else usual
    return _short(str(cube.attrs.get("sample_unit", says)))


def length_unit_of(cube: Any) -> str:
    """Return the unit of a cube's or section's map coordinates: "ft" where they say so, else "m"."""
    if not hasattr(cube, "dims"):
        return "m"
    stored = (cube.attrs.get("survey") or {}).get("length_unit", "m")
    says = cube.coords["cdp_x"].attrs.get("units", stored) if "cdp_x" in cube.coords else stored
    return "ft" if _short(str(says)) == "ft" else "m"


def _short(unit: str) -> str:
    """Return the usual short name of a unit; others as they are."""
    return next((short for short, names in _NAMES.items() if unit.lower() in names), unit)


def depth_scale(unit: str, length_unit: str) -> float | None:
    """Return the lengths on the map that one unit of depth is; None where the samples are not in depth.

    Examples
    --------
    >>> depth_scale("m", "m"), depth_scale("ms", "m"), round(depth_scale("m", "ft"), 3)
    (1.0, None, 3.281)
    """
    return METRES[unit] / METRES[length_unit] if unit in METRES else None
