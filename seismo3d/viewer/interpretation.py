"""An interpretation as it stands: faults and horizons with numbers that stay, and the edits that make the next one.

Every edit takes an interpretation and returns another; the old one stays as it was, which is all that undo needs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seismo3d._typing import ArrayLike, BoolArray
from seismo3d._validate import freeze
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.geometry.triangles import measure_cells
from seismo3d.seismic.faultset import VERTEX_ARRAYS, FaultSurface, surface_confidence
from seismo3d.seismic.tracks import Track


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """A fault of an interpretation.

    Attributes
    ----------
    number : int
        Its number, which no other fault or horizon has as long as this one is here or can come back by undo or redo.
    surface : FaultSurface
        The fault itself.
    sources : frozenset of int
        Labels whose voxels, in the volumes that were opened, belong to this fault.
    is_new : bool
        Whether some of it was traced in this session, so that its voxels are in no volume yet.
    """

    number: int
    surface: FaultSurface
    sources: frozenset[int] = frozenset()
    is_new: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Horizon:
    """A horizon of an interpretation: a track with a number that stays."""

    number: int
    track: Track


@dataclass(frozen=True, slots=True, eq=False)
class Interpretation:
    """Faults and horizons at one moment.

    Attributes
    ----------
    faults : tuple of Fault
        In the order in which they came.
    horizons : tuple of Horizon
        Likewise.
    next_number : int
        The number that the next fault or horizon gets.
    """

    faults: tuple[Fault, ...] = ()
    horizons: tuple[Horizon, ...] = ()
    next_number: int = 1

    def fault(self, number: int) -> Fault:
        """Return the fault of a number.

        Raises
        ------
        ParameterError
            If there is none.
        """
        for fault in self.faults:
            if fault.number == number:
                return fault
        known = ", ".join(str(fault.number) for fault in self.faults) or "none"
        raise ParameterError(f"fault {number} is not here; expected one of: {known}. Choose one of the list.")


def begin(faults: Any = None, tracks: Sequence[Track] = ()) -> Interpretation:
    """Start from results: the faults get their labels as numbers, and the tracks the numbers after them.

    Parameters
    ----------
    faults : FaultSet, optional
        Traced faults.
    tracks : sequence of Track
        Traced horizons.

    Returns
    -------
    Interpretation
        With all of them.
    """
    surfaces = faults.surfaces if faults is not None else ()
    known = tuple(Fault(n, surface, frozenset({n})) for n, surface in enumerate(surfaces, start=1))
    first = len(known) + 1
    horizons = tuple(Horizon(n, track) for n, track in enumerate(tracks, start=first))
    return Interpretation(known, horizons, first + len(horizons))


def add_fault(state: Interpretation, surface: FaultSurface) -> Interpretation:
    """Add a fault that was traced in this session."""
    added = Fault(state.next_number, surface, is_new=True)
    return replace(state, faults=(*state.faults, added), next_number=state.next_number + 1)


def add_horizon(state: Interpretation, track: Track) -> Interpretation:
    """Add a track."""
    added = Horizon(state.next_number, track)
    return replace(state, horizons=(*state.horizons, added), next_number=state.next_number + 1)


def delete(state: Interpretation, numbers: Iterable[int]) -> Interpretation:
    """Delete faults and horizons.

    Raises
    ------
    ParameterError
        If no number is given, or one that is not here.
    """
    gone = set(numbers)
    here = {fault.number for fault in state.faults} | {horizon.number for horizon in state.horizons}
    if not gone or gone - here:
        raise ParameterError(
            f"{sorted(gone) or 'nothing'} is to be deleted; expected numbers of the list. Select a fault or horizon."
        )
    return replace(
        state,
        faults=tuple(fault for fault in state.faults if fault.number not in gone),
        horizons=tuple(horizon for horizon in state.horizons if horizon.number not in gone),
    )


def merge_faults(state: Interpretation, numbers: Iterable[int]) -> Interpretation:
    """Make one fault of several: their vertices and triangles together, the confidence weighed by area.

    Raises
    ------
    ParameterError
        If fewer than two are given, or one that is not here.
    """
    chosen = [state.fault(number) for number in sorted(set(numbers))]
    if len(chosen) < 2:
        raise ParameterError(f"{len(chosen)} faults are to be merged; expected at least two. Select another one.")
    merged = Fault(
        state.next_number,
        _join([fault.surface for fault in chosen]),
        frozenset().union(*(fault.sources for fault in chosen)),
        any(fault.is_new for fault in chosen),
    )
    return _exchange(state, chosen, [merged])


def split_fault(state: Interpretation, number: int, *, point: ArrayLike, normal: ArrayLike) -> Interpretation:
    """Split a fault by a plane.

    Parameters
    ----------
    state : Interpretation
        What there is.
    number : int
        The fault.
    point : array_like of shape (3,)
        A point of the plane, in index coordinates.
    normal : array_like of shape (3,)
        Its normal; each triangle goes to the side on which its middle lies.

    Raises
    ------
    GeometryError
        If the plane does not cross the fault.
    ParameterError
        If the fault is not here.
    """
    fault = state.fault(number)
    middles = fault.surface.vertices[fault.surface.cells].mean(axis=1)
    side: BoolArray = (middles - np.asarray(point, np.float64)) @ np.asarray(normal, np.float64) >= 0.0
    if side.all() or not side.any():
        raise GeometryError(
            f"the line does not cross fault {number}; expected one that does. Draw it across the fault."
        )
    parts = [
        Fault(state.next_number + k, take_cells(fault.surface, chosen), fault.sources, fault.is_new)
        for k, chosen in enumerate((side, ~side))
    ]
    return _exchange(state, [fault], parts)


def take_cells(surface: FaultSurface, chosen: BoolArray) -> FaultSurface:
    """Cut a surface down to some of its cells, with the vertices that these use; area and confidence follow."""
    cells = surface.cells[chosen]
    used, renumbered = np.unique(cells, return_inverse=True)
    arrays: dict[str, Any] = {name: freeze(getattr(surface, name)[used]) for name in VERTEX_ARRAYS}
    area = float(measure_cells(arrays["vertices"], renumbered.reshape(cells.shape)).sum())
    return replace(
        surface,
        cells=freeze(renumbered.reshape(cells.shape).astype(np.int32)),
        area=area,
        confidence=surface_confidence(arrays["likelihood"], area),
        **arrays,
    )


def _join(surfaces: list[FaultSurface]) -> FaultSurface:
    arrays: dict[str, Any] = {
        name: freeze(np.concatenate([getattr(s, name) for s in surfaces])) for name in VERTEX_ARRAYS
    }
    starts = np.cumsum([0, *(len(s.vertices) for s in surfaces[:-1])])
    cells = np.concatenate([s.cells + start for s, start in zip(surfaces, starts, strict=True)])
    areas = np.array([s.area for s in surfaces])
    confidence, share, certainty = (
        float(np.average([getattr(s, name) for s in surfaces], weights=np.maximum(areas, 1e-9)))
        for name in ("confidence", "strike_share", "slip_certainty")
    )
    return replace(
        surfaces[0],
        cells=freeze(cells.astype(np.int32)),
        area=float(areas.sum()),
        confidence=confidence,
        strike_share=share,
        slip_certainty=certainty,
        **arrays,
    )


def _exchange(state: Interpretation, old: list[Fault], new: list[Fault]) -> Interpretation:
    """Put new faults in the place of the first of the old ones."""
    gone = {fault.number for fault in old}
    place = next(k for k, fault in enumerate(state.faults) if fault.number in gone)
    kept = [fault for fault in state.faults if fault.number not in gone]
    before = sum(fault.number not in gone for fault in state.faults[:place])
    faults = (*kept[:before], *new, *kept[before:])
    return replace(state, faults=faults, next_number=max(f.number for f in new) + 1)
