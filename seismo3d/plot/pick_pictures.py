"""Picks beside what was traced."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from seismo3d.plot.drawing import bar_ends, check_axes, label_axes, new_axes
from seismo3d.plot.map_frame import MapFrame


def picked_faults_map(faults: Any, sticks: Sequence[Any], score: Any, *, ax: Any = None) -> Any:
    """Draw traced faults and picked sticks from above, in line numbers.

    Parameters
    ----------
    faults : FaultSet
        Traced faults.
    sticks : sequence of FaultStick
        Picked sticks.
    score : StickScore
        Of these two.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        Surfaces that agree with the picks in grey, new ones in blue; sticks of faults that were found in green, of
        missed ones in red, and none of faults that lie outside the cube. As of :func:`seismo3d.plot.time_slice`.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from seismo3d.seismic.picks import place_stick

    frame = MapFrame.from_cube(faults.labels)
    ax = new_axes(7.5, 7.0) if ax is None else check_axes(ax)
    for label, surface in enumerate(faults.surfaces, start=1):
        places = frame.place(surface.vertices)
        colour = "#56b4e9" if label in score.new else "0.55"
        ax.add_collection(PolyCollection(list(places[surface.cells]), facecolors=colour, edgecolors="none", alpha=0.5))
    for missed, colour in ((False, "#009e73"), (True, "#d62728")):
        names = {row.name for row in score.faults if (row.name in score.missed) == missed}
        chosen = [stick for stick in sticks if stick.fault in names]
        lines = [frame.place(place_stick(stick, faults.labels)) for stick in chosen]
        ax.add_collection(LineCollection(lines, colors=colour, linewidths=1.4))
        # an upright stick is a point from above
        nodes = np.concatenate(lines) if lines else np.zeros((0, 2))
        ax.plot(*nodes.T, ".", color=colour, markersize=3)
    frame.lay_out(ax)
    ax.legend(
        handles=[
            Patch(color="0.55", alpha=0.5, label="traced, near picks"),
            Patch(color="#56b4e9", alpha=0.5, label=f"traced, new ({len(score.new)})"),
            Line2D([], [], color="#009e73", label="picked, found"),
            Line2D([], [], color="#d62728", label=f"picked, missed ({len(score.missed)})"),
        ],
        loc="lower right", fontsize="small", framealpha=0.9,
    )  # fmt: skip
    within = f"{100 * score.within:.0f} % of the sticks within {score.tolerance:g} traces and samples"
    ax.set_title(within, loc="left", fontsize="medium")
    return ax


def pick_distance_map(
    track: Any, picks: Any, *, unit: str, cube: Any = None, apart: float | None = None, ax: Any = None
) -> Any:
    """Draw how far below the picks a track lies, at the picks.

    Parameters
    ----------
    track, picks : HorizonPoints
        What was traced, and what was picked.
    unit : str
        Of their times or depths.
    cube : DataArray, optional
        The cube that both are of: then picks meet the nearest trace.
    apart : float, optional
        Largest distance in x and y at which two points are of one trace. [default: from the track's traces]
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes
        x and y as in the picks' file, or line numbers where both files have them; picks where nothing was traced black.
    """
    from scipy.spatial import cKDTree

    from seismo3d.seismic.horizon_scores import flat_places, have_lines, same_trace_distance

    ax = new_axes(7.5, 6.5) if ax is None else check_axes(ax)
    by_lines = have_lines(picks, track)
    apart = same_trace_distance([track]) if apart is None else apart
    here, there, reach = flat_places(picks, track, apart=apart, cube=cube)
    distance, near = cKDTree(there).query(here, distance_upper_bound=reach + 1e-9)
    common = np.isfinite(distance)
    down = track.points[np.asarray(near)[common], 2] - picks.points[common, 2]
    limit = float(np.percentile(np.abs(down), 95.0)) or 1.0 if len(down) else 1.0
    across = (1, 0) if by_lines else (0, 1)
    here = picks.lines if by_lines else picks.points[:, :2]
    ax.set_facecolor("0.7")  # what agrees is white
    ax.plot(*here[~common][:, across].T, ",", color="black")
    drawn = ax.scatter(*here[common][:, across].T, c=down, s=4, cmap="RdBu_r", vmin=-limit, vmax=limit, linewidths=0)
    beyond = bar_ends(down, -limit, limit)
    ax.figure.colorbar(drawn, ax=ax, label=f"Track below picks ({unit})", pad=0.02, shrink=0.8, extend=beyond)
    label_axes(ax, *("Crossline", "Inline") if by_lines else ("x", "y"))
    if not by_lines:
        ax.set_aspect("equal")
    if cube is not None and by_lines:
        MapFrame.from_cube(cube).turn(ax)
    elif by_lines:
        ax.invert_yaxis()
    ax.set_title(f"{track.name} against {picks.name}", loc="left", fontsize="medium")
    return ax
