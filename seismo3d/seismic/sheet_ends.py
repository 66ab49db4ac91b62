"""Where a sheet ends: at unbroken ground, at the edges of the data, along the layers, and at their bends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float64Array
from seismo3d.seismic.choosing import ChoiceSettings, is_well_told
from seismo3d.seismic.misfit_settings import NOISES
from seismo3d.seismic.sheet_measures import mean_support, median_throw, strength
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetSides, SheetThrow, every_sample

# samples from the edge of a mute within which a sheet lies beside it, and how far off its sides are read
_BESIDE, _WITHIN = 8, 16
# widths of the Gaussian window, in traces and samples, over which unmoved sides are compared
_WINDOW = (2.0, 6.0)
# share of an unbroken part that lies at its sheet's rim, at least
_AT_RIM = 0.08


def end_where_still(
    sheet: Sheet, throw: SheetThrow, sides: SheetSides, settings: ChoiceSettings, *, noise: float
) -> tuple[Sheet, SheetThrow]:
    """End a sheet where its sides fit unmoved and its support is weak: it has run on into unbroken ground.

    Parameters
    ----------
    sheet, throw : Sheet, SheetThrow
        A sheet and its throw.
    sides : SheetSides
        What was read on its two sides.
    settings : ChoiceSettings
        Thresholds.
    noise : float
        The cube's median misfit ratio.

    Returns
    -------
    Sheet, SheetThrow
        Without those places; specks that are left of it are dropped.
    """
    still = (np.abs(throw.throw) < np.interp(noise, NOISES[:2], settings.still_throw)) & (
        sheet.score < settings.still_score
    )
    still &= throw.fit >= settings.still_fit
    unbroken = _find_unbroken(sheet, throw, sides, settings)
    if not (still.any() or unbroken.any()):
        return sheet, throw
    still = _without_specks(still) | unbroken
    inside = ndimage.binary_opening(sheet.inside & ~still, np.ones((min(3, sheet.w.shape[0]), 3), bool))
    parts, n_parts = ndimage.label(inside, np.ones((3, 3)))
    if n_parts > 1:
        inside &= are_large(parts, settings.company_area / sheet.step)
    return sheet.only(inside), replace(throw, throw=np.where(inside, throw.throw, np.float32(np.nan)))


def _find_unbroken(sheet: Sheet, throw: SheetThrow, sides: SheetSides, settings: ChoiceSettings) -> BoolArray:
    """Mark large parts at a sheet's rim whose sides fit better unmoved than by a throw that was carried on to them."""
    weak = sheet.inside & (sheet.score < settings.unbroken_score)
    if not weak.any():
        return weak
    unmoved = _fit_unmoved(sides)[:, :: sheet.step]
    fits = (unmoved > settings.unbroken_fit) & (unmoved > throw.fit + settings.unbroken_gain)
    parts, _ = ndimage.label(_without_specks(weak & fits) & sheet.inside, np.ones((3, 3)))
    rim = sheet.inside & ~ndimage.binary_erosion(sheet.inside)
    n_at_rim, n = (np.bincount(parts[places], minlength=parts.max() + 1) for places in (rim, sheet.inside))
    return np.asarray(are_large(parts, settings.unbroken_area / sheet.step) & (n_at_rim > _AT_RIM * n)[parts])


def _fit_unmoved(sides: SheetSides) -> Float64Array:
    """Return how well the unmoved sides of a sheet fit in small windows, 1 where they are equal; 0 if not known."""
    known = (sides.known > 0.0).all(axis=0)
    one, other = np.where(known, sides.both, 0.0).astype(np.float64)
    off, energy, told = (
        ndimage.gaussian_filter(a, _WINDOW) for a in ((one - other) ** 2, one**2 + other**2, known.astype(np.float64))
    )
    return np.where((told > 0.5) & (energy > 0.0), 1.0 - off / np.where(energy > 0.0, energy, 1.0), 0.0)


def _without_specks(places: BoolArray) -> BoolArray:
    """Return what most places around each say: a few decide nothing, neither to end a sheet nor to go on with it."""
    return np.asarray(ndimage.median_filter(places, size=(5, 5), mode="nearest"))


