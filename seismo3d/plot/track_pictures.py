"""Tracks drawn: the depth map with contours, and the lines where tracks cross a section."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d._validate import as_kind, as_number, as_whole_number
from seismo3d.errors import ShapeError
from seismo3d.plot.drawing import NO_DATA, check_axes, check_colour_map, draw_faults, new_axes
from seismo3d.plot.map_frame import MapFrame
from seismo3d.plot.picture_set import PictureFile
from seismo3d.plot.pictures import as_tracks, axis_coordinates, axis_labels, take_picture
from seismo3d.plot.sections import section
from seismo3d.plot.traces_of_faults import cut_faults
from seismo3d.seismic.cube_checks import check_faults_of
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.track_pieces import LARGEST_STEP, are_joined, label_pieces
from seismo3d.seismic.tracks import Track

# fewest traces of a piece of a track that gets contours; entries of a legend in a row
_LEAST_CONTOURED, _LEGEND_COLUMNS = 16, 8
_COLOURS = ("#ffd54f", "#4fc3f7", "#aed581", "#ff8a65", "#ba68c8", "#4db6ac", "#f06292", "#5c6bc0")


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
        As of :func:`seismo3d.plot.time_slice`; seeds as stars. Contours end where the track jumps, as at a fault.

    Raises
    ------
    ShapeError
        If the track is of another cube.
    """
    _check(track, cube)
    if track.depth.ndim != 2:
        raise ShapeError(f"track has shape {track.depth.shape}: one of a section has no map. Use plot.track_section.")
    frame = MapFrame.from_cube(cube)
    rows, columns = frame.rows, frame.columns
    ax = new_axes(8.0, 6.0) if ax is None else check_axes(ax)
    check_colour_map(cmap)
    depth = np.ma.masked_invalid(track.depth)
    ax.set_facecolor(NO_DATA)
    drawn = ax.pcolormesh(columns, rows, depth, cmap=cmap, shading="nearest")
    _draw_contours(ax, track.depth, frame, _largest_step(cube), as_whole_number(contours, "contours", low=1, high=1000))
    ax.plot(track.seeds[:, 1], track.seeds[:, 0], "*", color="red", markeredgecolor="white", markersize=12)
    frame.lay_out(ax)
    ax.figure.colorbar(drawn, ax=ax, label=axis_labels(cube)[2], pad=0.02, shrink=0.8).ax.invert_yaxis()
    return ax


def _draw_contours(ax: Any, depth: AnyArray, frame: MapFrame, step: float, count: int) -> None:
    """Draw some contours, each within a piece of the track: across a fault they would pile up."""
    from matplotlib.ticker import MaxNLocator
    from scipy.ndimage import find_objects

    if not np.isfinite(depth).any() or min(depth.shape) < 2:
        return
    levels = MaxNLocator(count + 1, min_n_ticks=1).tick_values(np.nanmin(depth), np.nanmax(depth))
    pieces = label_pieces(depth, step)
    large = np.bincount(pieces.ravel()) >= _LEAST_CONTOURED
    labels = np.where(large, np.cumsum(large), 0)[pieces]
    for number, (rows, columns) in enumerate(find_objects(labels), start=1):
        part = np.ma.masked_array(depth[rows, columns], labels[rows, columns] != number)
        within = levels[(levels > part.min()) & (levels < part.max())]
        if min(part.shape) > 1 and len(within):
            lines = ax.contour(
                frame.columns[columns], frame.rows[rows], part, levels=within, colors="k", linewidths=0.6
            )
            ax.clabel(lines, fontsize="x-small", fmt="%g")


def _largest_step(cube: Any) -> float:
    """Return the step from a trace to the next beyond which a track jumps, in the cube's unit."""
    samples = axis_coordinates(cube, -1)
    return LARGEST_STEP * float(np.median(np.abs(np.diff(samples)))) if len(samples) > 1 else np.inf


def loop_map(closure: Any, cube: Any, *, cmap: str = "magma_r", most: float = 1.0, ax: Any = None) -> Any:
    """Draw from above by how much closed loops miss; traces where none begins stay empty.

    Parameters
    ----------
    closure : LoopClosure
        Loops of ``cube``.
    cube : DataArray or ndarray
        Gives the line numbers.
    cmap : str
        Any matplotlib colour map.
    most : float
        Error in samples at which the colours end.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        As of :func:`seismo3d.plot.time_slice`.

    Raises
    ------
    ShapeError
        If the loops are of another cube.
    """
    as_kind(closure, LoopClosure, "closure", remedy="Give what loop_closure returned.")
    if closure.error.shape != np.shape(cube)[:-1]:
        raise ShapeError(
            f"closure has shape {closure.error.shape}; expected {np.shape(cube)[:-1]}. Give the cube it is of."
        )
    highest = as_number(most, "most", low=0.0, strict=True)
    frame = MapFrame.from_cube(cube)
    ax = new_axes(8.0, 6.0) if ax is None else check_axes(ax)
    ax.set_facecolor(NO_DATA)
    check_colour_map(cmap)
    error = np.ma.masked_invalid(closure.error)
    drawn = ax.pcolormesh(frame.columns, frame.rows, error, cmap=cmap, vmin=0.0, vmax=highest, shading="nearest")
    frame.lay_out(ax)
    ax.figure.colorbar(drawn, ax=ax, label="Median loop error (samples)", pad=0.02, shrink=0.8, extend="max")
    return ax


