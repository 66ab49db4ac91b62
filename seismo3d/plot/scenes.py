"""3D scenes: a cube's slices, fault surfaces and tracks, with pyvista."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_flag, as_number, as_whole_numbers
from seismo3d.errors import ShapeError
from seismo3d.plot.drawing import amplitude_limits, check_colour_map
from seismo3d.plot.pictures import as_tracks, axis_coordinates, find_index, live_on_slice
from seismo3d.plot.rendering import has_screen, windowless
from seismo3d.plot.scene_frame import SceneFrame, far_slices, slice_points
from seismo3d.plot.scene_view import add_axes, aim_camera
from seismo3d.plot.traces_of_faults import SURFACE_COLOURS, check_colour, display_throw, value_colours
from seismo3d.seismic.cube_checks import check_faults_of

_TRACK_COLOURS = ("#ffd54f", "#4fc3f7", "#aed581", "#ff8a65", "#ba68c8")


def cube(
    cube: Any,
    *,
    faults: Any = None,
    tracks: Sequence[Any] | None = None,
    colour: str = "throw",
    inline: float | None = None,
    crossline: float | None = None,
    sample: float | None = None,
    cmap: str = "gray",
    clip: float = 99.0,
    height: float = 0.6,
    off_screen: bool | None = None,
    size: tuple[int, int] | None = None,
) -> Any:
    """Make a 3D scene: three slices of the cube, fault surfaces, tracks.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube of 3 axes. Of a lazy cube only the three slices are read.
    faults : FaultSet, optional
        Faults of this cube.
    tracks : sequence of Track or arrays, optional
        Horizons as maps of the sample coordinate (or of the sample index, where the cube is a bare array), NaN where
        there is none.
    colour : {"throw", "likelihood", "surface"}
        What the colour of a fault says; unknown throw is white.
    inline, crossline : float, optional
        Line numbers of the vertical slices (indices on a bare array); the back walls by default, which leave the faults
        in view.
    sample : float, optional
        Index of the horizontal slice; the floor by default.
    cmap : str
        Colour map of the amplitudes.
    clip : float
        Percentile of the absolute amplitude that gets the strongest colour.
    height : float
        Height of the scene over its longer horizontal side.
    off_screen : bool, optional
        Draw without a window; by default where there is no display.
    size : (int, int), optional
        Width and height in pixels.

    Returns
    -------
    pyvista.Plotter
        The scene: ``show()`` it, or take a ``screenshot``. Close it when done.

    Raises
    ------
    RenderError
        If there is neither a display nor a renderer that works without one.
    ShapeError
        If the cube is a section, or faults or tracks are of another cube.
    """
    import pyvista as pv

    check_colour(colour)
    check_colour_map(cmap)
    check_faults_of(cube, faults)
    frame = SceneFrame.from_cube(cube, height=height)
    walls = choose_slices(cube, inline=inline, crossline=crossline, sample=sample)
    maps = [_index_map(track, cube) for track in as_tracks(tracks)]
    off_screen = not has_screen() if off_screen is None else as_flag(off_screen, "off_screen")
    pixels = None if size is None else list(as_whole_numbers(size, "size", n=2, low=1, high=16384))
    with windowless() if off_screen else nullcontext():
        plotter = pv.Plotter(off_screen=off_screen, window_size=pixels, theme=pv.themes.DocumentTheme())
    _add_slices(plotter, cube, frame, walls, cmap=cmap, clip=clip)
    for number, depth in enumerate(maps):
        points, cells = grid_cells(depth)
        mesh = pv.PolyData.from_regular_faces(frame.place(points), cells)
        plotter.add_mesh(
            mesh, color=_TRACK_COLOURS[number % len(_TRACK_COLOURS)], smooth_shading=True, name=f"track {number}"
        )
    if faults is not None and faults.surfaces:
        _add_faults(plotter, faults, frame, colour)
    add_axes(plotter, cube, frame)
    aim_camera(plotter, frame.bounds)
    return plotter


def choose_slices(
    cube: Any, *, inline: float | None = None, crossline: float | None = None, sample: float | None = None
) -> tuple[int, int, int]:
    """Choose the indices of the scene's three slices: those asked for, else the back walls and the floor."""
    far = far_slices(cube)
    return (
        far[0] if inline is None else find_index(cube, 0, as_number(inline, "inline")),
        far[1] if crossline is None else find_index(cube, 1, as_number(crossline, "crossline")),
        far[2] if sample is None else find_index(cube, 2, as_number(sample, "sample"), as_index=True),
    )


def read_slice(cube: Any, axis: int, index: int) -> Float64Array:
    """One slice of a cube with NaN on traces that are not live."""
    cut = cube[(slice(None),) * axis + (index,)]
    values = np.array(cut.data if hasattr(cut, "dims") else cut, dtype=np.float64)
    values[~live_on_slice(cube, axis, index)] = np.nan
    return values


