"""The fracture network drawn: connected zones and intersections on the map, density, and flow paths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_kind
from seismo3d.errors import ShapeError
from seismo3d.plot.drawing import check_all_axes, check_axes, label_axes, new_axes
from seismo3d.plot.map_frame import MapFrame
from seismo3d.plot.picture_set import PictureFile
from seismo3d.plot.pictures import at_index, axis_coordinates, axis_labels
from seismo3d.plot.traces_of_faults import SURFACE_COLOURS
from seismo3d.seismic.cube_checks import check_faults, check_faults_of
from seismo3d.seismic.flow_paths import FlowPath
from seismo3d.seismic.network import FractureNetwork

# voxels from a flow path within which the likelihood is drawn
_NEAR_PATH = 8.0
_LINES: dict[str, Any] = {"cross": "-", "abut": "--", "corner": ":"}


def network_map(network: Any, faults: Any, cube: Any, *, ax: Any = None) -> Any:
    """Draw the faults from above, one colour a connected zone, and the lines in which they meet.

    Parameters
    ----------
    network : FractureNetwork
        The network of the faults.
    faults : FaultSet
        Faults of ``cube``.
    cube : DataArray or ndarray
        A cube of 3 axes, for the coordinates.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        As of :func:`seismo3d.plot.time_slice`. Intersections are black: whole lines where faults cross, dashed where
        one ends at the other, dotted where both end.

    Raises
    ------
    ShapeError
        If the faults are of another cube.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.lines import Line2D

    _check(faults, cube)
    as_kind(network, FractureNetwork, "network", remedy="Give what fracture_network returned.")
    frame = MapFrame.from_cube(cube)
    ax = new_axes(7.5, 7.0) if ax is None else check_axes(ax)
    for number, zone in enumerate(network.zones):
        colour = SURFACE_COLOURS[number % len(SURFACE_COLOURS)]
        for label in zone.surfaces:
            surface = faults.surfaces[label - 1]
            places = frame.place(surface.vertices)
            corners = list(places[surface.cells])
            ax.add_collection(PolyCollection(corners, facecolors=colour, edgecolors="none", alpha=0.35))
            # where the fault is shallowest: the middles of faults that cross lie on each other
            top = places[surface.vertices[:, 2] <= np.quantile(surface.vertices[:, 2], 0.1)].mean(axis=0)
            ax.annotate(str(label), top, fontsize="small", ha="center", va="center", path_effects=_halo())
    for line in network.intersections:
        ends = frame.place(line.points)[line.segments]
        ax.add_collection(LineCollection(list(ends), colors="black", linewidths=1.6, linestyles=_LINES[line.kind]))
    frame.lay_out(ax)
    ax.locator_params(axis="x", nbins=6)
    kinds = [kind for kind in _LINES if any(line.kind == kind for line in network.intersections)]
    words = {"cross": "they cross", "abut": "one ends at the other", "corner": "both end"}
    handles = [Line2D([], [], color="black", linestyle=_LINES[kind], label=words[kind]) for kind in kinds]
    if handles:
        ax.legend(handles=handles, loc="lower right", fontsize="small", framealpha=0.9)
    n = len(network.zones)
    few = ("no faults", "all faults connected")
    ax.set_title(few[n] if n < 2 else f"{n} connected zones, one colour each", loc="left", fontsize="medium")
    return ax