def track_section(cube: Any, tracks: Sequence[Any], *, ax: Any = None, **where: Any) -> Any:
    """Draw a section with the tracks, and faults if given, that cross it.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube, or a section, which is drawn whole.
    tracks : sequence of Track
        Tracks of this cube.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.
    **where
        ``inline`` or ``crossline``, ``faults``, and whatever else :func:`section` takes. Without a ``colour`` faults
        are black, which no track is.

    Returns
    -------
    matplotlib Axes
        The axes; a legend above names the tracks where there are several, and what faults look like.

    Raises
    ------
    ShapeError
        If a track is of another cube.
    """
    shown = as_tracks(tracks)
    for track in shown:
        _check(track, cube)
    plain = None if "colour" in where else where.pop("faults", None)
    check_faults_of(cube, plain)
    ax = section(cube, ax=ax, **where)
    picture = take_picture(cube, inline=where.get("inline"), crossline=where.get("crossline"))
    drawn = None if plain is None else draw_faults(ax, cut_faults(plain, picture), colour="plain")
    if drawn is not None:
        drawn.set_label("fault")
    step = _largest_step(cube)
    for number, track in enumerate(shown):
        depth = np.asarray(track.depth)
        line = depth if picture.axis < 0 else np.take(depth, int(picture.index), axis=picture.axis)
        columns, line = _broken(np.asarray(picture.columns), line, step)
        ax.plot(columns, line, color="black", linewidth=3.0)
        ax.plot(columns, line, color=_COLOURS[number % len(_COLOURS)], linewidth=1.6, label=f"track {number + 1}")
    if len(shown) > 1 or (shown and drawn is not None):
        # above the picture, where it hides nothing
        ax.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=_LEGEND_COLUMNS, fontsize="small",
            frameon=False, handlelength=1.2, columnspacing=1.0,
        )  # fmt: skip
    return ax


def _broken(columns: AnyArray, line: AnyArray, step: float) -> tuple[AnyArray, AnyArray]:
    """Return a line with a gap where it jumps, as at a fault."""
    at = np.flatnonzero(~are_joined(line, step)) + 1
    return np.insert(columns.astype(np.float64), at, np.nan), np.insert(line.astype(np.float64), at, np.nan)


def save_track_pictures(
    directory: str | Path, cube: Any, tracks: Sequence[Any], *, faults: Any = None, closure: Any = None
) -> list[PictureFile]:
    """Draw the pictures of a tracks run: a map of each track, and sections through the first seed with all of them.

    Parameters
    ----------
    directory : str or Path
        A folder that is there.
    cube : DataArray or ndarray
        The cube or section.
    tracks : sequence of Track
        Its tracks.
    faults : FaultSet, optional
        Its faults, drawn on the sections.
    closure : LoopClosure, optional
        Its closed loops.

    Returns
    -------
    list of PictureFile
        ``tracks_inline.png`` and ``tracks_crossline.png`` (``tracks_section.png`` of a section), ``track_01_map.png``
        and so on, none of them without tracks, and ``loops.png`` where there are loops.
    """
    from matplotlib.figure import Figure

    directory, files = Path(directory), []
    lines: list[tuple[str, dict[str, float]]] = [("section", {})] if tracks else []
    if tracks and np.ndim(cube) == 3:
        lines = [(n, {n: float(tracks[0].seeds[0][k])}) for k, n in enumerate(("inline", "crossline"))]
    for name, where in lines:
        figure = Figure(figsize=(10.0, 5.5), layout="constrained")
        track_section(cube, tracks, faults=faults, ax=figure.add_subplot(), **where)
        figure.savefig(directory / f"tracks_{name}.png", dpi=130)
        at = "The section" if not where else f"{name.capitalize()} {where[name]:.8g}, through the first seed"
        files.append(PictureFile(directory / f"tracks_{name}.png", f"{at}, with all tracks."))
    for number, track in enumerate(tracks if np.ndim(cube) == 3 else [], start=1):
        figure = Figure(figsize=(8.0, 6.0), layout="constrained")
        track_map(track, cube, ax=figure.add_subplot())
        path = directory / f"track_{number:02d}_map.png"
        figure.savefig(path, dpi=130, bbox_inches="tight", pad_inches=0.08)
        files.append(PictureFile(path, f"Track {number} from above, with contours; seeds are stars.", kind="half"))
    if closure is not None and closure.n_loops:
        figure = Figure(figsize=(8.0, 6.0), layout="constrained")
        loop_map(closure, cube, ax=figure.add_subplot())
        figure.savefig(directory / "loops.png", dpi=130, bbox_inches="tight", pad_inches=0.08)
        text = f"By how many samples closed loops of {closure.length} traces miss, in the median of each trace."
        files.append(PictureFile(directory / "loops.png", text, kind="half"))
    return files


def _check(track: Any, cube: Any) -> None:
    as_kind(track, Track, "track", remedy="Give what trace_tracks returned, one by one.")
    if track.depth.shape != np.shape(cube)[:-1]:
        raise ShapeError(
            f"track has shape {track.depth.shape}; expected {np.shape(cube)[:-1]}. Give the cube it was traced in."
        )
