"""Where a fault lies, to the trace: at the break that tells the traces on its two sides apart best."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from scipy import ndimage

from seismo3d._settings import Width
from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_placing import split_profiles
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import ThrowSettings, every_sample, gather_sides


@dataclass(frozen=True, slots=True)
class PlaceSettings:
    """How far a surface is moved, and by what; lengths in traces and samples.

    Attributes
    ----------
    reach : int in [2, 100]
        Traces on either side that are told apart: half as many again once the surface has been moved.
    along_strike, down : float in (0, 1000]
        Widths of the Gaussian window over which breaks are weighed, and over which moves are averaged.
    """

    reach: Annotated[int, "[2, 100]"] = 4
    along_strike: Width = 3.0
    down: Width = 4.0


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

    Takes what :func:`~seismo3d.seismic.throw.gather_sides` does. Returns the traces at -reach .. reach, at every
    row and sample of the sheet, and where they are known.
    """
    w = every_sample(sheet) if w is None else w
    shape = (2 * settings.reach + 1, *w.shape)
    values, known = np.zeros(shape, np.float32), np.zeros(shape, bool)
    for off in range(settings.reach + 1):
        only = replace(throw, near=off, far=off)
        both, read, _ = gather_sides(volume, valid, slopes, sheet, settings=only, w=w, off=0, corner=corner)
        # on the surface itself they are one
        for side, trace in enumerate((settings.reach - off, settings.reach + off)):
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
    that the profile of traces :math:`u_o` across the surface may have, the fault is the one that leaves the least
    variance, :math:`\sum_{o<b} (u_o - \bar u_{<b})^2 + \sum_{o>b} (u_o - \bar u_{>b})^2`, as a change of a mean is
    found in a series [1]_; the trace at the break may hold both sides. The sum is taken over a window along the
    surface, in which a fault keeps its place, and the parabola through the least one and its neighbours tells the place
    between traces. Where the surface was far off, few traces were left on one side: from its new place it is told
    again, by the nearest ones. Crests of support lie off the fault where another one, or the cube's end, bends them.

    Parameters
    ----------
    sheet : Sheet
        The fault.
    values, known : ndarray of shape (2 reach + 1, rows, samples)
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
    inside = np.isfinite(every_sample(sheet))
    moved = np.zeros(inside.shape, np.float32)
    for reach in (settings.reach, max(2, settings.reach // 2)):
        moved += _find_move(values, known, moved, inside, reach, settings)
    return replace(sheet, w=sheet.w + moved[:, np.arange(sheet.w.shape[1]) * sheet.step])


def _find_move(
    values: Float32Array, known: BoolArray, moved: Float32Array, inside: BoolArray, reach: int, settings: PlaceSettings
) -> Float32Array:
    """Return how far a surface that was moved is to be moved on: to the break between the traces within reach."""
    width = (settings.along_strike, settings.down)
    within, contrast = np.empty((2, 2 * reach - 1, *inside.shape), np.float32)
    split_profiles(values, known, moved, within, contrast)
    for maps in (within, contrast):
        for place, values_there in enumerate(maps):
            maps[place] = ndimage.gaussian_filter(values_there, width, mode="constant")
    apart = contrast.max(axis=0)
    told = inside & (apart > 0.0)
    if not told.any():
        return np.zeros_like(moved)
    move = np.where(told, _lowest(within) - (reach - 1), 0.0)
    # what hardly differs tells little of where it changes
    weight = np.where(told, np.sqrt(np.minimum(apart / np.median(apart[told]), 1.0)), 0.0)
    total, share = (ndimage.gaussian_filter(part, width, mode="nearest") for part in (move * weight, weight))
    return np.where(share > 1e-6, total / np.maximum(share, 1e-6), 0.0).astype(np.float32)


def _lowest(values: Float32Array) -> Float32Array:
    """Return where along the first axis values are least: between two by a parabola, except at the ends."""
    least = values.argmin(axis=0)
    inner = np.clip(least, 1, len(values) - 2)
    before, at, after = (np.take_along_axis(values, inner[None] + aside, axis=0)[0] for aside in (-1, 0, 1))
    between = 0.5 * (before - after) / np.maximum(before - 2.0 * at + after, 1e-30)
    return np.where(least == inner, least + np.clip(between, -0.5, 0.5), least).astype(np.float32)
