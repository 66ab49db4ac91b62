"""From a click to a horizon, from a picked stick to a fault: traced in a box around it, so that it takes seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import ArrayLike, BoolArray, Float64Array, Progress
from seismo3d._validate import as_points, freeze
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.plot.pictures import axis_coordinates
from seismo3d.seismic.faults import FaultSettings, trace_faults
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.layer_time import LayerModel, model_layers
from seismo3d.seismic.tracks import Track, trace_tracks
from seismo3d.viewer.interpretation import take_cells

REACHES = {"near": 700_000, "far": 4_000_000, "all": 64_000_000}
"""Samples of the box in which a click is traced: seconds, a minute, and as long as it takes, up to a medium cube."""
_NEAR = 3.0
"""Voxels within which a surface counts as running along a stick."""
_BEYOND = 4.0
"""Voxels by which a box's surfaces go on beyond it, so that they cut all of it."""
_MARGIN = 12
"""Traces from a side of a box, not the cube's own, within which a point is too near for the layers kept of it."""
_EASIER = 0.6
"""What the thresholds are multiplied by where nothing was found along a stick at their own values."""

Box = tuple[slice, slice, slice]


def place_box(shape: tuple[int, int, int], points: ArrayLike, *, most: int = REACHES["near"], margin: int = 24) -> Box:
    """Place a box of whole traces around points, as large as the work allows.

    Parameters
    ----------
    shape : (int, int, int)
        The cube's shape.
    points : array_like of shape (n, 3)
        Index coordinates that lie inside, where the box is not too large then.
    most : int
        Samples that the box may hold.
    margin : int
        Traces that it goes beyond the points at least.

    Returns
    -------
    tuple of slice
        Inlines, crosslines, samples (all of them).
    """
    at = as_points(points, "points", dim=3)
    low, high = np.floor(at.min(axis=0))[:2], np.ceil(at.max(axis=0))[:2]
    sides = np.maximum(high - low + 1 + 2 * margin, 1.0)
    wanted = max(1.0, most / shape[2])
    sides = np.maximum(sides, np.sqrt(wanted))
    # where one side is the whole cube's, the other may be longer
    for axis in (0, 1):
        if sides[axis] > shape[axis]:
            sides[axis] = shape[axis]
            sides[1 - axis] = max(sides[1 - axis], wanted / shape[axis])
    if sides.prod() > 4 * wanted:
        sides *= np.sqrt(4 * wanted / sides.prod())
    box = []
    for axis in (0, 1):
        n = int(min(shape[axis], max(8, round(sides[axis]))))
        middle = (low[axis] + high[axis]) / 2
        first = int(np.clip(round(middle - n / 2), 0, shape[axis] - n))
        box.append(slice(first, first + n))
    return box[0], box[1], slice(0, shape[2])


def crop_surfaces(surfaces: Sequence[FaultSurface], box: Box) -> list[FaultSurface]:
    """Cut surfaces down to a box, in its own index coordinates; those that miss it are left out."""
    low = np.array([part.start for part in box], np.float64)
    high = np.array([part.stop - 1 for part in box], np.float64)
    kept = []
    for surface in surfaces:
        inside = np.all((surface.vertices >= low - _BEYOND) & (surface.vertices <= high + _BEYOND), axis=1)
        cells: BoolArray = np.asarray(np.asarray(inside)[surface.cells].all(axis=1))
        if cells.any():
            part = take_cells(surface, cells)
            kept.append(replace(part, vertices=freeze((part.vertices - low).astype(np.float32))))
    return kept


