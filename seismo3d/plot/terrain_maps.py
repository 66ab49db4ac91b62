"""Terrain: hillshade maps with lines, change maps, the rose of strikes, and profiles across a scarp."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_kind, check_list
from seismo3d.geometry.map_grid import MapGrid, elevation_values
from seismo3d.plot.drawing import NO_DATA, bar_ends, check_axes, draw_rose, label_axes, new_axes
from seismo3d.terrain.change import Change
from seismo3d.terrain.fault_outcrops import Outcrop
from seismo3d.terrain.lineament_search import LineamentSet
from seismo3d.terrain.scarp_profiles import Scarp

_KINDS = {"both": "step and trough"}
_COLOURS = {"step": "#d62728", "trough": "#1f9bcf", "both": "#c218c2", "valley": "#1fa35c"}
_NO_CHANGE = "#d8d8d8"


def terrain(elevation: Any, *, lines: Any = None, outcrops: Any = (), ax: Any = None) -> Any:
    """Draw a map as a hillshade, with lineaments and the outcrops of faults.

    Parameters
    ----------
    elevation : DataArray or array_like of shape (rows, columns)
    lines : LineamentSet, optional
        Coloured by what speaks for them: a step, a trough, both, or a valley across divides.
    outcrops : sequence of Outcrop
        Drawn dashed.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
        In map coordinates; (column, row) without a georeference.
    """
    grid, z = MapGrid.from_elevation(elevation), elevation_values(elevation, least=2)
    if lines is not None:
        as_kind(lines, LineamentSet, "lines", remedy="Give what lineaments returned.")
    check_list(outcrops, "outcrops", Outcrop)
    ax = _map_axes(grid) if ax is None else check_axes(ax)
    _draw_grid(ax, grid, np.ma.masked_invalid(_hillshade(z, grid)), cmap="gray", vmin=0.0, vmax=1.0)
    shown = set()
    for line in lines.lines if lines is not None else ():
        label = None if line.kind in shown else _KINDS.get(line.kind, line.kind)
        shown.add(line.kind)
        ax.plot(line.points[:, 0], line.points[:, 1], color=_COLOURS[line.kind], linewidth=1.6, label=label)
    for number, outcrop in enumerate(outcrops):
        x, y = outcrop.points[:, 0], outcrop.points[:, 1]
        ax.plot(x, y, color="#ffb000", linewidth=1.8, linestyle="--", label=None if number else "fault, carried up")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper right", fontsize="small", framealpha=0.9)
    return ax


def change_map(change: Any, *, ax: Any = None) -> Any:
    """Draw the significant change of an elevation map; grey where there is none, hatched where a map is unknown.

    Parameters
    ----------
    change : Change
        From :func:`seismo3d.terrain.compare`.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    as_kind(change, Change, "change", remedy="Give what compare returned.")
    grid = MapGrid.from_elevation(change.difference)
    d, significant = np.asarray(change.difference), np.asarray(change.significant)
    known = np.isfinite(d)
    ax = _map_axes(grid) if ax is None else check_axes(ax)
    # what is not drawn over shows through; white is a change of about nothing
    unknown: dict[str, Any] = {"facecolor": NO_DATA, "edgecolor": "0.6", "hatch": "///"}
    ax.patch.set(**unknown)
    _draw_grid(ax, grid, np.ma.masked_array(np.zeros(d.shape), ~known), cmap=ListedColormap([_NO_CHANGE]))
    limit = float(np.percentile(np.abs(d[significant]), 98.0)) if significant.any() else 1.0
    drawn = _draw_grid(ax, grid, np.ma.masked_array(d, ~significant), cmap="RdBu", vmin=-limit, vmax=limit)
    beyond = bar_ends(d[significant], -limit, limit)
    ax.figure.colorbar(drawn, ax=ax, label="Elevation gained (m)", pad=0.02, shrink=0.8, extend=beyond)
    key = [Patch(facecolor=_NO_CHANGE, label=f"not significant at {100 * change.confidence:g} %")]
    key += [] if known.all() else [Patch(**unknown, label="no data")]
    ax.legend(handles=key, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize="small", frameon=False)
    return ax


def lineament_rose(lines: Any, *, bin_deg: float = 10.0, ax: Any = None) -> Any:
    """Draw a rose diagram of strike, weighted by length and drawn both ways; a petal's *area* is its share.

    Parameters
    ----------
    lines : LineamentSet
    bin_deg : float
        Width of a petal, 1 to 90 degrees.
    ax : matplotlib PolarAxes, optional

    Returns
    -------
    matplotlib PolarAxes

    Raises
    ------
    ParameterError
        If `bin_deg` is not 1 to 90.
    """
    as_kind(lines, LineamentSet, "lines", remedy="Give what lineaments returned.")
    names = ["N", "E", "S", "W"] if lines.grid.has_place else ["up", "right", "", ""]
    strike, length = strikes_by_length(lines)
    return draw_rose(strike, length, bin_deg=bin_deg, names=names, title="Strike of lineaments, by length", ax=ax)


