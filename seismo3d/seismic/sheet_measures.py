"""What a sheet and its throw amount to as a whole: strength, sizes, dip, and how well its sides match."""

from __future__ import annotations

import numpy as np

from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetThrow


def strength(sheet: Sheet) -> float:
    """Return a sheet's significance: its mean support times the square root of its area."""
    return mean_support(sheet) * float(np.sqrt(sheet.area)) if sheet.inside.any() else 0.0


def mean_support(sheet: Sheet) -> float:
    """Return a sheet's mean support, in standard deviations of the cube's evidence."""
    return float(np.nanmean(sheet.score))


def vertical_extent(sheet: Sheet) -> float:
    """Return a sheet's extent down the samples, in samples; 0 for one without nodes."""
    columns = np.flatnonzero(sheet.inside.any(axis=0))
    return float(np.ptp(columns)) * sheet.step if len(columns) else 0.0


def dip_deg(sheet: Sheet) -> float:
    """Return a sheet's median dip in degrees, in traces and samples; 90 for a sheet of one column."""
    if sheet.w.shape[1] < 2:
        return 90.0
    moves = np.abs(np.diff(sheet.w, axis=1))
    moves = moves[np.isfinite(moves)]
    return float(np.degrees(np.arctan2(sheet.step, np.median(moves)))) if moves.size else 90.0


def length_down_dip(sheet: Sheet) -> float:
    """Return a sheet's extent down its dip, in samples and traces."""
    return vertical_extent(sheet) / np.sin(np.radians(max(dip_deg(sheet), 10.0)))


def share_matched(sheet: Sheet, throw: SheetThrow) -> float:
    """Return the share of the places whose sides match."""
    fits = throw.fit[sheet.inside]
    return float(np.count_nonzero(fits > 0.0)) / max(len(fits), 1)


def median_fit(sheet: Sheet, throw: SheetThrow) -> float:
    """Return the median fit of the places whose sides match; 0 where none does."""
    fit = throw.fit[sheet.inside]
    matched = fit[fit > 0.0]
    return float(np.median(matched)) if matched.size else 0.0


def median_throw(throw: SheetThrow) -> float:
    """Return the median size of the throw; 0 where no side has data."""
    known = np.abs(throw.throw[np.isfinite(throw.throw)])
    return float(np.median(known)) if known.size else 0.0
