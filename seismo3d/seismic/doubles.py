"""Sheets that found one fault, each over a part of it: every place of the fault is left to one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.linking import Sheet
from seismo3d.seismic.sheet_distances import SheetNodes
from seismo3d.seismic.throw import SheetThrow

# nodes around what another sheet has within which slivers, of fewer than three nodes across, are dropped
_BESIDE = 3
_NEIGHBOURS = np.ones((3, 3), bool)


def part_doubles(
    sheets: list[Sheet], throws: list[SheetThrow], today: list[SheetThrow], settings: ChoiceSettings
) -> tuple[list[Sheet], list[SheetThrow], list[SheetThrow]]:
    """Leave every place of a fault to one of the sheets that lie on it.

    A fault that others cut is found in parts, and each is carried on along its ridges, over the next part as well: its
    throw is the surer for that. Where sheets of one attitude lie on each other, the one whose sides match best as a
    whole keeps the place; of the others stays what lies beyond, and nothing of one that has hardly more.

    Parameters
    ----------
    sheets : list of Sheet
        Faults of a cube, where they lie.
    throws, today : list of SheetThrow
        Their throws when they moved, and as they seem today.
    settings : ChoiceSettings
        How near sheets are one fault (`beside`), how much they may be turned (`alike_deg`), and how large what remains
        must be (`company_area`).

    Returns
    -------
    sheets, throws, today
        Of those that remain, in their order.
    """
    parted = list(sheets)
    kept: list[tuple[SheetNodes, Float64Array]] = []
    bounds = np.empty((0, 2, 3))
    for n in np.argsort([-_match(*pair) for pair in zip(sheets, throws, strict=True)], kind="stable").tolist():
        nodes, normal = SheetNodes.of(sheets[n]), _normal(sheets[n])
        reach = settings.beside
        near = (bounds[:, 0] <= nodes.bounds[1] + reach) & (nodes.bounds[0] <= bounds[:, 1] + reach)
        taken = np.zeros(len(nodes.points), bool)
        for other, its in (kept[m] for m in np.flatnonzero(near.all(axis=1))):
            if abs(float((normal * its).sum())) > np.cos(np.radians(settings.alike_deg)):
                taken |= nodes.are_within(other, reach)
        if taken.any():
            parted[n] = _without(sheets[n], taken, settings)
        if parted[n].inside.any():
            kept.append((SheetNodes.of(parted[n]), normal))
            bounds = np.concatenate([bounds, kept[-1][0].bounds[None]])
    left = [n for n, sheet in enumerate(parted) if sheet.inside.any()]
    return [parted[n] for n in left], [throws[n] for n in left], [today[n] for n in left]


def _match(sheet: Sheet, throw: SheetThrow) -> float:
    """Return how surely a sheet's sides match: their mean fit times the square root of its area."""
    known = np.isfinite(throw.throw)
    return float(throw.fit[known].mean(dtype=np.float64)) * sheet.area**0.5 if known.any() else 0.0


def _normal(sheet: Sheet) -> Float64Array:
    """Return the unit normal of a sheet's mean attitude, in traces and samples."""
    steps = np.diff(sheet.w, axis=1) / sheet.step
    steps = steps[np.isfinite(steps)]
    normal = np.append(sheet.across, -float(np.median(steps)) if steps.size else 0.0)
    return np.asarray(normal / np.sqrt((normal**2).sum()))


def _without(sheet: Sheet, taken: BoolArray, settings: ChoiceSettings) -> Sheet:
    """Return a sheet without some of its nodes, and without the slivers and scraps that are left beside them."""
    removed = np.zeros(sheet.w.shape, bool)
    removed[sheet.inside] = taken
    rest = sheet.inside & ~removed
    slivers = rest & ~ndimage.binary_opening(rest, _NEIGHBOURS)
    rest &= ~(slivers & ndimage.binary_dilation(removed, _NEIGHBOURS, iterations=_BESIDE))
    parts, n_parts = ndimage.label(rest, _NEIGHBOURS)
    if n_parts:
        sizes = np.bincount(parts.ravel())[1:] * sheet.step
        rest &= np.isin(parts, 1 + np.flatnonzero(sizes >= settings.company_area))
    empty = np.float32(np.nan)
    return replace(sheet, w=np.where(rest, sheet.w, empty), score=np.where(rest, sheet.score, empty))
