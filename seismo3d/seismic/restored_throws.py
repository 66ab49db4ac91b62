"""Throws of faults that others have cut, read as they lay before these moved."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_restore import spread
from seismo3d.seismic.both_walls import tell_throw
from seismo3d.seismic.fault_ages import (
    HistorySettings,
    StrikeSlip,
    count_generations,
    order_faults,
    tell_strike_slips,
)
from seismo3d.seismic.fault_families import are_one, find_families
from seismo3d.seismic.fault_motion import FaultMotion, Frame, enlarge, find_motion, undo_parts
from seismo3d.seismic.layer_strain import LayerSlopes, measure_evenness, tell_strains
from seismo3d.seismic.sheet_distances import are_near, bounds_of
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.slip_direction import refine_free_slip
from seismo3d.seismic.slip_fields import Sides, SlipField
from seismo3d.seismic.throw import (
    SheetSides,
    SheetThrow,
    ThrowSettings,
    at_every,
    carry_on_slip,
    every_sample,
    facing,
    find_slip,
    fit_of,
)

# traces and samples from one place to the next of those by which faults are compared
_EVERY = 2
# share of a place that must be covered by what was moved there
_COVERED = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A sheet at every sample: its places on the grid, where they lie today, and where its hanging wall is."""

    sheet: Sheet
    frame: Frame
    rows: IntArray
    columns: IntArray
    shape: tuple[int, int]
    hanging_side: int

    def points(self, every: int = 1) -> Float64Array:
        """Return its places as they lie today."""
        kept = slice(None) if every == 1 else (self.rows % every == 0) & (self.columns % every == 0)
        rows, columns = self.rows[kept], self.columns[kept]
        w = every_sample(self.sheet)[rows, columns].astype(np.float64)
        return self.sheet.points(rows.astype(np.float64), columns / self.sheet.step, w)


def restore_throws(
    sheets: list[Sheet],
    throws: list[SheetThrow],
    read_sides: Callable[[int], SheetSides],
    layers: LayerSlopes,
    *,
    settings: ThrowSettings,
    history: HistorySettings,
) -> list[SheetThrow]:
    """Measure the throws of faults as they lay when they moved.

    Faults that moved later have strained an older one, offset its parts, and taken what once touched to different
    places: what lies apart today is not what it threw. So the youngest fault is taken back first; the places of all
    that is known to be older move with its walls, by the shares of its slip that the slopes of the layers around say
    that each took, the less the farther off where slip dies away. What was read on the two sides of the next fault
    moves along; its parts come to lie on one surface, are matched together, and it is taken back in turn. Where it has
    offset older ones they tell how far it moved along its strike. Where both walls of a fault moved, and none that is
    younger has strained what tells so, its throw is told from how far what touched lies apart.

    Parameters
    ----------
    sheets : list of Sheet
        Faults.
    throws : list of SheetThrow
        Their throws as they seem today.
    read_sides : callable
        Takes the number of a sheet, and gives its two sides as :func:`~seismo3d.seismic.throw.gather_sides` does.
    layers : LayerSlopes
        Slopes of the layers all over the cube.
    settings : ThrowSettings
        How sides are matched.
    history : HistorySettings
        How ages are told.

    Returns
    -------
    list of SheetThrow
        In their order, with family and generation; else as they were where a fault lies as it did when it moved, or
        that is not known, and no older one tells that it moved along its strike.
    """
    parts = [_lay_out(sheet, throw) for sheet, throw in zip(sheets, throws, strict=True)]
    motions = [
        _present_motion(part, throw, history) if len(part.rows) else None
        for part, throw in zip(parts, throws, strict=True)
    ]
    known = [number for number, motion in enumerate(motions) if motion is not None]
    moved = [motion for motion in motions if motion is not None]
    places, areas = [parts[n].points(_EVERY) for n in known], [sheets[n].area for n in known]
    families = np.full(len(sheets), -1)
    families[known] = find_families(moved, places, areas, history)
    slips = tell_strike_slips(moved, places, areas, families[known], history)
    moved = [slip.of(motion) for slip, motion in zip(slips, moved, strict=True)]
    younger = np.zeros((len(sheets), len(sheets)), bool)
    younger[np.ix_(known, known)] = order_faults(moved, places, areas, families[known], history)

    def beside(number: int) -> tuple[SheetThrow, SheetSides, int]:
        return throws[known[number]], read_sides(known[number]), sheets[known[number]].step

    strain = dict(zip(known, tell_strains(moved, families[known], layers, beside, history), strict=True))
    told, today = dict(zip(known, slips, strict=True)), dict(zip(known, moved, strict=True))
    found, undone = list(throws), _Undone(parts, younger, families, history.reach)
    for group in _groups(parts, known, undone, history):
        read = cache(read_sides)  # of this group alone
        first = group[0]
        as_it_lies = len(group) == 1 and not younger[:, first].any()
        motion = today[first] if as_it_lies else None
        if not as_it_lies or told[first].share is not None:
            motion = _measure(group, parts, found, today, read, undone, settings, history, told[first]) or motion
        if motion is not None and younger[group].any():
            undone.add(group, strain[first].of(motion))
    generations = count_generations(younger).tolist()
    for family in set(families[known].tolist()):
        parts_of = [n for n in known if families[n] == family and generations[n] == 0]
        # what the layers tell of both walls is believed where slip dies away within the cube
        if parts_of and measure_evenness([found[n] for n in parts_of]) <= history.dying:
            for n in parts_of:
                found[n] = _tell_in_place(found[n], strain[n].lift, sheets[n].step)
    order = zip(families.tolist(), generations, strict=True)
    return [replace(throw, family=n, generation=g) for throw, (n, g) in zip(found, order, strict=True)]


