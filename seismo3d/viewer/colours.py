"""What the colour of a fault says: values at its vertices, and the colour map that they are drawn in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import ParameterError
from seismo3d.plot.traces_of_faults import SURFACE_COLOURS, display_throw, value_colours
from seismo3d.seismic.faultset import FaultSurface

ATTRIBUTES = ("throw", "likelihood", "confidence", "dip", "strike", "fault")
N_CLASSES = 24
"""Colours that a scale is drawn in."""
UNKNOWN = "#ffffff"


@dataclass(frozen=True, slots=True, eq=False)
class Scale:
    """A colour scale.

    Attributes
    ----------
    attribute : str
        What the colours say.
    low, high : float
        Values of the first and the last colour.
    unit : str
        Of the values.
    shades : tuple of str
        The colours, as "#rrggbb"; one a fault, over and over, for the attribute "fault".
    """

    attribute: str
    low: float
    high: float
    unit: str
    shades: tuple[str, ...]

    def classify(self, values: AnyArray) -> AnyArray:
        """Return the number of each value's colour; -1 where the value is not known."""
        share = (np.asarray(values, np.float64) - self.low) / max(self.high - self.low, 1e-12)
        known = np.isfinite(share)
        classes = np.clip(np.nan_to_num(share) * len(self.shades), 0, len(self.shades) - 1).astype(int)
        return np.where(known, classes, -1)

    def shade(self, number: int) -> str:
        """Return the colour of a class, white for -1."""
        return UNKNOWN if number < 0 else self.shades[number % len(self.shades)]


def vertex_values(surface: FaultSurface, attribute: str) -> Float64Array:
    """Values of an attribute at a surface's vertices, in the unit that its scale shows.

    Raises
    ------
    ParameterError
        If there is no such attribute.
    """
    if attribute == "throw":
        return np.asarray(display_throw(surface)[0])
    if attribute == "confidence":
        return np.full(len(surface.vertices), surface.confidence)
    names = {"likelihood": "likelihood", "dip": "dip_deg", "strike": "strike_deg"}
    if attribute not in names:
        raise ParameterError(f"attribute is {attribute!r}; expected one of {', '.join(ATTRIBUTES)}.")
    return np.asarray(getattr(surface, names[attribute]), np.float64)


def make_scale(surfaces: Sequence[FaultSurface], attribute: str) -> Scale:
    """Choose the colours for an attribute over all surfaces."""
    if attribute == "fault":
        return Scale("fault", 0.0, 1.0, "", SURFACE_COLOURS)
    name, low, high = {
        "likelihood": ("plasma", 0.0, 1.0),
        "confidence": ("plasma", 0.0, 1.0),
        "strike": ("twilight_shifted", 0.0, 360.0),
        "dip": ("viridis", 0.0, 90.0),
    }.get(attribute, ("", 0.0, 1.0))
    unit = "deg" if attribute in ("strike", "dip") else ""
    values = [vertex_values(surface, attribute) for surface in surfaces]
    if attribute == "throw":
        name, low, high = value_colours(np.concatenate(values) if values else np.zeros(0), "throw")
        unit = surfaces[0].sample_unit if surfaces else "samples"
    elif attribute == "dip" and values:
        low, high = (float(v) for v in np.percentile(np.concatenate(values), [2.0, 98.0]))
        high = max(high, low + 1.0)
    return Scale(attribute, low, high, unit, _shades(name))


def _shades(name: str) -> tuple[str, ...]:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return tuple(to_hex(colour) for colour in colormaps[name]((np.arange(N_CLASSES) + 0.5) / N_CLASSES))
