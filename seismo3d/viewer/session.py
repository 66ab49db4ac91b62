"""A session of the viewer without its page: what is shown, selected and edited, and what a click does."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array, Progress
from seismo3d._validate import as_kind
from seismo3d.errors import FileAccessError, GeometryError, ParameterError, ShapeError
from seismo3d.geometry.axis import Axis
from seismo3d.io._files import as_path
from seismo3d.plot.pictures import as_tracks, axis_coordinates, axis_labels
from seismo3d.seismic.cube_checks import check_faults_of
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.tracks import Track
from seismo3d.viewer.colours import ATTRIBUTES, Scale, make_scale
from seismo3d.viewer.history import History
from seismo3d.viewer.interpretation import (
    Interpretation,
    add_fault,
    add_horizon,
    begin,
    delete,
    merge_faults,
    split_fault,
)
from seismo3d.viewer.listing import list_rows
from seismo3d.viewer.panels import (
    CMAPS,
    HORIZON_COLOURS,
    Cut,
    cut_fault,
    encode_slice,
    fault_paths,
    horizon_path,
    nearest_fault,
    segments_path,
)
from seismo3d.viewer.relabelling import in_order
from seismo3d.viewer.slices import SliceReader
from seismo3d.viewer.storage import check_folder, last_save, save_session
from seismo3d.viewer.tracing import REACHES, Tracer, blank_faults, follow, resample

MODES = ("look", "seed", "stick", "split")
_HIT = 9.0
"""Pixels within which a click hits a fault."""


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One flat panel, ready for a page.

    Attributes
    ----------
    image : str
        Data URI of the slice.
    shape : (int, int)
        Rows and columns in index units.
    faults : list of dict
        Paths with ``d`` and ``stroke``.
    selected : str
        Path of the selected faults.
    horizons : list of dict
        Paths with ``d``, ``stroke`` and ``number``.
    picked : list of (float, float)
        Picked points as (column, row), with the middle of the first at one half.
    lines : (float, float)
        Where the two other slices cross: column, row.
    label : str
        What the panel shows.
    is_full : bool
        Whether the slice is at full detail.
    """

    image: str
    shape: tuple[int, int]
    faults: list[dict[str, str]]
    selected: str
    horizons: list[dict[str, Any]]
    picked: list[tuple[float, float]]
    lines: tuple[float, float]
    label: str
    is_full: bool


