"""Scores of a section's crests: whether a move of their sides explains the break, and how long a line they lie on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._settings import Count, Positive, Share, Smoothing, Steps, Threshold, Width
from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic._kernels_filters import gaussian_taps
from seismo3d.seismic._kernels_moves import explained_shares
from seismo3d.seismic.linking import link_sheets
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheet_measures import strength
from seismo3d.seismic.sheets import Sheet, SheetSettings


@dataclass(frozen=True, slots=True)
class SectionScoreSettings:
    """How the crests of a section are judged; lengths in traces and samples.

    Attributes
    ----------
    farther : float in [0, 1]
        Share of the evidence along slopes that is measured over one trace more a side.
    near, far : int in [1, 100], [near, 100]
        Traces off a crest between which each side is averaged.
    clear : int in [1, 100]
        Traces off it at which slopes are read.
    along : float in (0, 1000]
        Width of the Gaussian window along the crest over which the sides are compared.
    farthest : int in [1, 100]
        Largest move looked for, either way.
    doubt : float in [0, 1]
        Share of its score that a crest loses where no move explains the break: a trace of more noise, or of another
        gain, matches its neighbours no better for being moved.
    least_score : float in [0, inf]
        Support below which crests are linked into no line.
    least_points : int in [1, 1000000]
        Lines of fewer points are none.
    beside : float in [0, 1000]
        Distance from a line within which crests lie on it.
    usual_strength : float in (0, inf)
        Significance of a line that leaves the likelihood of its crests as their own scores say if these are 1.
    spread : float in (0, inf)
        Standard deviation of a line's place, in traces: no neighbours along the strike help to fix it.
    """

    farther: Share = 0.3
    near: Steps = 1
    far: Annotated[int, "[near, 100]"] = 3
    clear: Steps = 3
    along: Width = 5.0
    farthest: Steps = 12
    doubt: Share = 0.75
    least_score: Threshold = 0.15
    least_points: Count = 6
    beside: Smoothing = 1.6
    usual_strength: Positive = 7.0
    spread: Positive = 1.5


def weigh_crests(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    ridges: RidgePoints,
    *,
    settings: SectionScoreSettings,
) -> RidgePoints:
    """Lower the scores of crests whose break no move of their sides explains.

    At a fault one side matches the other moved along the fault; at a trace that is noisier than its neighbours, at a
    change of gain and where reflections die out none matches better than unmoved.

    Parameters
    ----------
    volume, valid : ndarray of shape (inline, crossline, sample)
        Amplitudes of a section, one of the first two lengths 1, of unit mean square; and where there are any.
    slopes : tuple of ndarray of the same shape
        Reflector slopes along inlines and crosslines.
    ridges : RidgePoints
        Crests of the section.
    settings : SectionScoreSettings
        Windows.

    Returns
    -------
    RidgePoints
        The same ones with their scores times 1 - doubt (1 - explained share).
    """
    share = explain_breaks(volume, valid, slopes, ridges, settings=settings)
    return replace(ridges, score=ridges.score * (1.0 - np.float32(settings.doubt) * (1.0 - share)))


def explain_breaks(
    volume: Float32Array,
    valid: BoolArray,
    slopes: tuple[Float32Array, Float32Array],
    ridges: RidgePoints,
    *,
    settings: SectionScoreSettings,
) -> Float32Array:
    """Return which share of the misfit at each crest is gone after the move that matches its sides best, 0 to 1."""
    axis = 0 if volume.shape[1] == 1 else 1
    section, known, slope = (np.ascontiguousarray(a.take(0, 1 - axis)) for a in (volume, valid, slopes[axis]))
    share = np.empty(len(ridges.score), np.float32)
    explained_shares(
        section, known, slope, ridges.positions[:, [axis, 2]], ridges.planes[:, 2] * ridges.planes[:, axis],
        settings.near, settings.far, settings.clear, settings.farthest, gaussian_taps(settings.along), share,
    )  # fmt: skip
    return share


def weigh_by_lines(
    ridges: RidgePoints, shape: tuple[int, int, int], *, step: int, link: SheetSettings, settings: SectionScoreSettings
) -> RidgePoints:
    """Give crests the geometric mean of their own score and the strength of the line that they lie on.

    A line's strength is its significance: mean support times the square root of its length. A short piece may score
    high by chance, and a weak place of a long fault is fault nonetheless. A crest on no line is one a step long.

    Parameters
    ----------
    ridges : RidgePoints
        Crests of a section.
    shape : tuple of int
        Shape of the evidence's grid.
    step : int
        Samples a step of that grid.
    link : SheetSettings
        When points belong together.
    settings : SectionScoreSettings
        Thresholds.

    Returns
    -------
    RidgePoints
        The same ones with those scores.
    """
    own = np.maximum(ridges.score, 0.0)
    whole = own * np.float32(np.sqrt(step))
    lines = link_sheets(
        ridges.select(own >= settings.least_score), shape, step=step, least_points=settings.least_points,
        end_score=settings.least_score, settings=link,
    )  # fmt: skip
    if lines:
        nodes = [line.nodes() for line in lines]
        strengths = np.repeat([strength(line) for line in lines], [len(part) for part in nodes])
        tree = cKDTree(np.concatenate(nodes))
        distance, nearest = tree.query(ridges.positions, distance_upper_bound=settings.beside)
        on = np.isfinite(distance)
        whole[on] = np.maximum(whole[on], strengths[nearest[on]])
    return replace(ridges, score=_mean_score(own, whole, settings))


def weigh_line(sheet: Sheet, settings: SectionScoreSettings) -> Sheet:
    """Give a line the scores that :func:`weigh_by_lines` gives to the crests on it."""
    return replace(sheet, score=_mean_score(np.maximum(sheet.score, 0.0), strength(sheet), settings))


def spread_likelihood(likelihood: Float32Array, *, settings: SectionScoreSettings) -> Float32Array:
    """Carry the likelihood of lines on to the traces beside them, as far as their place is uncertain.

    Parameters
    ----------
    likelihood : ndarray of shape (inline, crossline, sample), float32
        That of the crests of a section, one of the first two lengths 1; 0 elsewhere.
    settings : SectionScoreSettings
        How uncertain.

    Returns
    -------
    ndarray of the same shape, float32
        The largest of the likelihoods around, each times the Gaussian of its distance in traces.
    """
    axis = 0 if likelihood.shape[1] == 1 else 1
    lines = likelihood.swapaxes(0, axis)
    spread = lines.copy()
    for off in range(1, min(int(np.ceil(2.5 * settings.spread)), len(lines) - 1) + 1):
        share = np.float32(np.exp(-0.5 * (off / settings.spread) ** 2))
        np.maximum(spread[off:], share * lines[:-off], out=spread[off:])
        np.maximum(spread[:-off], share * lines[off:], out=spread[:-off])
    return spread.swapaxes(0, axis)


def _mean_score(own: Float32Array, whole: Float32Array | float, settings: SectionScoreSettings) -> Float32Array:
    """Return the geometric mean of places' own scores and the strength of the line that each is part of."""
    return np.sqrt(own * (whole / np.float32(settings.usual_strength))).astype(np.float32)
