"""Which faults are parts of one, as they lie today and as they lay when they moved."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import Float64Array, IntArray
from seismo3d.seismic.fault_ages import HistorySettings, near_pairs, roughness_of
from seismo3d.seismic.fault_motion import FaultMotion, Frame
from seismo3d.seismic.sheet_distances import are_near, bounds_of, within_box

# traces within which surfaces that cover each other are the same, and distance along a surface that is still on it
_SAME, _ON = 2.0, 1.5


def find_families(
    motions: list[FaultMotion], nodes: list[Float64Array], areas: list[float], settings: HistorySettings
) -> IntArray:
    """Tell which faults are parts of one as they lie today.

    Younger faults have taken the parts of an older one apart, along it and, by their heave, across it. Parts strike
    alike, dip to the same side, are not thrown up here and down there, unless one is too small to tell, and carry each
    other on: where each other's surface was found they do not lie, unless on that very surface. The closest go together
    first, as long as this holds for all parts of a fault.

    Parameters
    ----------
    motions, nodes, areas, settings
        As for :func:`~seismo3d.seismic.fault_ages.order_faults`.

    Returns
    -------
    ndarray of shape (fault,), int64
        Numbers from 0 on, the same for parts of one fault.
    """
    n = len(motions)
    family = np.arange(n)

    @cache
    def apart(one: int, other: int) -> tuple[bool, float]:
        large, small = (one, other) if areas[one] >= areas[other] else (other, one)
        return _part_from_other(motions[large], motions[small], nodes[small], areas[small], settings)

    for far, i, j in sorted((apart(i, j)[1], i, j) for i, j in near_pairs(nodes, settings.gap)):
        if not np.isfinite(far) or family[i] == family[j]:
            continue
        ours, theirs = (np.flatnonzero(family == family[m]) for m in (i, j))
        if all(apart(max(a, b), min(a, b))[0] for a in ours.tolist() for b in theirs.tolist()):
            family[theirs] = family[i]
    return np.asarray(np.unique(family, return_inverse=True)[1])


def are_one(
    frame: Frame, one: Float64Array, across: Float64Array, other: Float64Array, settings: HistorySettings
) -> bool:
    """Tell whether places of two faults, as they lay when they moved, lie on one surface.

    Parameters
    ----------
    frame : Frame
        Of the one.
    one : ndarray of shape (n, 3), float64
        Places on it.
    across : ndarray of shape (2,), float64
        Horizontal normal of the other.
    other : ndarray of shape (n, 3), float64
        Places on that.
    settings : HistorySettings
        Limits.

    Returns
    -------
    bool
    """
    alike = abs(float((frame.across * across).sum()))
    if alike < np.cos(np.radians(settings.turn_deg)):
        return False
    s, samples, _ = frame.lay(one)
    t, depths, _ = frame.lay(other)
    here, there = np.column_stack([s, samples]), np.column_stack([t, depths])
    if not are_near(bounds_of(here), bounds_of(there), settings.gap):
        return False
    # farther than this nothing is asked of them
    reach = settings.gap + settings.around + 1.0
    to_one = _distances(there, here, reach)
    gap = float(to_one.min())
    if gap > settings.gap or (to_one < _ON).mean() > settings.overlap:
        return False
    to_other = _distances(here, there, reach)
    if (to_other < _ON).mean() > settings.overlap:
        return False
    near, far = one[to_other < gap + settings.around], other[to_one < gap + settings.around]
    count = min(len(near), len(far))
    if count < settings.least_places // 2:
        return False
    both = [part[np.linspace(0, len(part) - 1, count).astype(np.int64)] for part in (near, far)]
    return roughness_of(frame, np.concatenate(both)) < settings.roughness


def _part_from_other(
    motion: FaultMotion, other: FaultMotion, nodes: Float64Array, area: float, settings: HistorySettings
) -> tuple[bool, float]:
    """Tell whether a fault and a smaller one, of such places and area, may be parts of one, and how far apart.

    Infinitely far where neither carries the other on.
    """
    alike = float((motion.frame.across * other.frame.across).sum())
    turned = 1 if alike >= 0 else -1
    if abs(alike) < np.cos(np.radians(settings.turn_deg)) or turned * other.hanging_side != motion.hanging_side:
        return False, np.inf
    away = motion.apart_at(nodes)
    gap = float(away.min())
    near = nodes[away < gap + settings.around]
    if area >= settings.least_area:
        up, down = sorted(float(np.median(fault.throw_at(near))) for fault in (motion, other))
        if up < -settings.opposed and down > settings.opposed:
            return False, np.inf
    # at right angles to the surface, which dips: across the strike it is as far off where that throws the part down
    aside = abs(float(np.median(motion.side(near)) / np.hypot(1.0, motion.slopes[1])))
    if aside > _SAME and float((away < _ON).mean()) > settings.overlap:
        return False, np.inf
    return True, gap + aside if gap <= settings.gap and aside <= settings.aside else np.inf


def _distances(places: Float64Array, others: Float64Array, reach: float) -> Float64Array:
    """Return how far each place is from the nearest of others; infinite where that is farther than the reach."""
    distances = np.full(len(places), np.inf)
    near = within_box(places, bounds_of(others), reach)
    if near.any():
        tree = cKDTree(others[within_box(others, bounds_of(places[near]), reach)])
        distances[near] = tree.query(places[near], distance_upper_bound=reach)[0]
    return distances
