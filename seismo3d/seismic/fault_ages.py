"""Which of two faults that meet is the younger, and how it slid, told by how they offset each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from seismo3d._settings import Count, Degrees, Positive, Share, Smoothing, Stiffness, Threshold
from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d.seismic.fault_motion import FaultMotion, Frame
from seismo3d.seismic.parted_faults import SidesOfFaults, distances_along, roughness_of, roughness_together
from seismo3d.seismic.sheet_distances import bounds_of, near_boxes

# roughness, in squared traces, that surfaces have anyway
_SMOOTH = 0.03
# strike slips over throw that are tried where ages are told, and what a trial costs that is so far off the known one
_TURNS, _PRICE = np.linspace(-0.6, 0.6, 13), 0.5
# strike slips over throw among which the one is looked for that mends older faults, and how far aside is surely worse
_SHARES, _ASIDE = np.linspace(-1.2, 1.2, 25), 0.2
# mend from which on an older fault bears witness, and how many times clearer a single one must
_WITNESS, _ALONE = 0.25, 1.6


@dataclass(frozen=True, slots=True)
class HistorySettings:
    """How the ages of faults are told, and older ones measured as they lay before younger ones moved.

    Attributes
    ----------
    reach, clear : float in [0, 1000], [0, reach]
        Traces beside a fault, at most and at least, of the places by which another is compared on its two sides.
    edge : float in [0, 1000]
        How far beyond its edge a fault is taken to go on.
    least_places : int in [1, 1000000]
        Places that it takes on either side.
    least_gain : float in [0, inf]
        Logarithm of how many times smoother two faults must be in one order than in the other.
    least_free : float in [0, inf]
        The same, if either may have moved along its strike as well, where strike slips are told by that order.
    least_share, least_mend : float in [0, inf]
        Strike slip over throw, and logarithm of how many times smoother it must leave the older faults, all together,
        from which on a fault's slip is oblique; if but one tells it, more. Slip less than 15 degrees off the dip line
        cannot be told from none by older faults.
    least_area : float in [0, inf]
        Smaller faults are not taken back for others' sake: their throw is too uncertain.
    stiffness : float in [0, 1000000]
        Of the field of throw, about a bell, by which others are moved back.
    least_match : float in [0, inf]
        How well the sides of a fault must match where others are taken back, in parts of how well they do today: what
        is moved there is interpolated, and matches a little worse for that alone.
    lift_spread : float in (0, inf)
        How far the share of slip that a hanging wall took is expected to lie off one.
    decay_odds, decay_spread : float in (-inf, inf), (0, inf)
        Logarithm of the odds that slip does not die away off a fault, before the layers are looked at; and how well
        their tilts beside it tell which share is lost a trace, where nothing scatters.
    even, dying : float in [0, 1]
        Least throw of a fault over its largest, but for a tenth of its places with less and a twentieth with more: from
        the first on slip does not die away off it either; up to the second it dies away within the cube, and what the
        layers tell of its two walls is believed of its own throw as well.
    turn_deg, gap, around, overlap, roughness : float in [0, 90], [0, inf], [0, inf], [0, 1], [0, inf]
        Two faults are parts of one where they strike alike within the first, lie no farther apart than the second, one
        covers no more than the fourth of the other, and one quadratic surface through both, within the third of each
        other, leaves no more than the last, in squared traces.
    aside : float in [0, inf]
        Before younger faults that cut them are taken back, parts of one fault may lie so far off each other's surface,
        carried on, in traces and samples; of turn, gap and overlap the same is asked then.
    opposed : float in [0, inf]
        Two faults, none of them smaller than `least_area`, are not parts of one if where they are nearest one is thrown
        up by more than that, in samples, and the other down.
    """

    reach: Smoothing = 20.0
    clear: Annotated[float, "[0, reach]"] = 2.0
    edge: Smoothing = 6.0
    least_places: Count = 60
    least_gain: Threshold = 0.65
    least_free: Threshold = 0.1
    least_share: Threshold = 0.27
    least_mend: Threshold = 1.2
    least_area: Threshold = 1500.0
    stiffness: Stiffness = 1000.0
    least_match: Threshold = 0.9
    lift_spread: Positive = 0.2
    decay_odds: Annotated[float, "(-inf, inf)"] = 2.0
    decay_spread: Positive = 0.006
    even: Share = 0.7
    dying: Share = 0.5
    turn_deg: Degrees = 20.0
    gap: Threshold = 30.0
    around: Threshold = 25.0
    overlap: Share = 0.25
    roughness: Threshold = 0.6
    aside: Threshold = 10.0
    opposed: Threshold = 2.0


@dataclass(frozen=True, slots=True)
class StrikeSlip:
    """Slip of a fault along its strike, as older faults that it has offset tell it.

    Attributes
    ----------
    share : float or None
        Motion of the hanging wall along the frame's `along`, in traces, for each sample of throw; None where they tell
        of none.
    certainty : float
        How sharply that is told, 0 to 1.
    """

    share: float | None = None
    certainty: float = 0.0

    def of(self, motion: FaultMotion) -> FaultMotion:
        """Return a motion that slides as it is told, or as it was where nothing is."""
        return motion if self.share is None else replace(motion, share=self.share)


def order_faults(
    motions: list[FaultMotion],
    nodes: list[Float64Array],
    areas: list[float],
    families: IntArray,
    settings: HistorySettings,
    *,
    sliding: bool = False,
) -> BoolArray:
    """Tell which faults are younger than which.

    The younger of two faults that cross has offset the older, and goes through unbroken. So the older is smoother where
    the younger is taken back, and the younger would be broken where the older is. The order in which both together are
    the smoother is taken, the clearest pairs first, so that no fault becomes younger than itself. What the parts of two
    faults tell is added up, and so is what two parts of one do that lie on either side of the other.

    Parameters
    ----------
    motions : list of FaultMotion
        The faults, or parts of them.
    nodes : list of ndarray of shape (n, 3), float64
        Places on each.
    areas : list of float
        Their areas, in traces times samples.
    families : ndarray of shape (part,), int64
        Which are parts of one, as :func:`~seismo3d.seismic.fault_families.find_families` tells it.
    settings : HistorySettings
        Limits.
    sliding : bool
        True for those orders alone that hold as well if faults may have moved along their strikes: one that did may
        have slid past an older one and left it whole.

    Returns
    -------
    ndarray of shape (fault, fault), bool
        True where the first is younger than the second; where neither is, it is not known.
    """
    meetings: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i, j in near_pairs(nodes, settings.reach):
        if families[i] != families[j]:
            one, other = (i, j) if families[i] > families[j] else (j, i)
            meetings.setdefault((int(families[one]), int(families[other])), []).append((one, other))
    sides = SidesOfFaults(motions, nodes, settings)

    def gain_of(pair: tuple[int, int], turns: Float64Array) -> float:
        one, other = (np.flatnonzero(families == family).tolist() for family in pair)
        gain = _gain_of_parts(meetings[pair], motions, nodes, turns, settings)
        for sign, young, old in ((1.0, one, other), (-1.0, other, one)):
            gain += sign * sum(_gain_of_parted(n, old, motions, areas, sides, turns, settings) for n in young)
        return gain

    told = []
    for pair in meetings:
        gain = gain_of(pair, np.zeros(1))
        if abs(gain) <= settings.least_gain:
            continue
        if sliding:
            free = gain_of(pair, _TURNS)
            if np.sign(gain) * free <= settings.least_free:
                continue
        told.append((abs(gain), *(pair if gain > 0 else pair[::-1])))
    n_families = int(families.max()) + 1 if len(motions) else 0
    area = np.bincount(families, areas, n_families)
    younger = np.zeros((n_families, n_families), bool)
    for _, i, j in sorted(told, key=lambda item: (-item[0], item[1], item[2])):
        if area[i] < settings.least_area or younger[j, i]:
            continue
        above, below = np.append(np.flatnonzero(younger[:, i]), i), np.append(np.flatnonzero(younger[j]), j)
        younger[np.ix_(above, below)] = True
    return younger[np.ix_(families, families)]


def count_generations(younger: BoolArray) -> IntArray:
    """Return the length of the longest chain of faults that moved one after the other, all later than each fault.

    Parameters
    ----------
    younger : ndarray of shape (fault, fault), bool
        As :func:`order_faults` tells it.

    Returns
    -------
    ndarray of shape (fault,), int64
        0 for faults of which nothing younger is known.

    Examples
    --------
    >>> import numpy as np
    >>> count_generations(np.array([[False, True, True], [False, False, True], [False, False, False]])).tolist()
    [0, 1, 2]
    """
    generation = np.zeros(len(younger), np.int64)
    for _ in range(len(younger)):
        after = np.where(younger, generation[:, None] + 1, 0).max(axis=0)
        if (after == generation).all():
            break
        generation = after
    return generation


def tell_strike_slips(
    motions: list[FaultMotion],
    nodes: list[Float64Array],
    areas: list[float],
    families: IntArray,
    settings: HistorySettings,
) -> list[StrikeSlip]:
    """Tell how far faults moved along their strikes, by the older ones that they have offset.

    A surface that dips, or strikes across, is a marker: it is whole again where both parts of the slip are taken back.
    What all older faults tell of all parts of a fault is added up.

    Parameters
    ----------
    motions, nodes, areas, families, settings
        As for :func:`order_faults`.

    Returns
    -------
    list of StrikeSlip
        One for each.
    """
    younger = order_faults(motions, nodes, areas, families, settings, sliding=True)
    told = [StrikeSlip() for _ in motions]
    for family in np.unique(families):
        parts = np.flatnonzero(families == family).tolist()
        along = motions[parts[0]].frame.along
        turns = [1.0 if float((motions[n].frame.along * along).sum()) >= 0 else -1.0 for n in parts]
        known = turns[0] * motions[parts[0]].share
        mended = np.zeros((int(families.max()) + 1, len(_SHARES)))
        for n, turn in zip(parts, turns, strict=True):
            for older in np.flatnonzero(younger[n]).tolist():
                near = _across(motions[n], nodes[older], settings)
                if near is not None:
                    shares = turn * np.append(_SHARES, known)
                    rough = np.log(_roughness_undone(motions[n], motions[older], near, shares) + _SMOOTH)
                    mended[families[older]] += rough[-1] - rough[:-1]
        share, certainty = _best_share(mended, settings)
        if share is not None:
            for n, turn in zip(parts, turns, strict=True):
                told[n] = StrikeSlip(turn * share, certainty)
    return told


def _best_share(mended: Float64Array, settings: HistorySettings) -> tuple[float | None, float]:
    """Return the strike slip over throw that mends older faults most, and how sharply they tell it; None if none does.

    `mended` is by how much each strike slip mends each older fault.
    """
    total = mended.sum(axis=0)
    best = int(total.argmax())
    witnesses = int((mended[:, best] > _WITNESS).sum())
    least = settings.least_mend * (1.0 if witnesses > 1 else _ALONE)
    if total[best] < least or best in (0, len(_SHARES) - 1):
        return None, 0.0
    before, here, after = total[best - 1 : best + 2]
    bend = min(before - 2.0 * here + after, -1e-9)
    share = float(_SHARES[best] + 0.5 * (_SHARES[1] - _SHARES[0]) * (before - after) / bend)
    if abs(share) < settings.least_share:
        return None, 0.0
    aside = float(np.interp([share - _ASIDE, share + _ASIDE], _SHARES, total).max())
    return share, float(-np.expm1(aside - total[best]))


def near_pairs(nodes: list[Float64Array], reach: float) -> Iterator[tuple[int, int]]:
    """Give all pairs of faults whose boxes come within reach, each once, the later first."""
    bounds = np.array([bounds_of(places) for places in nodes]).reshape(len(nodes), 2, 3)
    for i in range(len(nodes)):
        for j in near_boxes(bounds[:i], bounds[i], reach):
            yield i, j


def _gain_of_parts(
    parts: list[tuple[int, int]], motions: list[FaultMotion], nodes: list[Float64Array], turns: Float64Array,
    settings: HistorySettings,
) -> float:  # fmt: skip
    """Return the sum of the gains of pairs of parts, the first of each of the one fault, the other of the other."""
    return sum(_gain(motions[i], motions[j], nodes[i], nodes[j], turns, settings) for i, j in parts)


def _gain_of_parted(
    young: int, parts: list[int], motions: list[FaultMotion], areas: list[float], sides: SidesOfFaults,
    turns: Float64Array, settings: HistorySettings,
) -> float:  # fmt: skip
    """Return the logarithm of how many times smoother a fault's parts on either side of another are if that is undone.

    Of several pairs of parts the clearest one tells; 0 where there is none.
    """
    gains = [0.0]
    for n, i in enumerate(parts):
        for j in parts[:n]:
            large, small = (i, j) if areas[i] >= areas[j] else (j, i)
            places = sides.parted(young, large, small)
            if places is None:
                continue
            frame = motions[large].frame
            as_is = _roughness_of_parted(frame, places, settings)
            undone = [
                _roughness_of_parted(frame, tuple(fault.undo(part) for part in places), settings)
                * (1.0 + _PRICE * abs(float(turn)))
                for turn, fault in ((turn, _sliding(motions[young], float(turn))) for turn in turns)
            ]
            if np.isfinite(as_is) and np.isfinite(min(undone)):
                gains.append(float(np.log((as_is + _SMOOTH) / (min(undone) + _SMOOTH))))
    return max(gains, key=abs)


def _sliding(motion: FaultMotion, turn: float) -> FaultMotion:
    return replace(motion, share=motion.share + turn)


def _roughness_of_parted(frame: Frame, parts: tuple[Float64Array, ...], settings: HistorySettings) -> float:
    """Return the roughness of two parts together; infinite where too few of their places come near each other."""
    one, other = parts
    away = distances_along(frame, one, other, settings.gap + settings.around)
    roughness, count = roughness_together(frame, (one, other), away, settings.around)
    return roughness if count >= settings.least_places else np.inf


def _gain(
    one: FaultMotion, other: FaultMotion, nodes: Float64Array, others: Float64Array, turns: Float64Array,
    settings: HistorySettings,
) -> float:  # fmt: skip
    """Return the logarithm of how many times smoother both are if the first is the younger than if the other is.

    Either may have moved along its strike by any of some `turns` more than is known, over its throw.
    """
    as_is, with_one = _roughness_across(one, other, others, turns, settings)
    other_as_is, with_other = _roughness_across(other, one, nodes, turns, settings)
    together = np.log((as_is + with_other + _SMOOTH) / (with_one + other_as_is + _SMOOTH))
    each = np.log((as_is + _SMOOTH) / (with_one + _SMOOTH)) + np.log((with_other + _SMOOTH) / (other_as_is + _SMOOTH))
    # the rougher of the two decides the one, each as it is the other
    return float(0.5 * (together + each))


def _roughness_across(
    motion: FaultMotion, other: FaultMotion, nodes: Float64Array, turns: Float64Array, settings: HistorySettings
) -> tuple[float, float]:
    """Return how rough another fault, of which these are places, is across this one: as it is, and with this undone."""
    near = _across(motion, nodes, settings)
    if near is None:
        return 0.0, 0.0
    undone = _roughness_undone(motion, other, near, motion.share + turns) * (1.0 + _PRICE * np.abs(turns))
    return roughness_of(other.frame, near), float(undone.min())


def _across(motion: FaultMotion, nodes: Float64Array, settings: HistorySettings) -> Float64Array | None:
    """Return the places near a fault, on its two sides; None where either has too few."""
    near, side = motion.find_near(nodes, clear=settings.clear, reach=settings.reach, edge=settings.edge)
    beyond = int((side > 0).sum())
    return nodes[near] if min(beyond, len(near) - beyond) >= settings.least_places else None


def _roughness_undone(
    motion: FaultMotion, other: FaultMotion, places: Float64Array, shares: Float64Array
) -> Float64Array:
    """Return how rough places of another fault are with this one undone, for each strike slip over throw."""
    undone = (replace(motion, share=float(share)).undo(places) for share in shares)
    return np.array([roughness_of(other.frame, points) for points in undone])
