"""A base and a monitor cube before and after they are aligned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d._validate import as_kind
from seismo3d.errors import ShapeError
from seismo3d.geometry.axis import unit_of
from seismo3d.plot.drawing import NO_DATA, amplitude_limits, bar_ends, check_all_axes, draw_amplitudes, label_axes
from seismo3d.plot.pictures import Picture, axis_coordinates, take_picture
from seismo3d.seismic.preparing import find_level
from seismo3d.seismic.time_lapse import CubeAlignment

# share of a sample that the colours of shifts reach at least
_LEAST_SHIFT = 0.01


def time_lapse_section(
    base: Any, monitor: Any, alignment: Any, *, axes: Sequence[Any] | None = None, **where: float | None
) -> Any:
    """Draw a section of the base, what differs in the monitor before and after alignment, and the shift.

    Parameters
    ----------
    base, monitor : DataArray or ndarray
        The cubes.
    alignment : CubeAlignment
        From :func:`seismo3d.align_cubes`.
    axes : four matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.
    **where
        ``inline`` or ``crossline``; the middle inline by default.

    Returns
    -------
    list of matplotlib Axes
        Base and differences on one colour scale. The monitor is brought to the base's strength first; places that one
        of the two does not reach are empty. Shifts of both signs are red and blue about white.
    """
    as_kind(alignment, CubeAlignment, "alignment", remedy="Give what align_cubes returned.")
    for name, cube in (("base", base), ("monitor", monitor)):
        if np.shape(cube) != np.shape(alignment.shift):
            raise ShapeError(
                f"{name} has shape {np.shape(cube)} and the alignment {np.shape(alignment.shift)}; expected the same. "
                "Give the cubes that were aligned."
            )
    if axes is None:
        import matplotlib.pyplot as plt

        axes = plt.subplots(1, 4, figsize=(19.0, 5.0), layout="constrained", sharex=True, sharey=True)[1]
    axes = check_all_axes(axes, 4)
    first, raw, carried, shift = (take_picture(c, **where) for c in (base, monitor, alignment.aligned, alignment.shift))
    pictures = (first, raw, carried)
    seen, changed, moved = (_about_zero(picture) for picture in pictures)
    known = [_has_data(picture) & _has_data(first) for picture in pictures]
    scale = _strength(seen[first.live]) / max(_strength(changed[raw.live]), 1e-30)
    low, high = amplitude_limits(seen[first.live], 99.0)
    for ax, values, there, title in zip(
        axes[:3], (seen, changed * scale - seen, moved * scale - seen), known,
        (f"{first.title}: base", "Monitor less base", "The same, aligned"), strict=True,
    ):  # fmt: skip
        ax.set_facecolor(NO_DATA)
        shown = np.ma.masked_array(values, mask=~there)
        ax.imshow(shown, cmap="gray", vmin=low, vmax=high, extent=first.extent, aspect="auto")
        ax.set_title(title, loc="left", fontsize="medium")
        label_axes(ax, first.column_name, first.row_name if ax is axes[0] else "")
    samples = axis_coordinates(base, -1)
    least = _LEAST_SHIFT * float(np.abs(samples[1] - samples[0])) if len(samples) > 1 else _LEAST_SHIFT
    _draw_shift(axes[3], shift, unit_of(base), least)
    return axes


def _draw_shift(ax: Any, picture: Picture, unit: str, least: float) -> None:
    drawn = draw_amplitudes(ax, picture, cmap="RdBu_r", clip=99.5)
    finite = picture.values[np.isfinite(picture.values)]
    low, high = np.percentile(finite, [0.5, 99.5]) if len(finite) else (0.0, 0.0)
    if max(-low, high) < least:
        # nothing has moved: what rounding leaves gets no colours
        low, high = -least, least
    if low < 0.0 < high:
        # white is no shift, and red and blue are its signs
        high = max(-low, high)
        low = -high
    else:
        drawn.set_cmap("viridis")
    drawn.set_clim(low, high)
    beyond = bar_ends(finite, low, high)
    ax.figure.colorbar(drawn, ax=ax, label=f"Monitor deeper by ({unit})", pad=0.02, shrink=0.8, extend=beyond)
    ax.set_title("Shift", loc="left", fontsize="medium")
    ax.set_ylabel("")


def _about_zero(picture: Picture) -> Float64Array:
    """Amplitudes less what all of them share, 0 where there are none."""
    values = picture.values.astype(np.float64)
    return np.nan_to_num(values - find_level(values[picture.live])) * picture.live


def _has_data(picture: Picture) -> BoolArray:
    """Tell where there is data: not on traces without any, nor before a trace's first and past its last amplitude."""
    full = picture.live & (picture.values != 0.0)
    ends = np.logical_or.accumulate(full, axis=0), np.logical_or.accumulate(full[::-1], axis=0)[::-1]
    return np.asarray(ends[0] & ends[1])


def _strength(values: Float64Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 1.0
