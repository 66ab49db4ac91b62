"""Vertical sections with faults."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.plot.drawing import check_axes, draw_amplitudes, draw_faults, new_axes
from seismo3d.plot.map_frame import MapFrame
from seismo3d.plot.pictures import Picture, axis_coordinates, live_traces, name_axes, take_picture
from seismo3d.plot.traces_of_faults import check_colour, cut_faults
from seismo3d.seismic.cube_checks import check_faults, check_faults_of


def section(
    cube: Any,
    *,
    inline: float | None = None,
    crossline: float | None = None,
    time: float | None = None,
    depth: float | None = None,
    sample: float | None = None,
    faults: Any = None,
    colour: str = "surface",
    cmap: str = "gray",
    clip: float = 99.0,
    ax: Any = None,
) -> Any:
    """Draw one section of a cube, with the faults that cross it.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube, or a 2D section, which is drawn whole. Of a lazy cube only the slice is read.
    inline, crossline : float, optional
        Line number (index on a bare array) of the section; the middle inline by default.
    time, depth : float, optional
        Time in ms or depth in m: draws the time or depth slice instead.
    sample : float, optional
        The same by sample index.
    faults : FaultSet, optional
        Faults of this cube; drawn as lines where their surfaces cross the section.
    colour : {"surface", "throw", "likelihood"}
        What the colour of a fault says. Points of unknown throw are white.
    cmap : str
        Any matplotlib colour map, such as "gray" or "seismic".
    clip : float
        Percentile of the absolute amplitude that gets the strongest colour.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        The axes, in line numbers and ms, m or ft. Missing and dead traces are shown in a flat colour of their own.

    Raises
    ------
    ParameterError
        If more than one position is given, or it is not on the cube.
    ShapeError
        If the faults are of another cube.
    """
    if time is not None or depth is not None or sample is not None:
        from seismo3d.plot.maps import time_slice

        where = {"inline": inline, "crossline": crossline, "time": time, "depth": depth, "sample": sample}
        return time_slice(cube, faults=faults, colour=colour, cmap=cmap, clip=clip, ax=ax, **where)
    check_colour(colour)
    check_faults_of(cube, faults)
    picture = take_picture(cube, inline=inline, crossline=crossline)
    ax = _axes_for(picture) if ax is None else check_axes(ax)
    draw_amplitudes(ax, picture, cmap=cmap, clip=clip)
    if faults is not None:
        draw_faults(ax, cut_faults(faults, picture), colour=colour)
    return ax


def likelihood(
    cube: Any,
    *,
    faults: Any,
    inline: float | None = None,
    crossline: float | None = None,
    time: float | None = None,
    depth: float | None = None,
    sample: float | None = None,
    clip: float = 99.0,
    ax: Any = None,
) -> Any:
    """Draw a section or time slice with the fault likelihood of every voxel over it.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube, or a 2D section.
    faults : FaultSet
        Faults of this cube.
    inline, crossline, time, depth, sample : float, optional
        One position, as in :func:`section`.
    clip : float
        Percentile of the absolute amplitude that gets the strongest grey.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        The axes. Likelihood is transparent at 0.

    Raises
    ------
    ParameterError
        If more than one position is given, or it is not on the cube.
    ShapeError
        If the faults are of another cube.
    """
    check_faults(faults)
    check_faults_of(cube, faults)
    where = {"inline": inline, "crossline": crossline, "time": time, "depth": depth, "sample": sample}
    picture = take_picture(cube, **where)
    same_coordinates = cube.copy(data=faults.likelihood) if hasattr(cube, "dims") else faults.likelihood
    over = take_picture(same_coordinates, **where).values
    ax = _axes_for(picture) if ax is None else check_axes(ax)
    draw_amplitudes(ax, picture, cmap="gray", clip=clip)
    shown = np.ma.masked_array(over, mask=~(over > 0))
    drawn = ax.imshow(
        shown, cmap="plasma", vmin=0, vmax=1, extent=picture.extent, aspect="auto", interpolation="nearest"
    )
    if picture.axis == 2:
        MapFrame.from_cube(cube).lay_out(ax)
    ax.figure.colorbar(drawn, ax=ax, label="Fault likelihood", pad=0.02, shrink=0.8)
    return ax


def most_faulted_lines(faults: Any, cube: Any) -> dict[str, float]:
    """Coordinates of the inline, the crossline and the time or depth slice that cross most fault voxels.

    Lines without live traces, and the outermost tenth of the samples, are left out.

    Parameters
    ----------
    faults : FaultSet
        The faults of ``cube``; without any the middle lines are chosen.
    cube : DataArray or ndarray
        A cube of 3 axes.

    Returns
    -------
    dict of str to float
        Coordinate by axis name.
    """
    names = name_axes(cube)
    found = {}
    counts = count_fault_voxels(faults)
    for axis, name in enumerate(names):
        count = counts[axis]
        if axis < 2:
            count[~live_traces(cube).any(axis=1 - axis)] = -1.0
        else:
            margin = len(count) // 10
            count[:margin] = count[len(count) - margin :] = -1.0
        middle = np.abs(np.arange(len(count)) - (len(count) - 1) / 2)
        found[name] = float(axis_coordinates(cube, axis)[np.lexsort((middle, -count))[0]])
    return found


def count_fault_voxels(faults: Any) -> list[Float64Array]:
    """Count the fault voxels on every inline, on every crossline and at every sample; lazy labels a slab at a time."""
    labels = faults.labels.data if hasattr(faults.labels, "dims") else faults.labels
    shape = labels.shape
    counts = [np.zeros(n) for n in shape]
    slab = shape[0] if isinstance(labels, np.ndarray) else labels.chunks[0][0]
    for start in range(0, shape[0], slab):
        drawn = np.asarray(labels[start : start + slab]) > 0
        for axis, count in enumerate(counts):
            others = tuple(k for k in range(3) if k != axis)
            into = count[start : start + slab] if axis == 0 else count
            into += drawn.sum(axis=others)
    return counts


def _axes_for(picture: Picture) -> Any:
    n_rows, n_columns = picture.values.shape
    width = float(np.clip(9.0 * n_columns / max(n_rows, 1), 6.0, 12.0))
    return new_axes(width, 5.5)
