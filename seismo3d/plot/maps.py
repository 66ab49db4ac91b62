"""Views from above: time slices, and where the throw is."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.plot.drawing import NO_DATA, bar_ends, check_axes, draw_amplitudes, draw_faults, new_axes
from seismo3d.plot.map_frame import MapFrame
from seismo3d.plot.pictures import live_traces, name_axes, take_picture
from seismo3d.plot.traces_of_faults import check_colour, cut_faults, display_throw, value_colours
from seismo3d.seismic.cube_checks import check_faults, check_faults_of


def time_slice(
    cube: Any,
    *,
    time: float | None = None,
    depth: float | None = None,
    sample: float | None = None,
    inline: float | None = None,
    crossline: float | None = None,
    faults: Any = None,
    colour: str = "surface",
    cmap: str = "gray",
    clip: float = 99.0,
    ax: Any = None,
) -> Any:
    """Draw a time or depth slice, with the faults that cross it.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube of 3 axes. Of a lazy cube only the slice is read.
    time, depth : float, optional
        Time in ms or depth in m; the middle sample by default.
    sample : float, optional
        The same by sample index.
    inline, crossline : float, optional
        Refused: a time slice has no such position.
    faults, colour, cmap, clip, ax
        As in :func:`seismo3d.plot.section`.

    Returns
    -------
    matplotlib Axes
        Crosslines to the right, inlines up or down as on the map, downwards without one; bins drawn in their true
        proportions.

    Raises
    ------
    ParameterError
        If more than one position is given, or a line, or it is not on the cube.
    ShapeError
        If the cube is a section, or the faults are of another cube.
    """
    check_colour(colour)
    check_faults_of(cube, faults)
    if len(name_axes(cube)) == 2:
        raise ShapeError(f"cube has shape {np.shape(cube)}: a section has no time slice. Use plot.section.")
    where = {"time": time, "depth": depth, "sample": sample}
    if all(value is None for value in where.values()):
        for name, line in (("inline", inline), ("crossline", crossline)):
            if line is not None:
                raise ParameterError(
                    f"{name} is {line!r}; expected the time, depth or sample of a time slice. Use plot.section."
                )
        where["sample"] = cube.shape[2] // 2
    picture = take_picture(cube, **where, inline=inline, crossline=crossline)
    ax = new_axes(7.5, 7.0) if ax is None else check_axes(ax)
    draw_amplitudes(ax, picture, cmap=cmap, clip=clip)
    MapFrame.from_cube(cube).lay_out(ax)
    if faults is not None:
        draw_faults(ax, cut_faults(faults, picture), colour=colour)
    return ax


def throw_map(faults: Any, cube: Any, *, ax: Any = None) -> Any:
    """Draw every fault from above, coloured by throw.

    Parameters
    ----------
    faults : FaultSet
        Faults of ``cube``; deeper parts lie below shallower ones.
    cube : DataArray or ndarray
        A cube of 3 axes, for the coordinates.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        As of :func:`time_slice`. Unknown throw is white; the area without data is hatched.

    Raises
    ------
    ShapeError
        If the cube is a section, or the faults are of another cube.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    check_faults(faults)
    check_faults_of(cube, faults)
    frame = MapFrame.from_cube(cube)
    ax = new_axes(7.5, 7.0) if ax is None else check_axes(ax)
    ax.contourf(frame.columns, frame.rows, ~live_traces(cube), levels=[0.5, 1.5], hatches=["///"], colors=NO_DATA)
    everything = [display_throw(surface)[0] for surface in faults.surfaces]
    name, low, high = value_colours(np.concatenate(everything) if everything else np.zeros(0), "throw")
    colours = ScalarMappable(Normalize(low, high), colormaps[name].with_extremes(bad="white"))
    triangles, values, depths = [], [], []
    for surface, throw in zip(faults.surfaces, everything, strict=True):
        triangles.append(frame.place(surface.vertices)[surface.cells])
        values.append(throw[surface.cells].mean(axis=1))
        depths.append(surface.vertices[surface.cells, 2].mean(axis=1))
    if triangles:
        order = np.argsort(-np.concatenate(depths), kind="stable")
        shades = colours.to_rgba(np.ma.masked_invalid(np.concatenate(values)[order]))
        ax.add_collection(
            PolyCollection(list(np.concatenate(triangles)[order]), facecolors=shades, edgecolors=shades, linewidths=0.3)
        )
    unit = display_throw(faults.surfaces[0])[1] if faults.surfaces else "samples"
    beyond = bar_ends(np.concatenate(values) if values else np.zeros(0), low, high)
    ax.figure.colorbar(colours, ax=ax, label=f"Throw ({unit})", pad=0.02, shrink=0.8, extend=beyond)
    frame.lay_out(ax)
    ax.set_title("Throw, seen from above", loc="left", fontsize="medium")
    return ax
