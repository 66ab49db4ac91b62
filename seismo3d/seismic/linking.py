"""Ridge points linked into surfaces: sets of points that each lie on one sheet, one point for each place."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from seismo3d._threads import map_items
from seismo3d._typing import AnyArray, Float32Array, IntArray
from seismo3d.seismic._kernels_linking import (
    count_contacts,
    fill_cells,
    find_lone_surfaces,
    grow_surfaces,
    number_cells,
)
from seismo3d.seismic.changeovers import part_changeovers
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheets import Sheet, SheetSettings, fit_sheet

# into so many shares, to be counted one by one, the points of a cube are split
_SHARES = 8
# points of surfaces of which parts may be of another fault
_LARGE = 400


class Room(Protocol):
    """Where linking keeps what is as long as there are points."""

    @property
    def most(self) -> int:
        """Points that are worked on between two rests."""
        ...

    def array(self, shape: tuple[int, ...], dtype: Any) -> AnyArray:
        """Return an array to write to."""
        ...

    def rest(self) -> None:
        """Do what keeps memory low."""
        ...


class InMemory:
    """Keeps everything in memory."""

    most = 2**62

    def array(self, shape: tuple[int, ...], dtype: Any) -> AnyArray:
        """Return an array to write to."""
        return np.empty(shape, dtype)

    def rest(self) -> None:
        """Do nothing."""


def link_sheets(
    ridges: RidgePoints,
    shape: tuple[int, int, int],
    *,
    step: int,
    least_points: int,
    end_score: float = 0.0,
    settings: SheetSettings | None = None,
    room: Room | None = None,
) -> list[Sheet]:
    """Link ridge points into sheets, largest first.

    A surface grows from its best point over neighbours that lie on each other's planes, one point for each place on it:
    where faults branch or cross, each keeps its own. Where one has gone on along another that it crosses, that part is
    given back (:mod:`~seismo3d.seismic.changeovers`). Surfaces that continue each other across a gap are joined.

    Parameters
    ----------
    ridges : RidgePoints
        From :func:`~seismo3d.seismic.scan.thin`.
    shape : tuple of int
        Shape of the evidence's grid.
    step : int
        Samples a step of that grid.
    least_points : int
        Smaller sets are left out.
    end_score : float
        Support, averaged over the surface nearby, below which a surface ends.
    settings : SheetSettings, optional
        When points belong together.
    room : Room, optional
        Where arrays as long as there are points are kept; in memory without one.

    Returns
    -------
    list of Sheet
    """
    settings = settings or SheetSettings()
    sheets: list[Sheet] = []
    for number, parts in enumerate(_grow(ridges, shape, step, settings, room)):
        if room is not None and number % 64 == 0:
            room.rest()
        whole = np.concatenate(parts)
        if len(whole) < least_points:
            continue
        sheet, share = fit_sheet(ridges, whole, shape, step, end_score, settings)
        if len(parts) == 1 or share > settings.joint_share:
            sheets.append(sheet)
        else:  # no one height field: what seemed to continue is two faults that meet
            sheets += [
                fit_sheet(ridges, part, shape, step, end_score, settings)[0]
                for part in parts
                if len(part) >= least_points
            ]
    return sorted(sheets, key=lambda sheet: -sheet.area)


class _Neighbourhoods(NamedTuple):
    """What tells which ridge points are near each other.

    Attributes
    ----------
    normals : ndarray of shape (n, 3), float32
        Of their planes.
    cells, n_cells
        Numbers of the cells of points, and how many there are: see :func:`number_cells`.
    points : ndarray of shape (n_cells, 64), int32
        Those in each cell.
    """

    normals: Float32Array
    cells: IntArray
    n_cells: int
    points: IntArray


def _grow(
    ridges: RidgePoints, shape: tuple[int, int, int], step: int, settings: SheetSettings, room: Room | None = None
) -> list[list[IntArray]]:
    """Return the points of every surface: as parts grown apart, one continuing another across a gap."""
    if len(ridges.score) == 0:
        return []
    room = room or InMemory()
    near = _find_neighbourhoods(ridges, shape, room)
    label = _label_surfaces(ridges, near, shape, step, settings, room)
    label[np.bincount(label)[label] < settings.fragment] = -1
    if 1 not in shape[:2]:
        _give_back(ridges, label, room)
    n_surfaces = int(label.max()) + 1
    if n_surfaces == 0:
        return []
    contacts = _count_contacts(ridges, near, label, n_surfaces, shape, step, settings, room)
    group = _join(n_surfaces, contacts, settings.contacts)
    parts: dict[int, list[IntArray]] = {}
    for part in _split(label):
        parts.setdefault(int(group[label[part[0]]]), []).append(part)
    return list(parts.values())


def _give_back(ridges: RidgePoints, label: IntArray, room: Room) -> None:
    """Give parts of surfaces, in place, to those that they continue."""
    members = [part for part in _split(label) if len(part) >= _LARGE]
    numbers = [label[part[0]] for part in members]
    for number, part in zip(numbers, part_changeovers(ridges.positions, members, most=room.most), strict=True):
        label[part] = number
    room.rest()


def _find_neighbourhoods(ridges: RidgePoints, shape: tuple[int, int, int], room: Room) -> _Neighbourhoods:
    n, most = len(ridges.score), room.most
    normals = room.array((n, 3), np.float32)
    for start in range(0, n, min(n, most)):
        normals[start : start + most] = _unit_normals(ridges.planes[start : start + most])
    cells, n_cells = number_cells(ridges.voxels, *shape)
    points = room.array((n_cells, 64), np.int32)
    fill_cells(ridges.voxels, cells, points)
    return _Neighbourhoods(normals, cells, n_cells, points)


def _unit_normals(planes: Float32Array) -> Float32Array:
    normals = np.column_stack([planes[:, :2], -planes[:, 2]])
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def _label_surfaces(
    ridges: RidgePoints, near: _Neighbourhoods, shape: tuple[int, int, int], step: int, settings: SheetSettings,
    room: Room,
) -> IntArray:  # fmt: skip
    """Return the number of the surface that each point belongs to, grown from the best points on."""
    n = len(ridges.score)
    order = room.array((n,), np.int64)
    order[:] = np.argsort(-ridges.score, kind="stable")
    label = np.full(n, -1, np.int32)
    places = (2 * (shape[0] + shape[1]) + 1, shape[2])
    height, owner = np.zeros(places, np.float32), np.full(places, -1, np.int32)
    first = n_surfaces = 0
    while first < n:
        room.rest()
        first, n_surfaces = grow_surfaces(
            ridges.voxels, ridges.positions, near.normals, ridges.score, order, shape, (near.cells, near.points), step,
            settings.reach, _cosine(settings.angle_deg), np.float32(settings.off_plane), np.float32(settings.fold),
            _cosine(settings.turn_deg), first, n_surfaces, room.most, height, owner, label,
        )  # fmt: skip
    return label


def _count_contacts(
    ridges: RidgePoints, near: _Neighbourhoods, label: IntArray, n_surfaces: int, shape: tuple[int, int, int],
    step: int, settings: SheetSettings, room: Room,
) -> IntArray:  # fmt: skip
    """Return rows of two surfaces, their pairs of close points, and how many of these lie on each other's planes."""
    n, most = len(label), room.most
    holds = find_lone_surfaces(ridges.voxels, label, near.cells, near.n_cells)
    cosine = _cosine(0.7 * settings.angle_deg)
    contacts = []
    for start in range(0, n, min(n, most)):
        room.rest()
        ends = np.linspace(start, min(start + most, n), _SHARES + 1).astype(np.int64)
        contacts += map_items(
            lambda share: count_contacts(
                ridges.voxels, ridges.positions, near.normals, label, n_surfaces, shape, (near.cells, near.points),
                holds, step, settings.gap, cosine, np.float32(settings.off_plane), *share,
            ),
            pairwise(ends),
        )  # fmt: skip
    return np.concatenate(contacts)


def _cosine(angle_deg: float) -> np.float32:
    return np.float32(np.cos(np.radians(angle_deg)))


def _split(label: IntArray) -> list[IntArray]:
    """Return the members of every label from 0 on, in order."""
    members = np.flatnonzero(label >= 0)
    order = members[np.argsort(label[members], kind="stable")]
    starts = np.flatnonzero(np.diff(label[order]))
    return np.split(order, starts + 1) if len(order) else []


def _join(n_surfaces: int, contacts: IntArray, least: int) -> IntArray:
    """Return the group of every surface: united are those most of whose close points lie on each other's planes."""
    pairs, row = np.unique(contacts[:, :2], axis=0, return_inverse=True)
    (first, second), (near, along) = pairs.T, (np.bincount(row, counted) for counted in contacts.T[2:])
    joined = (along >= least) & (along > 0.7 * near)
    graph = coo_matrix((np.ones(joined.sum()), (first[joined], second[joined])), shape=(n_surfaces, n_surfaces))
    _, group = connected_components(graph, directed=False)
    return group
