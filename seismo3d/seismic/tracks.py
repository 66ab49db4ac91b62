"""Tracks: horizons followed from seeds through a whole cube and across its faults."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._settings import as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import Float32Array, Float64Array, Progress
from seismo3d._validate import as_array, as_kind, freeze
from seismo3d.errors import ParameterError, Seismo3dWarning, ShapeError
from seismo3d.geometry.axis import Axis
from seismo3d.seismic._kernels_tracks import lies_in_data
from seismo3d.seismic.cube_checks import check_order, tell_extent
from seismo3d.seismic.layer_time import LayerModel, model_layers
from seismo3d.seismic.preparing import describe_volume
from seismo3d.seismic.track_events import check_event, seed_events, snap_to_events
from seismo3d.seismic.track_fitting import fit_track
from seismo3d.seismic.track_refining import TrackSettings


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One horizon.

    Attributes
    ----------
    depth : ndarray of shape (inline, crossline), or (trace,) of a section, float32
        Where the horizon is, in the unit of the cube's sample coordinate (fractional sample index of a bare array); NaN
        where it was not traced.
    confidence : ndarray of the same shape, float32
        Correlation of the waveform there with that at the seeds, 0 to 1; NaN where it was not traced. Beside a fault,
        where too little of a trace is left to be compared, that of the block around times the share that is left.
    seeds : ndarray of shape (n, 3), or (n, 2) of a section, float64
        The points that it was traced from, in the cube's coordinates.
    sample_unit : str
        "ms", "m", "ft" or "samples"; any other word of the cube as it is.
    """

    depth: Float32Array
    confidence: Float32Array
    seeds: Float64Array
    sample_unit: str = "samples"

    def __repr__(self) -> str:
        return (
            f"<Track: {len(self.seeds)} seeds, on {self.share:.0%} of {self.depth.size} traces, in {self.sample_unit}>"
        )

    @property
    def share(self) -> float:
        """Share of the cube's traces on which the horizon was traced."""
        return float(np.isfinite(self.depth).mean())


def trace_tracks(
    cube: Any,
    seeds: Sequence[Any] | None = None,
    *,
    faults: Any = None,
    event: str | None = None,
    count: int = 5,
    layers: LayerModel | None = None,
    settings: TrackSettings | None = None,
    progress: Progress | None = None,
    memory: int | str | None = None,
    folder: str | Path | None = None,
    scheduler: str | None = None,
) -> list[Track]:
    """Follow horizons from seeds through a cube, across its faults.

    A track is a level set of the layer time (see :func:`~seismo3d.layer_time`). Every part of it that faults bound, or
    traces unlike their neighbours, is compared with the parts that the seeds lie on over a long window of layers, which
    ends at faults, and moved to where it fits, or left out where it fits nowhere; then each trace is aligned with that
    waveform at sub-sample precision. Where a reverse fault lays a horizon over itself the track is the upper one, or
    the lower one around a seed that lies on it. A track passes through its seeds, and between two that lie side by
    side; of one that noise or a missed fault parts from all around it, it holds the trace alone, and a warning says so.
    Of three or more those do not count that lie more than three samples off a block on which others lie, while most
    agree; a seed that is alone on its block tells where the horizon is there. A track ends where it leaves the cube.

    Parameters
    ----------
    cube : DataArray or array_like
        A cube (inline, crossline, sample) or a section (trace, sample).
    seeds : sequence, optional
        One entry a track: a point (inline, crossline, time or depth) in the cube's coordinates (indices on a bare
        array; of a section without the inline), or a list of points that lie on one horizon. Without seeds the `count`
        best horizons, as :func:`~seismo3d.find_horizons` finds them.
    faults : FaultSet, optional
        Faults of this cube.
    event : {"peak", "trough", "zero"}, optional
        Put each track on such an event: the seeds are moved to the nearest one, and every trace to the one next to
        where the track runs; zero crossings all rise, or all fall. Traces without one are left out. By default the
        seed's own phase is kept.
    count : int
        Number of horizons to find where no seeds are given.
    layers : LayerModel, optional
        Of this cube and these faults, from :func:`model_layers`, to save its computation.
    settings : TrackSettings, optional
        Windows and thresholds.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.
    memory, folder, scheduler : optional
        As for :func:`~seismo3d.layer_time`: a cube that needs more memory in one piece is worked on in blocks, and
        tracks read from disk what lies along them. A section that needs more is refused.

    Returns
    -------
    list of Track
        One for each seed, in their order; without seeds best first.

    Warns
    -----
    Seismo3dWarning
        If a track could not be followed from one of its seeds, which it holds on its own trace alone.

    Raises
    ------
    ShapeError
        If the cube has neither two nor three axes or is too small, or a seed has not as many numbers.
    ParameterError
        If a seed lies outside the cube, on a trace without data, in a mute or a gap, or far from any `event`, `event`
        is not known, seeds of one track lie on one trace, apart, `layers` is given for a section or beside what it
        takes the place of, or is no LayerModel, work in blocks is refused as by :func:`~seismo3d.layer_time`, `faults`
        is no FaultSet, `settings` are no TrackSettings, or `progress` is no function.
    GeometryError
        If the faults are of a cube or section elsewhere.
    """
    settings = as_settings(settings, TrackSettings)
    check_event(event)
    report = as_progress(progress)
    describe_volume(cube if hasattr(cube, "dtype") else as_array(cube, "cube"))
    is_volume = np.ndim(cube) == 3
    if is_volume and layers is not None:
        as_kind(layers, LayerModel, "layers", remedy="Give what model_layers returned, or leave it out.")
    groups = index_seeds(cube, seeds) if is_volume and seeds is not None else []
    is_bounded = memory is not None or folder is not None or scheduler is not None
    if is_bounded and not is_volume:
        from seismo3d.seismic.blocks.layering import whole_layers_bytes
        from seismo3d.seismic.blocks.tracing import asks_for_blocks

        asks_for_blocks(cube, memory, folder=folder, scheduler=scheduler, whole_bytes=whole_layers_bytes)
    elif is_bounded:
        if layers is not None:
            raise ParameterError("layers is given with memory, folder or scheduler; it takes their place. Give either.")
        from seismo3d.seismic.blocks.stored_layers import layers_within

        layers = layers_within(
            cube, faults, memory=memory, folder=folder, scheduler=scheduler, settings=settings.layers, progress=report
        )
    if seeds is None:
        from seismo3d.seismic.horizon_search import find_horizons

        return find_horizons(cube, count, faults=faults, event=event, layers=layers, settings=settings, progress=report)
    if np.ndim(cube) == 2:
        from seismo3d.seismic.section_tracks import cut_middle, put_on_middle, thicken

        if layers is not None:
            raise ParameterError("layers is given for a section; it is for cubes. Leave it out.")
        thick, surfaces = thicken(cube, faults)
        groups = [(group, put_on_middle(index)) for group, index in read_seeds(cube, seeds)]
        _check_groups(groups)
        layers = model_layers(thick, faults=surfaces, settings=settings.layers, progress=report)
        return [cut_middle(track) for track in _follow(thick, groups, layers, event, settings, report)]
    if layers is None:
        layers = model_layers(cube, faults=faults, settings=settings.layers, progress=report)
    return _follow(cube, groups, layers, event, settings, report)


