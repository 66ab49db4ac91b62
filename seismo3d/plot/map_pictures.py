"""Pictures of a mapped place: the path of the camera, and the coloured surface from outside."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_whole_numbers
from seismo3d.plot.drawing import check_axes, new_axes


def trajectory_plot(trajectory: Any, *, ax: Any = None) -> Any:
    """Draw the camera's position and turn over time.

    Parameters
    ----------
    trajectory : Trajectory
        From :mod:`seismo3d.robot`.
    ax : matplotlib Axes, optional
        Positions go here; turns to a second axis on its right.

    Returns
    -------
    matplotlib Axes
    """
    if ax is None:
        ax = new_axes(9.0, 4.5)
    check_axes(ax)
    times = trajectory.times - trajectory.times[0]
    at = trajectory.T_world_camera
    for axis, (name, colour) in enumerate((("x right", "#c0392b"), ("y down", "#2e8b57"), ("z forward", "#1f5f99"))):
        ax.plot(times, at[:, axis, 3], color=colour, label=name)
    turn = np.degrees(np.arccos(np.clip((np.trace(at[:, :3, :3] @ at[0, :3, :3].T, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    right = ax.twinx()
    right.plot(times, turn, color="0.55", linestyle="--", label="turn")
    right.set_ylabel("Turn from the first frame (°)")
    ax.set(xlabel="Time (s)", ylabel="Position (m)")
    lines = [*ax.get_lines(), *right.get_lines()]
    # above the picture, where it hides nothing
    ax.legend(
        lines, [line.get_label() for line in lines], loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4,
        fontsize="small", frameon=False,
    )  # fmt: skip
    ax.margins(x=0.01)
    return ax


def surface_picture(
    mesh: Any, *, T_world_map: Any, trajectory: Any = None, size: tuple[int, int] = (1100, 800)
) -> AnyArray:
    """Return a picture of a mesh, seen from behind and above, with the camera's path in red.

    Parameters
    ----------
    mesh : Mesh
        From :mod:`seismo3d.robot`.
    T_world_map : ndarray of shape (4, 4)
        Carries map axes (x right, y forward, z up) to the world, as an occupancy map has it.
    trajectory : Trajectory, optional
    size : (int, int)
        Width and height in pixels.

    Returns
    -------
    ndarray of shape (height, width, 3), uint8
        White where nothing is mapped; black without a mesh.
    """
    width, height = as_whole_numbers(size, "size", n=2, low=1, high=16384)
    if len(mesh.triangles) == 0:
        return np.zeros((height, width, 3), dtype=np.uint8)
    R = np.asarray(T_world_map)[:3, :3]
    corners = mesh.points[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    tilt = np.radians(35.0)
    view = np.array([[1, 0, 0], [0, -np.sin(tilt), -np.cos(tilt)], [0, np.cos(tilt), -np.sin(tilt)]]) @ R.T
    facing = (normal / length) @ view.T
    colour = mesh.colours[mesh.triangles].mean(axis=1) * (0.55 + 0.45 * np.abs(facing[:, 2:]))
    points = np.concatenate([corners.mean(axis=1), corners.reshape(-1, 3)]) @ view.T
    shades = np.concatenate([colour, np.repeat(colour, 3, axis=0)])
    seen = np.concatenate([facing[:, 2] < 0, np.repeat(facing[:, 2] < 0, 3)])
    low, high = np.percentile(points[:, :2], [0.5, 99.5], axis=0)
    scale = 0.92 * min(width / max(high[0] - low[0], 1e-6), height / max(high[1] - low[1], 1e-6))
    offset = np.array([width, height]) / 2 - scale * (low + high) / 2
    image = np.full((height, width, 3), 255, dtype=np.uint8)
    _splat(image, points[seen] * [scale, scale, 1.0] + [*offset, 0.0], shades[seen])
    if trajectory is not None and len(trajectory):
        path = trajectory.T_world_camera[:, :3, 3] @ view.T
        dense = np.concatenate(
            [a + np.linspace(0, 1, 40)[:, None] * (b - a) for a, b in itertools.pairwise(path)] or [path]
        )
        places = np.rint(dense[:, :2] * scale + offset).astype(int)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)):
            x, y = np.clip(places + np.array([dx, dy]), 0, [width - 1, height - 1]).T
            image[y, x] = (200, 30, 30)
    return image


def _splat(image: AnyArray, points: Float64Array, colours: Float64Array) -> None:
    """Paint points (column, row, depth), far ones first, each over 2 x 2 pixels."""
    height, width = image.shape[:2]
    order = np.argsort(-points[:, 2], kind="stable")
    places = np.floor(points[order, :2]).astype(int)
    painted = np.clip(colours[order], 0, 255).astype(np.uint8)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = places[:, 0] + dx, places[:, 1] + dy
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        depth = np.full(height * width, -1, dtype=np.int64)
        flat = y[inside] * width + x[inside]
        np.maximum.at(depth, flat, np.flatnonzero(inside))
        hit = depth >= 0
        pixels = image.reshape(-1, 3)
        empty = hit & (pixels == 255).all(axis=1) if dx or dy else hit
        pixels[empty] = painted[depth[empty]]
