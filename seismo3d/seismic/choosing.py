"""Which sheets are faults: those strong enough by themselves, and weaker ones that move beside such a sheet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.seismic.linking import Sheet
from seismo3d.seismic.throw import SheetThrow


@dataclass(frozen=True, slots=True)
class ChoiceSettings:
    """How large and strong a sheet must be to be a fault; lengths in traces and samples.

    Attributes
    ----------
    least_area : float
        Smallest area, in traces times samples.
    least_strength : float
        Significance that is needed: mean support times the square root of the area.
    least_height : float
        Smallest extent down the samples.
    least_throw : float
        Smallest median throw: sides that fit best unmoved, as at a channel's edge, are no fault.
    still_score : float
        Support below which a sheet ends where its throw falls below `least_throw`.
    tall, tall_strength : float
        Height from which on a sheet is no channel's edge, and the strength that is enough there.
    host_strength : float
        Strength of a fault beside which weaker ones are looked for: faults come in families, and cut each other up.
    company_area, company_strength, company_height, company_throw : float
        Smallest area, strength, height and median throw of such a weaker one.
    company_matched, company_fit : float
        Smallest share of it where its moved sides match, and their median fit there.
    gap : float
        Farthest that it may be from its host.
    overlap, beside : float
        Largest share of it that may lie within `beside` of faults chosen before: more is the same fault once more.
    """

    least_area: float = 400.0
    least_strength: float = 38.0
    least_height: float = 24.0
    least_throw: float = 1.0
    still_score: float = 1.0
    tall: float = 60.0
    tall_strength: float = 28.0
    host_strength: float = 55.0
    company_area: float = 200.0
    company_strength: float = 18.0
    company_height: float = 30.0
    company_throw: float = 1.4
    company_matched: float = 0.3
    company_fit: float = 0.75
    gap: float = 8.0
    overlap: float = 0.3
    beside: float = 2.5

    @classmethod
    def for_section(cls) -> ChoiceSettings:
        """Return the settings of a section, where sizes are lengths of lines; a line stands by itself or not at all."""
        return cls(
            least_area=24.0,
            least_strength=5.5,
            least_throw=0.5,
            still_score=0.0,
            tall_strength=5.5,
            host_strength=np.inf,
            company_strength=5.5,
            company_area=24.0,
        )


def strength(sheet: Sheet) -> float:
    """Return a sheet's significance: its mean support times the square root of its area."""
    return float(np.nanmean(sheet.score) * np.sqrt(sheet.area)) if sheet.inside.any() else 0.0


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
        and _height(sheet) >= min(settings.company_height, settings.least_height)
    ]


def end_where_still(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> tuple[Sheet, SheetThrow]:
    """End a sheet where its sides fit unmoved and its support is weak: it has run on into unbroken ground.

    Parameters
    ----------
    sheet, throw : Sheet, SheetThrow
        A sheet and its throw.
    settings : ChoiceSettings
        Thresholds.

    Returns
    -------
    Sheet, SheetThrow
        Without those places; specks that are left of it are dropped.
    """
    still = (np.abs(throw.throw) < settings.least_throw) & (sheet.score < settings.still_score)
    if not still.any():
        return sheet, throw
    # a few places decide nothing, neither to end a sheet nor to go on with it
    still = ndimage.median_filter(still, size=(5, 5), mode="nearest")
    inside = ndimage.binary_opening(sheet.inside & ~still, np.ones((min(3, sheet.w.shape[0]), 3), bool))
    parts, n_parts = ndimage.label(inside, np.ones((3, 3)))
    if n_parts > 1:
        sizes = np.bincount(parts.ravel())[1:]
        inside &= np.isin(parts, 1 + np.flatnonzero(sizes * sheet.step >= settings.company_area))
    empty = np.float32(np.nan)
    return (
        replace(sheet, w=np.where(inside, sheet.w, empty), score=np.where(inside, sheet.score, empty)),
        replace(throw, throw=np.where(inside, throw.throw, empty)),
    )


def choose_faults(
    candidates: list[tuple[Sheet, SheetThrow]], settings: ChoiceSettings
) -> list[tuple[Sheet, SheetThrow]]:
    """Keep the sheets that are faults, with their throws, in their order.

    A sheet stands by itself when it is large and strong. A weaker one is kept where it lies beside a strong fault, does
    not double one, and moves its sides: a fault that others have cut to pieces is found whole.

    Parameters
    ----------
    candidates : list of (Sheet, SheetThrow)
        From :func:`may_be_faults` and :func:`end_where_still`.
    settings : ChoiceSettings
        Thresholds.

    Returns
    -------
    list of (Sheet, SheetThrow)
    """
    significance = np.array([strength(sheet) for sheet, _ in candidates])
    keep = np.array([_stands(*candidate, settings) for candidate in candidates], bool)
    order = [int(n) for n in np.argsort(-significance, kind="stable")]
    weaker = [n for n in order if not keep[n] and _may_join(*candidates[n], settings)]
    trees = {n: cKDTree(_nodes(candidates[n][0])) for n in order if keep[n]} if weaker else {}
    hosts = [n for n in trees if significance[n] >= settings.host_strength]
    for n in weaker:
        nodes = _nodes(candidates[n][0])
        if not any(_within(trees[host], nodes, settings.gap).any() for host in hosts):
            continue
        taken = np.zeros(len(nodes), bool)
        for tree in trees.values():
            taken |= _within(tree, nodes, settings.beside)
        if taken.mean() <= settings.overlap:
            keep[n] = True
            trees[n] = cKDTree(nodes)
    return [candidates[n] for n in np.flatnonzero(keep)]


def _stands(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    height = _height(sheet)
    enough = settings.tall_strength if height >= settings.tall else settings.least_strength
    return (
        sheet.area >= settings.least_area
        and height >= settings.least_height
        and strength(sheet) >= enough
        and median_throw(throw) >= settings.least_throw
    )


def _may_join(sheet: Sheet, throw: SheetThrow, settings: ChoiceSettings) -> bool:
    fit = throw.fit[sheet.inside]
    matched = fit > 0.0
    return (
        sheet.area >= settings.company_area
        and _height(sheet) >= settings.company_height
        and strength(sheet) >= settings.company_strength
        and median_throw(throw) >= settings.company_throw
        and float(matched.mean()) >= settings.company_matched
        and float(np.median(fit[matched])) >= settings.company_fit
    )


def median_throw(throw: SheetThrow) -> float:
    """Return the median size of the throw; 0 where no side has data."""
    known = np.abs(throw.throw[np.isfinite(throw.throw)])
    return float(np.median(known)) if known.size else 0.0


def _height(sheet: Sheet) -> float:
    columns = np.flatnonzero(sheet.inside.any(axis=0))
    return float(np.ptp(columns)) * sheet.step if len(columns) else 0.0


def _nodes(sheet: Sheet) -> Float64Array:
    rows, columns = np.nonzero(sheet.inside)
    return sheet.points(rows.astype(np.float64), columns.astype(np.float64), sheet.w[rows, columns].astype(np.float64))


def _within(tree: cKDTree, nodes: Float64Array, distance: float) -> BoolArray:
    return np.asarray(tree.query(nodes, distance_upper_bound=distance)[0] < np.inf)
