"""Locate a frame in the map: planes against the predicted surface and landmarks, fused in one quadratic form.

Vertices are paired with what the predicted image shows at their pixel; landmarks keep their rays, so that only what
lies across a ray counts (the reprojection error to first order). Both weigh by their own spread, measured anew at each
step: landmarks lead far from the solution and along what the planes do not see, planes lead near it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.registration.observability import assess
from seismo3d.registration.quadratic import Frame, plane_form, point_form
from seismo3d.registration.robust import TUKEY, robust_scale, tukey_weights
from seismo3d.registration.solvers import Limits, Prior, Solution, walk
from seismo3d.robot import _kernels_tracking as kernels
from seismo3d.robot.ekf import log_motion
from seismo3d.robot.frames import Measured
from seismo3d.robot.landmarks import Sightings
from seismo3d.robot.tsdf import Prediction

TERMS = ("fused", "planes", "features", "two_stage")
"""What a frame is located by; ``two_stage`` is landmarks first, then planes alone."""
_FREE = Limits(np.full(6, -np.inf), np.full(6, np.inf))
_STILL = 2e-4
"""Steps below are the last, rad and m."""
_NEARLY = 1e-3
"""Steps below which vertices are paired more finely, rad and m."""
_COARSE, _FINE = (4, 2000), (3, 4000)
"""Every so many vertices of a row and rows are paired far from the solution and near it, of large images as few as make
so many pairs: neighbours share their errors."""
_LEADING, _MANY, _FAR_OFF = 2, 30, 4.0
"""Steps that landmarks take alone at first where at least so many of them are off by so many pixels."""
_PER_PLANE = 8.0
"""Pixels of the half image (every second one of it) that carry as much as one independent measurement: neighbours
share the sensor's and the map's errors."""


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """Where a frame was.

    Attributes
    ----------
    T_world_camera : ndarray of shape (4, 4), float64
    covariance : ndarray of shape (6, 6), float64
        Of a perturbation on the left, (rotation, translation).
    n_planes, n_landmarks : int
        Pairs that agree.
    share : float
        Share of the vertices that have a partner and agree with it.
    plane_spread : float
        Robust standard deviation of the planes' residuals over what the sensor's noise explains.
    landmark_spread : float
        The same of the landmarks, in pixels.
    converged : bool
    planes : PlanePairs or None
    landmark_weights : ndarray of shape (n,), float64
        Inverse variances, per pixel squared.
    """

    T_world_camera: Float64Array
    covariance: Float64Array
    n_planes: int
    n_landmarks: int
    share: float
    plane_spread: float
    landmark_spread: float
    converged: bool
    planes: PlanePairs | None
    landmark_weights: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class PlanePairs:
    """Vertices with their partners on the predicted surface.

    Attributes
    ----------
    source, target, normals : ndarray of shape (n, 3), float64
        Vertices in the camera's frame; points and normals in the world.
    weights : ndarray of shape (n,), float64
        Inverse variances; zero for pairs that disagree.
    residuals : ndarray of shape (n,), float64
        Metres, along the normals.
    n_tried : int
        Vertices that were looked up.
    spread : float
        As in :class:`Located`.
    """

    source: Float64Array
    target: Float64Array
    normals: Float64Array
    weights: Float64Array
    residuals: Float64Array
    n_tried: int
    spread: float


def locate(
    measured: Measured,
    prediction: Prediction,
    sightings: Sightings,
    T_world_camera: Float64Array,
    lens: PinholeCamera,
    *,
    terms: str = "fused",
    loose: bool = False,
    max_steps: int = 10,
) -> Located:
    """Find the pose at which a frame fits the map.

    Parameters
    ----------
    measured : Measured
    prediction : Prediction
        The map near the pose.
    sightings : Sightings
        Landmarks found in the frame.
    T_world_camera : ndarray of shape (4, 4), float64
        Where to start; kept along what neither planes nor landmarks see.
    lens : PinholeCamera
    terms : str
        One of ``TERMS``.
    loose : bool
        Whether the start may be far off: then landmarks take the first steps alone.
    max_steps : int

    Returns
    -------
    Located
    """
    T = T_world_camera
    found = Located(T, np.full((6, 6), np.inf), 0, 0, 0.0, np.inf, np.inf, False, None, np.zeros(len(sightings)))
    last: _Step | None = None
    steps = _step_of(measured, _COARSE), fine_step(measured)
    frame: Frame | None = None
    fine, n_left = False, max_steps // 2
    for step in range(max_steps):
        use_planes = terms in ("fused", "planes") or (terms == "two_stage" and fine)
        use_landmarks = terms in ("fused", "features") or (terms == "two_stage" and not fine)
        reach = (0.1, 0.1, 0.06, 0.04)[min(step, 3)]
        rays = _weigh_landmarks(sightings, T, lens) if use_landmarks and len(sightings) >= 4 else None
        if loose and terms == "fused" and step < _LEADING and rays is not None and rays.lead:
            use_planes = False
        pairs = _pair_planes(measured, prediction, T, steps[fine], reach) if use_planes else None
        if pairs is None and rays is None:
            break
        frame = frame or _frame_of(pairs, rays, sightings)
        new = _solve(T, frame, pairs, rays, sightings)
        if new is None:
            break
        move = log_motion(np.linalg.inv(T) @ new.T_world_camera)
        T, last = new.T_world_camera, new
        n_left -= 1
        least = _STILL if fine else _NEARLY
        if n_left == 0 or (np.linalg.norm(move[:3]) < least and np.linalg.norm(move[3:]) < least):
            if fine:
                break
            fine, n_left = True, max_steps - max_steps // 2
    return found if last is None else _concluded(last)


def fine_step(measured: Measured) -> int:
    """Return every how manieth vertex of a row, and row, is paired near the solution."""
    return _step_of(measured, _FINE)


def _step_of(measured: Measured, least: tuple[int, int]) -> int:
    rows, columns, _ = measured.vertices.shape
    return max(least[0], int(np.sqrt(rows * columns / least[1])))


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    source: Float64Array
    information: Float64Array
    weights: Float64Array
    spread: float
    n_agreeing: int

    @property
    def lead(self) -> bool:
        """Whether so many are so far off that planes would pair with the wrong parts of the surface."""
        return self.n_agreeing >= _MANY and self.spread > _FAR_OFF


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    T_world_camera: Float64Array
    frame: Frame
    Q: Float64Array
    found: Solution
    pairs: PlanePairs | None
    rays: _Rays | None
    n_sightings: int


def _pair_planes(
    measured: Measured, prediction: Prediction, T: Float64Array, step: int, reach: float
) -> PlanePairs | None:
    rows, columns, _ = measured.vertices.shape
    n = (rows // step + 1) * (columns // step + 1)
    source, target, normal = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    sigma, residual = np.empty(n), np.empty(n)
    seen = prediction.T_world_camera
    count, tried = kernels.project_pairs(
        measured.vertices, measured.normals, step, np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3]),
        np.ascontiguousarray(seen[:3, :3]), np.ascontiguousarray(seen[:3, 3]), prediction.lens, prediction.points,
        prediction.normals, reach, 0.8, source, target, normal, sigma, residual,
    )  # fmt: skip
    if count < 30:
        return None
    residual, sigma = residual[:count], sigma[:count]
    spread = robust_scale(residual / sigma)
    floored = max(spread, 0.3)
    weights = tukey_weights(residual / sigma, TUKEY * floored) / (sigma * floored) ** 2
    weights *= step * step / (4.0 * _PER_PLANE)
    return PlanePairs(source[:count], target[:count], normal[:count], weights, residual, tried, spread)


def _weigh_landmarks(sightings: Sightings, T: Float64Array, lens: PinholeCamera) -> _Rays:
    """Put each landmark at its depth on its ray, with the information of its pixel across the ray."""
    n = len(sightings)
    depth, miss = np.empty(n), np.empty(n)
    kernels.miss_rays(T, sightings.T_depth_pixel, sightings.points, sightings.rays, lens.fx, lens.fy, depth, miss)
    spread = 1.2 / 1.4826 * robust_scale(miss)
    floored = max(spread, 0.3)
    weights = tukey_weights(miss, TUKEY * floored) / floored**2
    source, information = np.empty((n, 3)), np.empty((n, 3, 3))
    kernels.place_on_rays(T, sightings.T_depth_pixel, sightings.rays, depth, weights, lens.fx, source, information)
    return _Rays(source, information, weights, spread, int(np.count_nonzero(weights)))


def _frame_of(pairs: PlanePairs | None, rays: _Rays | None, sightings: Sightings) -> Frame:
    """Return the frame in which the forms of all steps are kept: that of the first pairs."""
    targets = [p for p in (pairs.target if pairs else None, sightings.points if rays else None) if p is not None]
    sources = [p for p in (pairs.source if pairs else None, rays.source if rays else None) if p is not None]
    return Frame.of(np.concatenate(targets), np.concatenate(sources))


def _solve(
    T: Float64Array, frame: Frame, pairs: PlanePairs | None, rays: _Rays | None, sightings: Sightings
) -> _Step | None:
    """Add both terms up in one form, and walk to its minimum from the pose before: the pairs hold near that alone."""
    Q = np.zeros((13, 13))
    if pairs is not None:
        Q += plane_form(frame.target(pairs.target), frame.source(pairs.source), pairs.normals, pairs.weights)
    if rays is not None:
        Q += point_form(frame.target(sightings.points), frame.source(rays.source), rays.information)
    if not np.isfinite(Q).all() or not Q[:12, :12].any():
        return None
    A, t = frame.enter(T)
    found = walk(Q, A, t, model="rigid", prior=Prior(A, t), limits=_FREE, ratio=1e-5)
    return _Step(frame.leave(found.A, found.t), frame, Q, found, pairs, rays, len(sightings))


def _concluded(last: _Step) -> Located:
    """Say how sure the last step is, and what supports it."""
    frame, Q, found, pairs, rays = last.frame, last.Q, last.found, last.pairs, last.rays
    sure = assess(Q, Q / frame.size**2, found.A, found.t, model="rigid", frame=frame, ratio=1e-5, limits=_FREE)
    n_planes = 0 if pairs is None else int((pairs.weights > 0).sum())
    return Located(
        T_world_camera=last.T_world_camera,
        covariance=sure.covariance,
        n_planes=n_planes,
        n_landmarks=0 if rays is None else rays.n_agreeing,
        share=0.0 if pairs is None else n_planes / max(pairs.n_tried, 1),
        plane_spread=np.inf if pairs is None else pairs.spread,
        landmark_spread=np.inf if rays is None else rays.spread,
        converged=True,
        planes=pairs,
        landmark_weights=np.zeros(last.n_sightings) if rays is None else rays.weights,
    )
