"""How slip dies away off a fault, told by how the layers tilt beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.seismic.fault_ages import HistorySettings
from seismo3d.seismic.throw import SheetSides, SheetThrow

# fit from which on a throw counts, smallest throw that tells, and how many places it takes
_FITS, _TELLS, _LEAST_PLACES = 0.5, 1.0, 100
_ROUNDS = 8


def find_decay(parts: Sequence[tuple[SheetThrow, SheetSides, int]], history: HistorySettings) -> float:
    r"""Find which share of the slip of a fault is lost a trace off it.

    Layers that were level across the fault are thrown by :math:`T` at its surface, and by less farther off in the
    hanging wall: there they rise away from it (reverse drag [1]_), by :math:`c\,T` a trace more than in the footwall.
    The factor is fitted to the tilts on both sides at all places that match, robustly.

    Parameters
    ----------
    parts : sequence of (SheetThrow, SheetSides, int)
        Throw of each part of the fault as it seems today, its sides, and every how many samples the sheet has a node.
    history : HistorySettings

    Returns
    -------
    float
        0 where slip does not die away, or no more than the tilts' scatter explains.

    References
    ----------
    .. [1] W. K. Hamblin, Geological Society of America Bulletin 76(10), 1145-1164, 1965.
    """
    found = [_tilt_by_throw(*part) for part in parts]
    tilt, throw, weight = (np.concatenate([part[k] for part in found]) for k in range(3))
    if len(tilt) < _LEAST_PLACES:
        return 0.0
    decay, weights = 0.0, weight
    for _ in range(_ROUNDS):
        decay = -float((weights * tilt * throw).sum()) / float((weights * throw**2).sum())
        left = tilt + decay * throw
        spread = 1.4826 * float(np.median(np.abs(left))) + 1e-4
        weights = weight / (1.0 + (left / (2.0 * spread)) ** 2)
    return min(decay, history.most_decay) if decay >= history.least_decay else 0.0


def _tilt_by_throw(throw: SheetThrow, sides: SheetSides, step: int) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return how much more layers tilt in the hanging wall than where they came from, the throw, and its weight."""
    rows, columns = np.nonzero(np.isfinite(throw.throw) & (throw.fit > _FITS) & (np.abs(throw.throw) > _TELLS))
    thrown, fit = (values[rows, columns].astype(np.float64) for values in (throw.throw, throw.fit))
    below = columns * step
    above = np.rint(below - thrown).astype(np.int64)
    n_samples = sides.tilts.shape[2]
    inside = (below < n_samples) & (above >= 0) & (above < n_samples)
    rows, below, above, thrown, fit = (values[inside] for values in (rows, below, above, thrown, fit))
    up = 1 if throw.hanging_side > 0 else 0
    hanging, foot = ((side, rows, at) for side, at in ((up, below), (1 - up, above)))
    known = (sides.known[hanging] > 0.0) & (sides.known[foot] > 0.0)
    tilt = throw.hanging_side * (sides.tilts[hanging].astype(np.float64) - sides.tilts[foot])
    return tilt[known], thrown[known], fit[known] ** 2
