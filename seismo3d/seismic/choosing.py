"""Which sheets are faults: those strong enough by themselves, and weaker ones that move beside such a sheet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.sparse.csgraph import connected_components

from seismo3d._settings import Count, Degrees, Positive, Share, Threshold
from seismo3d._typing import Float64Array
from seismo3d.seismic.sheet_distances import SheetNodes
from seismo3d.seismic.sheet_measures import (
    dip_deg,
    length_down_dip,
    mean_support,
    median_fit,
    median_throw,
    share_matched,
    strength,
    vertical_extent,
)
from seismo3d.seismic.sheet_tips import share_out_of_view
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.term_fits import fit_terms
from seismo3d.seismic.throw import SheetThrow

# root of the area across a cube, in traces times samples, from which on there is room for faults of any strength
_ROOM = 90.0
# traces times samples in which so many lines are found by chance
_CHANCE_SIZE = 10_000
# traces over which a sheet's course along its strike is smoothed
_COURSE = 3.0


@dataclass(frozen=True, slots=True)
class ChoiceSettings:
    """How large and strong a sheet must be to be a fault; lengths in traces and samples.

    Attributes
    ----------
    least_area : float in [0, inf]
        Smallest area, in traces times samples.
    least_strength : float in [0, inf]
        Significance that is needed: mean support times the square root of the area.
    least_height : float in [0, inf]
        Smallest extent down the samples.
    least_throw : float in [0, inf]
        Smallest median throw: sides that fit best unmoved, as at a channel's edge, are no fault.
    still_score : float in [0, inf]
        Support below which a sheet ends where its throw falls below `still_throw`.
    still_throw : tuple of (float, float) in [0, inf]
        Throw below which sides count as unmoved: without noise, and from the mild noise of a good survey on, where a
        throw that is read may be off by as much.
    still_fit : float in [0, inf]
        Fit of the unmoved sides that this takes: a throw carried on from elsewhere says nothing of a place.
    unbroken_score, unbroken_fit, unbroken_gain, unbroken_area : float in [0, inf]
        A part of a sheet of at least this area, at its rim, is unbroken ground if its support is below the score and
        its sides fit unmoved by more than this, and by so much more than by its throw: one carried on over as large a
        part, though nothing matches there, is of the fault that ends before it.
    layer_angle_deg, thrust_angle_deg : float in [0, 90]
        Least angle, in the median, between a sheet and the layers beside it, across its strike: what runs along steep
        layers is one of them, whose neighbours do not fit where its dip is told wrongly. The second is that of thrusts,
        which climb through their layers at low angles.
    thrust_strength, thrust_dip_deg : float in [0, inf], [0, 90]
        What is well told, of at least this strength and of no more than this dip may be a thrust.
    leaning, leaning_deg, leaning_score : float in [0, 1], [0, 90], [0, inf]
        What is nearer to the layers than this share of its dip, and than this angle, leans over as they do: if it is
        weaker than `sure_strength`, it needs this mean support. What does not fit along steep layers spreads to the
        planes between theirs and upright ones.
    bend : float in [0, inf]
        Traces over which the layers on a sheet's two sides, whose dips differ, would come apart by its median throw:
        with fewer, they bend there, and do not break.
    tall, tall_strength : float in [0, inf]
        Height from which on a sheet is no channel's edge, and the strength that is enough there, and where it is well
        told and off all strong faults.
    told_matched : float in [0, 1]
        Share of a sheet whose sides match, by `little_fit` in the median, from which on it is well told, if it is less
        steep than `leftover_dip_deg` and its throw as large as that of a steep weaker one.
    low_fit, steep_height : float in [0, inf]
        What is less tall and weaker than `sure_strength` stands by itself only where its moved sides match by so much
        in the median, and, if it is steep, from this height on: edges of channels are steep and low.
    sure_strength : float in [0, inf]
        Strength of what is no channel's edge whatever its shape, unless it winds.
    winding, winding_height, winding_extent : float in [0, inf]
        Slope of its course along the strike, root mean square about a bend, from which on a sheet winds, and the median
        height, and extent down the samples, up to which it is a channel's edge then, however strong and near to a
        fault: faults bend, but rivers meander.
    unlike_fit, unlike_score : float in [0, inf]
        What fits by less than the first, on the mean over the whole of it, stands by itself only with a mean support of
        the second: nothing tells that its sides, which are unlike wherever they are taken back to, were ever one.
    in_view_fit : float in [0, inf]
        Mean fit, over those places whose throw leads to one within the cube, from which on it may all the same.
    little_matched, little_fit : float in [0, 1], [0, inf]
        Share of what slopes, and median fit, from which on its sides are alike all the same: a large throw leads out of
        view from most places, and where it does not, chaotic beds and noise match by chance, but not so well.
    closed, closed_out : float in [0, inf], [0, 1]
        Likeness of the layers beyond both its ends from which on a sheet ends within them, and the share of it whose
        throw leads out of view from which on its sides were never one then, unless it is as strong as `sure_strength`
        or lies beside a strong fault, which may have cut it off.
    host_strength : float in [0, inf]
        Strength of a fault beside which weaker ones are looked for: faults come in families, and cut each other up.
    company_area, company_strength, company_length : float in [0, inf]
        Smallest area, strength and length down the dip of such a weaker one.
    company_matched : tuple of (float, float) in [0, 1]
        Smallest share of it where its moved sides match: where they match as well as those of steep ones must, and
        where they match no better than those of sloping ones must. A third of a sheet matches by chance at some throw,
        but not well.
    company_half, company_score : float in [0, 1], [0, inf]
        Share of it whose sides match below which its mean support is the second: weak ridges between layers and faults
        match here and there by chance.
    company_low_deg, company_low_score : tuple of (float, float) in [0, 90], [0, inf]
        Mean support that it needs at these dips, and in between what is proportional: along unconformities and gentle
        bends of layers weak ridges line up that are less steep than most faults.
    company_throw, company_fit : tuple of (float, float) in [0, inf]
        Smallest median fit where its sides match, and smallest median throw at that fit: of sloping ones, and of steep
        ones. At a perfect fit `least_throw` is enough, in between what is proportional.
    leftover_strength, leftover_fit : float in [0, inf]
        Smallest strength, and median fit where its sides match, of what was linked from the ridges that certain faults
        leave over; its throw is as large as that of a steep weaker one, and `little_matched` of it match.
    leftover_dip_deg, leftover_score : float in [0, 90], [0, inf]
        Such a one is less steep than the first, and if its dip is lower than `low_dip_deg` its mean support is the
        second: in noise and chaotic beds weak ridges line up with the layers.
    gap : float in [0, inf]
        Farthest that it may be from its host.
    small_throw, small_matched : float in [0, 1]
        Largest median throw, as a share of its height, and smallest share of it where its moved sides match, of a
        weaker one that needs no host but a swarm: a small fault moves by little. What was laid down or cut out moves by
        nothing, and the throw at which its sides are alike by chance may be any.
    swarm : int in [1, 1000000]
        Fewest faults that are one: such small ones and others, each no farther from one of these than it is large.
    steep_deg : float in [0, 90]
        Dip from which on a weaker one may be a channel's edge, or the bend of layers over a lower fault.
    low_dip_deg, alike_deg : float in [0, 90]
        Beside a host of a lower dip than the first, what is steep, weaker than a host and strikes alike within the
        second is such a bend, and no fault.
    upright_deg, upright_share, upright_throw : float in [0, 90], [0, 1], [0, 1]
        What lies within `gap` of a stronger fault with so large a share of it, strikes alike, is steeper by the angle
        and moves as that one does to within this share, or a sample, is that one's own break seen upright.
    overlap, beside : float in [0, 1], [0, inf]
        Largest share of it that may lie within `beside` of faults chosen before: more is the same fault once more, but
        for what matches and slopes as leftovers must and is as large as a weaker one must be without that.
    chance, chance_fall, chance_share : float in [0, inf], (0, inf), [0, 1]
        Lines of `least_strength` or more that are found in strong noise, in 10,000 traces times samples of a section;
        by how much more strength they are e times fewer; and which share of all lines down to some strength they may
        be: where they would be more, what is weaker is no fault. No chance leaves all.
    """

    least_area: Threshold = 400.0
    least_strength: Threshold = 23.0
    least_height: Threshold = 24.0
    least_throw: Threshold = 1.0
    still_score: Threshold = 0.6
    still_throw: tuple[Threshold, Threshold] = (0.5, 1.0)
    still_fit: Threshold = 0.7
    unbroken_score: Threshold = 0.4
    unbroken_fit: Threshold = 0.3
    unbroken_gain: Threshold = 0.2
    unbroken_area: Threshold = 300.0
    layer_angle_deg: Degrees = 20.0
    thrust_angle_deg: Degrees = 10.0
    thrust_strength: Threshold = 25.0
    thrust_dip_deg: Degrees = 45.0
    leaning: Share = 0.75
    leaning_deg: Degrees = 45.0
    leaning_score: Threshold = 0.48
    bend: Threshold = 11.0
    tall: Threshold = 60.0
    tall_strength: Threshold = 17.0
    told_matched: Share = 0.6
    low_fit: Threshold = 0.6
    steep_height: Threshold = 40.0
    sure_strength: Threshold = 33.0
    winding: Threshold = 0.2
    winding_height: Threshold = 40.0
    winding_extent: Threshold = 100.0
    unlike_fit: Threshold = 0.25
    unlike_score: Threshold = 0.65
    in_view_fit: Threshold = 0.4
    little_matched: Share = 0.12
    little_fit: Threshold = 0.8
    closed: Threshold = 0.85
    closed_out: Share = 0.2
    host_strength: Threshold = 33.0
    company_area: Threshold = 200.0
    company_strength: Threshold = 11.0
    company_length: Threshold = 30.0
    company_matched: tuple[Share, Share] = (0.3, 0.45)
    company_half: Share = 0.5
    company_score: Threshold = 0.35
    company_low_deg: tuple[Degrees, Degrees] = (45.0, 55.0)
    company_low_score: tuple[Threshold, Threshold] = (0.3, 0.2)
    company_throw: tuple[Threshold, Threshold] = (1.0, 1.4)
    company_fit: tuple[Threshold, Threshold] = (0.6, 0.75)
    leftover_strength: Threshold = 12.0
    leftover_fit: Threshold = 0.75
    leftover_dip_deg: Degrees = 80.0
    leftover_score: Threshold = 0.45
    gap: Threshold = 8.0
    small_throw: Share = 0.125
    small_matched: Share = 0.65
    swarm: Count = 3
    steep_deg: Degrees = 65.0
    low_dip_deg: Degrees = 55.0
    alike_deg: Degrees = 25.0
    upright_deg: Degrees = 15.0
    upright_share: Share = 0.5
    upright_throw: Share = 0.1
    overlap: Share = 0.3
    beside: Threshold = 2.5
    chance: Threshold = 0.0
    chance_fall: Positive = 0.55
    chance_share: Share = 0.2

    @classmethod
    def for_section(cls) -> ChoiceSettings:
        """Return the settings of a section, where sizes are lengths of lines; a line stands by itself or not at all."""
        return cls(
            least_area=24.0,
            least_strength=2.8,
            least_throw=0.5,
            still_score=0.0,
            unbroken_score=0.0,
            leaning_score=0.0,
            tall_strength=2.8,
            low_fit=0.0,
            unlike_fit=0.0,
            steep_height=0.0,
            closed=np.inf,
            host_strength=np.inf,
            small_throw=0.0,
            company_strength=2.8,
            company_area=24.0,
            chance=0.35,
        )

    def for_size(self, shape: tuple[int, ...]) -> ChoiceSettings:
        """Return the settings of a cube or section of this size.

        In a small or narrow cube no fault is as large as that a usual support makes it strong, and less lines up by
        chance: a tall one, and a host, need the less strength the less room there is for them. In a section the more
        lines up by chance the larger it is.
        """
        if 1 in shape[:2]:
            return replace(self, chance=self.chance * float(np.prod(shape)) / _CHANCE_SIZE) if self.chance else self
        share = float(np.sqrt(min(shape[0], shape[1]) * shape[2])) / _ROOM
        if share >= 1.0:
            return self
        tall = max(self.company_strength, share * self.tall_strength)
        return replace(self, tall_strength=tall, host_strength=share * self.host_strength)


def may_be_faults(sheets: list[Sheet], is_section: bool, settings: ChoiceSettings) -> list[Sheet]:
    """Leave out the sheets that are too small or weak whatever their throw.

    Parameters
    ----------
    sheets : list of Sheet
        From :func:`~seismo3d.seismic.linking.link_sheets`.
    is_section : bool
        True where the sheets are lines on one section.
    settings : ChoiceSettings
        Thresholds.

    Returns
    -------
    list of Sheet
        In their order.
    """
    return [
        sheet
        for sheet in sheets
        if (is_section or min(sheet.w.shape) > 1)
        and sheet.area >= min(settings.company_area, settings.least_area)
        and strength(sheet) >= min(settings.company_strength, settings.least_strength)
        and vertical_extent(sheet) >= settings.least_height
    ]


def choose_faults(candidates: list[tuple[Sheet, SheetThrow]], settings: ChoiceSettings) -> list[int]:
    """Tell which sheets are faults.

    A sheet stands by itself when it is large and strong. A weaker one is kept where it lies beside a strong fault, does
    not double one, and moves its sides: a fault that others have cut to pieces is found whole. So is one that moves by
    as little as its size has it, among others: throws of faults grow with their lengths [1]_, and small faults come in
    swarms. What was linked from leftovers is judged last, and never stands by itself.

    Parameters
    ----------
    candidates : list of (Sheet, SheetThrow)
        What :func:`may_be_faults` leaves, ended where it ends: see :mod:`seismo3d.seismic.sheet_ends`.
    settings : ChoiceSettings
        Thresholds.

    Returns
    -------
    list of int
        Their numbers, increasing.

    References
    ----------
    .. [1] Y.-S. Kim, D. J. Sanderson, Earth-Science Reviews 68, 317-334, 2005. :doi:`10.1016/j.earscirev.2004.06.003`
    """
    significance = np.array([strength(sheet) for sheet, _ in candidates])
    hosts: list[_Chosen] = []
    kept: dict[int, SheetNodes] = {}
    reaches: dict[int, float] = {}
    leftover = np.array([sheet.leftover for sheet, _ in candidates], bool)
    for n in (int(n) for n in np.lexsort((-significance, leftover))):
        sheet, throw = candidates[n]
        may_stand = not sheet.leftover and _stands(sheet, throw, settings, alone=True)
        if not (may_stand or _may_join(sheet, throw, settings)) or _winds(sheet, settings):
            continue
        nodes = SheetNodes.of(sheet)
        near = [host for host in hosts if nodes.touches(host.nodes, settings.gap)]
        stands = may_stand and (not near or _stands(sheet, throw, settings, alone=False))
        if not near and _is_walled(sheet, throw, settings):
            continue
        if any(_is_upright(sheet, throw, nodes, host, settings) for host in near):
            continue
        is_host = stands and significance[n] >= settings.host_strength
        is_bend = not is_host and any(_is_bend(sheet, host.sheet, settings) for host in near)
        is_small = not stands and not near and _moves_by_little(sheet, throw, settings)
        joins = bool(near) or is_small
        if not is_bend and (stands or (joins and _is_new(sheet, throw, nodes, kept.values(), settings))):
            kept[n] = nodes
            if is_small:
                reaches[n] = float(np.sqrt(sheet.area))
        if is_host:
            hosts.append(_Chosen(sheet, throw, nodes))
    return _beyond_chance(sorted(set(kept) - _find_alone(reaches, kept, settings)), significance, settings)


def _beyond_chance(numbers: list[int], significance: Float64Array, settings: ChoiceSettings) -> list[int]:
    """Leave out the weakest, down to whose strength noise alone would have too large a share of all [1]_.

    References
    ----------
    .. [1] Y. Benjamini, Y. Hochberg, Journal of the Royal Statistical Society B 57(1), 289-300, 1995.
    """
    falling = np.sort(significance[numbers])[::-1]
    by_chance = settings.chance * np.exp((settings.least_strength - falling) / settings.chance_fall)
    enough = np.flatnonzero(by_chance <= settings.chance_share * np.arange(1, len(falling) + 1))
    least = falling[enough[-1]] if len(enough) else np.inf
    return [number for number in numbers if significance[number] >= least]


@dataclass(frozen=True, slots=True, eq=False)
class _Chosen:
    """A fault beside which others are looked at: its sheet, throw and nodes."""

    sheet: Sheet
    throw: SheetThrow
    nodes: SheetNodes


def _is_new(
    sheet: Sheet, throw: SheetThrow, nodes: SheetNodes, kept: Iterable[SheetNodes], settings: ChoiceSettings
) -> bool:
    """Tell whether a sheet does not double those chosen before, or enough of one that is told well does not."""
    taken = np.zeros(len(nodes.points), bool)
    for other in kept:
        taken |= nodes.are_within(other, settings.beside)
    if not sheet.leftover and taken.mean() <= settings.overlap:
        return True
    enough = np.count_nonzero(~taken) * sheet.step >= settings.company_area
    return bool(enough) and (sheet.leftover or _is_told_leftover(sheet, throw, settings))


def _stands(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings, *, alone: bool) -> bool:
    """Tell whether a sheet is a fault by itself, alone or beside a strong one, where it may be that one once more."""
    height = vertical_extent(sheet)
    is_tall = height >= settings.tall
    needs_less = is_tall or (alone and is_well_told(sheet, throw, settings))
    enough = settings.tall_strength if needs_less else settings.least_strength
    return (
        sheet.area >= settings.least_area
        and height >= settings.least_height
        and strength(sheet) >= enough
        and median_throw(throw) >= settings.least_throw
        and (is_tall or strength(sheet) >= settings.sure_strength or _is_clear(sheet, throw, settings))
        and not _is_unlike(sheet, throw, settings)
    )


def is_well_told(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether most of a sheet's sides match well once moved, which neither noise nor an upright bend does."""
    return (
        share_matched(sheet, throw) >= settings.told_matched
        and median_fit(sheet, throw) >= settings.little_fit
        and median_throw(throw) >= settings.company_throw[1]
        and dip_deg(sheet) < settings.leftover_dip_deg
    )


