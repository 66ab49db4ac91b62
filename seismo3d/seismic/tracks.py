"""Tracks: horizons followed from seeds through a whole cube and across its faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Progress
from seismo3d._validate import freeze
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.axis import Axis
from seismo3d.seismic._kernels_tracks import read_waveforms
from seismo3d.seismic.layer_pieces import layer_pieces
from seismo3d.seismic.layer_time import LayerModel, model_layers
from seismo3d.seismic.track_fitting import fit_track
from seismo3d.seismic.track_refining import TrackSettings

EVENTS = ("peak", "trough", "zero")
_SNAP_REACH = 4


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One horizon.

    Attributes
    ----------
    depth : ndarray of shape (inline, crossline), or (trace,) of a section, float32
        Where the horizon is, in the unit of the cube's sample coordinate (fractional sample index of a bare array); NaN
        where it was not traced.
    confidence : ndarray of the same shape, float32
        Correlation of the waveform there with that at the seeds, 0 to 1; NaN where it was not traced.
    seeds : ndarray of shape (n, 3), or (n, 2) of a section, float64
        The points that it was traced from, in the cube's coordinates.
    sample_unit : str
        "ms", "m" or "samples".
    """

    depth: Float32Array
    confidence: Float32Array
    seeds: Float64Array
    sample_unit: str = "samples"

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

    A track is a level set of the layer time (see :func:`layer_time`). Every part of it that faults bound, or traces
    unlike their neighbours, is compared with the parts that the seeds lie on over a long window of layers, which ends
    at faults, and moved to where it fits, or left out where it fits nowhere; then each trace is aligned with that
    waveform at sub-sample precision. Where a reverse fault lays a horizon over itself the track is the upper one, on
    the part of the seeds their own. A track passes through its seeds.

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
        Put each track on the nearest such event. By default the seed's own phase is kept.
    count : int
        Number of horizons to find where no seeds are given.
    layers : LayerModel, optional
        Of this cube and these faults, from :func:`model_layers`, to save its computation.
    settings : TrackSettings, optional
        Windows and thresholds.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.
    memory, folder, scheduler : optional
        As for :func:`layer_time`: a cube that needs more memory in one piece is worked on in blocks, and tracks read
        from disk what lies along them.

    Returns
    -------
    list of Track
        One for each seed, in their order; without seeds best first.

    Raises
    ------
    ShapeError
        If the cube has neither two nor three axes, or a seed not as many numbers.
    ParameterError
        If a seed lies outside the cube or on a trace without data, `event` is not known, `layers` is given for a
        section or beside what it takes the place of, or work in blocks is refused as by :func:`layer_time`.
    """
    settings = settings or TrackSettings()
    is_bounded = memory is not None or folder is not None or scheduler is not None
    if is_bounded and np.ndim(cube) == 3:
        if layers is not None:
            raise ParameterError("layers is given with memory, folder or scheduler; it takes their place. Give either.")
        from seismo3d.seismic.blocks.stored_layers import layers_within

        _check_event(event)
        report = progress or _unheard
        layers = layers_within(
            cube, faults, memory=memory, folder=folder, scheduler=scheduler, settings=settings.layers, progress=report
        )
    if seeds is None:
        from seismo3d.seismic.horizon_search import find_horizons

        return find_horizons(
            cube, count, faults=faults, event=event, layers=layers, settings=settings, progress=progress
        )
    if np.ndim(cube) == 2:
        from seismo3d.seismic.section_tracks import cut_middle, thicken, thicken_seeds

        if layers is not None:
            raise ParameterError("layers is given for a section; it is for cubes. Leave it out.")
        thick, surfaces = thicken(cube, faults)
        found = trace_tracks(
            thick, thicken_seeds(seeds), faults=surfaces, event=event, settings=settings, progress=progress
        )
        return [cut_middle(track) for track in found]
    _check_event(event)
    layers = layers or model_layers(cube, faults=faults, settings=settings.layers, progress=progress)
    axes = axes_of(cube)
    groups = [_as_seeds(entry, n) for n, entry in enumerate(seeds)]
    tracks = []
    for number, group in enumerate(groups):
        if progress is not None:
            progress("tracks", number / len(groups))
        index = np.stack([axis.index(group[:, k]) for k, axis in enumerate(axes)], axis=1)
        _check_seeds(index, group, layers, number)
        depth, confidence = fit_track(layers, index, settings)
        if event is not None:
            depth = _snap(_read_amplitudes(cube, layers, depth), depth, event)
        depth = axes[2].coordinate(depth).astype(np.float32)
        tracks.append(Track(freeze(depth), freeze(confidence), freeze(group), layers.sample_unit))
    return tracks


def _unheard(stage: str, share: float) -> None:
    """Take reports of progress where nobody asked for them."""


def _check_event(event: str | None) -> None:
    if event is not None and event not in EVENTS:
        raise ParameterError(
            f"event is {event!r}; expected one of {', '.join(EVENTS)}, or None for the seed's own phase."
        )


def axes_of(cube: Any) -> tuple[Axis, Axis, Axis]:
    """Return the cube's three axes; of a bare array those of its indices."""
    shape = np.shape(cube)
    if not hasattr(cube, "dims"):
        return tuple(Axis(0.0, 1.0, n) for n in shape)  # type: ignore[return-value]
    return tuple(
        Axis.from_coordinates(cube[name].values, str(name)) if name in cube.coords else Axis(0.0, 1.0, n)
        for name, n in zip(cube.dims, shape, strict=True)
    )  # type: ignore[return-value]


