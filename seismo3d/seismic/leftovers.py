"""Sheets linked from the ridges that certain ones leave over: pieces of faults that others have cut up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from seismo3d._typing import BoolArray, IntArray
from seismo3d.seismic.doubles import node_normals
from seismo3d.seismic.extending import ExtendSettings, ridges_beside
from seismo3d.seismic.linking import InMemory, Room, link_sheets
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheet_distances import SheetNodes
from seismo3d.seismic.sheet_measures import strength
from seismo3d.seismic.sheets import Sheet, SheetSettings


def link_leftovers(
    sheets: Sequence[Sheet],
    ridges: RidgePoints,
    shape: tuple[int, int, int],
    *,
    step: int,
    least_points: int,
    link: SheetSettings | None = None,
    settings: ExtendSettings | None = None,
    room: Room | None = None,
) -> list[Sheet]:
    """Link the ridges that lie on no certain sheet, and keep what comes near one.

    Faults come in families and cut each other up. A piece of one between others is seen by few planes of the scan that
    none of the others crosses: its ridges are weaker than what is linked anywhere in a cube, and not so straight that
    the fault could be followed over to it.

    Parameters
    ----------
    sheets : sequence of Sheet
        All that were linked from the strong ridges of a cube.
    ridges : RidgePoints
        Weak and strong ones of the cube, by growing inline as :func:`~seismo3d.seismic.scan.thin` gives them.
    shape : tuple of int
        Shape of the evidence's grid.
    step : int
        Samples a step of that grid.
    least_points : int
        Smaller sets are left out.
    link : SheetSettings, optional
        When points belong together.
    settings : ExtendSettings, optional
        What is certain, what lies near it, the weakest ridge, and what lies on a sheet.
    room : Room, optional
        Bound of the memory.

    Returns
    -------
    list of Sheet
        New ones, marked as leftovers, largest first.
    """
    settings, room = settings or ExtendSettings(), room or InMemory()
    certain = [sheet for sheet in sheets if strength(sheet) >= settings.strength]
    if not certain:
        return []
    left: BoolArray = np.asarray(ridges.score >= settings.weakest)
    for sheet in certain:
        left[_on_sheet(sheet, ridges, settings)] = False
        room.rest()
    found = link_sheets(
        _select(ridges, left, room), shape, step=step, least_points=least_points, end_score=settings.weakest,
        settings=link, room=room,
    )  # fmt: skip
    hosts = [SheetNodes.of(sheet) for sheet in certain]
    return [replace(sheet, leftover=True) for sheet in found if _comes_near(sheet, hosts, settings.gap)]


def _comes_near(sheet: Sheet, others: Sequence[SheetNodes], gap: float) -> bool:
    if not sheet.inside.any():
        return False
    nodes = SheetNodes.of(sheet)
    return any(nodes.touches(other, gap) for other in others)


def _select(ridges: RidgePoints, chosen: BoolArray, room: Room) -> RidgePoints:
    """Return the chosen ridges in their order, kept where the room keeps things."""
    numbers = np.flatnonzero(chosen)
    columns = {entry.name: getattr(ridges, entry.name) for entry in fields(ridges)}
    found = {name: room.array((len(numbers), *column.shape[1:]), column.dtype) for name, column in columns.items()}
    for start in range(0, len(numbers), room.most):
        part = slice(start, start + room.most)
        for name, column in columns.items():
            found[name][part] = column[numbers[part]]
        room.rest()
    return RidgePoints(**found)


def _on_sheet(sheet: Sheet, ridges: RidgePoints, settings: ExtendSettings) -> IntArray:
    """Return the numbers of the ridges that lie on a sheet, in its attitude there."""
    near = ridges_beside(sheet, ridges, int(np.ceil(settings.off_sheet)), settings.weakest)
    place: IntArray = np.full(sheet.w.shape, -1)
    place[sheet.inside] = np.arange(np.count_nonzero(sheet.inside))
    node = place[near.row, near.column]
    on = node >= 0
    normals = node_normals(sheet)[node[on]]
    off = (near.height[on] - sheet.w[near.row[on], near.column[on]]) * (normals[:, :2] @ sheet.across)
    alike = np.abs((normals * near.normals[on]).sum(axis=1)) > np.cos(np.radians(settings.angle_deg))
    return near.number[on][alike & (np.abs(off) <= settings.off_sheet)]
