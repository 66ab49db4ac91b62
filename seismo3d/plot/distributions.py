"""Which way faults strike, and how much they throw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_flag
from seismo3d.geometry.triangles import weigh_vertices
from seismo3d.plot.drawing import BLUE, check_axes, draw_rose, new_axes
from seismo3d.plot.traces_of_faults import display_throw
from seismo3d.seismic.cube_checks import check_faults


def strike_rose(faults: Any, *, from_north: bool, bin_deg: float = 10.0, ax: Any = None) -> Any:
    """Draw a rose diagram of strike, weighted by fault area and drawn both ways.

    Parameters
    ----------
    faults : FaultSet
        Faults of a cube.
    from_north : bool
        Whether strikes are measured from north (the cube lies on a map) or from the inline axis.
    bin_deg : float
        Width of a petal, 1 to 90 degrees.
    ax : matplotlib PolarAxes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib PolarAxes
        The rose; a petal's *area* is its share of the fault area.

    Raises
    ------
    ParameterError
        If `bin_deg` is not 1 to 90.
    """
    check_faults(faults)
    north = as_flag(from_north, "from_north")
    strikes = [np.asarray(s.strike_deg, dtype=np.float64) for s in faults.surfaces]
    weights = [weigh_vertices(s.vertices, s.cells) for s in faults.surfaces]
    strike, weight = (np.concatenate(x) if x else np.zeros(0) for x in (strikes, weights))
    known = np.isfinite(strike)
    names = ["N", "E", "S", "W"] if north else ("inline axis", "crossline\naxis", "", "")
    return draw_rose(strike[known], weight[known], bin_deg=bin_deg, names=names, title="Strike", ax=ax)


def throw_histogram(faults: Any, *, ax: Any = None) -> Any:
    """Draw how the fault area is spread over throws.

    Parameters
    ----------
    faults : FaultSet
        Faults of a cube or section.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        Shares of the area of known throw, where the two sides match; the outermost bars hold what little lies beyond
        them, too. The share of the area where throw is carried on, or not known, is written on it.
    """
    ax = new_axes(5.5, 4.0) if ax is None else check_axes(ax)
    check_faults(faults)
    throws = [display_throw(surface) for surface in faults.surfaces]
    weights = [weigh_vertices(surface.vertices, surface.cells) for surface in faults.surfaces]
    unit = throws[0][1] if throws else "samples"
    throw = np.concatenate([t for t, _ in throws]) if throws else np.zeros(0)
    weight = np.concatenate(weights) if weights else np.zeros(0)
    known = np.concatenate([s.is_matched for s in faults.surfaces]) if throws else np.zeros(0, bool)
    if known.any():
        edges = _bin_edges(*np.percentile(throw[known], [0.5, 99.5]))
        shares = 100.0 * weight[known] / weight[known].sum()
        ax.hist(
            np.clip(throw[known], edges[0], edges[-1]),
            bins=edges,
            weights=shares,
            color=BLUE,
            edgecolor="white",
            linewidth=0.5,
        )
    unknown = 100.0 * weight[~known].sum() / weight.sum() if weight.sum() > 0 else 0.0
    ax.axvline(0.0, color="0.3", linewidth=0.8)
    ax.set(xlabel=f"Throw ({unit}), positive: hanging wall down", ylabel="Share of fault area (%)")
    ax.set_title(f"Throw (carried on over {unknown:.0f} % of the area)", fontsize="medium")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _bin_edges(low: float, high: float) -> Float64Array:
    """Edges of up to 30 bars, each at least a sixtieth of the axis, which holds zero: thinner ones are not seen."""
    axis = max(high, 0.0) - min(low, 0.0) or 1.0
    width = max((high - low) / 30, axis / 60)
    n = max(math.ceil((high - low) / width - 1e-9), 1)
    middle = (low + high) / 2
    return np.linspace(middle - n * width / 2, middle + n * width / 2, n + 1)
