r"""Align two elevation maps to a small share of a cell: shift, tilt, turn and scale.

Where a map is moved by a little, its elevation changes by the slope along the move. That is the relation of slope and
aspect of [1]_; it is solved here by least squares over all cells with robust weights, cell by cell instead of by bins
of aspect, together with offset, tilt and vertical scale.

References
----------
.. [1] C. Nuth, A. Kaab, The Cryosphere 5, 271-290, 2011. :doi:`10.5194/tc-5-271-2011`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import freeze, is_among, told
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.geometry.map_grid import MapGrid, elevation_values, refuse_apart, refuse_other_systems
from seismo3d.registration.feature_pairs import as_pairs
from seismo3d.terrain._kernels_align import resample
from seismo3d.terrain.coarse import match_pose
from seismo3d.terrain.fitting import Fit, Level, Pose, fit_pose, measure_covariance, relief
from seismo3d.terrain.pyramid import make_levels

MODELS = {"translation": (0, 1), "rigid": (0, 1, 2), "similarity": (0, 1, 2, 3)}
"""Parameters, by number, of each horizontal model."""
VERTICALS = {"offset": (4,), "tilt": (4, 5, 6), "scaled": (4, 5, 6, 7)}
"""Parameters of each vertical model; each holds the one before it."""
GOOD_FIT = 0.25
"""Residual over relief below which the answer from the maps' own places is taken without a global search."""
POOR_FIT = 0.7
"""Residual over relief beyond which an answer explains too little to be one."""
RESTLESS = 0.25
"""Share of the standard deviations below which steps that go on are at rest: cells that join and leave make them."""
LEAST_OVERLAP = 0.02
"""Share of the smaller map's known ground that must lie on the other."""


