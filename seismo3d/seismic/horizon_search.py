"""Horizons without seeds: the most continuous and best matched of a cube."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._settings import as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import Float64Array, Progress
from seismo3d._validate import as_kind, as_whole_number, check_array, freeze
from seismo3d.errors import ParameterError, Seismo3dWarning
from seismo3d.seismic._kernels_tracks import level_depths, read_waveforms
from seismo3d.seismic.layer_pieces import layer_pieces
from seismo3d.seismic.layer_time import LayerModel, model_layers
from seismo3d.seismic.section_tracks import cut_middle, thicken
from seismo3d.seismic.track_events import check_event, seed_events
from seismo3d.seismic.tracks import Track, TrackSettings, axes_of, axis_points, trace_tracks

# so many candidates are traced for each horizon that is asked for
_CANDIDATES = 3
# gaps between horizons, in parts of what they have if they are spread evenly: between those chosen first, between
# any, and between candidates
_WIDE_GAP, _LEAST_GAP, _SEED_GAP = 0.5, 0.2, 0.2
# samples from the ends of a cube where no horizon is looked for; of a thin one, its thickness divided by the other
_MARGIN, _PARTS = 8, 8


def find_horizons(
    cube: Any, count: int = 5, *, faults: Any = None, event: str | None = None,
    layers: LayerModel | None = None, settings: TrackSettings | None = None, progress: Progress | None = None,
) -> list[Track]:  # fmt: skip
    """Find the best horizons of a cube or section without seeds.

    Strong continuous events all over the cube are traced, three for each horizon asked for. Those count most that are
    strong and were followed over a large share of the traces with a high correlation. They are spread over the cube:
    first those are taken that keep half the distance that all would have if they were spread evenly, then others that
    do not run along one taken. Layers do not cross: where two horizons meet or pass each other, that which matches
    worse there is left out.

    Parameters
    ----------
    cube : DataArray or array_like
        A cube (inline, crossline, sample) or a section (trace, sample).
    count : int
        Most horizons to give.
    faults : FaultSet, optional
        Faults of this cube.
    event : {"peak", "trough", "zero"}, optional
        Find horizons on such events only, as :func:`trace_tracks` follows them.
    layers : LayerModel, optional
        Of this cube and these faults, from :func:`model_layers`, to save its computation.
    settings : TrackSettings, optional
        Windows and thresholds.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    list of Track
        Best first, each chosen among those far enough from the ones before.

    Raises
    ------
    ShapeError
        If the cube has neither two nor three axes, or the faults are of another cube.
    ParameterError
        If `count` is not a whole number from 1 to the samples of a trace, `layers` is given for a section or is no
        LayerModel, `settings` are no TrackSettings, or `progress` is no function.
    """
    check_event(event)
    report = as_progress(progress)
    settings = as_settings(settings, TrackSettings)
    check_array(cube, "cube")
    wanted = as_whole_number(count, "count", low=1, high=max(np.shape(cube)[-1:], default=1))
    is_section = np.ndim(cube) == 2
    if is_section and layers is not None:
        raise ParameterError("layers is given for a section; it is for cubes. Leave it out.")
    if layers is not None:
        as_kind(layers, LayerModel, "layers", remedy="Give what model_layers returned, or leave it out.")
    thick, surfaces = thicken(cube, faults) if is_section else (cube, faults)
    if layers is None:
        layers = model_layers(thick, faults=surfaces, settings=settings.layers, progress=report)
    gap = _SEED_GAP * np.shape(thick)[2] / wanted
    seeds, strengths = _rank_seeds(layers, _CANDIDATES * wanted, gap=gap, event=event)
    if event is not None and len(seeds):
        # the layer of a strong event may lack it on the seed's own trace
        on_event = np.isfinite(seed_events(thick, layers, seeds, event)[0][:, 2])
        seeds, strengths = seeds[on_event], strengths[on_event]
    more: dict[str, Any] = {"event": event, "layers": layers, "settings": settings, "progress": report}
    with warnings.catch_warnings():
        # of seeds that nobody gave
        warnings.simplefilter("ignore", Seismo3dWarning)
        tracks = trace_tracks(thick, list(axis_points(axes_of(thick), seeds)), faults=surfaces, **more)
    axis = axes_of(thick)[2]
    best = _part(_choose(tracks, strengths, wanted, spread=abs(axis.step) * axis.n / wanted), least=abs(axis.step))
    if not is_section:
        return best
    return [cut_middle(track) for track in best]


def find_seeds(layers: LayerModel, *, count: int = 5) -> Float64Array:
    """Index points on the most continuous strong events, spread over the layer times of the cube.

    Parameters
    ----------
    layers : LayerModel
        Of the cube.
    count : int
        Number of seeds.

    Returns
    -------
    ndarray of shape (m, 3), float64
        At most `count` points, from the shallowest horizon to the deepest.
    """
    return _rank_seeds(layers, count, gap=_WIDE_GAP * layers.times.shape[2] / count)[0]


def _rank_seeds(
    layers: LayerModel, count: int, *, gap: float, event: str | None = None
) -> tuple[Float64Array, Float64Array]:
    """Return at most `count` seeds, no less than a gap apart, from above, and the strength of each one's event.

    The strength is the mean amplitude all over its layer: without the sign if any event will do, of zero crossings its
    slope.
    """
    live = np.argwhere(layers.live)
    middle = live[np.abs(live - live.mean(axis=0)).sum(axis=1).argmin()]
    row = layers.times[tuple(middle)]
    n = len(row)
    total, n_traces = np.zeros(n), 0
    for _, whole in layer_pieces(layers, "times", "cuts", "volume", "valid"):
        times, cuts, volume, valid = (np.ascontiguousarray(a[::4, ::4]) for a in whole)
        depth, waves = np.empty(times.shape[:2]), np.empty((*times.shape[:2], 1), np.float32)
        for k in range(2, n - 2):
            level_depths(times, cuts, np.full(depth.shape, row[k], dtype=np.float64), depth)
            read_waveforms(volume, valid, depth, 0, waves)
            total[k] += float(waves.sum(dtype=np.float64))
        n_traces += depth.size
    mean = total / n_traces
    strength = {"peak": mean, "trough": -mean, "zero": np.abs(np.gradient(mean))}.get(event or "", np.abs(mean))
    chosen: list[int] = []
    margin = max(2, min(_MARGIN, n // _PARTS))
    known = np.asarray(layers.valid[tuple(middle)])
    inner = [k for k in range(margin, n - margin) if known[k]]
    peaks = [k for k in inner if strength[k] > 0 and strength[k] >= strength[k - 1] and strength[k] > strength[k + 1]]
    for k in sorted(peaks, key=lambda k: -strength[k]):
        if len(chosen) < count and all(abs(k - other) >= gap for other in chosen):
            chosen.append(k)
    chosen.sort()
    return np.array([[*middle, k] for k in chosen], dtype=np.float64).reshape(-1, 3), strength[chosen]


def _choose(tracks: list[Track], strengths: Float64Array, count: int, *, spread: float) -> list[Track]:
    """Return the best tracks that keep apart; `spread` is their distance if they are spread evenly."""
    worth = np.array([strength * _followed(track) for track, strength in zip(tracks, strengths, strict=True)])
    order = [tracks[n] for n in np.argsort(-worth, kind="stable") if worth[n] > 0]
    chosen: list[Track] = []
    for gap in (_WIDE_GAP, _LEAST_GAP):
        for track in order:
            taken = any(track is other for other in chosen)
            if len(chosen) < count and not taken and all(_apart(track, other) > gap * spread for other in chosen):
                chosen.append(track)
    return chosen


def _part(tracks: list[Track], *, least: float) -> list[Track]:
    """Leave out of two horizons that come nearer than `least`, or pass each other, what of one matches worse there."""
    depths, sure = ([getattr(track, name).copy() for track in tracks] for name in ("depth", "confidence"))
    for a, b in combinations(range(len(tracks)), 2):
        below = depths[b] - depths[a]
        known = np.isfinite(below)
        if not known.any():
            continue
        meeting, n_places = ndimage.label(known & (np.sign(np.median(below[known])) * below < least))
        for place in range(1, n_places + 1):
            there = meeting == place
            worse = a if sure[a][there].mean() < sure[b][there].mean() else b
            depths[worse][there] = sure[worse][there] = np.nan
    return [
        replace(track, depth=freeze(depth), confidence=freeze(confidence))
        for track, depth, confidence in zip(tracks, depths, sure, strict=True)
    ]


def _followed(track: Track) -> float:
    """Share of the traces that a horizon was followed over, each as sure as it is."""
    known = np.isfinite(track.depth)
    return float(np.sum(track.confidence[known])) / track.depth.size


def _apart(one: Track, other: Track) -> float:
    """Median vertical distance of two tracks; infinite where they share no trace."""
    distance = np.abs(one.depth - other.depth)
    known = np.isfinite(distance)
    return float(np.median(distance[known])) if known.any() else float("inf")
