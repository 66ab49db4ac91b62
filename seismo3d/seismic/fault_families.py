"""Which faults are parts of one, as they lie today and as they lay when they moved."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from seismo3d._typing import Float64Array, IntArray
from seismo3d.seismic.fault_ages import HistorySettings, near_pairs
from seismo3d.seismic.fault_motion import FaultMotion, Frame
from seismo3d.seismic.parted_faults import SidesOfFaults, distances_along, roughness_together

# traces within which surfaces that cover each other are the same, and distance along a surface that is still on it
_SAME, _ON = 2.0, 1.5
# traces and samples between two parts on either side of a fault, as they lie today
_FAR = 60.0
# roughness, in squared traces, that undoing a fault leaves of two parts that it has taken apart, and how many times and
# by how much rougher they are as they lie
_MENDED, _TIMES, _ROUGHER = 2.0, 4.0, 0.5


def find_families(
    motions: list[FaultMotion], nodes: list[Float64Array], areas: list[float], settings: HistorySettings
) -> IntArray:
    """Tell which faults are parts of one as they lie today.

    Younger faults have taken the parts of an older one apart, along it and, by their heave, across it. Parts strike
    alike, dip to the same side, are not thrown up here and down there, unless one is too small to tell, and carry each
    other on: where each other's surface was found they do not lie, unless on that very surface. The closest go together
    first, as long as this holds for all parts of a fault. Then those go together, the largest first, that lie farther
    apart, on either side of another fault, and on one surface once that is undone.

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
    sides = SidesOfFaults(motions, nodes, settings)

    @cache
    def parted(one: int, other: int, fault: int) -> bool:
        large, small = (one, other) if areas[one] >= areas[other] else (other, one)
        places = sides.parted(fault, large, small)
        return places is not None and _go_together(motions[large].frame, places, motions[fault], settings)

    for _, i, j, fault in sorted(_between(motions, nodes, areas, family, settings)):
        if family[i] == family[j] or family[fault] in (family[i], family[j]) or not parted(i, j, fault):
            continue
        ours, theirs = (np.flatnonzero(family == family[m]) for m in (i, j))
        pairs = [(max(a, b), min(a, b)) for a in ours.tolist() for b in theirs.tolist()]
        if all(apart(*pair)[0] or parted(*pair, fault) for pair in pairs):
            family[theirs] = family[i]
    return np.asarray(np.unique(family, return_inverse=True)[1])


def _between(
    motions: list[FaultMotion], nodes: list[Float64Array], areas: list[float], family: IntArray,
    settings: HistorySettings,
) -> Iterator[tuple[float, int, int, int]]:  # fmt: skip
    """Give all pairs of faults that may be parts of one, and those that come near both, the largest pairs least."""
    near = [set[int]() for _ in motions]
    for i, j in near_pairs(nodes, settings.reach):
        near[i].add(j)
        near[j].add(i)
    for i, j in near_pairs(nodes, _FAR):
        if family[i] == family[j] or not _are_alike(motions[i], motions[j], settings):
            continue
        smaller = min(areas[i], areas[j])
        if _are_opposed(motions[i].throw, motions[j].throw, smaller, settings):
            continue
        for fault in sorted(near[i] & near[j]):
            if areas[fault] >= settings.least_area:
                yield -smaller, i, j, fault


def _go_together(
    frame: Frame, places: tuple[Float64Array, Float64Array], fault: FaultMotion, settings: HistorySettings
) -> bool:
    """Tell whether two parts, given by places on either side of a fault, lie on one surface if that is undone."""
    one, other = (fault.undo(part) for part in places)
    reach = settings.gap + settings.around + 1.0
    away = distances_along(frame, one, other, reach)
    if not _carry_on(away, settings):
        return False
    mended, count = roughness_together(frame, (one, other), away, settings.around)
    if mended > _MENDED or count < settings.least_places:
        return False
    as_is, _ = roughness_together(frame, places, distances_along(frame, *places, reach), settings.around)
    return as_is >= _TIMES * mended + _ROUGHER


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
    # farther than this nothing is asked of them
    away = distances_along(frame, one, other, settings.gap + settings.around + 1.0)
    if not _carry_on(away, settings):
        return False
    roughness, count = roughness_together(frame, (one, other), away, settings.around)
    return count >= settings.least_places // 2 and roughness < settings.roughness


def _part_from_other(
    motion: FaultMotion, other: FaultMotion, nodes: Float64Array, area: float, settings: HistorySettings
) -> tuple[bool, float]:
    """Tell whether a fault and a smaller one, of such places and area, may be parts of one, and how far apart.

    Infinitely far where neither carries the other on.
    """
    if not _are_alike(motion, other, settings):
        return False, np.inf
    away = motion.apart_at(nodes)
    gap = float(away.min())
    near = nodes[away < gap + settings.around]
    if _are_opposed(motion.throw_at(near), other.throw_at(near), area, settings):
        return False, np.inf
    # at right angles to the surface, which dips: across the strike it is as far off where that throws the part down
    aside = abs(float(np.median(motion.side(near)) / np.hypot(1.0, motion.slopes[1])))
    if aside > _SAME and float((away < _ON).mean()) > settings.overlap:
        return False, np.inf
    return True, gap + aside if gap <= settings.gap and aside <= settings.aside else np.inf


def _carry_on(away: tuple[Float64Array, Float64Array], settings: HistorySettings) -> bool:
    """Tell whether two parts, given how far their places lie from the other, are near each other and side by side."""
    gap = min(float(far.min()) for far in away)
    return gap <= settings.gap and max(float((far < _ON).mean()) for far in away) <= settings.overlap


def _are_alike(one: FaultMotion, other: FaultMotion, settings: HistorySettings) -> bool:
    """Tell whether two faults strike alike and dip to the same side."""
    alike = float((one.frame.across * other.frame.across).sum())
    turned = 1 if alike >= 0 else -1
    return abs(alike) >= np.cos(np.radians(settings.turn_deg)) and turned * other.hanging_side == one.hanging_side


def _are_opposed(one: Float64Array, other: Float64Array, area: float, settings: HistorySettings) -> bool:
    """Tell whether one fault is thrown up and the other down, by some throws of both; not of too small an area."""
    if area < settings.least_area:
        return False
    up, down = sorted(float(np.median(throws)) for throws in (one, other))
    return up < -settings.opposed and down > settings.opposed