def join_surfaces(faults: Any) -> tuple[Float64Array, AnyArray, AnyArray]:
    """Vertices and triangles of all surfaces in one list, and each vertex's surface, from 1."""
    sizes = [len(surface.vertices) for surface in faults.surfaces]
    starts = np.cumsum([0, *sizes[:-1]])
    vertices = np.concatenate([np.asarray(surface.vertices, dtype=np.float64) for surface in faults.surfaces])
    cells = np.concatenate([surface.cells + start for surface, start in zip(faults.surfaces, starts, strict=True)])
    return vertices, cells, np.repeat(np.arange(1, len(sizes) + 1), sizes)


def fault_values(faults: Any, colour: str) -> tuple[AnyArray, str]:
    """Throw or likelihood at the vertices of all surfaces, and what it is called."""
    if colour == "likelihood":
        return np.concatenate([surface.likelihood for surface in faults.surfaces]), "Fault likelihood"
    throws = [display_throw(surface) for surface in faults.surfaces]
    return np.concatenate([throw for throw, _ in throws]), f"Throw ({throws[0][1]})"


def grid_cells(depth: AnyArray) -> tuple[Float64Array, AnyArray]:
    """Index points of a map, and the squares whose four corners are known."""
    rows, columns = np.meshgrid(*(np.arange(n) for n in depth.shape), indexing="ij")
    points = np.stack([rows.ravel(), columns.ravel(), np.nan_to_num(depth).ravel()], axis=1).astype(np.float64)
    numbers = np.arange(depth.size).reshape(depth.shape)
    corners = np.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]], axis=-1).reshape(-1, 4)
    return points, corners[np.isfinite(depth.ravel()[corners]).all(axis=1)]


def _index_map(track: Any, cube: Any) -> Float64Array:
    depth = np.asarray(getattr(track, "depth", track), dtype=np.float64)
    if depth.shape != tuple(cube.shape[:2]):
        raise ShapeError(
            f"track has shape {depth.shape}; expected {tuple(cube.shape[:2])}, one depth a trace of the cube."
        )
    coordinates = axis_coordinates(cube, 2)
    inside = (depth >= coordinates[0]) & (depth <= coordinates[-1])
    return np.where(inside, np.interp(np.nan_to_num(depth), coordinates, np.arange(len(coordinates))), np.nan)


def _add_slices(
    plotter: Any, cube: Any, frame: SceneFrame, walls: tuple[int, int, int], *, cmap: str, clip: float
) -> None:
    import pyvista as pv

    pictures = [read_slice(cube, axis, index) for axis, index in enumerate(walls)]
    limits = amplitude_limits(np.concatenate([picture.ravel() for picture in pictures]), clip)
    for axis, (index, values) in enumerate(zip(walls, pictures, strict=True)):
        points, shape = slice_points(frame, axis, index)
        grid = pv.StructuredGrid()
        grid.points = frame.place(points)
        grid.dimensions = (shape[1], shape[0], 1)
        grid["amplitude"] = values.ravel()
        plotter.add_mesh(
            grid,
            scalars="amplitude",
            cmap=cmap,
            clim=limits,
            nan_color="#dfe5ec",
            lighting=False,
            show_scalar_bar=False,
            copy_mesh=True,
            name=f"slice {axis}",
        )


def _add_faults(plotter: Any, faults: Any, frame: SceneFrame, colour: str) -> None:
    import pyvista as pv

    vertices, cells, surface = join_surfaces(faults)
    mesh = pv.PolyData.from_regular_faces(frame.place(vertices), cells)
    looks = {
        "smooth_shading": True,
        "split_sharp_edges": False,
        "ambient": 0.65,
        "diffuse": 0.45,
        "specular": 0.0,
        "name": "faults",
    }
    if colour == "surface":
        shades = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in SURFACE_COLOURS], dtype=np.uint8)
        mesh["colour"] = shades[(surface - 1) % len(shades)]
        plotter.add_mesh(mesh, scalars="colour", rgb=True, **looks)
        return
    values, title = fault_values(faults, colour)
    cmap, low, high = value_colours(values, colour)
    bar = {"title": title, "vertical": True, "position_x": 0.90, "position_y": 0.25, "height": 0.5, "width": 0.05}
    digits = "{:.0f}" if max(-low, high) >= 100 else "{:.3g}"
    bar |= {"color": "black", "title_font_size": 20, "label_font_size": 18, "n_labels": 5, "fmt": digits}
    mesh[title] = values
    plotter.add_mesh(mesh, scalars=title, cmap=cmap, clim=(low, high), nan_color="white", scalar_bar_args=bar, **looks)
