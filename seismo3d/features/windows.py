r"""Round windows whose sums slide over an image at a cost that does not depend on their radius.

A window is given by its half-widths: row ``dy`` of it covers the columns ``-w(dy) .. w(dy)``. When its centre moves one
column, the pixels on its right edge enter and those on its left edge leave. The edges here are those of a sixteen-sided
polygon, at most two percent of the radius from the circle, whose sides run along the directions (0, 1), (1, 2), (1, 1)
and (2, 1) of the pixel grid. The sum along a side is a difference of two running sums in its direction, so that one
step costs a fixed number of additions. All sums are integers: sliding and summing afresh agree to the last bit.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np

from seismo3d._typing import ArrayLike, Int32Array
from seismo3d._validate import as_number, as_real_array
from seismo3d.features import _kernels
from seismo3d.features.gradients import quantise_gradients

_SIDE_END = (0.195, 0.556, 0.831, 0.981)  # sines of 11.25, 33.75, 56.25 and 78.75 degrees


@functools.lru_cache(maxsize=64)
def _polygon(radius: float) -> tuple[int, ...]:
    """Half-width at the centre and rows along each kind of side that come closest to the circle."""
    ends = [radius * end for end in _SIDE_END]
    nominal = (radius, ends[0], (ends[1] - ends[0]) / 2.0, ends[2] - ends[1], ends[3] - ends[2])
    choices = [sorted({max(0, math.floor(v) + k) for k in (-1, 0, 1, 2)}) for v in nominal]
    n_rows = math.floor(radius) + 3
    squared = radius**2 - np.arange(n_rows) ** 2.0
    disc = np.where(squared >= 0.0, np.floor(np.sqrt(np.maximum(squared, 0.0))), -1.0)
    best: tuple[int, ...] = (0, 0, 0, 0, 0)
    best_misfit = math.inf
    for sides in itertools.product(*choices):
        widths = np.array(_profile(sides), dtype=float)
        if widths.min() < 0.0 or widths.size > n_rows:
            continue
        misfit = float(np.abs(np.pad(widths, (0, n_rows - widths.size), constant_values=-1.0) - disc).sum())
        if misfit < best_misfit:
            best, best_misfit = sides, misfit
    return best


def _profile(sides: tuple[int, ...]) -> list[int]:
    """Half-widths of the rows 0, 1, 2, ... of the polygon with these sides."""
    width, n_vertical, n_steep, n_diagonal, n_flat = sides
    widths = [width] * (n_vertical + 1)
    for _ in range(n_steep):
        width -= 1
        widths += [width, width]
    for step, count in ((1, n_diagonal), (2, n_flat)):
        for _ in range(count):
            width -= step
            widths.append(width)
    return widths


@functools.lru_cache(maxsize=64)
def window_half_widths(radius: float) -> Int32Array:
    """Return the half-widths of the rows of a round window, top to bottom.

    Parameters
    ----------
    radius : float
        In pixels, 1 to 256.

    Returns
    -------
    ndarray of shape (2 m + 1,), int32
        Row ``i`` covers the columns from ``-w[i]`` to ``w[i]``, both included.

    Raises
    ------
    ParameterError
        If the radius is out of bounds.
    """
    upper = _profile(_polygon(as_number(radius, "radius", low=1.0, high=256.0)))
    widths = np.array(upper[:0:-1] + upper, dtype=np.int32)
    widths.flags.writeable = False
    return widths


@functools.lru_cache(maxsize=64)
def _edge_taps(radius: float) -> Int32Array:
    """Taps (plane, row, column, sign) in the running sums that give what enters minus what leaves in one step.

    Planes: 0 vertical; 1, 2 steep (1 column in 2 rows) going right, left; 3, 4 diagonal; 5, 6 flat (2 columns a row).
    """
    width, n_vertical, n_steep, n_diagonal, n_flat = _polygon(radius)
    taps: list[tuple[int, int, int, int]] = []
    for side, sign in ((1, 1), (-1, -1)):  # entering on the right of the new centre, leaving on the left of the old one
        shift = 0 if side == 1 else -1
        taps += [(0, n_vertical, side * width + shift, sign), (0, -n_vertical - 1, side * width + shift, -sign)]
        row, reach = n_vertical, width
        for plane, n_steps, rows, columns in ((1, n_steep, 2, 1), (3, n_diagonal, 1, 1), (5, n_flat, 1, 2)):
            if n_steps == 0:
                continue
            last_row, last = row + n_steps * rows, reach - n_steps * columns
            # Below the centre a right edge goes left with each row; above it, it goes right: the mirror image.
            inward, outward = (plane + 1, plane) if side == 1 else (plane, plane + 1)
            taps += [(inward, last_row, side * last + shift, sign), (inward, row, side * reach + shift, -sign)]
            top = side * (reach - columns) + shift
            taps += [(outward, -row - 1, top, sign), (outward, -last_row - 1, side * (last - columns) + shift, -sign)]
            row, reach = last_row, last
    return np.array(taps, dtype=np.int32)


def slide_window(planes: ArrayLike, radius: float) -> Int32Array:
    """Sum integer planes over a round window at every pixel, by recursion.

    Parameters
    ----------
    planes : array_like of shape (n, rows, columns), integer
        Values outside count as zero. Sums must fit into 32 bits.
    radius : float
        Of the window, in pixels, 1 to 256. The cost does not depend on it, but for the margin that is carried along.

    Returns
    -------
    ndarray of shape (n, rows, columns), int32
        Bit-identical to adding up the window's pixels afresh at each place.

    Raises
    ------
    ShapeError
        If the planes are not real numbers on three axes.
    """
    values = np.ascontiguousarray(as_real_array(planes, "planes", ndim=3), dtype=np.int32)
    widths = window_half_widths(float(radius))
    reach = int(max(widths.max(), widths.size // 2))
    return _kernels.slide_window(values, _edge_taps(float(radius)), reach)


def histogram_map(image: ArrayLike, radius: float, *, n_bins: int = 16) -> Int32Array:
    r"""Histogram of oriented gradients in a round window around every pixel.

    Each pixel votes for the two bins nearest to its gradient's direction, with the square root of its magnitude, in
    integer steps of 1/256 grey level; the window then slides by recursion, [1]_ in spirit.

    Parameters
    ----------
    image : array_like of shape (rows, columns)
        Finite real values. Scaled to 0..255 over its own range first.
    radius : float
        Of the window, in pixels, 1 to 256.
    n_bins : int
        Bins over the full turn.

    Returns
    -------
    ndarray of shape (n_bins, rows, columns), int32
        Bin ``b`` is centred on the direction :math:`2 \pi b / n` (x right, y down).

    References
    ----------
    .. [1] D. Miramontes-Jaramillo, V. Kober, V. H. Diaz-Ramirez, V. Karnaukhov, "A novel image matching algorithm based
       on sliding histograms of oriented gradients", J. Commun. Technol. Electron. 59, 2014.
    """
    grey = as_real_array(image, "image", ndim=2).astype(np.float32)
    low, high = float(grey.min()), float(grey.max())
    if high > low:
        grey = (grey - low) * np.float32(255.0 / (high - low))
    votes = quantise_gradients(grey, None, n_bins=n_bins)
    return slide_window(_kernels.votes_to_planes(*votes, n_bins), radius)
