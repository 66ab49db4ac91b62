"""Layer time mended level by level: what faults part is moved to where its waveforms fit.

Where the throw of a fault is off by a cycle, all beyond it is. Many waveforms together know better: at one level after
another the parts that faults bound are compared as a whole, over long windows, with those that are placed already.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, Int64Array, IntArray
from seismo3d.seismic._kernels_layer_levels import mend_runs, number_runs
from seismo3d.seismic._kernels_layers import make_runs_increasing
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.layer_parts import PartWaves, find_shapes, label_parts, place_once, read_parts
from seismo3d.seismic.layer_pieces import CROSSINGS, LayerVolumes, find_levels, layer_pieces

# what layer time spans at most, over the samples of a trace
_MOST_SPAN = 4
# share of the traces whose first or last sample lies beyond the first or last level
_BEYOND = 0.02
# traces that a part must have for layer time to be mended by it
_LEAST_TRACES = 16
# share of a part's crossings that must go on from parts placed before for it to begin where they are
_GOES_ON = 0.3
# rounds at the first level, where nothing is placed yet
_FIRST_ROUNDS = 2
# samples from an end of the cube within which a part is no good to begin with
_END = 8.0
# how much more a part counts as the next to stay where it goes on from the last, and how little if it fitted badly
_SAME, _POOR = 2.0, 0.1
# share of their thickness that moves must leave of the layers between two levels to be believed
_THINNEST = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class LevelMoves:
    """Where layers pass, and how far they are off there.

    Attributes
    ----------
    depth : ndarray of shape (inline, crossline, n), float32
        Fractional samples at which they are found, NaN where there is none.
    move : ndarray of the same shape, float32
        How far below they really lie; NaN where that is not known.
    """

    depth: Float32Array
    move: Float32Array


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """Parts of a level that are placed: maps of their moves, fits, runs between faults, and of the part that stays.

    Moves are NaN where they are not known.
    """

    moves: Float64Array
    scores: Float64Array
    runs: IntArray
    stays: BoolArray


def _list_levels(layers: LayerVolumes, settings: LayerTimeSettings) -> list[float]:
    """Return the layer times, evenly apart, of the levels that are looked at."""
    first, last = [], []
    for at, (times,) in layer_pieces(layers, "times"):
        live = layers.live[at]
        first.append(times[..., 0][live])
        last.append(times[..., -1][live])
    low = float(np.quantile(np.concatenate(first), _BEYOND))
    high = float(np.quantile(np.concatenate(last), 1.0 - _BEYOND))
    n = int(np.clip(round((high - low) / settings.apart), 1, most_levels(layers.times.shape[2], settings)))
    return [float(level) for level in low + (np.arange(n) + 0.5) * (high - low) / n]


def find_level_moves(layers: LayerVolumes, settings: LayerTimeSettings) -> Iterator[tuple[int, LevelMoves]]:
    """Place the parts of level after level, from the middle down, then from the middle up.

    A part begins where those that it goes on from, of the level before, were moved to, and as trusted as they are. One
    large part at each level stays where it so begins, and the others go by all that are trusted.

    Parameters
    ----------
    layers : LayerVolumes
        Of a cube with faults.
    settings : LayerTimeSettings

    Yields
    ------
    number : int
        Of the level, from above.
    found : LevelMoves
        Of this level alone.
    """
    levels = _list_levels(layers, settings)
    middle = len(levels) // 2
    found, first = _place_level(layers, levels[middle], None, settings)
    yield middle, found
    for rest in (range(middle + 1, len(levels)), range(middle - 1, -1, -1)):
        before = first
        for number in rest:
            found, before = _place_level(layers, levels[number], before, settings)
            yield number, found


def most_levels(n_samples: int, settings: LayerTimeSettings) -> int:
    """Return how many levels there are at most in a cube of so many samples."""
    return max(1, round(_MOST_SPAN * n_samples / settings.apart))


def join_levels(found: Sequence[LevelMoves]) -> LevelMoves:
    """Put levels together, from above."""
    return LevelMoves(*(np.concatenate([getattr(f, name) for f in found], axis=2) for name in ("depth", "move")))


def mend_times(times: Float32Array, cuts: IntArray, found: LevelMoves, least: float) -> None:
    """Mend layer time, in place.

    Between two levels of a run, from one fault to the next, moves change linearly; above the first and below the last
    they go on. Of levels that would change places, or all but do, the most that agree count. Runs without a known move
    stay.
    """
    mend_runs(times, cuts, found.depth, found.move, np.float32(_THINNEST))
    make_runs_increasing(times, cuts, least)


def _place_level(
    layers: LayerVolumes, level: float, before: _Placed | None, settings: LayerTimeSettings
) -> tuple[LevelMoves, _Placed]:
    last = layers.times.shape[2] - 1
    crossings = find_levels(layers, np.full(layers.live.shape, level), settings.parts.farthest)
    runs = np.empty(crossings.shape, np.int64)
    for at, (cuts,) in layer_pieces(layers, "cuts"):
        number_runs(cuts, crossings[(slice(None), *at)], runs[(slice(None), *at)])
    parts = label_parts(crossings, layers.cuts, find_shapes(layers, crossings))
    there = parts >= 0
    n = int(parts.max(initial=-1)) + 1
    inner = np.bincount(parts[there & (crossings > _END) & (crossings < last - _END)], minlength=n)
    moves, scores, fixed = _begin(parts, runs, inner, before, settings)
    waves = read_parts(layers, crossings, parts, settings.parts)
    for _ in range(_FIRST_ROUNDS if before is None else 1):
        moves, scores = place_once(waves, moves, scores, fixed, settings.parts)
    is_sure = (scores >= _least_scores(waves, settings)) & (waves.size >= _LEAST_TRACES)
    moved = np.append(np.where(is_sure, moves, np.nan), np.nan)[parts]
    depth, move = (np.ascontiguousarray(np.moveaxis(a, 0, -1), dtype=np.float32) for a in (crossings, moved))
    stays = np.append(np.isin(np.arange(n), fixed), False)[parts]
    placed = _Placed(moved, np.append(scores, 0.0)[parts], runs, stays)
    return LevelMoves(depth, move), placed


def _least_scores(waves: PartWaves, settings: LayerTimeSettings) -> Float64Array:
    """Return the correlations that tell: of a waveform that is cut short a higher one comes about by chance."""
    return np.asarray(settings.sure / np.maximum(waves.known(settings.parts.window), 1e-6) ** 0.25)


def _begin(
    parts: IntArray, runs: Int64Array, inner: IntArray, before: _Placed | None, settings: LayerTimeSettings
) -> tuple[Float64Array, Float32Array, IntArray]:
    """Return the moves and trust that the parts of a level begin with, and the part that stays so."""
    n = len(inner)
    moves, scores, worth = np.zeros(n), np.zeros(n), inner.astype(np.float64)
    if before is not None:
        sums = np.zeros((4, n))
        for one, other in np.ndindex(CROSSINGS, CROSSINGS):
            same = (parts[one] >= 0) & (runs[one] == before.runs[other]) & np.isfinite(before.moves[other])
            at = parts[one][same]
            for place, values in enumerate((before.moves[other], before.scores[other], before.stays[other])):
                sums[place] += np.bincount(at, values[same], n)
            sums[3] += np.bincount(at, minlength=n)
        n_before = np.maximum(sums[3], 1.0)
        goes_on = sums[3] > _GOES_ON * np.bincount(parts[parts >= 0], minlength=n)
        moves, scores = (np.where(goes_on, total / n_before, 0.0) for total in sums[:2])
        trust = np.where(scores >= settings.parts.trusted, 1.0, _POOR)
        known = np.minimum(sums[3], inner) * trust * (1.0 + _SAME * sums[2] / n_before)
        worth = known if known.any() else worth
    fixed: IntArray = np.array([worth.argmax()] if n else [], np.int64)
    scores[fixed] = 1.0
    return moves, scores.astype(np.float32), fixed
