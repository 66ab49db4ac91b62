"""Where faults cross a picture: line segments with the attributes that colour them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array, IntArray
from seismo3d._validate import is_among, told
from seismo3d.errors import ParameterError
from seismo3d.geometry.triangles import cut_mesh
from seismo3d.plot.pictures import Picture

# ten colours that stay apart on grey and in print, after Okabe and Ito with four more
SURFACE_COLOURS = (
    "#e6194b",
    "#0072b2",
    "#f58231",
    "#009e73",
    "#cc33bb",
    "#d4a800",
    "#56b4e9",
    "#8c564b",
    "#7fbf00",
    "#5e3c99",
)


@dataclass(frozen=True, slots=True, eq=False)
class FaultLines:
    """Segments of faults on a picture.

    Attributes
    ----------
    segments : ndarray of shape (s, 2, 2), float64
        Both ends of each segment as (x, y) in the picture's coordinates.
    surface : ndarray of shape (s,), int
        Number of the surface, from 1.
    throw, likelihood : ndarray of shape (s,), float64
        Means of both ends; throw in ``throw_unit``, NaN where not known.
    throw_unit : str
        "ms", "m", "ft" or "samples".
    throw_colours : (str, float, float)
        Colour map and limits for throw, the same on every picture of these faults.
    """

    segments: Float64Array
    surface: IntArray
    throw: Float64Array
    likelihood: Float64Array
    throw_unit: str
    throw_colours: tuple[str, float, float]

    def values(self, colour: str) -> Float64Array | None:
        """Return the numbers behind a colouring: None where colours go by surface."""
        return {"throw": self.throw, "likelihood": self.likelihood}.get(colour)


def check_colour(colour: str) -> None:
    """Refuse a colouring that there is not."""
    if not is_among(colour, ("surface", "throw", "likelihood")):
        raise ParameterError(f"colour is {told(colour)}; expected 'surface', 'throw' or 'likelihood'.")


def display_throw(surface: Any) -> tuple[AnyArray, str]:
    """Throw of a surface in ms, m or ft where its sample interval is known, else in samples, and that unit."""
    return np.asarray(surface.throw, dtype=np.float64) * surface.sample_interval, str(surface.sample_unit)


def cut_faults(faults: Any, picture: Picture) -> FaultLines:
    """Cut all surfaces of a fault set by the plane of a picture.

    Parameters
    ----------
    faults : FaultSet
        The faults.
    picture : Picture
        A slice of the cube that they were traced in.

    Returns
    -------
    FaultLines
        Segments, surface by surface.
    """
    parts: list[tuple[AnyArray, AnyArray, AnyArray, AnyArray]] = []
    unit = "samples"
    for number, surface in enumerate(faults.surfaces, start=1):
        throw, unit = display_throw(surface)
        points, segments, throw, likelihood = _cross(surface, picture, throw)
        ends = points[segments]
        parts.append((ends, np.full(len(ends), number), throw[segments], likelihood[segments]))
    if not parts:
        return FaultLines(
            np.zeros((0, 2, 2)), np.zeros(0, dtype=int), np.zeros(0), np.zeros(0), unit, ("turbo", 0.0, 1.0)
        )
    ends, surface_number, throw, likelihood = (np.concatenate(column) for column in zip(*parts, strict=True))
    colours = value_colours(np.concatenate([display_throw(surface)[0] for surface in faults.surfaces]), "throw")
    return FaultLines(ends, surface_number, throw.mean(axis=1), likelihood.mean(axis=1), unit, colours)


def value_colours(values: AnyArray, colour: str) -> tuple[str, float, float]:
    """Choose a colour map and its limits for throw or likelihood: throws of both signs get a symmetric map."""
    if colour == "likelihood":
        return "plasma", 0.0, 1.0
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "turbo", 0.0, 1.0
    # signed noise of a few points should not turn the whole picture into two colours
    low, high = (float(v) for v in np.percentile(finite, [2.0, 98.0]))
    if low < 0 < high:
        # wrong throws are far off, and often of the wrong sign: a tenth of them leaves the scale alone
        limit = float(np.percentile(np.abs(finite), 90.0)) or max(-low, high)
        return "RdYlBu_r", -limit, limit
    return "turbo", min(low, 0.0), max(high, 0.0) or (0.0 if low < 0 else 1.0)


def _cross(surface: Any, picture: Picture, throw: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """Points on the picture, segments between them, throw and likelihood at them."""
    if picture.axis < 0:
        points, segments = np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.cells)
        likelihood = np.asarray(surface.likelihood, dtype=np.float64)
    else:
        cut = cut_mesh(surface.vertices, surface.cells, axis=picture.axis, value=picture.index)
        points, segments = np.delete(cut.points, picture.axis, axis=1), cut.segments
        throw, likelihood = cut.interpolate(throw), cut.interpolate(surface.likelihood)
    across, down = (1, 0) if picture.axis == 2 else (0, 1)
    placed = np.stack(picture.place(points[:, across], points[:, down]), axis=1)
    return placed, segments, throw, likelihood