def _is_unlike(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether a sheet's sides match next to nowhere and its support is not so strong that it is one all the same.

    So are the edges of chaotic beds, and what lines up in noise; and faults whose other side lies outside the cube.
    """
    fit = float(throw.fit[sheet.inside].mean())
    return bool(
        fit < settings.unlike_fit
        and fit < settings.in_view_fit * _in_view(sheet, throw, settings)
        and mean_support(sheet) < settings.unlike_score
        and not _is_told_by_little(sheet, throw, settings)
    )


def _in_view(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> float:
    """Return the share of a sheet whose throw leads to a place within the cube; all of it where that is too little."""
    return throw.in_view if throw.in_view * sheet.area >= settings.company_area else 1.0


def _share_matched_in_view(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> float:
    """Return the share whose sides match of that part of a sheet."""
    return min(share_matched(sheet, throw) / _in_view(sheet, throw, settings), 1.0)


def _is_told_by_little(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether the few places of a sheet whose sides match at all match well, and it is no channel's edge.

    A large throw leads out of view from most places of a sheet.
    """
    return dip_deg(sheet) < settings.steep_deg and _matches_on_little(sheet, throw, settings.little_fit, settings)


def _matches_on_little(sheet: Sheet, throw: SheetThrow, least_fit: float, settings: ChoiceSettings) -> bool:
    """Tell whether a sheet's sides match on a little of it at least, and so well there in the median."""
    return share_matched(sheet, throw) >= settings.little_matched and median_fit(sheet, throw) >= least_fit


def _is_clear(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether a low sheet's sides match where it puts them, and its shape is not that of a channel's edge."""
    is_low_edge = dip_deg(sheet) >= settings.steep_deg and vertical_extent(sheet) < settings.steep_height
    return median_fit(sheet, throw) >= settings.low_fit and not is_low_edge


def _winds(sheet: Sheet, settings: ChoiceSettings) -> bool:
    """Tell whether a low sheet winds along its strike, as the edge of a channel does."""
    if vertical_extent(sheet) > settings.winding_extent:
        return False
    rows, columns = np.nonzero(sheet.inside)
    n_nodes = np.bincount(rows)
    there = np.flatnonzero(n_nodes)
    n_nodes = n_nodes[there]
    if len(there) < 3 or np.median(n_nodes) * sheet.step > settings.winding_height:
        return False
    s, z = ((a - a.mean()) / max(a.std(), 1.0) for a in (rows, columns))
    terms = (np.ones_like(s), s, z, s * s, s * z, z * z)
    _, off = fit_terms(terms, sheet.w[rows, columns].astype(np.float64))
    course = ndimage.gaussian_filter1d(np.bincount(rows, off)[there] / n_nodes, _COURSE, mode="nearest")
    slope = np.gradient(course, there.astype(np.float64))
    return bool(np.sqrt(np.average(slope * slope, weights=n_nodes)) >= settings.winding)


def _is_walled(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether layers run on above and below a sheet though its throw, from much of it, leads beyond its ends."""
    return (
        throw.runs_on >= settings.closed
        and strength(sheet) < settings.sure_strength
        and share_out_of_view(sheet, throw.throw) >= settings.closed_out
    )


def _may_join(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether a sheet that does not stand by itself is a fault if it lies beside a strong one."""
    is_told = _is_told_leftover if sheet.leftover else _is_told_company
    return (
        sheet.area >= settings.company_area
        and vertical_extent(sheet) >= settings.least_height
        and length_down_dip(sheet) >= settings.company_length
        and (
            _share_matched_in_view(sheet, throw, settings) >= settings.company_half
            or mean_support(sheet) >= settings.company_score
        )
        and is_told(sheet, throw, settings)
    )


def _moves_by_little(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether most of a sheet's sides match, by a throw that suits a fault of its size, and it is no edge."""
    return (
        not sheet.leftover
        and dip_deg(sheet) < settings.leftover_dip_deg
        and sheet.area >= settings.least_area
        and share_matched(sheet, throw) >= settings.small_matched
        and median_throw(throw) <= settings.small_throw * vertical_extent(sheet)
        and _is_clear(sheet, throw, settings)
    )


def _find_alone(reaches: dict[int, float], kept: dict[int, SheetNodes], settings: ChoiceSettings) -> set[int]:
    """Return those small faults, which are given by number with how far they reach, that belong to no swarm."""
    if not reaches:
        return set()
    numbers = list(kept)
    links = np.zeros((len(numbers), len(numbers)), bool)
    for n, reach in reaches.items():
        links[numbers.index(n)] = [kept[n].touches(other, reach) for other in kept.values()]
    swarm = connected_components(links, directed=False)[1]
    is_few = np.bincount(swarm)[swarm] < settings.swarm
    return {n for n, few in zip(numbers, is_few, strict=True) if few and n in reaches}


def _is_told_company(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell whether a sheet is strong enough, and its sides match and move, as a weaker fault's do."""
    matched, fit, dip = _share_matched_in_view(sheet, throw, settings), median_fit(sheet, throw), dip_deg(sheet)
    steep = int(dip >= settings.steep_deg)
    enough = settings.company_fit[steep]
    least_fit = float(np.interp(matched, settings.company_matched, (settings.company_fit[1], enough)))
    least_throw = float(np.interp(fit, (enough, 1.0), (settings.company_throw[steep], settings.least_throw)))
    return bool(
        strength(sheet) >= settings.company_strength
        and mean_support(sheet) >= np.interp(dip, settings.company_low_deg, settings.company_low_score)
        and median_throw(throw) >= least_throw
        and (
            (matched >= settings.company_matched[0] and fit >= least_fit) or _is_told_by_little(sheet, throw, settings)
        )
    )


def _is_told_leftover(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    """Tell the same as of leftovers: upright edges of channels, and what runs along the layers, are weak ridges too."""
    dip = dip_deg(sheet)
    return (
        strength(sheet) >= settings.leftover_strength
        and median_throw(throw) >= settings.company_throw[1]
        and _matches_on_little(sheet, throw, settings.leftover_fit, settings)
        and dip < settings.leftover_dip_deg
        and (dip >= settings.low_dip_deg or mean_support(sheet) >= settings.leftover_score)
    )


def _is_upright(sheet: Sheet, throw: SheetThrow, nodes: SheetNodes, host: _Chosen, settings: ChoiceSettings) -> bool:
    """Tell whether a sheet is the break at a stronger, less steep fault once more, upright through it."""
    if not _strike_alike(sheet, host.sheet, settings):
        return False
    if dip_deg(sheet) - dip_deg(host.sheet) < settings.upright_deg:
        return False
    distance, nearest = (np.asarray(a) for a in host.nodes.tree.query(nodes.points, distance_upper_bound=settings.gap))
    near = np.isfinite(distance)
    if near.mean() < settings.upright_share:
        return False
    own, its = throw.throw[sheet.inside][near], host.throw.throw[host.sheet.inside][nearest[near]]
    apart = np.abs(own - its)
    known = np.isfinite(apart)
    return bool(
        known.any() and np.median(apart[known]) <= max(1.0, settings.upright_throw * np.median(np.abs(its[known])))
    )


def _is_bend(sheet: Sheet, host: Sheet, settings: ChoiceSettings) -> bool:
    """Tell whether a steep sheet is the bend of layers over a low fault."""
    if not _strike_alike(sheet, host, settings):
        return False
    return dip_deg(sheet) >= settings.steep_deg and dip_deg(host) < settings.low_dip_deg


def _strike_alike(sheet: Sheet, host: Sheet, settings: ChoiceSettings) -> bool:
    return abs(float(sheet.across @ host.across)) > np.cos(np.radians(settings.alike_deg))
