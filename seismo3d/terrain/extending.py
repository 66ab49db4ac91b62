"""Lines carried on along their strike: a fault goes on straight where its own evidence is thin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float32Array
from seismo3d.terrain.placing import snap_line
from seismo3d.terrain.tracing import TracedLine

_BASE = 72
"""Places at a line's end that the way on is taken from."""
_STRIDES = (2.0, 4.0, 6.0)
"""Windows by which a line is carried on at once."""
_LEAST_PART = 3.0
"""Prominence that the new part has at least by itself: its way is given, so that chance has few tries."""
_STILL_OUT = 0.75
"""Share of its prominence that the longer line keeps at least."""


def extend_line(
    line: TracedLine,
    crest: Float32Array,
    score: Float32Array,
    *,
    window: float,
    reach: float,
    judge: Callable[[TracedLine], float],
) -> TracedLine:
    """Carry a line on at both ends as long as what is added stands out by itself.

    Parameters
    ----------
    line : TracedLine
    crest : ndarray of shape (rows, columns), float32
        Of the finest level: where a line belongs.
    score : ndarray of that shape, float32
        Evidence that the new places get.
    window : float
        In cells.
    reach : float
        Farthest, in cells, that the crest may lie from the straight way on.
    judge : callable
        How far a line stands out.
    """
    for last in (True, False):
        while True:
            tried = [_longer(line, crest, score, last, n * window, reach) for n in _STRIDES]
            good = [(judge(part), whole) for whole, part in filter(None, tried) if judge(part) >= _LEAST_PART]
            good = [(value, whole) for value, whole in good if judge(whole) >= _STILL_OUT * judge(line)]
            if not good:
                break
            line = max(good, key=lambda pair: pair[0])[1]
    return line


def _longer(
    line: TracedLine, crest: Float32Array, score: Float32Array, last: bool, length: float, reach: float
) -> tuple[TracedLine, TracedLine] | None:
    """Return the line with a new part at an end, and that part alone; None where it would leave the map."""
    places = line.places if last else line.places[::-1]
    values = line.score if last else line.score[::-1]
    way = places[-1] - places[max(len(places) - _BASE, 0)]
    way = way / max(float(np.hypot(*way)), 1e-9)
    straight = places[-1] + np.arange(1.0, length + 1.0)[:, None] * way
    inside = ((straight >= 0.0) & (straight <= np.array(crest.shape) - 1.0)).all(axis=1)
    straight = straight[: len(straight) if inside.all() else int(np.argmin(inside))]
    if len(straight) < 0.5 * length:
        return None
    part = snap_line(TracedLine(straight, np.zeros(len(straight)), line.kind, 1), crest, stiffness=1.0, reach=reach)
    # bent over to the crest from the line's own end
    share = np.minimum(np.arange(1.0, len(part.places) + 1.0) / 24.0, 1.0)[:, None]
    bent = (1.0 - share) * straight[: len(part.places)] + share * part.places
    seen = np.asarray(ndimage.map_coordinates(score, bent.T, order=1, mode="nearest"), np.float64)
    return (
        TracedLine(np.concatenate([places, bent]), np.concatenate([values, seen]), line.kind, line.factor),
        TracedLine(bent, seen, line.kind, line.factor),
    )
