"""Matches between two images or cubes, drawn side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_kind, as_real_array, as_whole_number
from seismo3d.errors import ShapeError
from seismo3d.features.matching import Matches
from seismo3d.io._files import check_output
from seismo3d.plot.drawing import bar_ends, check_axes
from seismo3d.plot.picture_files import PICTURES, save_figure

_GAP = 12


def matches(target: Any, source: Any, found: Any, *, n_shown: int = 200, ax: Any = None) -> Any:
    """Draw two images side by side, with a line for each match, coloured by its score.

    Parameters
    ----------
    target, source : array_like
        What was matched: images (rows, columns), grey or colour, or volumes. Of volumes, the inline in the middle
        of the matches is drawn, sample axis downwards, with all matches projected onto it.
    found : Matches
        As :func:`seismo3d.match` gives them.
    n_shown : int
        At most so many, drawn by lot, and the same ones each time.
    ax : matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ShapeError
        If the matches have another number of axes than the images.
    """
    as_kind(found, Matches, "found", remedy="Give what match returned.")
    first, places_t = _picture(target, found.points_target, "target")
    second, places_s = _picture(source, found.points_source, "source")
    n = as_whole_number(n_shown, "n_shown", low=0, high=1e6)
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.subplots(figsize=(12.0, 6.0), layout="constrained")[1]
    check_axes(ax)
    offset = first.shape[1] + _GAP
    canvas = np.full((max(first.shape[0], second.shape[0]), offset + second.shape[1]), np.nan, dtype=np.float32)
    canvas[: first.shape[0], : first.shape[1]] = first
    canvas[: second.shape[0], offset:] = second
    ax.imshow(canvas, cmap="gray", vmin=0.0, vmax=1.0, interpolation="antialiased")
    shown = np.sort(np.random.default_rng(0).permutation(len(found))[:n])
    _draw_lines(ax, places_t[shown], places_s[shown] + [offset, 0.0], found.score[shown])
    ax.set_title(f"{len(found)} matches" + (f", {n} shown" if n < len(found) else ""), loc="left", fontsize="medium")
    ax.set_xticks([])
    ax.set_yticks([])
    return ax


def _draw_lines(ax: Any, first: Float64Array, second: Float64Array, score: Float64Array) -> None:
    from matplotlib.collections import LineCollection

    lines = LineCollection(list(np.stack([first, second], axis=1)), cmap="viridis", linewidths=0.6, alpha=0.7)
    lines.set_array(np.asarray(score))
    lines.set_clim(0.5, 1.0)
    ax.add_collection(lines)
    both = np.concatenate([first, second])
    ax.scatter(both[:, 0], both[:, 1], s=6.0, c=np.tile(score, 2), cmap="viridis", vmin=0.5, vmax=1.0, linewidths=0.0)
    ax.figure.colorbar(lines, ax=ax, label="Score", shrink=0.8, extend=bar_ends(score, 0.5, 1.0))


def _picture(values: Any, points: Float64Array, name: str) -> tuple[AnyArray, Float64Array]:
    """Grey levels 0 to 1 to draw, and where the points lie on them as (column, row)."""
    grid = as_real_array(getattr(values, "values", values), name, ndim=(2, 3))
    if grid.ndim == 3 and points.shape[1] == 2:
        grid = grid[..., :3].mean(axis=2)
    if grid.ndim != points.shape[1]:
        raise ShapeError(f"{name} has {grid.ndim} axes and its matches {points.shape[1]}. Give what was matched.")
    if grid.ndim == 3:
        middle = round(float(np.median(points[:, 0]))) if len(points) else grid.shape[0] // 2
        grid, points = grid[middle].T, points[:, 1:]
    grid = grid.astype(np.float32)
    known = grid[np.isfinite(grid)]
    low, high = np.percentile(known, [1.0, 99.0]) if known.size else (0.0, 1.0)
    return np.clip((grid - low) / max(high - low, 1e-30), 0.0, 1.0), points


def save_matches(path: str | Path, target: Any, source: Any, found: Any, *, n_shown: int = 200) -> None:
    """Write the drawing of :func:`matches` to a picture file.

    Parameters
    ----------
    path : str or Path
        Ending in ``.png``, ``.pdf``, ``.svg``, ``.eps``, ``.jpg``, ``.tif`` or ``.webp``.
    target, source, found, n_shown
        As for :func:`matches`.

    Raises
    ------
    ParameterError
        If the name ends in something else.
    FileAccessError
        If it cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = check_output(path, endings=PICTURES)
    figure = Figure(figsize=(12.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    matches(target, source, found, n_shown=n_shown, ax=figure.add_subplot())
    save_figure(figure, path, dpi=150)
