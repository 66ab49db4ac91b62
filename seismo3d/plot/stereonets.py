"""Poles of faults on a stereonet."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_flag, as_kind, as_number
from seismo3d.geometry.bearings import whole_deg
from seismo3d.plot.drawing import check_axes
from seismo3d.plot.traces_of_faults import SURFACE_COLOURS
from seismo3d.seismic.network import FractureNetwork
from seismo3d.seismic.orientations import kamb_density, mean_pole


def stereonet(network: Any, *, from_north: bool, sigma: float = 3.0, ax: Any = None) -> Any:
    """Draw the poles of faults on the lower hemisphere, in equal area (Schmidt's net), with their density.

    Parameters
    ----------
    network : FractureNetwork
        The network.
    from_north : bool
        Whether azimuths are measured from north (the cube lies on a map) or from the inline axis.
    sigma : float
        Smoothing of the density, see :func:`seismo3d.seismic.orientations.kamb_density`.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        A dot for the mean pole of each fault, in the colour of its set and the size of its area; the mean plane of each
        set as a great circle; contours every two standard deviations above an even spread. Without faults the bare net.
    """
    as_kind(network, FractureNetwork, "network", remedy="Give what fracture_network returned.")
    north = as_flag(from_north, "from_north")
    width = as_number(sigma, "sigma", low=0.1, high=100.0)
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.subplots(figsize=(5.0, 5.0), layout="constrained")[1]
    check_axes(ax)
    if len(network.poles.directions):
        _draw_density(ax, network, width)
    _draw_net(ax, north)
    _draw_sets(ax, network)
    return ax


def _draw_density(ax: Any, network: Any, sigma: float) -> None:
    poles = network.poles
    x, y = np.meshgrid(np.linspace(-1, 1, 121), np.linspace(-1, 1, 121))
    inside = np.hypot(x, y) <= 1.0
    count = max(network.graph.number_of_nodes(), 1)
    density = kamb_density(poles.directions, poles.weights, _from_net(x, y), count=count, sigma=sigma)
    top = max(2.0, float(density[inside].max()))
    levels = np.arange(2.0, top + 2.0, 2.0) if top < 20.0 else np.linspace(2.0, top, 9)
    shown = np.ma.masked_array(density, ~inside)
    drawn = ax.contourf(x, y, shown, levels=np.append(0.0, levels), cmap="Greys", extend="max", alpha=0.8)
    ax.figure.colorbar(drawn, ax=ax, label="Standard deviations above an even spread", shrink=0.7, pad=0.02)


def _draw_sets(ax: Any, network: Any) -> None:
    poles = network.poles
    largest = max((network.graph.nodes[n]["area"] for n in network.graph), default=1.0)
    for number, entry in enumerate(network.sets):
        colour = SURFACE_COLOURS[number % len(SURFACE_COLOURS)]
        name = f"{whole_deg(entry.strike_deg):.0f}/{entry.dip_deg:.0f}, {100 * entry.share:.0f} % of the area"
        ax.plot(*_great_circle(entry.strike_deg, entry.dip_deg), color=colour, linewidth=1.4, label=name)
        for label in entry.surfaces:
            chosen = poles.labels == label
            at = _to_net(mean_pole(poles.directions[chosen], poles.weights[chosen])[None])[0]
            size = 15.0 + 90.0 * network.graph.nodes[label]["area"] / largest
            ax.scatter(*at, s=size, color=colour, edgecolor="white", linewidth=0.8, zorder=3)
    if network.sets:
        ax.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.02), fontsize="x-small", ncols=2, title="Sets: strike/dip"
        ).get_title().set_fontsize("x-small")


def _draw_net(ax: Any, from_north: bool) -> None:
    turn = np.radians(np.arange(0, 361, 2))
    ax.plot(np.sin(turn), np.cos(turn), color="black", linewidth=1.0)
    for azimuth in range(0, 360, 30):
        c, s = np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))
        ax.plot([s, 1.03 * s], [c, 1.03 * c], color="black", linewidth=0.8)
    for name, (east, north), side in zip(
        ("N", "E", "S", "W") if from_north else ("inline axis", "crossline\naxis", "", ""),
        ((0, 1.1), (1.06, 0), (0, -1.1), (-1.06, 0)), ("center", "left", "center", "right"), strict=True,
    ):  # fmt: skip
        ax.text(east, north, name, ha=side, va="center", fontsize="small")
    ax.plot(0, 0, "+", color="black", markersize=7)
    ax.set_aspect("equal")
    ax.set(xlim=(-1.2, 1.2 if from_north else 1.5), ylim=(-1.2, 1.2))
    ax.axis("off")
    ax.set_title("Poles of faults, lower hemisphere, equal area", fontsize="medium")


def _to_net(poles: AnyArray) -> Float64Array:
    """Place on the net of planes with poles (east, north, up) that point up."""
    poles = np.asarray(poles, dtype=np.float64)
    # the lower end of the pole, at angle t from straight down, lies sqrt(2) sin(t / 2) off the middle
    scale = 1.0 / np.sqrt(1.0 + np.clip(poles[:, 2], 0.0, 1.0))
    return np.asarray(-poles[:, :2] * scale[:, None])


def _from_net(x: AnyArray, y: AnyArray) -> Float64Array:
    """Poles (east, north, up) of places on the net; beyond its rim level ones."""
    square = np.minimum(x**2 + y**2, 1.0)
    up = 1.0 - square
    scale = np.sqrt(np.maximum(2.0 - square, 0.0))
    poles = np.stack([-x * scale, -y * scale, up], axis=-1)
    return np.asarray(poles / np.linalg.norm(poles, axis=-1, keepdims=True))


def _great_circle(strike_deg: float, dip_deg: float) -> tuple[Float64Array, Float64Array]:
    """Places on the net of the lines in a plane."""
    strike, dip = np.radians(strike_deg), np.radians(dip_deg)
    along = np.array([np.sin(strike), np.cos(strike), 0.0])
    down = np.array([np.cos(strike) * np.cos(dip), -np.sin(strike) * np.cos(dip), -np.sin(dip)])
    turn = np.linspace(0.0, np.pi, 91)[:, None]
    # _to_net draws the lower end of what points up
    places = _to_net(-(np.cos(turn) * along + np.sin(turn) * down))
    return places[:, 0], places[:, 1]