def axis_points(axes: tuple[Axis, Axis, Axis], points: Float64Array) -> Float64Array:
    """Index points of shape (n, 3) in coordinates."""
    return np.stack([axis.coordinate(points[:, k]) for k, axis in enumerate(axes)], axis=1)


def _as_seeds(entry: Any, number: int) -> Float64Array:
    points = np.atleast_2d(np.asarray(entry, dtype=np.float64))
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ShapeError(
            f"seeds[{number}] has shape {np.shape(entry)}; expected a point (inline, crossline, time or depth), "
            "or a list of such points, of finite numbers."
        )
    return points


def _check_seeds(index: Float64Array, group: Float64Array, layers: LayerModel, number: int) -> None:
    limit = np.array(layers.times.shape) - 1
    for at, point in zip(index, group, strict=True):
        if (at < -1e-6).any() or (at > limit + 1e-6).any():
            raise ParameterError(f"seeds[{number}] {tuple(point)} lies outside the cube. Give its coordinates.")
        if not layers.live[tuple(np.rint(at[:2]).astype(int))]:
            raise ParameterError(f"seeds[{number}] {tuple(point)} lies on a trace without data. Choose another trace.")


def _read_amplitudes(cube: Any, layers: LayerModel, depth: Float64Array) -> Float32Array:
    """Return the cube's own amplitudes about every depth."""
    values = cube.data if hasattr(cube, "dims") else cube if hasattr(cube, "dtype") else np.asarray(cube)
    waves = np.empty((*depth.shape, 2 * _SNAP_REACH + 3), np.float32)
    for at, (valid,) in layer_pieces(layers, "valid"):
        volume = np.asarray(values[at], dtype=np.float32)
        read_waveforms(volume, valid, depth[at], _SNAP_REACH + 1, waves[at])
    return waves


def _snap(waves: Float32Array, depth: Float64Array, event: str) -> Float64Array:
    """Move every trace to its nearest event of a kind, at sub-sample precision; traces without one stay."""
    reach = _SNAP_REACH
    left, here, right = waves[..., :-2], waves[..., 1:-1], waves[..., 2:]
    lag = np.arange(-reach, reach + 1, dtype=np.float64)
    place: AnyArray
    if event == "zero":
        found = (here * right <= 0) & (here != right)
        place = lag + here / np.where(found, here - right, 1.0)
    else:
        sign = 1.0 if event == "peak" else -1.0
        found = (sign * here >= sign * left) & (sign * here > sign * right)
        bend = left - 2.0 * here + right
        place = lag + np.where(found, 0.5 * (left - right) / np.where(found, bend, 1.0), 0.0)
    distance = np.where(found, np.abs(place), np.inf)
    best = distance.argmin(axis=2)[..., None]
    move = np.take_along_axis(place, best, axis=2)[..., 0]
    return depth + np.where(np.isfinite(np.take_along_axis(distance, best, axis=2)[..., 0]), move, 0.0)
