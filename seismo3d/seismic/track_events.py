"""Tracks put on peaks, troughs or zero crossings of the cube's own amplitudes."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array
from seismo3d._validate import is_among, told
from seismo3d.errors import ParameterError
from seismo3d.seismic._kernels_tracks import read_finely, read_known
from seismo3d.seismic.layer_pieces import layer_pieces
from seismo3d.seismic.layer_time import LayerModel

EVENTS = ("peak", "trough", "zero")
# samples within which an event is looked for: of where a track runs, and of its seeds
_REACH, _SEED_REACH = 4, 16
# samples between the amplitudes by which an event is placed between samples, how often, and how far it moves at most
_LAG, _ROUNDS, _FARTHEST = 0.25, 4, 0.75
# share of it by which the level of unsigned numbers may lie off their middle
_OFF_MIDDLE = 0.1


def check_event(event: str | None) -> None:
    """Refuse an event that is not known."""
    if event is not None and not is_among(event, EVENTS):
        raise ParameterError(
            f"event is {told(event)}; expected one of {', '.join(EVENTS)}, or None for the seed's own phase."
        )


def seed_events(cube: Any, layers: LayerModel, index: Float64Array, event: str) -> tuple[Float64Array, float]:
    """Find the events nearest to seeds.

    Parameters
    ----------
    cube : DataArray or array_like
        Whose amplitudes tell the events.
    layers : LayerModel
        Of this cube: it tells where that holds data, and the level that peaks lie above.
    index : ndarray of shape (n, 3), float64
        Seeds, as fractional indices.
    event : str
        One of ``EVENTS``.

    Returns
    -------
    index : ndarray of shape (n, 3), float64
        On the events; NaN where a seed has none near it.
    slope : float
        Sign of the slope of the zero crossing next to the first seed, on which all lie; 0 for other events.
    """
    traces = np.rint(index[:, :2]).astype(int)
    values = _values_of(cube)
    volume = np.stack([_about(layers.level, values[i, j]) for i, j in traces])[None]
    valid = np.stack([np.asarray(layers.valid[int(i), int(j)]) for i, j in traces])[None]
    depth = index[None, :, 2].copy()
    places, slopes = _nearest_told(volume, valid, depth, event, 0.0)
    known = slopes[np.isfinite(places)]
    slope = float(known[0]) if len(known) else 0.0
    if event == "zero":
        places, _ = _nearest_told(volume, valid, depth, event, slope)
    moved = index.copy()
    moved[:, 2] = places[0]
    return moved, slope


def snap_to_events(cube: Any, layers: LayerModel, depth: Float64Array, event: str, slope: float) -> Float64Array:
    """Move every trace of a track to its nearest event; NaN where there is none near.

    The event is that of the band-limited trace, between its samples.

    Parameters are those of :func:`seed_events`, the track's fractional samples of shape (inline, crossline), and the
    slope that zero crossings have.
    """
    values = _values_of(cube)
    snapped = np.empty_like(depth)
    for at, (valid,) in layer_pieces(layers, "valid"):
        volume = _about(layers.level, values[at])
        waves = np.empty((*depth[at].shape, 2 * _REACH + 3), np.float32)
        read_known(volume, valid, depth[at], _REACH + 1, waves)
        snapped[at] = _settle(volume, valid, depth[at] + _nearest(waves, event, slope)[0], event)
    return snapped


def _nearest_told(
    volume: Float32Array, valid: AnyArray, depth: Float64Array, event: str, slope: float
) -> tuple[Float64Array, Float32Array]:
    """Return the places of the events nearest to seeds that the data tell, NaN without one, and their slopes' signs."""
    waves = np.empty((*depth.shape, 2 * _SEED_REACH + 3), np.float32)
    read_known(volume, valid, depth, _SEED_REACH + 1, waves)
    while True:
        moves, slopes = _nearest(waves, event, slope)
        places = _settle(volume, valid, depth + moves, event)
        lost = np.isnan(places) & np.isfinite(moves)
        if not lost.any():
            return places, slopes
        # an event too near an end of the data: the next one may be farther from it
        waves[(*np.nonzero(lost), np.rint(moves[lost]).astype(int) + _SEED_REACH + 1)] = np.nan


def _settle(volume: Float32Array, valid: AnyArray, places: Float64Array, event: str) -> Float64Array:
    """Return places (inline, crossline) on events, known to a good part of a sample, exactly on them.

    They are NaN where the amplitudes about them are not known.
    """
    side = 1.0 if event == "peak" else -1.0
    settled = places.copy()
    waves = np.empty((*places.shape, 3))
    for _ in range(_ROUNDS):
        read_finely(volume, valid, settled, _LAG, waves)
        left, here, right = np.moveaxis(waves, -1, 0)
        if event == "zero":
            over, under = 2.0 * here, left - right
        else:
            over, under = 0.5 * (left - right), left - 2.0 * here + right
            under = np.where(side * under > 0, 0.0, under)
        move = _LAG * np.divide(over, under, out=np.zeros_like(over), where=under != 0)
        settled = places + np.clip(settled + move - places, -_FARTHEST, _FARTHEST)
    return settled


def _about(level: float, values: Any) -> Float32Array:
    """Amplitudes about the level of the whole cube: of unsigned bytes none is below zero.

    The level is told by what most amplitudes are about; unsigned whole numbers have their zero in the middle.
    """
    given = np.asarray(values)
    middle = 2.0 ** (8 * given.dtype.itemsize - 1)
    if given.dtype.kind == "u" and abs(level - middle) <= _OFF_MIDDLE * middle:
        level = middle
    amplitudes = given.astype(np.float32, copy=False)
    return amplitudes - np.float32(level) if level else amplitudes


def _values_of(cube: Any) -> Any:
    return cube.data if hasattr(cube, "dims") else cube if hasattr(cube, "dtype") else np.asarray(cube)


def _nearest(waves: Float32Array, event: str, slope: float) -> tuple[Float64Array, Float32Array]:
    """Distance of the event nearest to the middle of every waveform, NaN without one; of crossings the slope's sign.

    There is none beside amplitudes that are not known (NaN). Only crossings of a slope of the same sign count where one
    is given.
    """
    left, here, right = waves[..., :-2], waves[..., 1:-1], waves[..., 2:]
    reach = (here.shape[-1] - 1) // 2
    lag = np.arange(-reach, reach + 1, dtype=np.float64)
    rise: AnyArray = np.sign(right - here)
    if event == "zero":
        found = (here * right <= 0) & (rise != 0) & (rise * slope >= 0)
        place = lag + here / np.where(found, here - right, 1.0)
    else:
        sign = 1.0 if event == "peak" else -1.0
        found = (sign * here > 0) & (sign * here >= sign * left) & (sign * here > sign * right)
        bend = left - 2.0 * here + right
        place = lag + np.where(found, 0.5 * (left - right) / np.where(found, bend, 1.0), 0.0)
    distance = np.where(found, np.abs(place), np.inf)
    best = distance.argmin(axis=-1)[..., None]
    move, least, sloped = (np.take_along_axis(a, best, axis=-1)[..., 0] for a in (place, distance, rise))
    return np.where(np.isfinite(least), move, np.nan), sloped * np.float32(event == "zero")
