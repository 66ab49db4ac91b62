"""Sheets that found one fault, each over a part of it: every place of the fault is left to one of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.extending import local_planes
from seismo3d.seismic.sheet_distances import SheetNodes, near_boxes, within_box
from seismo3d.seismic.sheet_ends import are_large
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetThrow

# traces and samples within which a node is on another sheet
_ON = 1.5
# nodes around what another sheet has within which slivers, of fewer than three nodes across, are dropped
_BESIDE = 3
# nodes of the window in which a sheet's attitude is told
_WIDTH = 3.0
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
        How much sheets on each other may be turned (`alike_deg`), and how large what remains must be (`company_area`).

    Returns
    -------
    sheets, throws, today
        Of those that remain, in their order.
    """
    parted = list(sheets)
    kept: list[_Placed] = []
    bounds = np.empty((0, 2, 3))
    for n in np.argsort([-_match(*pair) for pair in zip(sheets, throws, strict=True)], kind="stable").tolist():
        placed = _Placed.of(sheets[n])
        taken = np.zeros(len(placed.normals), bool)
        for m in near_boxes(bounds, placed.nodes.bounds, _ON):
            taken |= placed.lies_on(kept[m], settings)
        if taken.any():
            parted[n] = without_nodes(sheets[n], taken, settings)
        if parted[n].inside.any():
            kept.append(_Placed.of(parted[n]) if taken.any() else placed)
            bounds = np.concatenate([bounds, kept[-1].nodes.bounds[None]])
    left = [n for n, sheet in enumerate(parted) if sheet.inside.any()]
    return [parted[n] for n in left], [throws[n] for n in left], [today[n] for n in left]


def _match(sheet: Sheet, throw: SheetThrow) -> float:
    """Return how surely a sheet's sides match: their mean fit times the square root of its area."""
    known = np.isfinite(throw.throw)
    return float(throw.fit[known].mean(dtype=np.float64)) * sheet.area**0.5 if known.any() else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """The nodes of a sheet, and its unit normal at each, in traces and samples."""

    nodes: SheetNodes
    normals: Float64Array

    @classmethod
    def of(cls, sheet: Sheet) -> _Placed:
        return cls(SheetNodes.of(sheet), node_normals(sheet))

    def lies_on(self, other: _Placed, settings: ChoiceSettings) -> BoolArray:
        """Tell which nodes lie on another sheet, in its attitude there."""
        near = np.flatnonzero(within_box(self.nodes.points, other.nodes.bounds, _ON))
        found = np.zeros(len(self.normals), bool)
        distance, nearest = other.nodes.tree.query(self.nodes.points[near], distance_upper_bound=_ON)
        on = np.isfinite(distance)
        near, nearest = near[on], np.asarray(nearest)[on]
        alike = np.abs((self.normals[near] * other.normals[nearest]).sum(axis=1))
        found[near] = alike > np.cos(np.radians(settings.alike_deg))
        return found


def node_normals(sheet: Sheet) -> Float64Array:
    """Return the unit normal of a sheet at each of its nodes, in traces and samples: shape (n, 3)."""
    rows, columns = np.nonzero(sheet.inside)
    return normals_of(sheet, local_planes(sheet.w.astype(np.float64), sheet.inside, (rows, columns), _WIDTH))


def normals_of(sheet: Sheet, planes: Float64Array) -> Float64Array:
    """Return the unit normals along the sheet's `across` of planes from :func:`local_planes`, both of shape (n, 3)."""
    flat = sheet.across - planes[:, 1:2] * sheet.along
    normals = np.column_stack([flat, -planes[:, 2] / sheet.step])
    return np.asarray(normals / np.sqrt((normals**2).sum(axis=1, keepdims=True)))


def without_nodes(sheet: Sheet, taken: BoolArray, settings: ChoiceSettings) -> Sheet:
    """Return a sheet without some of its nodes, and without the slivers and scraps that are left beside them."""
    removed = np.zeros(sheet.w.shape, bool)
    removed[sheet.inside] = taken
    rest = sheet.inside & ~removed
    slivers = rest & ~ndimage.binary_opening(rest, _NEIGHBOURS)
    rest &= ~(slivers & ndimage.binary_dilation(removed, _NEIGHBOURS, iterations=_BESIDE))
    parts, _ = ndimage.label(rest, _NEIGHBOURS)
    return sheet.only(are_large(parts, settings.company_area / sheet.step))
