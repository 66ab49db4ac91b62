"""Where a fault lies, to the trace: at the break that tells the traces on its two sides apart best."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_placing import split_profiles
from seismo3d.seismic.linking import Sheet
from seismo3d.seismic.throw import ThrowSettings, every_sample, gather_sides


@dataclass(frozen=True, slots=True)
class PlaceSettings:
    """How far a surface is moved, and by what; lengths in traces and samples.

    Attributes
    ----------
    reach : int
        Traces on either side that are told apart.
    farthest : int
        Farthest that the surface is moved.
    along_strike, down : float
        Widths of the Gaussian window over which breaks are weighed.
    stay : float
        Cost of a move by a trace, as a share of what sets the two sides apart.
    smoothing : tuple of (float, float)
        Widths, along the strike and down, of the Gaussian over which moves are averaged.
    """

    reach: int = 4
    farthest: int = 3
    along_strike: float = 3.0
    down: float = 4.0
    stay: float = 0.01
    smoothing: tuple[float, float] = (4.0, 5.0)


def read_profile(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    sheet: Sheet,
    *,
    throw: ThrowSettings,
    settings: PlaceSettings,
    w: Float32Array | None = None,
    corner: tuple[int, int] = (0, 0),
) -> tuple[Float32Array, BoolArray]:
    """Read the traces on both sides of a sheet, each carried to it along its dips.

    Takes what :func:`~seismo3d.seismic.throw.gather_sides` does. Returns the traces at -reach .. -1 and 1 .. reach, at
    every row and sample of the sheet, and where they are known.
    """
    w = every_sample(sheet) if w is None else w
    shape = (2 * settings.reach, *w.shape)
    values, known = np.zeros(shape, np.float32), np.zeros(shape, bool)
    for off in range(1, settings.reach + 1):
        only = replace(throw, near=off, far=off)
        both, read, _ = gather_sides(volume, valid, slopes, sheet, settings=only, w=w, off=0, corner=corner)
        for side, trace in enumerate((settings.reach - off, settings.reach + off - 1)):
            values[trace], known[trace] = both[side], read[side] > 0.0
    return values, known


def profile_reach(throw: ThrowSettings, settings: PlaceSettings) -> int:
    """Return how many traces off a sheet its profile is read at most, slopes included."""
    return settings.reach + throw.clear + 2


def place_sheet(
    sheet: Sheet, values: Float32Array, known: BoolArray, *, settings: PlaceSettings | None = None
) -> Sheet:
    r"""Move a sheet to the break between the traces on its two sides.

    Carried to the surface along their layers, the traces on one side of a fault are alike. Of all breaks :math:`b`
    that the profile of traces :math:`u_o` across the surface may have, the fault is the one that leaves the least,
    :math:`\sum_{o<b} (u_o - \bar u_{<b})^2 + \sum_{o>b} (u_o - \bar u_{>b})^2`, as a change of a mean is found in a
    series [1]_. The sum is taken over a window along the surface, in which a fault keeps its place. Crests of support
    lie off it where another fault, or the cube's end, bends them.

    Parameters
    ----------
    sheet : Sheet
        The fault.
    values, known : ndarray of shape (2 reach, rows, samples)
        From :func:`read_profile`.
    settings : PlaceSettings, optional
        Windows and limits.

    Returns
    -------
    Sheet
        The same nodes, moved across.

    References
    ----------
    .. [1] D. V. Hinkley, Biometrika 57(1), 1-17, 1970. :doi:`10.1093/biomet/57.1.1`
    """
    settings = settings or PlaceSettings()
    breaks = np.arange(-settings.farthest, settings.farthest + 1)
    shape = (len(breaks), *values.shape[1:])
    within, contrast = np.empty(shape, np.float32), np.empty(shape, np.float32)
    split_profiles(values, known, settings.farthest, within, contrast)
    width = (settings.along_strike, settings.down)
    for place in range(len(breaks)):
        for maps in (within, contrast):
            maps[place] = ndimage.gaussian_filter(maps[place], width, mode="constant")
    apart = contrast.max(axis=0)
    inside = np.isfinite(every_sample(sheet)) & (apart > 0.0)
    if not inside.any():
        return sheet
    cost = within / np.where(inside, apart, 1.0) + settings.stay * np.abs(breaks)[:, None, None]
    move = np.where(inside, breaks[cost.argmin(axis=0)], 0.0)
    # what hardly differs tells little of where it changes
    weight = np.where(inside, np.sqrt(np.minimum(apart / np.median(apart[inside]), 1.0)), 0.0)
    total, share = (
        ndimage.gaussian_filter(part, settings.smoothing, mode="nearest") for part in (move * weight, weight)
    )
    columns = np.arange(sheet.w.shape[1]) * sheet.step
    moved = np.where(share > 1e-6, total / np.maximum(share, 1e-6), 0.0)[:, columns]
    return replace(sheet, w=sheet.w + moved.astype(np.float32))
