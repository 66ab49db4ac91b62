"""Tracks: horizons followed from seeds through a whole cube and across its faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from seismo3d._typing import AnyArray, Float32Array, Float64Array, IntArray, Progress
from seismo3d._validate import freeze
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.axis import Axis
from seismo3d.seismic._kernels_tracks import read_waveforms
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.layer_pieces import find_levels, layer_pieces, read_along
from seismo3d.seismic.layer_time import LayerModel, model_layers

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


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """How a layer becomes a track; lengths in samples and traces.

    Attributes
    ----------
    window : int
        Half-length of the waveform by which blocks are recognised across faults.
    farthest : int
        Farthest that a block is moved to where its waveform fits.
    near : int
        Half-length of the waveform that is followed from trace to trace.
    most : float
        Farthest that a trace is moved to fit its neighbours.
    gain : float
        How much better the correlation of a block must become for it to be moved.
    least_block, least_trace : float
        Correlation below which a block, or a trace, is left out.
    layers : LayerTimeSettings
        Settings of the layer time.
    """

    window: int = 24
    farthest: int = 12
    near: int = 10
    most: float = 1.0
    gain: float = 0.05
    least_block: float = 0.5
    least_trace: float = 0.3
    layers: LayerTimeSettings = field(default_factory=LayerTimeSettings)


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

    A track is a level set of the layer time (see :func:`layer_time`). Every part of it that faults bound is compared
    with the waveform at the seeds over a long window and moved to where it fits, or left out where it fits nowhere;
    then each trace is aligned with that waveform at sub-sample precision.

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
        depth, confidence = _trace_one(layers, index, settings)
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


def _trace_one(layers: LayerModel, index: Float64Array, settings: TrackSettings) -> tuple[Float64Array, Float32Array]:
    """Depth (fractional sample) and confidence of the horizon through seeds."""
    depth = _level(layers, index)
    parts = label_parts(depth, layers.cuts)
    reference = _reference(layers, index, settings.window)
    depth, parts = _place_parts(layers, depth, parts, reference, index, settings)
    return _align(layers, depth, parts, index, settings)


def _level(layers: LayerModel, index: Float64Array) -> Float64Array:
    """Depth of the level set through the seeds; between seeds of differing times these are weighed by distance."""
    times, weights = [], []
    n0, n1, n2 = layers.times.shape
    i, j = np.meshgrid(np.arange(n0), np.arange(n1), indexing="ij")
    for at in index:
        row = layers.times[tuple(np.rint(at[:2]).astype(int))]
        times.append(float(np.interp(at[2], np.arange(n2), row)))
        weights.append(1.0 / ((i - at[0]) ** 2 + (j - at[1]) ** 2 + 0.25))
    target = np.tensordot(times, weights, axes=1) / np.sum(weights, axis=0)
    depth = find_levels(layers, target)
    depth[~layers.live] = np.nan
    return depth


def _around(layers: LayerModel, i: int, j: int, reach: int) -> tuple[slice, slice]:
    n0, n1, _ = layers.times.shape
    return slice(max(i - reach, 0), min(i + reach + 1, n0)), slice(max(j - reach, 0), min(j + reach + 1, n1))


def label_parts(depth: Float64Array, cuts: AnyArray) -> IntArray:
    """Give numbers to the parts of a map that faults bound, from 0; -1 where the map is not known."""
    known = np.isfinite(depth)
    numbers = np.arange(depth.size).reshape(depth.shape)
    k: AnyArray = np.asarray(np.rint(np.nan_to_num(depth)), dtype=np.int64)
    i, j = np.meshgrid(*(np.arange(n) for n in depth.shape), indexing="ij")
    ends = []
    for axis in range(2):
        a, b = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
        if axis == 1:
            a, b = a[::-1], b[::-1]
        middle = (k[a] + k[b]) // 2
        cut = np.zeros(middle.shape, bool)
        for sample in (k[a], middle, k[b]):
            cut |= (cuts[i[a], j[a], sample] & (1 << axis)) > 0
        free = known[a] & known[b] & ~cut & (np.abs(np.nan_to_num(depth[a] - depth[b])) < 6.0)
        ends.append(np.stack([numbers[a][free], numbers[b][free]]))
    pairs = np.concatenate(ends, axis=1)
    graph = coo_matrix((np.ones(pairs.shape[1], bool), tuple(pairs)), shape=(depth.size,) * 2)
    parts = connected_components(graph, directed=False)[1].reshape(depth.shape)
    return np.where(known, parts, -1)


def _reference(layers: LayerModel, index: Float64Array, half: int) -> Float64Array:
    """Mean waveform at the seeds, from the traces around each along the layers."""
    total = np.zeros(2 * half + 1)
    for at in index:
        depth = _level(layers, at[None])
        i, j = np.rint(at[:2]).astype(int)
        near = _around(layers, i, j, 2)
        parts = label_parts(depth, layers.cuts)
        waves = np.empty((*parts[near].shape, 2 * half + 1), np.float32)
        read_waveforms(layers.volume[near], layers.valid[near], depth[near], half, waves)
        total += waves[parts[near] == parts[i, j]].mean(axis=0)
    return total / len(index)


def _place_parts(
    layers: LayerModel, depth: Float64Array, parts: IntArray, reference: Float64Array, index: Float64Array,
    settings: TrackSettings,
) -> tuple[Float64Array, IntArray]:  # fmt: skip
    """Move every part to where its mean waveform fits the seeds', or drop it where it fits nowhere."""
    far, half = settings.farthest, settings.window
    waves = read_along(layers, depth, half + far)
    seeded = {int(parts[tuple(np.rint(at[:2]).astype(int))]) for at in index}
    depth = depth.copy()
    labels, sizes = np.unique(parts[parts >= 0], return_counts=True)
    for label, size in zip(labels, sizes, strict=True):
        if label in seeded:
            continue
        mask = parts == label
        lags = correlate_lags(waves[mask].mean(axis=0), reference)
        best = int(lags.argmax())
        if size < 4 or lags[best] < settings.least_block:
            depth[mask] = np.nan
        elif lags[best] > lags[far] + settings.gain:
            depth[mask] += _vertex(lags, best) - far
    return depth, np.where(np.isfinite(depth), parts, -1)


