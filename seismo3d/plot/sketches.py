"""The 3D scene drawn by matplotlib alone, for machines that have no OpenGL."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.geometry.triangles import merge_vertices
from seismo3d.plot.drawing import amplitude_limits, bar_ends
from seismo3d.plot.scene_frame import SceneFrame, slice_points
from seismo3d.plot.scenes import choose_slices, fault_values, join_surfaces, read_slice
from seismo3d.plot.traces_of_faults import value_colours
from seismo3d.seismic.cube_checks import check_faults_of

_MOST_TRIANGLES = 40_000
_MOST_CELLS = 90  # a side of a slice: matplotlib draws each cell as a polygon


def sketch_scene(cube: Any, *, faults: Any, height: float = 0.6) -> Any:
    """Draw slices and faults of a cube on matplotlib's 3D axes.

    Slices are thinned to some 90 cells a side and surfaces to some 40,000 triangles, and the depth order of surfaces
    that cross is approximate: use :func:`seismo3d.plot.cube` wherever it runs.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube of 3 axes.
    faults : FaultSet
        Faults of this cube, coloured by throw.
    height : float
        Height of the scene over its longer horizontal side.

    Returns
    -------
    matplotlib Figure
        A figure of its own, outside pyplot.
    """
    from matplotlib.figure import Figure

    check_faults_of(cube, faults)
    frame = SceneFrame.from_cube(cube, height=height)
    figure = Figure(figsize=(11, 7.5), layout="constrained")
    ax: Any = figure.add_subplot(projection="3d")
    _draw_walls(ax, cube, frame)
    if faults.surfaces:
        _draw_surfaces(ax, faults, frame)
    bounds, ranges = frame.bounds, frame.axis_ranges(cube)
    for k, (name, title) in enumerate(zip("xyz", frame.axis_titles(cube), strict=True)):
        low, high = bounds[2 * k : 2 * k + 2]
        getattr(ax, f"set_{name}lim")(low, high)
        ticks = [f"{value:.0f}" for value in np.linspace(ranges[2 * k], ranges[2 * k + 1], 5)]
        getattr(ax, f"set_{name}ticks")(np.linspace(low, high, 5), ticks)
        getattr(ax, f"set_{name}label")(title)
    ax.set_box_aspect([bounds[1] - bounds[0], bounds[3] - bounds[2], bounds[5] - bounds[4]])
    ax.view_init(elev=25, azim=-133)
    return figure


def _draw_walls(ax: Any, cube: Any, frame: SceneFrame) -> None:
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    walls = choose_slices(cube)
    pictures = [read_slice(cube, axis, index) for axis, index in enumerate(walls)]
    low, high = amplitude_limits(np.concatenate([picture.ravel() for picture in pictures]), 99.0)
    for axis, (index, values) in enumerate(zip(walls, pictures, strict=True)):
        points, shape = slice_points(frame, axis, index)
        grid = frame.place(points).reshape(*shape, 3)
        steps = [max(1, -(-n // _MOST_CELLS)) for n in shape]
        rows, columns = (np.unique([*range(0, n, step), n - 1]) for n, step in zip(shape, steps, strict=True))
        corner = grid[np.ix_(rows, columns)]
        quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=2).reshape(-1, 4, 3)
        shade = (values[np.ix_(rows[:-1], columns[:-1])].ravel() - low) / (high - low)
        colours = colormaps["gray"].with_extremes(bad="#dfe5ec")(np.ma.masked_invalid(shade))
        ax.add_collection3d(
            Poly3DCollection(list(quads), facecolors=colours, edgecolors="none", zsort="max", antialiased=False)
        )


def _draw_surfaces(ax: Any, faults: Any, frame: SceneFrame) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    vertices, cells, surface = join_surfaces(faults)
    values, title = fault_values(faults, "throw")
    size = 1.0
    while len(cells) > _MOST_TRIANGLES:
        size *= 1.5
        merged, cells = merge_vertices(vertices, cells, group=surface, size=size)
        vertices, values, surface = (_average(item, merged) for item in (vertices, values, surface))
    name, low, high = value_colours(values, "throw")
    scale = ScalarMappable(Normalize(low, high), colormaps[name].with_extremes(bad="white"))
    shades = scale.to_rgba(np.ma.masked_invalid(values[cells].mean(axis=1)))
    triangles = frame.place(vertices)[cells]
    ax.add_collection3d(
        Poly3DCollection(list(triangles), facecolors=shades, edgecolors=shades, linewidths=0.2, zsort="min")
    )
    ax.figure.colorbar(scale, ax=ax, label=title, shrink=0.6, pad=0.06, extend=bar_ends(values, low, high))


def _average(values: AnyArray, merged: AnyArray) -> Float64Array:
    """Means over merged vertices of what is known at them."""
    rows = np.asarray(values, dtype=np.float64).reshape(len(merged), -1).T
    means = []
    with np.errstate(invalid="ignore"):
        for row in rows:
            known = np.isfinite(row)
            means.append(np.bincount(merged, np.where(known, row, 0.0)) / np.bincount(merged, known))
    return np.stack(means, axis=1).reshape(-1, *np.shape(values)[1:])