def _halo() -> list[Any]:
    """Return what keeps a number readable on lines and colours."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.0, foreground="white")]


def density_map(network: Any, cube: Any, *, ax: Any = None) -> Any:
    """Draw the mean fault density of the columns of cells, from above.

    Parameters
    ----------
    network : FractureNetwork
        The network.
    cube : DataArray or ndarray
        The cube of 3 axes that it is of, for the coordinates.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        As of :func:`seismo3d.plot.time_slice`.
    """
    as_kind(network, FractureNetwork, "network", remedy="Give what fracture_network returned.")
    frame = MapFrame.from_cube(cube)
    ax = new_axes(7.5, 6.5) if ax is None else check_axes(ax)
    n = np.shape(cube)[2]
    thick = np.diff(np.minimum(np.arange(network.density.shape[2] + 1) * network.cell[2], n))
    mean = network.density @ (thick / thick.sum())
    down, across = (_cell_edges(lines, network.cell[k]) for k, lines in enumerate((frame.rows, frame.columns)))
    drawn = ax.pcolormesh(across, down, mean, cmap="magma_r", vmin=0.0, vmax=float(mean.max()) or 1.0)
    frame.lay_out(ax)
    ax.locator_params(axis="x", nbins=6)
    ax.figure.colorbar(drawn, ax=ax, label=f"Fault area over volume (1/{network.unit})", pad=0.02, shrink=0.8)
    ax.set_title("Fault density (P32), mean over depth", loc="left", fontsize="medium")
    return ax


def flow_path_views(path: Any, faults: Any, cube: Any, *, axes: Sequence[Any] | None = None) -> Any:
    """Draw a flow path from above and from two sides, over the largest fault likelihood within 8 voxels of it.

    Parameters
    ----------
    path : FlowPath
        The path.
    faults : FaultSet
        The faults of ``cube`` that it was found in.
    cube : DataArray or ndarray
        A cube of 3 axes, for the coordinates.
    axes : three matplotlib Axes, optional
        Where to draw: map, along the inlines, along the crosslines; a new pyplot figure by default.

    Returns
    -------
    list of matplotlib Axes

    Raises
    ------
    ShapeError
        If the faults are of another cube.
    """
    as_kind(path, FlowPath, "path", remedy="Give what flow_path returned.")
    _check(faults, cube)
    if axes is None:
        import matplotlib.pyplot as plt

        axes = plt.subplots(1, 3, figsize=(14.0, 4.8), layout="constrained")[1]
    labels = axis_labels(cube)
    at, likelihood = _likelihood_near(path, faults)
    for ax, (across, down) in zip(check_all_axes(axes, 3), ((1, 0), (1, 2), (0, 2)), strict=True):
        x, y = axis_coordinates(cube, across), axis_coordinates(cube, down)
        behind = np.zeros((len(x), len(y)))
        np.maximum.at(behind, (at[:, across], at[:, down]), likelihood)
        ax.pcolormesh(x, y, behind.T, cmap="Greys", vmin=0.0, vmax=1.0, shading="nearest", rasterized=True)
        ax.plot(x[path.voxels[:, across]], y[path.voxels[:, down]], color="#0072b2", linewidth=2.2)
        for end, marker in ((0, "o"), (-1, "s")):
            place = x[path.voxels[end, across]], y[path.voxels[end, down]]
            ax.plot(*place, marker, color="#e6194b", markeredgecolor="white", markersize=8)
        label_axes(ax, labels[across], labels[down])
        ax.set_ylim(max(y), min(y))
        ax.locator_params(axis="x", nbins=6)
    MapFrame.from_cube(cube).lay_out(axes[0])
    axes[0].locator_params(axis="x", nbins=3)  # a map may be narrow
    unit = "bins" if path.unit == "bin" else path.unit
    axes[0].set_title(
        f"Length {path.length:,.0f} {unit}, {100 * path.share_on_faults:.0f} % on faults",
        loc="left",
        fontsize="medium",
    )
    return list(axes)


def save_network_pictures(directory: str | Path, network: Any, faults: Any, *, path: Any = None) -> list[PictureFile]:
    """Draw the pictures of a network run.

    Parameters
    ----------
    directory : str or Path
        A folder that is there.
    network : FractureNetwork
        The network.
    faults : FaultSet
        Its faults; their volumes give the coordinates.
    path : FlowPath, optional
        A flow path through them.

    Returns
    -------
    list of PictureFile
        ``map.png``, ``density.png``, ``stereonet.png``, ``rose.png``, and ``flow_path.png`` where there is a path.
    """
    from matplotlib.figure import Figure

    from seismo3d.geometry.survey import SurveyGeometry
    from seismo3d.plot.distributions import strike_rose
    from seismo3d.plot.stereonets import stereonet

    directory, cube = Path(directory), faults.labels
    north = hasattr(cube, "dims") and SurveyGeometry.from_cube(cube).has_map
    origin = "from north" if north else "from the inline axis: the cube has no map coordinates"
    dips = "; dips in bins and samples" if network.unit == "bin" else ""
    jobs: list[tuple[str, tuple[float, float], Any, dict[str, str], str]] = [
        ("map", (7.5, 7.0), lambda ax: network_map(network, faults, cube, ax=ax), {},
         "All faults from above, one colour a connected zone, and the lines in which they meet."),
        ("density", (7.5, 6.5), lambda ax: density_map(network, cube, ax=ax), {},
         "Fault area over volume, averaged over depth."),
        ("stereonet", (5.6, 5.8), lambda ax: stereonet(network, from_north=north, ax=ax), {},
         f"Poles of the faults, the mean plane of each set, and density after Kamb; azimuths {origin}{dips}."),
        ("rose", (4.8, 4.6), lambda ax: strike_rose(faults, from_north=north, ax=ax), {"projection": "polar"},
         f"Strike, {origin}. The area of a petal is its share of the fault area."),
    ]  # fmt: skip
    files = []
    for name, size, draw, axes, caption in jobs:
        figure = Figure(figsize=size, layout="constrained")
        draw(figure.add_subplot(**axes))
        figure.savefig(directory / f"{name}.png", dpi=130, bbox_inches="tight", pad_inches=0.08)
        files.append(PictureFile(directory / f"{name}.png", caption, kind="half"))
    if path is not None:
        figure = Figure(figsize=(14.0, 4.8), layout="constrained")
        flow_path_views(path, faults, cube, axes=figure.subplots(1, 3))
        figure.savefig(directory / "flow_path.png", dpi=130)
        caption = (
            "The flow path from above and from two sides, over the fault likelihood near it; the circle is its start."
        )
        files.append(PictureFile(directory / "flow_path.png", caption))
    return files


def _likelihood_near(path: Any, faults: Any) -> tuple[Any, Any]:
    """Voxels of some likelihood near a path, and that likelihood."""
    from scipy.spatial import cKDTree

    likelihood = np.nan_to_num(np.asarray(faults.likelihood))
    voxels = np.argwhere(likelihood > 0)
    if len(voxels):
        voxels = voxels[np.isfinite(cKDTree(path.voxels).query(voxels, distance_upper_bound=_NEAR_PATH)[0])]
    return voxels, likelihood[tuple(voxels.T)]


def _cell_edges(lines: Float64Array, cell: int) -> Float64Array:
    """Line numbers at the edges of cells of so many lines; the last one may be narrower."""
    return at_index(lines, np.minimum(np.arange(-(-len(lines) // cell) + 1) * cell, len(lines)) - 0.5)


def _check(faults: Any, cube: Any) -> None:
    check_faults(faults)
    check_faults_of(cube, faults)
    if np.ndim(cube) != 3:
        raise ShapeError(f"cube has shape {np.shape(cube)}: a section has no fracture network. Give a cube.")