def end_in_mutes(sheet: Sheet, sides: SheetSides, shape: tuple[int, ...]) -> Sheet:
    """End a sheet where traces beside it begin and end; gaps in them, and dead traces, it passes.

    Parameters
    ----------
    sheet : Sheet
        A sheet.
    sides : SheetSides
        What was read on its two sides.
    shape : tuple of int
        Inlines, crosslines and samples of the cube.

    Returns
    -------
    Sheet
        Without what lies above the first and below the last data on either side. None of its nodes where it runs along
        a mute that slopes, whose edge breaks all layers as a fault would.
    """
    told = (sides.known > 0.0)[:, :, :: sheet.step]
    begun, still = np.maximum.accumulate(told, axis=2), np.maximum.accumulate(told[..., ::-1], axis=2)[..., ::-1]
    dead: BoolArray = np.asarray(~told.any(axis=(0, 2)))[:, None]
    ended = sheet.only(sheet.inside & ((begun.any(axis=0) & still.any(axis=0)) | dead))
    muted = ended.inside & ~(begun & still).all(axis=0) & ~dead
    # what is read beyond the cube is none of a mute
    points, last = ended.nodes(), np.array(shape) - 1
    told_of = np.all((last < 2 * _WITHIN) | ((points >= _WITHIN) & (points <= last - _WITHIN)), axis=1)
    along = ndimage.maximum_filter1d(muted, 2 * (_BESIDE // sheet.step) + 1, axis=1)[ended.inside][told_of]
    return _nothing_of(sheet) if 2 * along.sum() > along.size else ended


def end_along_layers(sheet: Sheet, throw: SheetThrow, sides: SheetSides, settings: ChoiceSettings) -> Sheet:
    """Leave nothing of a sheet that runs along the layers beside it, or of a weak one that leans over as they do.

    Parameters
    ----------
    sheet, throw : Sheet, SheetThrow
        A sheet and its throw.
    sides : SheetSides
        What was read on its two sides.
    settings : ChoiceSettings
        The angles, and the support of what leans, that are needed.

    Returns
    -------
    Sheet
        The same one, or none of its nodes.
    """
    if sheet.w.shape[1] < 2:
        return sheet
    lean = np.arctan2(1.0, np.gradient(every_sample(sheet), axis=1))
    apart = np.abs(lean - np.arctan(sides.tilts))
    apart = np.minimum(apart, np.pi - apart)
    told = (sides.known > 0.0) & np.isfinite(lean)
    if not told.any():
        return sheet
    angle, dip = np.median(apart[told]), np.median(np.broadcast_to(np.minimum(lean, np.pi - lean), told.shape)[told])
    leans = angle < min(settings.leaning * dip, np.radians(settings.leaning_deg))
    is_thrust = (
        strength(sheet) >= settings.thrust_strength
        and dip <= np.radians(settings.thrust_dip_deg)
        and is_well_told(sheet, throw, settings)
    )
    least = settings.thrust_angle_deg if is_thrust else settings.layer_angle_deg
    is_sure = is_thrust or strength(sheet) >= settings.sure_strength
    is_weak = not is_sure and mean_support(sheet) < settings.leaning_score
    if angle >= np.radians(least) and not (leans and is_weak):
        return sheet
    return _nothing_of(sheet)


def end_at_bends(sheet: Sheet, throw: SheetThrow, sides: SheetSides, settings: ChoiceSettings) -> Sheet:
    """Leave nothing of a sheet across which layers bend rather than break.

    At the hinge of a fold, or at the wall of a column that hangs down, layers dip otherwise on one side than on the
    other. Carried on over a few traces they miss each other by as much as their dips differ over these, and match by a
    throw. A block that a fault has turned moves by the turn over all of its width.

    Parameters
    ----------
    sheet, throw : Sheet, SheetThrow
        A sheet and its throw.
    sides : SheetSides
        What was read on its two sides.
    settings : ChoiceSettings
        The width that is needed.

    Returns
    -------
    Sheet
        The same one, or none of its nodes.
    """
    there = np.isfinite(every_sample(sheet)) & (sides.known > 0.0).all(axis=0)
    if not there.any():
        return sheet
    turned = abs(float(np.median((sides.tilts[1] - sides.tilts[0])[there])))
    if median_throw(throw) >= settings.bend * turned:
        return sheet
    return _nothing_of(sheet)


def _nothing_of(sheet: Sheet) -> Sheet:
    """Return a sheet without any of its nodes."""
    return sheet.only(np.zeros(sheet.w.shape, bool))


def are_large(parts: AnyArray, least: float) -> BoolArray:
    """Mark what belongs to a part of at least so many places; parts are numbered from 1, as ``label`` does."""
    large = np.bincount(parts.ravel()) >= least
    large[0] = False
    return np.asarray(large[parts])
