"""Traced horizons beside a picked one: how far apart, what was missed, what is new."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import BoolArray, Float64Array, IntArray
from seismo3d._validate import as_kind, as_number, check_list, told
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry
from seismo3d.io.horizons import HorizonPoints
from seismo3d.seismic.picks import finite_percentile, place_horizon

# line numbers, or indices, that differ by no more are of one trace
_ONE_TRACE = 0.5
# so are x and y, in metres, unless the traces lie closer
_ONE_PLACE = 1.0
# traces, about, from which their spacing is read
_SOME_PLACES = 10_000


@dataclass(frozen=True, slots=True)
class HorizonScore:
    """A picked horizon against the traced one that is nearest to it.

    Attributes
    ----------
    name : str
        The picked horizon.
    track : str
        The traced one.
    tolerance : float
        Vertical distance up to which both agree, in the unit of the picks.
    n_picks, n_common : int
        Picks, and those of them at which the track was traced.
    median, p90, bias : float
        Median and 90th percentile of the vertical distance where both are known, and its signed median: positive where
        the track is deeper.
    within : float
        Share of the common picks within the tolerance.
    missed : float
        Share of the picks where the track was not traced.
    new : int
        Number of places where the track was traced and nothing was picked.
    """

    name: str
    track: str
    tolerance: float
    n_picks: int
    n_common: int
    median: float
    p90: float
    bias: float
    within: float
    missed: float
    new: int


def score_horizon(
    tracks: Sequence[HorizonPoints],
    picks: HorizonPoints,
    *,
    tolerance: float,
    cube: Any = None,
    apart: float | None = None,
    extent: tuple[float, float] | None = None,
) -> HorizonScore:
    """Score traced horizons against a picked one; the traced one with the smallest median distance counts.

    Parameters
    ----------
    tracks : sequence of HorizonPoints
        What was traced.
    picks : HorizonPoints
        What was picked, in the same unit.
    tolerance : float
        Vertical distance up to which both agree, in that unit.
    cube : DataArray, optional
        The cube that both are of: then picks meet the nearest trace, half a bin off at most. By default line numbers
        are compared where both files have them, else x and y to within `apart`, which a grid whose nodes are not on
        the traces misses.
    apart : float, optional
        Largest distance in x and y at which two points are of one trace. [default: :func:`same_trace_distance`]
    extent : (float, float), optional
        Between which times or depths a pick lies in the cube. [default: those of `cube` where it is given]

    Returns
    -------
    HorizonScore

    Raises
    ------
    ParameterError
        If there is no track, or `tracks` is no list of them.
    GeometryError
        If no pick lies on a place of any track, or none that does lies in the cube's times or depths: they are then of
        another unit or sign.
    """
    check_list(tracks, "tracks", HorizonPoints)
    if not tracks:
        raise ParameterError("tracks is empty; expected at least one. Trace horizons first.")
    as_kind(picks, HorizonPoints, "picks", remedy="Give what read_horizon returned.")
    limit = as_number(tolerance, "tolerance", low=0.0)
    reach = same_trace_distance(tracks) if apart is None else as_number(apart, "apart", low=0.0)
    if extent is None:
        extent = (-np.inf, np.inf) if cube is None else sample_extent(cube)
    is_pair = isinstance(extent, (tuple, list)) and len(extent) == 2
    if not is_pair or not all(isinstance(end, (int, float, np.number)) for end in extent):
        raise ParameterError(f"extent is {told(extent)}; expected (shallowest, deepest).")
    low, high = extent
    is_inside = (picks.points[:, 2] > low) & (picks.points[:, 2] < high)
    met = False
    scores = []
    for track in tracks:
        here, there, farthest = flat_places(picks, track, cube=cube, apart=reach)
        distance, near = cKDTree(there).query(here, distance_upper_bound=farthest + 1e-9)
        common: BoolArray = np.asarray(np.isfinite(distance))
        met |= bool(common.any())
        if (common & is_inside).any():
            scores.append(_compare(picks, track, common, np.asarray(near)[common], limit))
    if scores:
        return min(scores, key=lambda score: score.median)
    if met:
        z = picks.points[:, 2]
        raise GeometryError(
            f"{picks.name} has z from {z.min():g} to {z.max():g} and no pick on a trace of a track "
            f"between {low:g} and {high:g}, where the cube lies; expected its own unit, growing downwards. "
            "Check the export's unit and sign."
        )
    raise GeometryError(
        f"no pick of {picks.name} lies on a trace of a track; expected the same survey in the same coordinates. "
        "Check the export's coordinate system."
    )


def _compare(
    picks: HorizonPoints, track: HorizonPoints, common: BoolArray, near: IntArray, limit: float
) -> HorizonScore:
    """Score a track against picks, of which these are in common with it, at these of its points."""
    down = track.points[near, 2] - picks.points[common, 2]
    size = np.abs(down)
    return HorizonScore(
        name=picks.name,
        track=track.name,
        tolerance=limit,
        n_picks=len(common),
        n_common=int(common.sum()),
        median=finite_percentile(size, 50.0),
        p90=finite_percentile(size, 90.0),
        bias=float(np.median(down)),
        within=float((size <= limit).mean()),
        missed=1.0 - float(common.mean()),
        new=len(track.points) - len(np.unique(near)),
    )


def same_trace_distance(tracks: Sequence[HorizonPoints]) -> float:
    """Return how far apart in x and y two points of one trace may lie: half the traces' spacing, but no more than 1.

    Without map coordinates x and y are line numbers, so that one apart is the next trace.
    """
    spacing = np.inf
    for track in tracks:
        places = track.points[:, :2]
        some = places[:: max(1, len(places) // _SOME_PLACES)]
        distance = np.asarray(cKDTree(places).query(some, k=2)[0])[:, 1]
        apart = distance[(distance > 0) & np.isfinite(distance)]
        if len(apart):
            # not the least: a crooked line may all but meet itself
            spacing = min(spacing, float(np.percentile(apart, 5.0)))
    return min(_ONE_PLACE, _ONE_TRACE * spacing)


def sample_extent(cube: Any) -> tuple[float, float]:
    """Return the times or depths between which points lie in a cube or section: half a sample beyond its ends."""
    geometry = SectionGeometry if np.ndim(cube) == 2 else SurveyGeometry
    axis = geometry.from_cube(cube).sample
    ends = float(axis.coordinate(-0.5)), float(axis.coordinate(axis.n - 0.5))
    return min(ends), max(ends)


def have_lines(picks: HorizonPoints, track: HorizonPoints) -> bool:
    """Tell whether all points of both have line numbers."""
    return bool(np.isfinite(picks.lines).all() and np.isfinite(track.lines).all())


def flat_places(
    picks: HorizonPoints, track: HorizonPoints, *, apart: float, cube: Any = None
) -> tuple[Float64Array, Float64Array, float]:
    """Places of both on one plane, and how far the same place may lie apart: indices, line numbers, or x and y."""
    if cube is not None:
        return np.rint(place_horizon(picks, cube)[:, :2]), np.rint(place_horizon(track, cube)[:, :2]), _ONE_TRACE
    if have_lines(picks, track):
        return picks.lines, track.lines, _ONE_TRACE
    return picks.points[:, :2], track.points[:, :2], apart
