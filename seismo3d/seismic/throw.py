"""Throws: how far the hanging wall has come down along a fault, at every place of its surface."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
from scipy import ndimage

from seismo3d._settings import Amount, Smoothing, Steps, StepsOrNone, Width
from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_throw import mark_beside, read_sides
from seismo3d.seismic.dip import DipSettings, estimate_slopes
from seismo3d.seismic.fault_motion import enlarge, fill_nearest
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.slip_direction import refine_free_slip
from seismo3d.seismic.slip_fields import MISMATCH, Sides, SlipField, SlipSettings, refine_slip
from seismo3d.seismic.throw_bells import carry_on
from seismo3d.seismic.throw_matching import match_throws

# a throw read closer is refined from the one before so many times: what drag has bent comes out some samples beside it
_REFINEMENTS = 2


@dataclass(frozen=True, slots=True)
class ThrowSettings:
    """How the sides are matched; lengths in traces and samples.

    Attributes
    ----------
    near, far : int in [1, 100], [near, 100]
        Traces off a steep surface between which each side is averaged.
    clearance : float in [0, 1000]
        Samples, down the trace, from the surface to these traces where throws are looked for: beside a surface that
        dips gently they are taken farther off, as the wavelet mixes what lies above it with what lies below.
    close : float in [0, 1000]
        The same where throws that were found are refined: layers carried on over fewer traces are surer.
    farthest : int in [0, 100]
        By at most so many traces are they taken farther off.
    clear : int in [1, 100]
        Traces still farther off at which their slopes are read.
    beside : int in [0, 100]
        Traces beside a surface that are left out where these slopes are estimated.
    usual : int in [1, 1000]
        A throw larger than that must match clearly better than any smaller one.
    longest : int in [1, 1000]
        Largest throw looked for, either way; one that is carried on to where nothing matches may be larger.
    thin : int in [1, 100]
        Throws are found at every so many traces and samples, and interpolated.
    along_strike, down : float in (0, 1000]
        Widths of the Gaussian window over which the sides are compared.
    unmatched : float in [0, inf)
        Misfit ratio that a throw is given where its other side lies outside the surface.
    step, jump : float in [0, inf)
        Cost, as a misfit ratio, of a throw that changes by a sample from a place to the next, and by more.
    slip
        How throws are refined and the direction of slip is found.
    """

    near: Steps = 2
    far: Annotated[int, "[near, 100]"] = 4
    clearance: Smoothing = 8.0
    close: Smoothing = 5.0
    farthest: StepsOrNone = 11
    clear: Steps = 3
    beside: StepsOrNone = 1
    usual: Annotated[int, "[1, 1000]"] = 48
    longest: Annotated[int, "[1, 1000]"] = 96
    thin: Steps = 2
    along_strike: Width = 3.0
    down: Width = 4.0
    unmatched: Amount = 0.4
    step: Amount = 0.3
    jump: Amount = 16.0
    slip: SlipSettings = field(default_factory=SlipSettings)


class SheetSides(NamedTuple):
    """Both sides of a sheet, read along it, one value a sample; the first lies against the sheet's ``across``.

    Attributes
    ----------
    both : ndarray of shape (2, row, sample), float32
        Amplitudes.
    known : ndarray of the same shape, float32
        1 where there are any, else 0.
    tilts : ndarray of the same shape, float32
        How much deeper the layers beside the sheet lie a trace farther along ``across``, in samples.
    """

    both: Float32Array
    known: Float32Array
    tilts: Float32Array


@dataclass(frozen=True, slots=True, eq=False)
class SheetThrow:
    """Throw of one sheet on its grid.

    Attributes
    ----------
    throw : ndarray of the sheet's shape, float32
        Samples, positive where the hanging wall is down; NaN outside the sheet and where a side has no data.
    fit : ndarray of the same shape, float32
        1 where the hanging wall equals the footwall that it came from, 0 where they are unrelated, and where the throw
        is carried on from matched places around it.
    hanging_side : int
        1 where the hanging wall lies along the sheet's `across`, else -1.
    strike_share : float
        Motion of the hanging wall along the sheet's `along`, in traces, for each sample of throw.
    slip_certainty : float
        How sharply that is told, 0 to 1.
    family : int
        Number of the fault that the sheet is a part of; -1 where that is not told.
    generation : int
        Length of the longest chain of faults that moved one after the other, all of them later.
    runs_on : float
        How alike, 1 at most, the layers on both sides are, unmoved, above its upper end and below its lower one: the
        lesser; 0 where that is not told.
    in_view : float
        Share of its places whose throw leads to one within the cube: no more of it can match.
    lift : float
        Share of the slip that the hanging wall took, where it is told that both walls moved: throw is then that of each
        place, not how far it lies from its counterpart.
    """

    throw: Float32Array
    fit: Float32Array
    hanging_side: int
    strike_share: float = 0.0
    slip_certainty: float = 0.0
    family: int = -1
    generation: int = 0
    runs_on: float = 0.0
    in_view: float = 1.0
    lift: float = 1.0


def gather_sides(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    sheet: Sheet,
    *,
    settings: ThrowSettings,
    w: Float32Array | None = None,
    off: int | None = None,
    corner: tuple[int, int] = (0, 0),
) -> SheetSides:
    """Read both sides of a sheet, one value a sample, where its position `w` at every sample is known.

    They are read `off` traces farther off than `near` and `far`: of a part of a sheet, as the whole asks for. The
    volumes may be a block of the cube that begins at a corner.
    """
    w = every_sample(sheet) if w is None else w
    off = farther_off(sheet, settings) if off is None else off
    sides, known, tilts = (np.zeros((2, *w.shape), np.float32) for _ in range(3))
    read_sides(
        volume, valid, *slopes, w, sheet.origin, sheet.along, sheet.across, sheet.first_s, sheet.first_sample,
        settings.near + off, settings.far + off, settings.clear, corner, sides, known, tilts,
    )  # fmt: skip
    return SheetSides(sides, known, tilts)


def gather_closer(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    sheet: Sheet,
    *,
    settings: ThrowSettings,
) -> SheetSides:
    """Do what :func:`gather_sides` does, close to the sheet, for a throw that was found to be refined."""
    off = farther_off(sheet, settings, close=True)
    return gather_sides(volume, valid, slopes, sheet, settings=settings, off=off)


def side_reach(settings: ThrowSettings) -> int:
    """Return how many traces off a sheet its sides are read at most."""
    return settings.far + settings.farthest + settings.clear + 2


def farther_off(sheet: Sheet, settings: ThrowSettings, *, close: bool = False) -> int:
    """Return how many traces farther off than `near` and `far` the sides of a sheet are read, for its dip's sake.

    Where its throw is looked for, or, if `close`, where it is refined.
    """
    steps = np.abs(np.diff(sheet.w.astype(np.float64), axis=1)) / sheet.step
    steps = steps[np.isfinite(steps)]
    if not steps.size:
        return 0
    clearance = settings.close if close else settings.clearance
    wanted = clearance * float(np.median(steps)) - 0.5 * (settings.near + settings.far)
    return int(np.clip(np.rint(wanted), 0, settings.farthest))


def mask_sheets(sheets: list[Sheet], valid: BoolArray, *, beside: int, corner: tuple[int, int] = (0, 0)) -> BoolArray:
    """Return where there are data more than `beside` traces from all sheets but leftovers, in a block from a corner."""
    clear = valid.copy()
    for sheet in (sheet for sheet in sheets if not sheet.leftover):
        mark_beside(every_sample(sheet), sheet.origin, sheet.along, sheet.across, sheet.first_s, sheet.first_sample,
                    beside, corner, clear)  # fmt: skip
    return clear


def slopes_beside(
    volume: Float32Array, valid: BoolArray, sheets: list[Sheet], *, dip: DipSettings, settings: ThrowSettings
) -> tuple[Float32Array, Float32Array]:
    """Estimate slopes of the layers without what lies on the sheets: a break there is a slope of no layer."""
    return estimate_slopes(volume, mask_sheets(sheets, valid, beside=settings.beside), settings=dip)


def match_sides(sheet: Sheet, both: Float32Array, known: Float32Array, *, settings: ThrowSettings) -> SheetThrow:
    """Find where on the footwall each place of the hanging wall came from.

    Each side was read along the surface, a few traces off and carried to it along its dips. The throw at a place is how
    far the hanging wall there lies below its counterpart in the footwall today. For every throw the squared difference
    of the two is averaged over a small window and divided by their energy. The trend over the whole surface that costs
    least, a quadratic or a bell, tells repeated reflectors apart; then the cheapest paths along rows and columns are
    added up (semi-global matching [1]_) near the trend, which is fitted anew to what matched. Where the counterpart
    lies outside the surface, as it does below the top of the cube, the throw is that of the bell through what matches.

    Parameters
    ----------
    sheet : Sheet
        The fault.
    both, known : ndarray of shape (2, row, sample), float32
        Its two sides, as :func:`gather_sides` gives them.
    settings : ThrowSettings
        Windows and limits.

    Returns
    -------
    SheetThrow

    References
    ----------
    .. [1] H. Hirschmueller, IEEE TPAMI 30(2), 328-341, 2008. :doi:`10.1109/TPAMI.2007.1166`
    """
    w = every_sample(sheet)
    is_line = sheet.w.shape[1] == 1  # no way down it, so it leans to neither side and nothing can be matched
    hanging_side = 1 if is_line or np.nanmean(np.gradient(sheet.w, axis=1)) >= 0 else -1
    sides = facing(both, known, hanging_side)
    if is_line or not (sides.in_hanging.any() and sides.in_foot.any()):
        return SheetThrow(np.full(sheet.w.shape, np.nan, np.float32), np.zeros_like(sheet.w), hanging_side)
    slip = find_slip(sides, np.isfinite(w), settings=settings)
    throw, fit = _on_nodes(sheet, slip, settings.thin)
    return SheetThrow(throw, fit, hanging_side, slip.share, slip.certainty)


def refine_throw(sheet: Sheet, throw: SheetThrow, sides: SheetSides, *, settings: ThrowSettings) -> SheetThrow:
    """Refine the throw of a sheet, by its two sides as they are closer to it than where the throw was found.

    Carried to a gently dipping fault from where the wavelet does not mix its sides, layers that drag has bent come out
    beside their place: their slopes change on the way, and those right beside the fault are the least sure. Closer to
    it that matters less. But what the wavelet has mixed is alike on both sides, and matches best without a throw: so
    throws are not looked for there.

    Parameters
    ----------
    sheet : Sheet
        The fault.
    throw : SheetThrow
        Its throw.
    sides : SheetSides
        Its two sides, read closer.
    settings : ThrowSettings
        Windows and limits.

    Returns
    -------
    SheetThrow
        With other throws and fits.
    """
    if not np.isfinite(throw.throw).any():
        return throw
    thin, places = settings.thin, np.isfinite(every_sample(sheet))[:: settings.thin, :: settings.thin]
    thrown, fit = (at_every(values, sheet, thin) for values in (throw.throw, throw.fit))
    beside = facing(sides.both, sides.known, throw.hanging_side)
    for _ in range(_REFINEMENTS):
        slip = refine_slip(beside, thrown, fit, places, thin=thin, settings=settings.slip, share=throw.strike_share)
        thrown, fit = slip.throw, fit_of(slip)
    thrown, fit = _on_nodes(sheet, _within_range(slip, places, settings), thin)
    return replace(throw, throw=np.where(np.isfinite(throw.throw), thrown, np.float32(np.nan)), fit=fit)


def facing(both: Float32Array, known: Float32Array, hanging_side: int) -> Sides:
    """Return the two sides of a sheet, and where they are known, as hanging wall and footwall."""
    up = 1 if hanging_side > 0 else 0
    return Sides(both[up], both[1 - up], known[up], known[1 - up])


def _on_nodes(sheet: Sheet, slip: SlipField, thin: int) -> tuple[Float32Array, Float32Array]:
    """Return throw, NaN off the sheet, and fit at the nodes of a sheet from those at every `thin`-th place."""
    columns = np.arange(sheet.w.shape[1]) * sheet.step
    throw, fit = (enlarge(part, _sizes(sheet), thin)[:, columns] for part in (slip.throw, fit_of(slip)))
    throw[~sheet.inside] = np.nan
    return throw, fit


def at_every(values: Float32Array, sheet: Sheet, every: int) -> Float32Array:
    """Return what is told at the nodes of a sheet at every so many rows and samples; off the nodes the nearest."""
    rows, samples = (np.arange(0, size, every, dtype=np.float64) for size in _sizes(sheet))
    at = np.stack(np.meshgrid(rows, samples / sheet.step, indexing="ij"))
    return ndimage.map_coordinates(fill_nearest(values), at, order=1).astype(np.float32)


def find_slip(
    sides: Sides,
    inside: BoolArray,
    *,
    settings: ThrowSettings,
    about: float | None = None,
    share: float | None = None,
) -> SlipField:
    """Match two sides read along a surface: throw, slip along strike and misfit at every `thin`-th place.

    `about` is the throw that is expected, if any is; `share` the strike slip over throw, if that is known.
    """
    rough, thin = match_throws(sides, inside, about=about, settings=settings), settings.thin
    inside = inside[::thin, ::thin]
    slip = refine_free_slip(sides, *rough, inside, thin=thin, settings=settings.slip, share=share)
    return _within_range(slip, inside, settings)


def _within_range(slip: SlipField, inside: BoolArray, settings: ThrowSettings) -> SlipField:
    """Return a slip whose throws are no longer than those looked for, carried on to where nothing matches."""
    found = np.clip(slip.throw, -settings.longest, settings.longest)
    return carry_on_slip(replace(slip, throw=found), inside)


def carry_on_slip(slip: SlipField, inside: BoolArray) -> SlipField:
    """Carry the throw of a slip on to where nothing matches, from the places inside a surface where something does."""
    return replace(slip, throw=carry_on(slip.throw, np.where(inside, fit_of(slip), np.float32(0.0))))


def fit_of(slip: SlipField) -> Float32Array:
    """Return 1 where the sides are equal, 0 where they do not match and throw is carried on."""
    return np.where(slip.misfit < MISMATCH, 1.0 - slip.misfit, 0.0).astype(np.float32)


def _sizes(sheet: Sheet) -> tuple[int, int]:
    """Return the rows and samples of a sheet where its position is known at every sample."""
    n_rows, n_columns = sheet.w.shape
    return n_rows, (n_columns - 1) * sheet.step + 1


def every_sample(sheet: Sheet) -> Float32Array:
    """Return the sheet's position at every sample in place of every step-th."""
    n_columns = sheet.w.shape[1]
    if n_columns == 1:
        return sheet.w.copy()
    at = np.arange(_sizes(sheet)[1]) / sheet.step
    low = np.minimum(at.astype(np.int64), n_columns - 2)
    share = (at - low).astype(np.float32)
    between = sheet.w[:, low] * (1 - share) + sheet.w[:, low + 1] * share
    return np.where(np.isfinite(between), between, sheet.w[:, np.rint(at).astype(np.int64)]).astype(np.float32)