class _Undone:
    """The motions that are taken back so far, the youngest first, and where they bring the places of the others.

    A fault moves the older ones that come within `reach` of it: what a survey holds beyond is strained by neither. The
    motions of its parts are taken back as one; a fault's places are asked for when all that is younger is taken back.
    """

    def __init__(self, parts: list[_Part], younger: BoolArray, families: IntArray, reach: float) -> None:
        self.younger = younger
        self.families = families
        self._parts = parts
        self._reach = reach
        self._motions: dict[int, list[tuple[FaultMotion, Float64Array]]] = {}
        self._places: dict[int, tuple[Float64Array, Float64Array, list[list[FaultMotion]]]] = {}

    def add(self, group: list[int], motion: FaultMotion) -> None:
        """Take back the motion of these faults, parts of one."""
        bounds = bounds_of(np.concatenate([self.bounds(n) for n in group]))
        self._motions.setdefault(int(self.families[group[0]]), []).append((motion, bounds))

    def places(self, number: int) -> Float64Array:
        """Return where some places of a fault lay before what is taken back."""
        return self._follow(number)[0]

    def bounds(self, number: int) -> Float64Array:
        """Return the bounds of these places."""
        return self._follow(number)[1]

    def take_back(self, number: int, points: Float64Array) -> Float64Array:
        """Return where points beside a fault lay before what is taken back of it."""
        for motions in self._follow(number)[2]:
            points = undo_parts(motions, points)
        return points

    def _follow(self, number: int) -> tuple[Float64Array, Float64Array, list[list[FaultMotion]]]:
        """Return some places of a fault before what is taken back, their bounds, and by what they are moved."""
        if number not in self._places:
            points, moved_by = self._parts[number].points(_EVERY), []
            bounds = bounds_of(points)
            for family, motions in self._motions.items():
                younger = self.younger[self.families == family, number].any()
                if younger and any(are_near(reached, bounds, self._reach) for _, reached in motions):
                    moved_by.append([motion for motion, _ in motions])
                    points = undo_parts(moved_by[-1], points)
                    bounds = bounds_of(points)
            self._places[number] = (points, bounds, moved_by)
        return self._places[number]


def _lay_out(sheet: Sheet, throw: SheetThrow) -> _Part:
    w = every_sample(sheet)
    rows, columns = np.nonzero(np.isfinite(w))
    frame = Frame(sheet.origin, sheet.across)
    return _Part(sheet, frame, rows, columns, (w.shape[0], w.shape[1]), throw.hanging_side)