def correlate_lags(wave: AnyArray, reference: AnyArray) -> Float64Array:
    """Correlation coefficient of a waveform with a shorter one, tapered, at every lag at which it covers it."""
    taper = np.hanning(len(reference) + 2)[1:-1]
    windows = np.lib.stride_tricks.sliding_window_view(np.asarray(wave, dtype=np.float64), len(reference))
    size = np.sqrt((windows**2) @ taper * float((reference**2) @ taper))
    return windows @ (reference * taper) / np.maximum(size, 1e-12)


def _vertex(scores: Float64Array, best: int) -> float:
    """Place of the maximum next to the best entry, by a parabola."""
    if not 0 < best < len(scores) - 1:
        return float(best)
    before, here, after = scores[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return best + (0.5 * (before - after) / bend if bend < 0 else 0.0)


def _align(
    layers: LayerModel, depth: Float64Array, parts: IntArray, index: Float64Array, settings: TrackSettings
) -> tuple[Float64Array, Float32Array]:
    """Align every trace with the mean waveform along the track; the part with the seeds stays on the whole."""
    near, reach = settings.near, 3
    waves = read_along(layers, depth, near + reach)
    known = np.isfinite(depth)
    if not known.any():
        return depth, np.full(depth.shape, np.nan, np.float32)
    mean = waves[known].mean(axis=0)[reach:-reach]
    taper = np.hanning(2 * near + 3)[1:-1]
    waves = _smooth_parts(waves, parts, 1.0)
    windows = np.lib.stride_tricks.sliding_window_view(waves, 2 * near + 1, axis=2)
    score = windows @ (mean * taper)
    score /= np.sqrt(np.maximum((windows**2) @ taper, 1e-12) * float((mean**2) @ taper))
    best = np.clip(score.argmax(axis=2), 1, 2 * reach - 1)
    before, here, after = (np.take_along_axis(score, (best + d)[..., None], axis=2)[..., 0] for d in (-1, 0, 1))
    bend = before - 2.0 * here + after
    part = np.where(bend < -1e-9, 0.5 * (before - after) / np.minimum(bend, -1e-9), 0.0)
    move = best - reach + np.clip(part, -0.5, 0.5)
    trusted = known & (here > settings.least_trace)
    weight = np.where(trusted, here, 0.0)[..., None].astype(np.float32)
    both = _smooth_parts(np.concatenate([weight * move[..., None], weight], axis=2).astype(np.float32), parts, 2.0)
    move = both[..., 0] / np.maximum(both[..., 1], 1e-3)
    of_seeds = np.isin(parts, parts[tuple(np.rint(index[:, :2]).astype(int).T)]) & trusted
    move -= move[of_seeds].mean() if of_seeds.any() else 0.0
    confidence = np.where(trusted, np.clip(here, 0.0, 1.0), np.nan).astype(np.float32)
    return np.where(trusted, depth + np.clip(move, -settings.most, settings.most), np.nan), confidence


def _smooth_parts(maps: Float32Array, parts: IntArray, sigma: float) -> Float32Array:
    """Smooth maps of shape (inline, crossline, n) within each part alone."""
    out = np.zeros_like(maps)
    for label, box in enumerate(ndimage.find_objects(parts + 1)):
        if box is None:
            continue
        mask = parts[box] == label
        share = ndimage.gaussian_filter(mask.astype(np.float32), sigma)
        smoothed = ndimage.gaussian_filter(maps[box] * mask[..., None], (sigma, sigma, 0))
        out[box][mask] = smoothed[mask] / share[mask][:, None]
    return out


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