def blank_faults(surfaces: Sequence[FaultSurface], shape: tuple[int, ...]) -> FaultSet:
    """Make a fault set of surfaces alone; its volumes are empty and take no memory."""
    return FaultSet(
        surfaces=tuple(surfaces),
        likelihood=np.broadcast_to(np.float32(0.0), shape),
        labels=np.broadcast_to(np.int32(0), shape),
        throw=np.broadcast_to(np.float32(np.nan), shape),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Layers:
    box: Box
    surfaces: tuple[FaultSurface, ...]
    values: Any
    model: LayerModel


class Tracer:
    """Traces horizons and faults in a cube, a box at a time; keeps the layers of the latest box.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube (inline, crossline, sample), in memory or lazy; only boxes of it are read.

    Attributes
    ----------
    reach : {"near", "far", "all"}
        How large the box around a click is: see ``REACHES``.
    """

    def __init__(self, cube: Any) -> None:
        self._cube = cube
        self._layers: _Layers | None = None
        self.reach = "near"

    def trace_horizon(
        self, seed: ArrayLike, *, surfaces: Sequence[FaultSurface] = (), progress: Progress | None = None
    ) -> tuple[Track, Box]:
        """Follow the horizon through a point, across faults, in a box around it.

        Parameters
        ----------
        seed : array_like of shape (3,)
            Fractional index coordinates.
        surfaces : sequence of FaultSurface
            The faults that it is followed across.
        progress : callable, optional
            Called with the stage's name and the share of it that is done.

        Returns
        -------
        track : Track
            A map of the whole cube, NaN outside the box.
        box : tuple of slice
            Where it was followed.

        Raises
        ------
        ParameterError
            If the point lies outside the cube or on a trace without data.
        """
        point = as_points(np.asarray(seed)[None], "seed", dim=3)[0]
        shape = self._cube.shape
        if (point < -0.5).any() or (point > np.array(shape) - 0.5).any():
            raise ParameterError(f"seed {tuple(point)} lies outside the cube of shape {shape}. Click inside it.")
        layers = self._find_layers(np.clip(point, 0, np.array(shape) - 1), tuple(surfaces), progress)
        low = np.array([part.start for part in layers.box])
        local = np.clip(point - low, 0, np.array(layers.values.shape) - 1)
        seeds = [self._coordinates(layers.values, local)]
        track = trace_tracks(layers.values, seeds, layers=layers.model, progress=progress)[0]
        return self._widen(track, layers.box), layers.box

    def trace_fault(self, stick: ArrayLike, *, progress: Progress | None = None) -> tuple[FaultSurface, Box]:
        """Trace the fault along a picked stick, in a box around it.

        The box is traced at the usual thresholds; where no surface runs along half of the stick, at lower ones.

        Parameters
        ----------
        stick : array_like of shape (n, 3)
            Two points or more on one line of the cube, in index coordinates.
        progress : callable, optional
            Called with the stage's name and the share of it that is done.

        Returns
        -------
        surface : FaultSurface
            In index coordinates of the whole cube.
        box : tuple of slice
            Where it was traced.

        Raises
        ------
        ParameterError
            If the stick has fewer than two points.
        GeometryError
            If there is no break of the layers along it.
        """
        points = resample(stick)
        box = place_box(self._cube.shape, points, most=REACHES[self.reach])
        low = np.array([part.start for part in box], np.float32)
        values = self._read(box)
        settings = FaultSettings()
        easier = replace(settings, least_score=_lower(settings.least_score), end_score=_lower(settings.end_score))
        for tried in (settings, easier):
            found = trace_faults(values, settings=tried, progress=progress)
            moved = [replace(s, vertices=freeze(s.vertices + low)) for s in found.surfaces]
            best = follow(moved, points)
            if best is not None:
                return moved[best], box
        raise GeometryError(
            "no break of the layers runs along half of the stick; expected one within three voxels of it. "
            "Pick the stick along a break, over more of its height."
        )

    def _find_layers(
        self, point: Float64Array, surfaces: tuple[FaultSurface, ...], progress: Progress | None
    ) -> _Layers:
        known = self._layers
        box = place_box(self._cube.shape, point[None], most=REACHES[self.reach])
        if known is not None and _serves(known.box, box, point, self._cube.shape) and _same(known.surfaces, surfaces):
            return known
        values = self._read(box)
        faults = blank_faults(crop_surfaces(surfaces, box), values.shape)
        self._layers = _Layers(box, surfaces, values, model_layers(values, faults=faults, progress=progress))
        return self._layers

    def _read(self, box: Box) -> Any:
        part = self._cube[box]
        return part.compute() if hasattr(part, "compute") else np.asarray(part)

    def _coordinates(self, values: Any, local: Float64Array) -> tuple[float, ...]:
        if not hasattr(values, "dims"):
            return tuple(float(v) for v in local)
        axes = (axis_coordinates(values, k) for k in range(3))
        return tuple(float(np.interp(at, np.arange(len(axis)), axis)) for at, axis in zip(local, axes, strict=True))

    def _widen(self, track: Track, box: Box) -> Track:
        """Lay a box's track into a map of the whole cube."""
        maps = []
        for part in (track.depth, track.confidence):
            whole = np.full(self._cube.shape[:2], np.nan, np.float32)
            whole[box[:2]] = part
            maps.append(freeze(whole))
        return replace(track, depth=maps[0], confidence=maps[1])


def resample(stick: ArrayLike) -> Float64Array:
    """Points along a stick about one voxel apart.

    Raises
    ------
    ParameterError
        If it has fewer than two points that differ.
    """
    points = as_points(stick, "stick", dim=3)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if len(points) < 2 or lengths.sum() < 1.0:
        raise ParameterError(f"stick has {len(points)} points on one spot; expected two or more along the fault.")
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0.0, way[-1], int(np.ceil(way[-1])) + 1)
    return np.stack([np.interp(at, way, points[:, k]) for k in range(3)], axis=1)


def follow(surfaces: Sequence[FaultSurface], points: Float64Array) -> int | None:
    """Return the index of the surface that runs along most of a stick, None where none does along half of it."""
    best, most = None, 0.5
    for number, surface in enumerate(surfaces):
        spread = _spread(surface)
        distance = np.asarray(cKDTree(spread).query(points, distance_upper_bound=_NEAR)[0])
        along: BoolArray = np.isfinite(distance)
        # of two along the same share, the nearer one
        share = float(along.mean()) - 1e-3 * float(distance[along].mean() if along.any() else 0.0)
        if share >= most:
            best, most = number, share
    return best


def _spread(surface: FaultSurface) -> Float64Array:
    """Vertices, middles of triangles and of their sides: dense enough to measure distances to."""
    corners = surface.vertices[surface.cells].astype(np.float64)
    sides = (corners + np.roll(corners, 1, axis=1)) / 2
    return np.concatenate([surface.vertices.astype(np.float64), corners.mean(axis=1), sides.reshape(-1, 3)])


def _lower(scores: tuple[float, ...]) -> Any:
    return tuple(_EASIER * score for score in scores)


def _same(first: tuple[FaultSurface, ...], second: tuple[FaultSurface, ...]) -> bool:
    return len(first) == len(second) and all(a is b for a, b in zip(first, second, strict=True))


def _serves(known: Box, wanted: Box, point: Float64Array, shape: tuple[int, int, int]) -> bool:
    """Tell whether a box is as large as is wanted and holds a point, not near a side that is not the cube's own."""
    for at, part, other, n in zip(point, known, wanted, shape, strict=True):
        low = part.start if part.start == 0 else part.start + _MARGIN
        high = part.stop - 1 if part.stop == n else part.stop - 1 - _MARGIN
        if not low <= at <= high or part.stop - part.start < other.stop - other.start:
            return False
    return True