def _present_motion(part: _Part, throw: SheetThrow, history: HistorySettings) -> FaultMotion | None:
    """Return the motion of a sheet as it lies today; None where its throw is not known."""
    if not np.isfinite(throw.throw).any():
        return None
    thrown, fit = (at_every(values, part.sheet, _EVERY) for values in (throw.throw, throw.fit))
    return find_motion(
        part.frame, (part.sheet.first_s, float(part.sheet.first_sample)), every_sample(part.sheet).astype(np.float64),
        thrown, fit, hanging_side=part.hanging_side, share=throw.strike_share, stiffness=history.stiffness, thin=_EVERY,
    )  # fmt: skip


def _groups(parts: list[_Part], known: list[int], undone: _Undone, history: HistorySettings) -> Iterator[list[int]]:
    """Give the faults, the youngest first and the largest of these before others, each with its other parts."""
    left = list(known)
    while left:
        held = np.asarray(undone.younger[left].any(axis=0))
        free = [n for n in left if not held[n]]
        free.sort(key=lambda n: (-parts[n].sheet.area, n))
        group = [free[0]]
        for n in free[1:]:
            if undone.families[n] != undone.families[free[0]]:
                continue
            if any(_are_one(parts, m, n, undone, history) for m in group):
                group.append(n)
        yield group
        left = [n for n in left if n not in group]


def _are_one(parts: list[_Part], one: int, other: int, undone: _Undone, history: HistorySettings) -> bool:
    # no surface bends so much that it goes on from farther away
    if not are_near(undone.bounds(one), undone.bounds(other), 3.0 * history.gap):
        return False
    return are_one(parts[one].frame, undone.places(one), parts[other].frame.across, undone.places(other), history)


def _turned(part: _Part, other: _Part) -> int:
    return 1 if float((part.frame.across * other.frame.across).sum()) >= 0 else -1


def _measure(
    group: list[int],
    parts: list[_Part],
    found: list[SheetThrow],
    today: dict[int, FaultMotion],
    read_sides: Callable[[int], SheetSides],
    undone: _Undone,
    settings: ThrowSettings,
    history: HistorySettings,
    told: StrikeSlip,
) -> FaultMotion | None:
    """Match the sides of a fault's parts as they lay when it moved; write their throws and return its motion.

    Where they match worse than they do today something was not taken back as it moved: None, and nothing is written.
    """
    first = parts[group[0]]
    laid = [first.frame.lay(undone.take_back(n, parts[n].points())) for n in group]
    low = [float(np.floor(min(at[axis].min() for at in laid))) - 1.0 for axis in (0, 1)]
    high = [max(float(at[axis].max()) for at in laid) for axis in (0, 1)]
    sums = np.zeros((7, int(high[0] - low[0]) + 3, int(high[1] - low[1]) + 3))
    weight = np.zeros(sums.shape[1:])
    for n, (s, samples, w) in zip(group, laid, strict=True):
        part = parts[n]
        sides, known, _ = read_sides(n)
        if _turned(part, first) < 0:
            sides, known = sides[::-1], known[::-1]
        sides, known = (values[:, part.rows, part.columns] for values in (sides, known))
        foot, match = _counterparts(part, found[n], today[n])
        lay_apart = samples - undone.take_back(n, foot)[:, 2]
        values = np.concatenate([sides * known, known, [w, lay_apart * match, match]])
        spread(s - low[0], samples - low[1], values, sums, weight)
    inside = weight > _COVERED
    both, seen = _mean_sides(sums)
    height = np.where(inside, sums[4] / np.maximum(weight, 1e-9), np.nan)
    sides_there = facing(both, seen, first.hanging_side)
    if not (seen[0].any() and seen[1].any()):
        return None
    slip = _best_slip(
        sides_there, inside, sums[5] / np.maximum(sums[6], 1e-9), sums[6] / np.maximum(weight, 1e-9), settings, told
    )
    fit = fit_of(slip)
    whole = [enlarge(values, inside.shape, settings.thin) for values in (slip.throw, fit)]
    read = {
        n: _read_throw(parts[n], found[n], slip, whole, (s - low[0], samples - low[1]), _turned(parts[n], first))
        for n, (s, samples, _) in zip(group, laid, strict=True)
    }
    if _matched(read.values()) < history.least_match * _matched(found[n] for n in group):
        return None
    for n, throw in read.items():
        found[n] = throw
    return find_motion(
        first.frame, (low[0], low[1]), height, slip.throw, fit, hanging_side=first.hanging_side,
        share=slip.share, stiffness=history.stiffness, thin=settings.thin,
    )  # fmt: skip


