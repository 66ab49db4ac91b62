"""Amplitudes, fault lines and roses drawn on matplotlib axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_kind, as_number, is_among, told
from seismo3d.errors import ParameterError
from seismo3d.plot.pictures import Picture
from seismo3d.plot.traces_of_faults import SURFACE_COLOURS, FaultLines, value_colours
from seismo3d.seismic.preparing import find_level

BLUE = "#2b6ca3"
"""Colour of bars and petals."""

NO_DATA = "#e9edf2"
"""Colour of places without data."""
_LINE_WIDTH = 2.0
"""Of a fault on a picture, in points."""


def new_axes(width: float, height: float) -> Any:
    """Axes of a new pyplot figure, size in inches."""
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=(width, height), layout="constrained")[1]


def check_axes(ax: Any, *, polar: bool = False) -> Any:
    """Return axes as they are, or refuse what is none, or none of the kind that is drawn on."""
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes

    if polar:
        return as_kind(ax, PolarAxes, "ax", remedy="Give plt.subplot(projection='polar'), or leave it out.")
    return as_kind(ax, Axes, "ax", remedy="Give what plt.subplots()[1] is, or leave it out.")


def check_all_axes(axes: Any, count: int) -> list[Any]:
    """Return so many axes side by side, or refuse others."""
    from matplotlib.axes import Axes

    found = list(np.ravel(axes)) if isinstance(axes, (list, tuple, np.ndarray)) else []
    if len(found) != count or not all(isinstance(ax, Axes) for ax in found):
        raise ParameterError(
            f"axes is {told(axes)}; expected {count} Axes. Give plt.subplots(1, {count})[1], or leave them out."
        )
    return found


def check_colour_map(cmap: Any) -> None:
    """Refuse what is no colour map, nor the name of one."""
    from matplotlib import colormaps
    from matplotlib.colors import Colormap

    if cmap is not None and not isinstance(cmap, Colormap) and not is_among(cmap, colormaps):
        raise ParameterError(
            f"cmap is {told(cmap)}; expected a colour map of matplotlib or its name, such as 'gray' or 'seismic'."
        )


def bar_ends(values: Any, low: float, high: float) -> str:
    """Which ends of a colour bar hold what lies beyond them too, for ``extend``: matplotlib draws these pointed."""
    known = np.asarray(values)[np.isfinite(values)]
    below, above = bool((known < low).any()), bool((known > high).any())
    if below and above:
        return "both"
    return "min" if below else "max" if above else "neither"


def label_axes(ax: Any, x: str, y: str) -> None:
    """Name both axes, and write line numbers and map coordinates in full: not as what is to be added to 1.2e6."""
    ax.set(xlabel=x, ylabel=y)
    ax.ticklabel_format(useOffset=False, style="plain")


def draw_rose(
    strike: Float64Array, weight: Float64Array, *, bin_deg: float, names: Sequence[str], title: str, ax: Any = None
) -> Any:
    """Draw a rose diagram both ways; a petal's *area* is its share of the weights.

    Parameters
    ----------
    strike, weight : ndarray of shape (n,), float64
        Degrees, and how much each counts.
    bin_deg : float
        Width of a petal, 1 to 90 degrees.
    names : sequence of str
        What the four directions are called, clockwise from the top.
    title : str
        What strikes.
    ax : matplotlib PolarAxes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib PolarAxes

    Raises
    ------
    ParameterError
        If `bin_deg` is not 1 to 90.
    """
    n = round(180.0 / as_number(bin_deg, "bin_deg", low=1.0, high=90.0))
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.subplots(figsize=(4.5, 4.5), layout="constrained", subplot_kw={"projection": "polar"})[1]
    check_axes(ax, polar=True)
    counts, edges = np.histogram(strike % 180.0, bins=n, range=(0.0, 180.0), weights=weight)
    length = np.sqrt(counts / counts.sum()) if counts.sum() > 0 else counts
    centres = np.radians(np.concatenate([edges[:-1], edges[:-1] + 180.0]) + 90.0 / n)
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.bar(centres, np.tile(length, 2), width=np.pi / n, color=BLUE, edgecolor="white", linewidth=0.6)
    ax.set_xticks(np.radians([0, 90, 180, 270]), names)
    for label, side in zip(ax.get_xticklabels(), ("center", "left", "center", "right"), strict=True):
        # beside the circle, not across it
        label.set_horizontalalignment(side)
    ax.set_yticks([])
    ax.set_title(title, fontsize="medium")
    return ax


def draw_amplitudes(ax: Any, picture: Picture, *, cmap: str, clip: float) -> Any:
    """Draw a picture with colours symmetric about what its amplitudes share; places without data get a flat colour.

    Parameters
    ----------
    ax : matplotlib Axes
        Where to draw.
    picture : Picture
        What to draw.
    cmap : str
        A matplotlib colour map.
    clip : float
        Percentile of the amplitude's size that gets the strongest colour.

    Returns
    -------
    AxesImage
        The drawn picture.
    """
    check_colour_map(cmap)
    low, high = amplitude_limits(picture.values[picture.live], clip)
    masked = np.ma.masked_array(picture.values, mask=~picture.live)
    ax.set_facecolor(NO_DATA)
    drawn = ax.imshow(
        masked,
        cmap=cmap,
        vmin=low,
        vmax=high,
        extent=picture.extent,
        aspect="auto",
        interpolation="antialiased",
        interpolation_stage="rgba",
    )
    label_axes(ax, picture.column_name, picture.row_name)
    ax.set_title(picture.title, loc="left", fontsize="medium")
    if not picture.live.all():
        _note_missing(ax, picture)
    return drawn


def amplitude_limits(values: AnyArray, clip: float) -> tuple[float, float]:
    """Amplitudes that get the strongest colours: about what all share, by a percentile of how far off it they lie."""
    percent = as_number(clip, "clip", low=0, high=100)
    level = find_level(values)
    off = np.abs(values[np.isfinite(values)].astype(np.float64) - level)
    limit = float(np.percentile(off, percent)) if off.size else 0.0
    limit = limit or float(off.max(initial=0)) or 1.0
    return level - limit, level + limit


def draw_faults(ax: Any, lines: FaultLines, *, colour: str) -> Any:
    """Draw fault lines over a picture, with a colour bar where their colours are numbers.

    Parameters
    ----------
    ax : matplotlib Axes
        Where to draw.
    lines : FaultLines
        What to draw.
    colour : {"surface", "throw", "likelihood", "plain"}
        What the colour says; segments of unknown throw are white. Plain ones are black with white rims, for pictures in
        which colours tell something else.

    Returns
    -------
    LineCollection or None
        None where no fault crosses the picture.
    """
    from matplotlib.collections import LineCollection

    if not len(lines.segments):
        return None
    limits = ax.get_xlim(), ax.get_ylim()
    is_plain = colour == "plain"
    rim = LineCollection(list(lines.segments), colors="white" if is_plain else "black", capstyle="round")
    rim.set_linewidth(_LINE_WIDTH + 1.4)
    ax.add_collection(rim)
    top = LineCollection(list(lines.segments), linewidths=_LINE_WIDTH, capstyle="round")
    values = lines.values(colour)
    if is_plain:
        top.set_color("black")
    elif values is None:
        top.set_color([SURFACE_COLOURS[(number - 1) % len(SURFACE_COLOURS)] for number in lines.surface])
    else:
        top.set_array(np.ma.masked_invalid(values))
        name, low, high = lines.throw_colours if colour == "throw" else value_colours(values, colour)
        top.set_cmap(_with_unknown(name))
        top.set_clim(low, high)
    ax.add_collection(top)
    ax.set_xlim(*limits[0])
    ax.set_ylim(*limits[1])
    if values is not None:
        name = f"Throw ({lines.throw_unit})" if colour == "throw" else "Fault likelihood"
        ax.figure.colorbar(top, ax=ax, label=name, pad=0.02, shrink=0.8, extend=bar_ends(values, *top.get_clim()))
    return top


def _with_unknown(name: str) -> Any:
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad="white")


def _note_missing(ax: Any, picture: Picture) -> None:
    from matplotlib.patches import Patch

    share = 100.0 * (1.0 - picture.live.mean())
    patch = Patch(facecolor=NO_DATA, edgecolor="0.4", label=f"no data ({share:.2g} %)")
    ax.legend(handles=[patch], loc="lower right", fontsize="x-small", framealpha=0.9, handlelength=1.2)
