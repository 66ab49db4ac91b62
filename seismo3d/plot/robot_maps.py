"""Maps for robots: what is free, occupied and unknown, what the ground costs, and the way through."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._validate import as_kind
from seismo3d.plot.drawing import check_axes, new_axes
from seismo3d.robot.occupancy import Occupancy

_FREE, _OCCUPIED, _UNKNOWN, _KEPT_OFF = "#f7f7f2", "#30343b", "#b9bfc9", "#e3a79b"


def occupancy_map(occupancy: Any, *, path: Any = None, traversability: Any = None, ax: Any = None) -> Any:
    """Draw a map from above, and a path coloured by its speed.

    Parameters
    ----------
    occupancy : Occupancy
        From :mod:`seismo3d.robot`.
    path : Path, optional
        One that was found; one without a way is not drawn.
    traversability : Traversability, optional
        Free cells that the robot's middle must not enter are tinted, and dear ground is darker.
    ax : matplotlib Axes, optional

    Returns
    -------
    matplotlib Axes
        In map axes, metres; x to the right, y up.
    """
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    as_kind(occupancy, Occupancy, "occupancy", remedy="Give Occupancy(...), or what Mapper.occupancy returns.")
    left, right, low, high = occupancy.extent
    if ax is None:
        ratio = float(np.clip((high - low) / (right - left), 0.4, 2.0))
        ax = new_axes(7.5, 7.5 * ratio)
    check_axes(ax)
    image = np.empty((*occupancy.shape, 3))
    for value, colour in ((0, _FREE), (1, _OCCUPIED), (2, _UNKNOWN)):
        image[occupancy.cells == value] = to_rgb(colour)
    legend = {"free": _FREE, "occupied": _OCCUPIED, "unknown": _UNKNOWN}
    if traversability is not None:
        free = occupancy.cells == 0
        dear = np.clip((traversability.cost / 128.0 - 1.0) / 4.0, 0.0, 1.0)[:, :, None]
        image = np.where(free[:, :, None], image * (1.0 - 0.45 * dear), image)
        image[free & (traversability.cost == 0)] = to_rgb(_KEPT_OFF)
        legend["not for its middle"] = _KEPT_OFF
    ax.imshow(image, extent=(left, right, low, high), origin="lower", interpolation="nearest")
    if path is not None and len(path.poses):
        _draw_path(ax, path)
    handles = [Patch(facecolor=colour, edgecolor="0.5", label=name) for name, colour in legend.items()]
    handles = [*ax.get_legend_handles_labels()[0], *handles]
    ax.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, fontsize="x-small", frameon=False
    )
    ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(left, right), ylim=(low, high))
    ax.set_aspect("equal")
    return ax


def _draw_path(ax: Any, path: Any) -> None:
    from matplotlib.collections import LineCollection

    xy = path.poses[:, :2]
    pieces = np.stack([xy[:-1], xy[1:]], axis=1)
    ax.add_collection(LineCollection(list(pieces), colors="white", linewidths=4.2, capstyle="round"))
    line = LineCollection(list(pieces), linewidths=2.4, capstyle="round", cmap="viridis")
    line.set_array(0.5 * (path.speeds[1:] + path.speeds[:-1]))
    ax.add_collection(line)
    if len(pieces):
        ax.figure.colorbar(line, ax=ax, label="Speed (m/s)", pad=0.02, shrink=0.8)
    ax.plot(*xy[0], "o", color="#1b7837", markersize=8, markeredgecolor="white", label="start")
    ax.plot(*xy[-1], "*", color="#c218c2", markersize=13, markeredgecolor="white", label="goal")
