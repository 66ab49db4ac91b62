"""A scarp worn by diffusion: the step of an error function on a slope that both sides share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from seismo3d._typing import Float64Array

_WIDTHS = 32
"""Widths that are tried, evenly spread in their logarithm; then a quarter as many beside the best, twice."""
_MIDDLES = 9
_LEAST_SIDE = 3
"""Places on each side of a step that its height needs."""


@dataclass(frozen=True, slots=True)
class WornStep:
    r"""The step :math:`c + b x + \frac{h}{2} \operatorname{erf}((x - x_0) / w)` of a profile.

    A vertical step that soil's creep wears down keeps its height :math:`h` far from it, and has
    :math:`w = 2 \sqrt{\kappa t}` after a time :math:`t` [1]_, [2]_.

    Attributes
    ----------
    height : float
        :math:`h`, positive where the profile steps up.
    slope : float
        :math:`b`, common to both sides.
    middle : float
        :math:`x_0`.
    width : float
        :math:`w`; its square over four is the diffusivity times the age.
    misfit : float
        Root mean square of what the step leaves, over that of what a plane slope alone leaves.

    References
    ----------
    .. [1] T. C. Hanks et al., J. Geophys. Res. 89(B7), 5771-5790, 1984. :doi:`10.1029/JB089iB07p05771`
    .. [2] D. J. Andrews and T. C. Hanks, J. Geophys. Res. 90(B12), 10193-10203, 1985. :doi:`10.1029/JB090iB12p10193`
    """

    height: float
    slope: float
    middle: float
    width: float
    misfit: float

    def form(self, offset: Float64Array) -> Float64Array:
        """Return the step of height one."""
        return np.asarray(0.5 * erf((offset - self.middle) / self.width))


def fit_worn_step(offset: Float64Array, profile: Float64Array, *, aside: float) -> WornStep:
    """Fit a worn step to a profile by least squares: height and slope exactly, middle and width by trial.

    Parameters
    ----------
    offset, profile : ndarray of shape (n,), float64
        Distance across, evenly spaced, and elevation; no NaN.
    aside : float
        Farthest that the middle may lie from offset 0.
    """
    step, reach = float(offset[1] - offset[0]), float(np.abs(offset).max())
    widths = np.geomspace(0.5 * step, 2.0 * reach, _WIDTHS)
    middles = np.linspace(-aside, aside, _MIDDLES)
    for _ in range(3):
        loss = np.array([[_loss(offset, profile, middle, width) for width in widths] for middle in middles])
        m, w = divmod(int(loss.argmin()), len(widths))
        best = float(middles[m]), float(widths[w])
        gap = middles[1] - middles[0]
        middles = np.clip(np.linspace(best[0] - gap, best[0] + gap, _MIDDLES), -aside, aside)
        widths = np.geomspace(widths[max(w - 1, 0)], widths[min(w + 1, len(widths) - 1)], _WIDTHS // 4)
    form = 0.5 * erf((offset - best[0]) / best[1])
    slope, height, left = fit_form(offset, profile, form)
    plain = profile - np.polyval(np.polyfit(offset, profile, 1), offset)
    return WornStep(height, slope, *best, left / max(float(np.sqrt((plain**2).mean())), 1e-12))


def fit_form(offset: Float64Array, profile: Float64Array, form: Float64Array) -> tuple[float, float, float]:
    """Return slope, height and root mean square residual of a step of known form; NaN where too little is known.

    Parameters
    ----------
    offset, profile : ndarray of shape (n,), float64
        NaN where not known.
    form : ndarray of shape (n,), float64
        From -0.5 to 0.5; NaN where it is not to be used.
    """
    known = np.isfinite(profile) & np.isfinite(form)
    below, above = known & (form < -0.25), known & (form > 0.25)
    if min(below.sum(), above.sum()) < _LEAST_SIDE:
        return float("nan"), float("nan"), float("nan")
    x, z, f = offset[known], profile[known], form[known]
    design = np.column_stack([np.ones(len(x)), x, f])
    solution = np.linalg.lstsq(design, z, rcond=None)[0]
    return float(solution[1]), float(solution[2]), float(np.sqrt(((z - design @ solution) ** 2).mean()))


def _loss(offset: Float64Array, profile: Float64Array, middle: float, width: float) -> float:
    left = fit_form(offset, profile, 0.5 * erf((offset - middle) / width))[2]
    return left if np.isfinite(left) else float("inf")