def _read_throw(
    part: _Part, today: SheetThrow, slip: SlipField, whole: list[Float32Array],
    at: tuple[Float64Array, Float64Array], turn: int,
) -> SheetThrow:  # fmt: skip
    """Return the throw of a part, from throw and fit of the whole fault, at its places there."""
    thrown, fits = (_read_back(values, part, *at) for values in whole)
    return replace(
        today,
        throw=np.where(part.sheet.inside & np.isfinite(today.throw), thrown, np.float32(np.nan)),
        fit=np.nan_to_num(fits),
        strike_share=turn * slip.share,
        slip_certainty=slip.certainty,
    )


def _tell_in_place(throw: SheetThrow, lift: float, step: int) -> SheetThrow:
    """Return the throw of a fault at its places, from how far apart what touched lies, if both of its walls moved."""
    told = tell_throw(throw.throw.astype(np.float64), lift, throw.strike_share, step)
    return replace(throw, throw=told.astype(np.float32), lift=lift)


def _matched(throws: Iterable[SheetThrow]) -> float:
    """Return how much of some sheets matches, in nodes."""
    return float(sum(throw.fit[np.isfinite(throw.throw)].sum(dtype=np.float64) for throw in throws))


def _counterparts(part: _Part, throw: SheetThrow, motion: FaultMotion) -> tuple[Float64Array, Float64Array]:
    """Return where the footwall lies today that each place of a part matches, and how well; itself where none does."""
    columns = np.minimum(np.rint(part.columns / part.sheet.step).astype(np.int64), throw.throw.shape[1] - 1)
    thrown, fit = (values[part.rows, columns].astype(np.float64) for values in (throw.throw, throw.fit))
    fit[~np.isfinite(thrown)] = 0.0
    thrown[fit == 0.0] = 0.0
    s, samples, _ = part.frame.lay(part.points())
    s, samples = s - motion.share * thrown, samples - thrown
    return part.frame.place(s, samples, motion.height_at(s, samples)), fit


def _best_slip(
    sides: Sides, inside: BoolArray, throw: Float64Array, fit: Float64Array, settings: ThrowSettings, told: StrikeSlip
) -> SlipField:
    """Match two sides anew, and about the throws expected; return the slip by which more of them match."""
    thin = settings.thin
    start, known = (values[::thin, ::thin].astype(np.float32) for values in (throw, fit))
    places = inside[::thin, ::thin]
    refined = refine_free_slip(sides, start, known, places, thin=thin, settings=settings.slip, share=told.share)
    expected = float((start * known).sum() / known.sum()) if known.any() else None
    anew = find_slip(sides, inside, settings=settings, about=expected, share=told.share)
    best = max((carry_on_slip(refined, places), anew), key=lambda slip: float(fit_of(slip)[places].sum()))
    return best if told.share is None else replace(best, certainty=told.certainty)


def _mean_sides(sums: Float64Array) -> tuple[Float32Array, Float32Array]:
    """Return both sides, and where they are known, from summed amplitudes and weights."""
    known = sums[2:4] > _COVERED
    sides = np.where(known, sums[:2] / np.maximum(sums[2:4], 1e-9), 0.0)
    return sides.astype(np.float32), known.astype(np.float32)


def _read_back(values: Float32Array, part: _Part, rows: Float64Array, columns: Float64Array) -> Float32Array:
    """Return what lies at the places of a part, on its sheet's own grid; NaN off it."""
    out = np.full(part.shape, np.nan, np.float32)
    out[part.rows, part.columns] = ndimage.map_coordinates(values, [rows, columns], order=1, mode="nearest")
    return out[:, np.arange(part.sheet.w.shape[1]) * part.sheet.step]