class Session:
    """What a viewer's page shows and does.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube (inline, crossline, sample), in memory or lazy.
    faults : FaultSet, optional
        Faults of it.
    tracks : sequence of Track
        Horizons of it.
    folder : path, optional
        Where it is saved: a new folder, an empty one, or an earlier session's, which is replaced.

    Raises
    ------
    FileAccessError
        If the folder holds something that no session saved.
    ShapeError
        If the cube has not three axes, or faults or tracks are of another cube.
    """

    def __init__(
        self,
        cube: Any,
        faults: FaultSet | None = None,
        *,
        tracks: Sequence[Track] = (),
        folder: str | Path | None = None,
    ) -> None:
        self.reader = SliceReader(cube)
        check_faults_of(cube, faults)
        tracks = as_tracks(tracks)
        for track in tracks:
            _check_track(track, self.reader.shape)
        self.cube = cube
        self.folder = None if folder is None else as_path(folder, "folder")
        self._last_save: tuple[int, int] | None = None
        if self.folder is not None:
            check_folder(self.folder)
            self._last_save = last_save(self.folder)
        self.tracer = Tracer(cube)
        self.history = History(begin(faults, tracks))
        self.selected: frozenset[int] = frozenset()
        self.index = [n // 2 for n in self.reader.shape]
        self.attribute = "throw" if faults is not None else "fault"
        self.cmap = CMAPS[0]
        self.mode = MODES[0]
        self.picked: list[Float64Array] = []
        self._picked_on: tuple[int, int] | None = None
        self._opened = faults
        self._limits: tuple[float, float] | None = None
        self._scale: tuple[Interpretation, Scale] | None = None
        self._cuts: dict[tuple[int, int], tuple[FaultSurface, Cut | None, int]] = {}
        self._writing = threading.Lock()

    @property
    def state(self) -> Interpretation:
        """The present faults and horizons."""
        return self.history.state

    @property
    def limits(self) -> tuple[float, float]:
        """Amplitudes that get the strongest colours; found when they are first asked for."""
        if self._limits is None:
            self._limits = self.reader.limits()
        return self._limits

    @property
    def scale(self) -> Scale:
        """Colour scale of the faults."""
        known = self._scale
        if known is None or known[0] is not self.state or known[1].attribute != self.attribute:
            known = (self.state, make_scale([fault.surface for fault in self.state.faults], self.attribute))
            self._scale = known
        return known[1]

    def move(self, axis: int, index: int) -> None:
        """Move the slice of one axis, within the cube."""
        self.index[axis] = int(np.clip(index, 0, self.reader.shape[axis] - 1))
        if self._picked_on is not None and self._picked_on[0] == axis:
            self.drop_picks()

    def choose(self, name: str, value: str) -> None:
        """Set ``mode``, ``attribute``, ``cmap`` or ``reach``.

        Raises
        ------
        ParameterError
            If there is no such setting or value.
        """
        known = {"mode": MODES, "attribute": ATTRIBUTES, "cmap": CMAPS, "reach": tuple(REACHES)}
        if value not in known.get(name, ()):
            raise ParameterError(f"{name} is {value!r}; expected one of {', '.join(known.get(name, known))}.")
        if name == "mode":
            self.drop_picks()
        setattr(self.tracer if name == "reach" else self, name, value)

    def panel(self, axis: int, *, most: int = 1024) -> Panel:
        """Draw the panel of one axis, with a slice of at most so many rows and columns."""
        index = self.index[axis]
        part = self.reader.read(axis, index, most=most)
        cuts = self.cuts(axis)
        surfaces = {fault.number: fault.surface for fault in self.state.faults}
        chosen = [cut.segments for cut in cuts if cut.number in self.selected]
        picked = self.picked if self._picked_on == (axis, index) else []
        points = [self._flat(axis, point) + 0.5 for point in picked]
        return Panel(
            image=encode_slice(part, limits=self.limits, cmap=self.cmap),
            shape=part.shape,
            faults=fault_paths(cuts, surfaces, self.scale),
            selected=segments_path(np.concatenate(chosen)) if chosen else "",
            horizons=self._horizons(axis, index),
            picked=[(float(point[0]), float(point[1])) for point in points],
            lines=self.crossing(axis),
            label=self.label(axis),
            is_full=part.is_full,
        )

    def crossing(self, axis: int) -> tuple[float, float]:
        """Where the two other slices cross a panel: column and row from its corner."""
        column, row = self._flat(axis, np.array(self.index, np.float64)) + 0.5
        return float(column), float(row)

    def label(self, axis: int) -> str:
        """Say which line a panel shows."""
        return f"{axis_labels(self.cube)[axis]} {axis_coordinates(self.cube, axis)[self.index[axis]]:.8g}"

    def place(self, axis: int, column: float, row: float) -> Float64Array:
        """Return the index coordinates of a point on a panel, where column and row count from the panel's corner."""
        point = np.empty(3)
        point[axis] = self.index[axis]
        across, down = (1, 0) if axis == 2 else (1 - axis, 2)
        point[across], point[down] = column - 0.5, row - 0.5
        return np.clip(point, 0.0, np.array(self.reader.shape) - 1.0)

    def cuts(self, axis: int) -> list[Cut]:
        """Faults on a panel; each is cut once as long as neither moves."""
        index, found = self.index[axis], []
        for fault in self.state.faults:
            key = (fault.number, axis)
            known = self._cuts.get(key)
            if known is None or known[0] is not fault.surface or known[2] != index:
                known = (fault.surface, cut_fault(fault, axis, index), index)
                self._cuts[key] = known
            if known[1] is not None:
                found.append(known[1])
        return found

    def click(self, axis: int, column: float, row: float, *, pixels: tuple[float, float] = (1.0, 1.0)) -> str:
        """Do what a click on a panel means in the present mode.

        "look" selects a fault, or moves the other slices to the point; "seed" and "stick" pick points that
        :meth:`trace_picked` traces from; "split" picks the two ends of a line and splits the selected fault by it.

        Parameters
        ----------
        axis : int
            The panel.
        column, row : float
            In index units from the panel's corner.
        pixels : (float, float)
            Size of a column and of a row on the screen.

        Returns
        -------
        str
            What happened.
        """
        point = self.place(axis, column, row)
        if self.mode == "look":
            return self._look(axis, point, pixels)
        on = (axis, self.index[axis])
        if self._picked_on != on or self.mode == "seed":
            self.drop_picks()
        self._picked_on = on
        self.picked.append(point)
        if self.mode == "split" and len(self.picked) == 2:
            return self._split(axis)
        return f"{len(self.picked)} {'point' if len(self.picked) == 1 else 'points'} picked"

    def drop_picks(self) -> None:
        """Forget the picked points."""
        self.picked, self._picked_on = [], None

    def select(self, numbers: Sequence[int]) -> None:
        """Select faults and horizons; numbers that are not here are left out."""
        here = {fault.number for fault in self.state.faults} | {entry.number for entry in self.state.horizons}
        self.selected = frozenset(numbers) & here

    def trace_picked(self, *, progress: Progress | None = None) -> str:
        """Trace the horizon through the picked seed, or the fault along the picked stick, and add it.

        Returns
        -------
        str
            What was traced.

        Raises
        ------
        ParameterError, GeometryError
            If too little was picked, or there is nothing to trace there.
        """
        points = [point.copy() for point in self.picked]
        if self.mode == "seed" and len(points) == 1:
            return self._trace_horizon(points[0], progress)
        if self.mode == "stick" and len(points) >= 2:
            return self._trace_fault(np.stack(points), progress)
        raise ParameterError(
            f"{len(points)} points are picked; expected one seed, or two or more points of a stick. Click on a panel."
        )

    def delete_selected(self) -> str:
        """Delete what is selected."""
        return self._edit(delete(self.state, self.selected), f"delete {_numbers(self.selected)}")

    def merge_selected(self) -> str:
        """Merge the selected faults."""
        merged = merge_faults(self.state, self.selected)
        words = self._edit(merged, f"merge {_numbers(self.selected)}")
        self.select([merged.next_number - 1])
        return words

    def undo(self) -> str:
        """Take the last edit back."""
        words = self.history.undo()
        self.select(tuple(self.selected))
        return f"undone: {words}" if words else "nothing to undo"

    def redo(self) -> str:
        """Do again what was undone last."""
        words = self.history.redo()
        self.select(tuple(self.selected))
        return f"done again: {words}" if words else "nothing to do again"

    def save(self) -> str:
        """Save to the session's folder, and say so, and where numbers there are not those of the list.

        Raises
        ------
        ParameterError
            If the session has none.
        FileAccessError
            If it cannot be written, or another session has saved to it since this one began or last saved.
        """
        if self.folder is None:
            raise ParameterError("the session has no folder; expected one to save to. Give one when it is opened.")
        with self._writing:
            state = self.state
            found = last_save(self.folder)
            if found not in (None, self._last_save):
                raise FileAccessError(
                    f"{self.folder} was saved by another session meanwhile, which would be lost. Give that folder "
                    "another name, and save again."
                )
            try:
                save_session(self.folder, self.cube, state, opened=self._opened)
            finally:
                self._last_save = last_save(self.folder)
            if state is self.state:
                self.history.mark_saved()
        numbers = [fault.number for fault in in_order(state)]
        differ = numbers != list(range(1, len(numbers) + 1))
        return f"saved in {self.folder}" + (", where faults are numbered anew, largest first" if differ else "")

    def rows(self) -> list[dict[str, Any]]:
        """Return a table of faults and horizons, one a row, for the page's list."""
        return list_rows(self.state, self.scale)

    def fault_set(self) -> FaultSet:
        """Return the present surfaces with empty volumes, to be drawn."""
        return blank_faults([fault.surface for fault in self.state.faults], self.reader.shape)

    def sample_axis(self) -> Axis:
        """Return the axis of the samples, by which depths become rows."""
        return Axis.from_coordinates(axis_coordinates(self.cube, 2), "samples")

    def _flat(self, axis: int, point: Float64Array) -> Float64Array:
        return point[[1, 0]] if axis == 2 else point[[1 - axis, 2]]

    def _horizons(self, axis: int, index: int) -> list[dict[str, Any]]:
        if axis == 2 or not self.state.horizons:
            return []
        samples = self.sample_axis()
        return [
            {
                "number": horizon.number,
                "d": horizon_path(horizon, samples, axis, index),
                "stroke": HORIZON_COLOURS[k % len(HORIZON_COLOURS)],
            }
            for k, horizon in enumerate(self.state.horizons)
        ]

    def _look(self, axis: int, point: Float64Array, pixels: tuple[float, float]) -> str:
        hit = nearest_fault(self.cuts(axis), self._flat(axis, point), scale=np.array(pixels), within=_HIT)
        if hit is not None:
            self.select(tuple(self.selected ^ {hit}))
            return f"fault {hit} {'selected' if hit in self.selected else 'no longer selected'}"
        for other in range(3):
            if other != axis:
                self.move(other, round(float(point[other])))
        return "slices moved"

    def _split(self, axis: int) -> str:
        start, end = self.picked
        self.drop_picks()
        chosen = [fault.number for fault in self.state.faults if fault.number in self.selected]
        if len(chosen) != 1:
            raise ParameterError(f"{len(chosen)} faults are selected; expected the one to split. Select it first.")
        held = np.zeros(3)
        held[axis] = 1.0
        normal = np.cross(end - start, held)
        if float(np.linalg.norm(normal)) < 1e-6:
            raise GeometryError("both points are on one spot; expected a line across the fault. Pick its ends apart.")
        return self._edit(split_fault(self.state, chosen[0], point=start, normal=normal), f"split fault {chosen[0]}")

    def _trace_horizon(self, point: Float64Array, progress: Progress | None) -> str:
        surfaces = [fault.surface for fault in self.state.faults]
        track, box = self.tracer.trace_horizon(point, surfaces=surfaces, progress=progress)
        share = float(np.isfinite(track.depth[box[:2]]).mean())
        with self._writing:
            state = add_horizon(self.state, track)
            self._edit(state, f"trace horizon {state.next_number - 1}")
        self.drop_picks()
        traces = f"{box[0].stop - box[0].start} x {box[1].stop - box[1].start}"
        return f"horizon {state.next_number - 1} traced on {100 * share:.0f} % of {traces} traces"

    def _trace_fault(self, points: Float64Array, progress: Progress | None) -> str:
        known = [fault.surface for fault in self.state.faults]
        there = follow(known, resample(points))
        if there is not None:
            number = self.state.faults[there].number
            self.select([number])
            self.drop_picks()
            return f"the stick lies on fault {number}, which is selected now"
        surface, _ = self.tracer.trace_fault(points, progress=progress)
        with self._writing:
            state = add_fault(self.state, surface)
            self._edit(state, f"trace fault {state.next_number - 1}")
        self.select([state.next_number - 1])
        self.drop_picks()
        return f"fault {state.next_number - 1} traced, {surface.area:.0f} voxels large"

    def _edit(self, state: Interpretation, words: str) -> str:
        self.history.do(state, words)
        self.select(tuple(self.selected))
        return words


def _numbers(numbers: frozenset[int]) -> str:
    return ", ".join(str(number) for number in sorted(numbers))


def _check_track(track: Track, shape: tuple[int, int, int]) -> None:
    as_kind(track, Track, "track", remedy="Give what trace_tracks returned, one by one.")
    if track.depth.shape != shape[:2]:
        raise ShapeError(f"track has shape {track.depth.shape}; expected {shape[:2]}. Give the cube it was traced in.")