def _follow(
    cube: Any,
    groups: list[tuple[Float64Array, Float64Array]],
    layers: LayerModel,
    event: str | None,
    settings: TrackSettings,
    report: Progress,
) -> list[Track]:
    """Return the tracks through seeds, which are given as the user gave them and as fractional indices of the cube."""
    axis = axes_of(cube)[2]
    for number, (group, index) in enumerate(groups):
        _check_told(index, group, layers, number, settings.near)
    tracks = []
    for number, (group, index) in enumerate(groups):
        report("tracks", number / len(groups))
        slope = 0.0
        if event is not None:
            index, slope = _on_events(cube, layers, index, group, event, number)
        depth, confidence, alone = fit_track(layers, index, settings)
        for at in group[alone]:
            warnings.warn(
                f"seeds[{number}] {_named(at)} is parted by a fault or by noise from the traces around it. The track "
                "holds it there alone, and may be another horizon elsewhere: look at it, or choose another seed.",
                Seismo3dWarning,
                stacklevel=3,
            )
        if event is not None:
            depth = snap_to_events(cube, layers, depth, event, slope)
            confidence = np.where(np.isfinite(depth), confidence, np.float32(np.nan))
        depth = axis.coordinate(depth).astype(np.float32)
        tracks.append(Track(freeze(depth), freeze(confidence), freeze(group), layers.sample_unit))
    return tracks


def axes_of(cube: Any) -> tuple[Axis, ...]:
    """Return a cube's three axes, or a section's two; of a bare array those of its indices."""
    shape = np.shape(cube)
    if not hasattr(cube, "dims"):
        return tuple(Axis(0.0, 1.0, n) for n in shape)
    return tuple(
        Axis.from_coordinates(cube[name].values, str(name)) if name in cube.coords else Axis(0.0, 1.0, n)
        for name, n in zip(cube.dims, shape, strict=True)
    )


def axis_points(axes: tuple[Axis, ...], points: Float64Array) -> Float64Array:
    """Index points of shape (n, 3) in coordinates."""
    return np.stack([axis.coordinate(points[:, k]) for k, axis in enumerate(axes)], axis=1)


