"""Faults found twice, at either flank of the zone in which the wavelet mixes their sides: one of each pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from seismo3d._settings import Degrees, Share, Smoothing, Threshold
from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d.seismic._kernels_extending import lay_on_grid
from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.doubles import node_normals, without_nodes
from seismo3d.seismic.sheet_measures import strength
from seismo3d.seismic.sheets import Sheet

# least support by which a place of a sheet is weighed
_LEAST_WEIGHT = 1e-3


@dataclass(frozen=True, slots=True)
class FlankSettings:
    """When two sheets are the flanks of one fault.

    Attributes
    ----------
    apart : float in [0, inf]
        Farthest that they lie above each other, in samples: about half of a wavelet.
    angle_deg : float in [0, 90]
        Largest angle between them at a place.
    share : float in [0, 1]
        Smallest share of the weaker one that lies so beside the stronger.
    smoothing : float in [0, 1000]
        Width, in nodes, of the window over which the move to the middle is averaged.
    """

    apart: Threshold = 6.0
    angle_deg: Degrees = 20.0
    share: Share = 0.4
    smoothing: Smoothing = 4.0


def join_flanks(
    sheets: Sequence[Sheet], choice: ChoiceSettings, *, settings: FlankSettings | None = None
) -> list[Sheet]:
    """Put one sheet in the middle of two that lie close above each other in one attitude.

    A wavelet sees both sides of a fault for half of its length above and below it. Over a steep fault that is a trace
    or two; a gently dipping one it turns into a zone many traces wide, which does not fit at its two ends, where layers
    begin and cease to bend. Each can be found as a sheet. The fault is between them: wavelets are symmetric.

    Parameters
    ----------
    sheets : sequence of Sheet
        All of a cube, where they lie.
    choice : ChoiceSettings
        How large a part must be that is left of a sheet (`company_area`).
    settings : FlankSettings, optional
        What are flanks.

    Returns
    -------
    list of Sheet
        In their order. Of two flanks the stronger one remains, moved by what both weigh: their support. The other keeps
        what lies beyond it, and is left out where that is hardly anything. Leftovers stay as they are.
    """
    settings = settings or FlankSettings()
    laid, found = [_Laid.of(sheet) for sheet in sheets], list(sheets)
    order = sorted(
        (number for number, sheet in enumerate(sheets) if not sheet.leftover),
        key=lambda number: -strength(sheets[number]),
    )
    for place, number in enumerate(order):
        moves, weights = np.zeros((2, *sheets[number].w.shape))
        for other in order[place + 1 :]:
            weaker = laid[other]
            beside = _find_beside(weaker, laid[number], settings)
            if beside is None:
                continue
            flank, at, move = beside
            weight = _weights(weaker.sheet)[weaker.rows[flank], weaker.columns[flank]]
            np.add.at(moves, at, weight * move)
            np.add.at(weights, at, weight)
            found[other] = without_nodes(weaker.sheet, flank, choice)
            laid[other] = _Laid.of(found[other])
        if weights.any():
            found[number] = _moved(found[number], moves, weights, settings)
    return [sheet for sheet in found if sheet.inside.any()]


@dataclass(frozen=True, slots=True, eq=False)
class _Laid:
    """A sheet, the grid places of its nodes, and its unit normal at each, in traces and samples."""

    sheet: Sheet
    rows: IntArray
    columns: IntArray
    normals: Float64Array

    @classmethod
    def of(cls, sheet: Sheet) -> _Laid:
        rows, columns = np.nonzero(sheet.inside)
        return cls(sheet, rows, columns, node_normals(sheet))


def _find_beside(
    weaker: _Laid, stronger: _Laid, settings: FlankSettings
) -> tuple[BoolArray, tuple[IntArray, IntArray], Float64Array] | None:
    """Tell which nodes of a sheet are a flank; return also the other's nodes at them, and how far across it they lie.

    None where too few are.
    """
    grid, least = stronger.sheet, settings.share * len(weaker.rows)
    cosine = np.cos(np.radians(settings.angle_deg))
    if not len(weaker.rows) or abs(float(weaker.sheet.across @ grid.across)) < 0.9 * cosine:
        return None
    points = weaker.sheet.nodes()
    row, column, height = lay_on_grid(
        points, np.arange(len(points)), grid.origin, grid.along, grid.across, grid.first_s, grid.first_sample, grid.step
    )
    place: IntArray = np.full(grid.w.shape, -1)
    place[stronger.rows, stronger.columns] = np.arange(len(stronger.rows))
    near = np.flatnonzero((row >= 0) & (row < place.shape[0]) & (column >= 0) & (column < place.shape[1]))
    near = near[place[row[near], column[near]] >= 0]
    if len(near) < least:
        return None
    at = row[near], column[near]
    normals = stronger.normals[place[at[0], at[1]]]
    cotangent = np.abs(normals[:, 2]) / np.maximum(np.hypot(normals[:, 0], normals[:, 1]), 1e-6)
    move = height[near] - grid.w[at[0], at[1]]
    close = np.abs(move) <= settings.apart * cotangent + 0.5
    close &= np.abs((weaker.normals[near] * normals).sum(axis=1)) > cosine
    if np.count_nonzero(close) < max(least, 1.0):
        return None
    flank = np.zeros(len(weaker.rows), bool)
    flank[near[close]] = True
    return flank, (at[0][close], at[1][close]), move[close]


def _weights(sheet: Sheet) -> Float64Array:
    """Return what a sheet's places weigh: their support, and nothing off the sheet."""
    return np.where(sheet.inside, np.maximum(np.nan_to_num(sheet.score), _LEAST_WEIGHT), 0.0).astype(np.float64)


def _moved(sheet: Sheet, moves: Float64Array, weights: Float64Array, settings: FlankSettings) -> Sheet:
    """Return a sheet moved to the middle, given the weighted moves to its flanks and their weights."""
    total, beside, own = (
        ndimage.gaussian_filter(values, settings.smoothing, mode="constant")
        for values in (moves, weights, _weights(sheet))
    )
    return replace(sheet, w=(sheet.w + total / np.maximum(beside + own, 1e-9)).astype(np.float32))
