"""Tracks drawn: the depth map with contours, and the lines where tracks cross a section."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from seismo3d.errors import ShapeError
from seismo3d.plot.drawing import new_axes
from seismo3d.plot.pictures import axis_coordinates, axis_label, name_axes, take_picture
from seismo3d.plot.sections import section

_COLOURS = ("#ffd54f", "#4fc3f7", "#aed581", "#ff8a65", "#ba68c8")


def track_map(track: Any, cube: Any, *, contours: int = 12, cmap: str = "viridis_r", ax: Any = None) -> Any:
    """Draw the depth map of a track with contours; places where it was not traced stay empty.

    Parameters
    ----------
    track : Track
        A track of ``cube``.
    cube : DataArray or ndarray
        Gives the line numbers.
    contours : int
        About how many contour lines.
    cmap : str
        Any matplotlib colour map.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        Crosslines to the right, inlines down; seeds as stars.

    Raises
    ------
    ShapeError
        If the track is of another cube.
    """
    _check(track, cube)
    rows, columns = axis_coordinates(cube, 0), axis_coordinates(cube, 1)
    names = name_axes(cube)
    ax = new_axes(8.0, 6.0) if ax is None else ax
    depth = np.ma.masked_invalid(track.depth)
    ax.set_facecolor("#e9edf2")
    drawn = ax.pcolormesh(columns, rows, depth, cmap=cmap, shading="nearest")
    if depth.count() and min(depth.shape) > 1 and np.ptp(depth.compressed()) > 0:
        lines = ax.contour(columns, rows, depth, levels=contours, colors="black", linewidths=0.6)
        ax.clabel(lines, fontsize="x-small", fmt="%g")
    ax.plot(track.seeds[:, 1], track.seeds[:, 0], "*", color="red", markeredgecolor="white", markersize=12)
    ax.set_xlabel(axis_label(names[1]))
    ax.set_ylabel(axis_label(names[0]))
    ax.invert_yaxis()
    ax.figure.colorbar(drawn, ax=ax, label=axis_label(names[2]), pad=0.02, shrink=0.8).ax.invert_yaxis()
    return ax


def track_section(cube: Any, tracks: Sequence[Any], *, ax: Any = None, **where: Any) -> Any:
    """Draw a section with the tracks, and faults if given, that cross it.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube.
    tracks : sequence of Track
        Tracks of this cube.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.
    **where
        ``inline`` or ``crossline``, ``faults``, and whatever else :func:`section` takes.

    Returns
    -------
    matplotlib Axes
        The axes.

    Raises
    ------
    ShapeError
        If a track is of another cube.
    """
    for track in tracks:
        _check(track, cube)
    ax = section(cube, ax=ax, **where)
    picture = take_picture(cube, inline=where.get("inline"), crossline=where.get("crossline"))
    for number, track in enumerate(tracks):
        line = np.take(np.asarray(track.depth), int(picture.index), axis=picture.axis)
        ax.plot(picture.columns, line, color="black", linewidth=3.0)
        ax.plot(picture.columns, line, color=_COLOURS[number % len(_COLOURS)], linewidth=1.6)
    return ax


def _check(track: Any, cube: Any) -> None:
    if track.depth.shape != tuple(cube.shape[:2]):
        raise ShapeError(
            f"track has shape {track.depth.shape}; expected {tuple(cube.shape[:2])}. Give the cube it was traced in."
        )