def scarp_profile(scarp: Any, *, ax: Any = None) -> Any:
    """Draw the mean profile across a scarp, with its slope.

    Parameters
    ----------
    scarp : Scarp
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
        Elevation; the slope is on a second axis.
    """
    as_kind(scarp, Scarp, "scarp", remedy="Give one of those that scarps returned.")
    ax = new_axes(6.0, 3.5) if ax is None else check_axes(ax)
    ax.plot(scarp.offset, scarp.profile, color="black")
    ax.set(xlabel="Towards the lower side (m)", ylabel="Elevation (m)")
    ax.set_title(f"Height {scarp.height_m:.2f} m, faces {scarp.facing_deg:.0f} deg", loc="left", fontsize="medium")
    slope = ax.twinx()
    slope.plot(scarp.offset, scarp.slope_profile_deg, color="#d62728", linewidth=1.0)
    slope.set_ylabel("Slope (deg)", color="#d62728")
    return ax


def strikes_by_length(lines: Any) -> tuple[Float64Array, Float64Array]:
    """Return strike in degrees and length in metres of every segment of all lines."""
    strikes, lengths = [], []
    for line in lines.lines:
        way = np.diff(stretch_ends(line), axis=0) * np.array(lines.grid.metres_per_unit)
        north = way[:, 1] if lines.grid.has_place else -way[:, 1]
        strikes.append(np.degrees(np.arctan2(way[:, 0], north)) % 180.0)
        lengths.append(np.linalg.norm(way, axis=1))
    return (np.concatenate(strikes), np.concatenate(lengths)) if strikes else (np.zeros(0), np.zeros(0))


def stretch_ends(line: Any) -> Float64Array:
    """Return the ends of a lineament's stretches of a dozen points: single cells strike anywhere."""
    return np.asarray(line.points[np.unique(np.append(np.arange(0, len(line.points), 12), len(line.points) - 1))])


def _hillshade(z: Float64Array, grid: MapGrid) -> Float64Array:
    from matplotlib.colors import LightSource

    dx, dy = (float(np.hypot(*column)) for column in grid.steps_m.T)
    filled = np.where(np.isfinite(z), z, np.nanmean(z))
    # plains and mountains alike: the usual slope gets the usual shade
    usual = float(np.median(np.hypot(*np.gradient(filled, dy, dx)))) or 1.0
    southwards = grid.matrix[1, 1] < 0 or not grid.has_place
    shade = LightSource(315.0, 45.0).hillshade(
        filled, vert_exag=float(np.clip(0.3 / usual, 0.2, 20.0)), dx=dx, dy=dy if southwards else -dy
    )
    return np.where(np.isfinite(z), shade, np.nan)


def _map_axes(grid: MapGrid) -> Any:
    rows, columns = grid.shape
    dx, dy = (float(np.hypot(*column)) for column in grid.steps_m.T)
    ratio = np.clip(rows * dy / (columns * dx), 0.4, 2.0)
    return new_axes(7.5, float(7.5 * ratio))


def _draw_grid(ax: Any, grid: MapGrid, values: Any, **colours: Any) -> Any:
    rows, columns = grid.shape
    corners = grid.to_map([[-0.5, -0.5], [columns - 0.5, rows - 0.5], [columns - 0.5, -0.5], [-0.5, rows - 0.5]])
    (left, top), (right, bottom) = corners[:2]
    is_turned = bool(grid.matrix[0, 1] or grid.matrix[1, 0])
    extent = (0, columns, rows, 0) if is_turned else (left, right, bottom, top)
    drawn = ax.imshow(values, extent=extent, interpolation="antialiased", **colours)
    if is_turned:
        _turn(drawn, ax, grid)
        (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
        ax.set(xlim=(left, right), ylim=(bottom, top))
    x, y = grid.metres_per_unit
    ax.set_aspect(y / x)
    if grid.has_place:
        unit = "deg" if grid.unit == "degree" else "m"
        label_axes(ax, f"East ({unit})", f"North ({unit})")
        if bottom > top:  # rows from south to north: north is still up
            ax.invert_yaxis()
    else:
        label_axes(ax, "Column", "Row")
    return drawn


def _turn(drawn: Any, ax: Any, grid: MapGrid) -> None:
    """Lay an image, drawn by columns and rows from its first corner, where a grid that is turned has them."""
    from matplotlib.transforms import Affine2D

    a, b, c, d, e, f = grid.transform
    drawn.set_transform(Affine2D.from_values(a, d, b, e, c, f) + ax.transData)