def index_seeds(cube: Any, seeds: Sequence[Any]) -> list[tuple[Float64Array, Float64Array]]:
    """Return the seeds of each track, in a cube's coordinates and as fractional indices, both of shape (n, 3).

    Raises
    ------
    ShapeError
        If a seed is no point of three numbers.
    ParameterError
        If a seed lies outside the cube, or two of one track on one trace.
    """
    check_order(cube)
    groups = read_seeds(cube, seeds)
    _check_groups(groups)
    return groups


def read_seeds(cube: Any, seeds: Sequence[Any]) -> list[tuple[Float64Array, Float64Array]]:
    """Return seeds as :func:`index_seeds` does, of a section without the inline; those of a track may contradict."""
    if not np.iterable(seeds):
        raise ShapeError(f"seeds is {seeds!r}; expected a list, one entry a track. Give count alone for that many.")
    axes = axes_of(cube)
    last = np.array(np.shape(cube)) - 1
    groups = []
    rows = seeds.to_numpy() if hasattr(seeds, "to_numpy") else seeds  # a table yields its columns' names else
    for number, entry in enumerate(rows):
        group = _as_points(entry, number, len(axes))
        index = np.stack([axis.index(group[:, k]) for k, axis in enumerate(axes)], axis=1)
        outside = ((index < -1e-6) | (index > last + 1e-6)).any(axis=1)
        if outside.any():
            name = "cube" if len(axes) == 3 else "section"
            raise ParameterError(
                f"seeds[{number}] {_named(group[outside.argmax()])} lies outside the {name}: {tell_extent(cube)}. "
                "Give a point in it, in this order."
            )
        groups.append((group, index))
    return groups


def _as_points(entry: Any, number: int, n_axes: int) -> Float64Array:
    told = f"{entry!r:.80}"
    try:
        points = np.atleast_2d(np.asarray(entry, dtype=np.float64))
        told = _named(points[0])[:80] if points.shape[:-1] == (1,) else told
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != n_axes or not np.isfinite(points).all():
        point = "(inline, crossline, time or depth)" if n_axes == 3 else "(trace, time or depth)"
        remedy = " Put one point alone in a list." if points.shape == (1, 1) else ""
        raise ShapeError(
            f"seeds[{number}] is {told}; expected a point {point}, or a list of such points, of finite numbers.{remedy}"
        )
    return points


def _check_groups(groups: list[tuple[Float64Array, Float64Array]]) -> None:
    """Refuse seeds of one track that lie on one trace, apart."""
    for number, (group, index) in enumerate(groups):
        _check_together(group, index, number)


def _check_together(group: Float64Array, index: Float64Array, number: int) -> None:
    order = np.lexsort((index[:, 2], *np.rint(index[:, :2]).T))
    step = np.diff(index[order], axis=0)
    same = (np.rint(index[order[1:], :2]) == np.rint(index[order[:-1], :2])).all(axis=1)
    if (same & (step[:, 2] > 1.0)).any():
        at = int((same & (step[:, 2] > 1.0)).argmax())
        raise ParameterError(
            f"seeds[{number}] has {_named(group[order[at]])} and {_named(group[order[at + 1]])} on one trace; "
            "a track passes a trace once. Give one of them."
        )


def _check_told(index: Float64Array, group: Float64Array, layers: LayerModel, number: int, reach: int) -> None:
    """Refuse seeds that lie where their trace has no data."""
    for at, point in zip(index, group, strict=True):
        trace = tuple(np.rint(at[:2]).astype(int))
        if not layers.live[trace]:
            raise ParameterError(f"seeds[{number}] {_named(point)} lies on a trace without data. Choose another trace.")
        if not lies_in_data(np.asarray(layers.valid[trace]), float(at[2]), reach):
            raise ParameterError(
                f"seeds[{number}] {_named(point)} lies where its trace is muted or has a gap. Choose a point with data."
            )


def _on_events(
    cube: Any, layers: LayerModel, index: Float64Array, group: Float64Array, event: str, number: int
) -> tuple[Float64Array, float]:
    """Return seeds moved onto events, and the slope of zero crossings; refuse seeds that have none near."""
    moved, slope = seed_events(cube, layers, index, event)
    lost = np.isnan(moved[:, 2])
    if lost.any():
        what = "zero crossing" if event == "zero" else event
        raise ParameterError(
            f"seeds[{number}] {_named(group[lost.argmax()])} has no {what} near it. Move it, or leave event out."
        )
    return moved, slope


def _named(point: Float64Array) -> str:
    return "(" + ", ".join(f"{value:.8g}" for value in point) + ")"
