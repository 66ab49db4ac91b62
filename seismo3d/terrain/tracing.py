"""Crests of line support linked into lines, by the tracer that links a cube's faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.seismic._kernels_scan import find_ridges
from seismo3d.seismic.linking import link_sheets
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheets import Sheet, SheetSettings
from seismo3d.terrain.support import LineSupport

_LINK = SheetSettings(fragment=8, contacts=4, closing=6, gap=6, smoothing=3.0, off_plane=1.6)


@dataclass(frozen=True, slots=True, eq=False)
class TracedLine:
    """A line on the map's grid.

    Attributes
    ----------
    places : ndarray of shape (n, 2), float64
        (row, column) on the finest level, about one cell of the line's own level apart.
    score : ndarray of shape (n,), float64
    kind : {"step", "trough", "both"}
    factor : int
        Cells of the map in a cell of the line's level.
    """

    places: Float64Array
    score: Float64Array
    kind: str
    factor: int

    @property
    def length(self) -> float:
        """Length in cells of the finest level."""
        return float(np.linalg.norm(np.diff(self.places, axis=0), axis=1).sum())

    @property
    def strength(self) -> float:
        """Mean score times the root of the length in cells of its own level: how significant the whole line is."""
        return float(self.score.mean() * np.sqrt(self.length / self.factor))


def trace_lines(support: LineSupport, *, least: float, least_contrast: float, least_length: float) -> list[TracedLine]:
    """Thin the support and link its crests into lines, longest first.

    Parameters
    ----------
    support : LineSupport
    least : float
        Score that a crest needs.
    least_contrast : float
        Contrast that it needs.
    least_length : float
        Shortest line, in cells of the level.
    """
    score = support.score.copy()
    score[support.contrast < least_contrast] = 0.0
    flat = score[:, :, None]
    offset = np.zeros_like(flat)
    planes = np.column_stack([support.normals, np.zeros(len(support.normals))]).astype(np.float32)
    keep = find_ridges(flat, support.orientation[:, :, None], planes, np.float32(least), offset)
    voxels = np.argwhere(keep).astype(np.int32)
    at = tuple(voxels.T)
    chosen = planes[support.orientation[at[:2]]]
    positions = voxels.astype(np.float32)
    positions[:, :2] += offset[at][:, None] * chosen[:, :2]
    ridges = RidgePoints(voxels, positions, chosen, flat[at])
    shape = (flat.shape[0], flat.shape[1], 1)
    sheets = link_sheets(ridges, shape, step=1, least_points=max(4, int(0.5 * least_length)), settings=_LINK)
    lines = [line for sheet in sheets if (line := _as_line(sheet, support)) is not None]
    return [line for line in lines if line.length >= least_length * support.factor]


def _as_line(sheet: Sheet, support: LineSupport) -> TracedLine | None:
    rows = np.flatnonzero(sheet.inside[:, 0])
    if len(rows) < 2:
        return None
    w = sheet.w[rows, 0].astype(np.float64)
    places = sheet.points(rows.astype(np.float64), np.zeros(len(rows)), w)[:, :2]
    # a cell of a level covers `factor` cells: its centre lies between theirs
    fine = support.factor * (places + 0.5) - 0.5
    return TracedLine(fine, sheet.score[rows, 0].astype(np.float64), support.kind, support.factor)
