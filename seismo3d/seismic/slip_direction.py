"""Direction of slip on a fault: what has slid along strike, told by the slopes of the layers that it cuts."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.seismic.slip_fields import Sides, SlipField, SlipSettings, match_about_field, refine_slip

# shares of strike slip that are tried, and how far aside certainty is measured
_SHARES = np.linspace(-1.0, 1.0, 21)
_ASIDE = 0.3
# leeway of the throws that are read, and width of the window in which layers' slopes are
_LEEWAY, _WIDTH = 4.0, 4.0
# every so many places are read, and fewer matched ones than this tell nothing
_EVERY, _LEAST_PLACES = 2, 80


def refine_free_slip(
    sides: Sides,
    throw: Float32Array,
    fit: Float32Array,
    inside: BoolArray,
    *,
    thin: int,
    settings: SlipSettings,
    share: float | None = None,
) -> SlipField:
    r"""Refine a throw, and find the slip along strike that goes with it.

    Where the hanging wall has moved by a share :math:`s` of its throw :math:`t` along strike, over layers that slope by
    :math:`m` along the fault, it seems to have come down by :math:`t (1 - s m)`. So what is seen straight down the dip
    wavers with the slopes of the layers, while throws themselves change smoothly: a quadratic :math:`t` and one
    :math:`s` are fitted to it, robustly. The share is believed where it explains much of what a quadratic alone leaves;
    the throw is then refined along it, and the share once more.

    Parameters
    ----------
    sides, throw, fit, inside, thin, settings
        As for :func:`~seismo3d.seismic.slip_fields.refine_slip`.
    share : float, optional
        Strike slip over throw, where that is known: throws alone are refined then.

    Returns
    -------
    SlipField
        With ``share`` 0 where slip down the dip alone explains what is seen as well, and the one given where it is
        known.
    """
    straight = refine_slip(sides, throw, fit, inside, thin=thin, settings=settings)
    if inside.shape[0] < 8 and share is None:
        return straight
    slopes = _layer_slopes(sides)

    def turn(share: float) -> SlipField:
        field = straight.throw / (1.0 - share * _at_counterparts(slopes, straight, thin))
        known = np.where(np.isfinite(straight.misfit), np.maximum(1.0 - straight.misfit, 0.0), 0.0)
        return refine_slip(
            sides, field.astype(np.float32), known.astype(np.float32), inside, thin=thin, settings=settings, share=share
        )

    if share is not None:
        return turn(share)
    found, gain, certainty = _find_share(sides, straight, slopes, inside, thin, settings)
    is_told = (
        abs(found) >= settings.least_share
        and gain >= settings.least_gain
        and certainty >= settings.least_certainty
        and _is_seen(found, straight, slopes, inside, thin, settings)
    )
    if not is_told:
        return SlipField(straight.throw, straight.misfit, 0.0, certainty)
    for _ in range(2):
        oblique = turn(found)
        more, _, certainty = _find_share(sides, oblique, slopes, inside, thin, settings)
        found = float(np.clip(found + more, -1.0, 1.0))
    return SlipField(oblique.throw, oblique.misfit, found, certainty)


def _is_seen(
    share: float, straight: SlipField, slopes: Float64Array, inside: BoolArray, thin: int, settings: SlipSettings
) -> bool:
    """Tell whether sides that match well waver by enough for the slip along strike that makes them to be seen."""
    seen = inside & np.isfinite(straight.misfit)
    wavering = abs(share) * float(np.std((straight.throw * _at_counterparts(slopes, straight, thin))[seen]))
    return wavering >= settings.least_wavering and float(np.median(straight.misfit[seen])) <= settings.most_misfit


def _layer_slopes(sides: Sides) -> Float64Array:
    """Slopes of the footwall's layers along the surface, in samples a row, smoothed over a window."""
    along, down = np.gradient(sides.foot.astype(np.float64))
    both = ndimage.gaussian_filter(along * down * sides.in_foot, _WIDTH)
    energy = ndimage.gaussian_filter(down * down * sides.in_foot, _WIDTH)
    return np.asarray(-both / (energy + 1e-3 * energy.mean() + 1e-12), np.float64)


def _at_counterparts(slopes: Float64Array, slip: SlipField, thin: int) -> Float64Array:
    """Slopes at the places of the footwall that those of the hanging wall came from."""
    rows, columns = np.indices(slip.throw.shape) * float(thin)
    at = np.stack([rows - slip.share * slip.throw, columns - slip.throw])
    return np.clip(ndimage.map_coordinates(slopes, at, order=1, mode="nearest"), -0.9, 0.9)


def _find_share(
    sides: Sides, slip: SlipField, slopes: Float64Array, inside: BoolArray, thin: int, settings: SlipSettings
) -> tuple[float, float, float]:
    """Return the strike slip over throw, beyond that of the field, that the throws about a field ask for.

    Also by how much of itself it lowers what a quadratic throw leaves over, and how much of what is left over a share
    aside leaves it is gone. All zero where the best lies at the end of those tried: such throws tell of no share.
    """
    shift, weight = match_about_field(sides, slip, inside, thin, _LEEWAY, settings)
    taken = np.zeros_like(inside)
    taken[::_EVERY, ::_EVERY] = weight[::_EVERY, ::_EVERY] > 0
    if int(taken.sum()) < _LEAST_PLACES:
        return 0.0, 0.0, 0.0
    slope = _at_counterparts(slopes, slip, thin)[taken]
    terms = _quadratic(taken)
    throw, counts = (slip.throw + shift)[taken].astype(np.float64), weight[taken].astype(np.float64)
    left = _left_over(throw, counts, terms, 1.0 - _SHARES[:, None] * slope)
    best = int(left.argmin())
    if best in (0, len(left) - 1):
        return 0.0, 0.0, 0.0
    share, least = float(_SHARES[best]), float(left[best])
    before, after = left[best - 1] - least, left[best + 1] - least
    if before + after > 1e-12:
        share += float(0.5 * (before - after) / (before + after)) * float(_SHARES[1] - _SHARES[0])
    aside = float(np.interp([share - _ASIDE, share + _ASIDE], _SHARES, left).min())
    straight = float(left[len(left) // 2])
    return share, 1.0 - least / max(straight, 1e-12), float(np.clip(1.0 - least / max(aside, 1e-12), 0.0, 1.0))


def _quadratic(taken: BoolArray) -> Float64Array:
    """Terms of a quadratic over the places taken, centred and scaled."""
    a, b = (values / max(float(values.std()), 1.0) for values in (p - p.mean() for p in np.nonzero(taken)))
    return np.column_stack([np.ones_like(a), a, b, a * a, a * b, b * b])


def _left_over(values: Float64Array, weights: Float64Array, terms: Float64Array, scales: Float64Array) -> Float64Array:
    """Mean robust square, at most one, of what a combination of terms leaves of the values, for each row of scales.

    A row's terms are the terms times its scales, place by place.
    """
    n_terms = terms.shape[1]
    products = (terms[:, :, None] * terms[:, None, :]).reshape(len(terms), -1)
    robust, error = np.broadcast_to(weights, scales.shape), values
    for _ in range(3):
        normal = ((robust * scales**2) @ products).reshape(-1, n_terms, n_terms)
        normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(n_terms)
        found = np.linalg.solve(normal, ((robust * scales * values) @ terms)[:, :, None])[:, :, 0]
        error = values - scales * (found @ terms.T)
        robust = weights / (1.0 + error**2) ** 2
    return np.asarray((weights * error**2 / (1.0 + error**2)).sum(axis=1) / weights.sum())
