"""How a 3D scene is looked at: its labelled edges and its camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d.plot.scene_frame import SceneFrame

# share of the picture's height that a scene may fill
_FILLED = 0.88


def add_axes(plotter: Any, cube: Any, frame: SceneFrame) -> None:
    """Write line numbers and times along the near edges of the floor and up the left edge of the back wall."""
    plotter.set_background("white")
    left, right, front, back, bottom, top = frame.bounds
    edges = (((left, front, bottom), 0, right), ((left, front, bottom), 1, back), ((left, back, bottom), 2, top))
    outwards = ((0.0, -0.06, -0.02), (-0.06, 0.0, -0.02), (-0.09, 0.02, 0.0))
    ranges, titles = frame.axis_ranges(cube), frame.axis_titles(cube)
    points, labels = [], []
    for (start, axis, end), away, title in zip(edges, outwards, titles, strict=True):
        foot, head = np.array(start), np.array(start)
        head[axis] = end
        plotter.add_lines(np.stack([foot, head]), color="black", width=2, name=f"axis {axis}")
        low, high = ranges[2 * axis], ranges[2 * axis + 1]
        for value in _round_values(low, high):
            share = (value - low) / (high - low) if high != low else 0.0
            points.append(foot + share * (head - foot) + np.array(away))
            labels.append(f"{value:.8g}")
        points.append(foot + 0.5 * (head - foot) + 2.2 * np.array(away))
        labels.append(title)
    plotter.add_point_labels(
        np.array(points),
        labels,
        shape=None,
        show_points=False,
        always_visible=True,
        text_color="black",
        font_size=18,
        justification_horizontal="center",
        justification_vertical="center",
        name="axis labels",
    )


def _round_values(low: float, high: float) -> list[float]:
    """Round numbers between two ends, in the order of the ends."""
    from matplotlib.ticker import MaxNLocator

    values = MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10]).tick_values(min(low, high), max(low, high))
    inside = [float(v) for v in values if min(low, high) <= v <= max(low, high)]
    return inside if low <= high else inside[::-1]


def aim_camera(plotter: Any, bounds: tuple[float, ...]) -> None:
    """Look from the front left and above, as near as all eight corners allow."""
    angle = 22.0
    corners = np.stack(np.meshgrid(bounds[:2], bounds[2:4], bounds[4:]), axis=-1).reshape(-1, 3)
    centre = corners.mean(axis=0)
    towards = np.array([-0.62, -0.66, 0.43])
    towards /= np.linalg.norm(towards)
    sideways = np.cross([0.0, 0.0, 1.0], towards)
    sideways /= np.linalg.norm(sideways)
    relative = corners - centre
    width, height = plotter.window_size
    half = _FILLED * np.tan(np.radians(angle / 2))
    vertical = np.abs(relative @ np.cross(towards, sideways)) / half
    horizontal = np.abs(relative @ sideways) / (half * 0.9 * width / height)
    distance = float((np.maximum(vertical, horizontal) + relative @ towards).max())
    # near corners look larger: move the aim to the middle of what is seen
    for across in (sideways, np.cross(towards, sideways)):
        seen = relative @ across / (distance - relative @ towards)
        centre = centre + across * distance * (seen.min() + seen.max()) / 2
    camera = plotter.camera
    camera.position, camera.focal_point, camera.up = tuple(centre + distance * towards), tuple(centre), (0.0, 0.0, 1.0)
    camera.view_angle = angle
    plotter.reset_camera_clipping_range()