@dataclass(frozen=True, slots=True, eq=False)
class ElevationRegistration:
    """How a source map lies on a target map.

    Attributes
    ----------
    T_target_source : ndarray of shape (4, 4), float64
        Carries a source point (x, y, elevation) onto the target, in map coordinates (places and elevation without a
        georeference).
    shift : ndarray of shape (3,), float64
        Move of the source's surface at the target's middle: x, y in metres (cells without a georeference), elevation.
    turn : float
        Anticlockwise on the map, in radians.
    growth : float
        Horizontal scale.
    tilt : ndarray of shape (2,), float64
        Elevation added per metre (cell) along x and y.
    vertical_scale : float
    covariance : ndarray of shape (8, 8), float64
        Of (shift x, shift y, turn, log growth, shift of elevation, tilt x, tilt y, vertical scale); zero for those that
        the model leaves out. From sums over patches of the map, so that residuals may be alike nearby.
    nmad_before, nmad_after : float
        Normalised median absolute deviation of the difference, target minus source.
    overlap : float
        Share of the target's cells at which both maps are known, after the alignment.
    state : str
        ``"converged"``, ``"not_converged"``, or ``"poor_fit"``: the source explains little of the target's relief
        where both are known.
    stage : str
        ``"local"``, from the maps' own places, or ``"global"``, from matched features.
    model, vertical : str
    """

    T_target_source: Float64Array
    shift: Float64Array
    turn: float
    growth: float
    tilt: Float64Array
    vertical_scale: float
    covariance: Float64Array
    nmad_before: float
    nmad_after: float
    overlap: float
    state: str
    stage: str
    model: str
    vertical: str

    @property
    def converged(self) -> bool:
        """Whether the state is ``"converged"``."""
        return self.state == "converged"

    @property
    def sigma(self) -> Float64Array:
        """Standard deviations of the eight parameters of ``covariance``, shape (8,)."""
        return np.sqrt(np.diag(self.covariance))

    def apply(self, source: Any, target: Any) -> Any:
        """Return the source carried onto the target's grid, as float32 of the target's shape and form.

        Bilinear; NaN beside holes and outside.
        """
        there, here = MapGrid.from_elevation(source), MapGrid.from_elevation(target)
        A, t = self.T_target_source[:2, :2], self.T_target_source[:2, 3]
        corners = here.to_map([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        places = there.to_places(np.linalg.solve(A, (corners - t).T).T)
        M = np.column_stack([places[1] - places[0], places[2] - places[0], places[0]])
        moved = np.empty(here.shape)
        resample(elevation_values(source, "source", least=2), M, moved)
        rows, columns = np.indices(here.shape)
        xy = np.linalg.solve(A, (here.to_map(np.column_stack([columns.ravel(), rows.ravel()])) - t).T)
        plane = self.T_target_source[2, :2] @ xy + self.T_target_source[2, 3]
        values = (self.T_target_source[2, 2] * moved + plane.reshape(here.shape)).astype(np.float32)
        return target.copy(data=values) if hasattr(target, "dims") else values


def register(
    target: Any, source: Any, *, model: str = "translation", vertical: str = "offset", matches: Any = None
) -> ElevationRegistration:
    """Find how a source map has to be moved to lie on a target map, to a small share of a cell.

    Starts from where the maps say they lie, coarse to fine. Where the source does not explain the target's relief from
    there, features of both maps are matched (:func:`seismo3d.match`) and the fit starts from the pose on which most
    agree. Every pass weighs cells by Tukey's function of their residual, so that change and outliers count little.

    Parameters
    ----------
    target, source : DataArray or array_like of shape (rows, columns)
        Elevation maps as :func:`~seismo3d.io.elevation.read_elevation` gives them, of one reference system, perhaps of
        different grids; or bare arrays, in cells. NaN where unknown.
    model : {"translation", "rigid", "similarity"}
        Horizontal motion: shift; shift and turn; shift, turn and scale.
    vertical : {"offset", "tilt", "scaled"}
        Offset; offset and tilt; offset, tilt and scale of elevation.
    matches : (points_target, points_source) or object with these, optional
        Matched places (column, row) to start from in place of features, where the maps do not fit as they lie.

    Returns
    -------
    ElevationRegistration

    Raises
    ------
    ParameterError
        If a model has another name.
    GeometryError
        If the reference systems differ, a map is all nodata, or the maps have no common area.

    Notes
    -----
    Sub-cell error has two sources: noise, of which the covariance tells, and resampling of the source between its
    cells, which is bilinear and costs up to 0.003 cells on rough terrain. Slopes come from a cell's neighbours without
    the cell itself, so that noise does not draw the answer towards whole cells.
    """
    if not is_among(model, MODELS):
        raise ParameterError(f"model is {told(model)}; expected one of {', '.join(MODELS)}.")
    if not is_among(vertical, VERTICALS):
        raise ParameterError(f"vertical is {told(vertical)}; expected one of {', '.join(VERTICALS)}.")
    if matches is not None:
        as_pairs(matches)
    here, there = MapGrid.from_elevation(target), MapGrid.from_elevation(source)
    refuse_other_systems(here, there, ("target", "source"))
    refuse_apart(here, there, ("target", "source"))
    levels = make_levels(elevation_values(target, "target"), here, elevation_values(source, "source"), there)
    free = MODELS[model] + VERTICALS[vertical]
    fits: list[tuple[Fit, str]] = []
    local = _down(levels, Pose(), free)
    if local is not None:
        fits.append((local, "local"))
    if local is None or local.spread > GOOD_FIT * relief(levels[0], local):
        start = match_pose(levels, model, matches)
        led = None if start is None else _down(levels, start, free)
        if led is not None:
            fits.append((led, "global"))
    if not fits:
        raise GeometryError("target and source have no common area with elevations. Check their georeference.")
    found, stage = min(fits, key=lambda pair: pair[0].spread / max(pair[0].share, 1e-3) ** 0.25)
    return _assemble(levels[0], found, here, stage=stage, model=model, vertical=vertical, free=free)


def _down(levels: list[Level], start: Pose, free: tuple[int, ...]) -> Fit | None:
    """Fit from the coarsest level to the finest; None where the maps do not overlap from this start."""
    pose, fit = start, None
    for number in range(len(levels) - 1, -1, -1):
        level = levels[number]
        # far from the answer a tilt or a scale takes over what is a shift
        few = tuple(p for p in free if p in (0, 1, 4)) if number == len(levels) - 1 else free
        for chosen in (few, free) if few != free else (free,):
            fit = fit_pose(level, pose, chosen, tolerance=1e-5 if number == 0 else 1e-2)
            if fit is None:
                return None
            pose = fit.pose
    return fit if fit is not None and fit.share >= LEAST_OVERLAP else None


def _assemble(
    level: Level,
    found: Fit,
    here: MapGrid,
    *,
    stage: str,
    model: str,
    vertical: str,
    free: tuple[int, ...],
) -> ElevationRegistration:
    pose = found.pose
    # metres about the target's middle -> map coordinates
    to_map = np.eye(3)
    to_map[:2, :2] = np.diag(1.0 / np.array(here.metres_per_unit))
    to_map[:2, 2] = here.to_map([level.centre])[0]
    flat = to_map @ pose.motion @ np.linalg.inv(to_map)
    T = np.eye(4)
    T[:2, :2], T[:2, 3] = flat[:2, :2], flat[:2, 2]
    c0, c1, c2, k = pose.vertical
    # the plane is given over the target; carry it back to source points
    slope = np.array([c1, c2]) * np.array(here.metres_per_unit)
    T[2, :2] = slope @ flat[:2, :2]
    T[2, 2] = k
    T[2, 3] = c0 + slope @ (flat[:2, 2] - to_map[:2, 2])
    before = fit_pose(level, Pose(), (4,), tolerance=1e-2, most=1)
    covariance = measure_covariance(level, found, free)
    at_rest = found.settled or bool((found.unrest <= RESTLESS * np.sqrt(np.diag(covariance)[:4])).all())
    state = "converged" if at_rest else "not_converged"
    if found.spread > POOR_FIT * relief(level, found):
        state = "poor_fit"
    # what elevation the source's own surface gains at the middle
    gained = c0 + (k - 1.0) * found.middle
    return ElevationRegistration(
        T_target_source=freeze(T),
        shift=freeze(np.array([pose.motion[0, 2], pose.motion[1, 2], gained])),
        turn=float(np.arctan2(pose.motion[1, 0], pose.motion[0, 0])),
        growth=float(np.hypot(pose.motion[0, 0], pose.motion[1, 0])),
        tilt=freeze(np.array([c1, c2])),
        vertical_scale=float(k),
        covariance=freeze(covariance),
        nmad_before=float("nan") if before is None else before.first_spread,
        nmad_after=found.spread,
        overlap=found.overlap,
        state=state,
        stage=stage,
        model=model,
        vertical=vertical,
    )
