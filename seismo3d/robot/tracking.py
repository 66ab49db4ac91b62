"""Locate a frame in the map: planes against the predicted surface and landmarks, fused in one quadratic form.

Vertices are paired with what the predicted image shows at their pixel; landmarks keep their rays, so that only what
lies across a ray counts (the reprojection error to first order). Both weigh by their own spread, measured anew at each
step: landmarks lead far from the solution and along what the planes do not see, planes lead near it. Where the two stay
apart, the answer that landmarks lead to is tried as well: the noise of many normals can hold a frame where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.registration._kernels_newton import RIGID, parameter_jacobian
from seismo3d.registration.observability import assess, to_input_units
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.solvers import Limits
from seismo3d.robot import _kernels_pose as kernels
from seismo3d.robot.frames import Measured
from seismo3d.robot.landmarks import Sightings
from seismo3d.robot.tsdf import Prediction

TERMS = ("fused", "planes", "features", "two_stage")
"""What a frame is located by; ``two_stage`` is landmarks first, then planes alone."""
_USES = {
    "fused": ((True, True), (True, True)),
    "planes": ((True, False), (True, False)),
    "features": ((False, True), (False, True)),
    "two_stage": ((False, True), (True, False)),
}
"""Whether planes and landmarks are used, far from the solution and near it."""
_REACHES = (0.1, 0.1, 0.06, 0.04)
"""Distance within which pairs are sought, in the first steps and all later ones, metres."""
_FREE = Limits(np.full(6, -np.inf), np.full(6, np.inf))
_MOST_STEPS, _STILL = 10, 2e-4
"""Steps that are taken at most, and below which a step is the last, rad and m."""
_NEARLY = 1e-3
"""Steps below which vertices are paired more finely, rad and m."""
_COARSE, _FINE = (3, 2000), (3, 4000)
"""Every so many vertices of a row and rows are paired far from the solution and near it, of large images as few as make
so many pairs: neighbours share their errors."""
_ENOUGH = 20
"""Landmarks from which on they say where a frame was, whatever the planes say."""
_UNKNOWN = 10.0
"""Variance along motions of unit length that nothing is said about, rad^2 and m^2."""
_NONE = np.empty((0, 6))
_LEADING, _MANY, _FAR_OFF = 2, 30, 4.0
"""Steps that landmarks take alone at first where at least so many of them are off by so many pixels."""
_APART, _NEARER, _AS_WELL = 1.0, 0.5, 0.5
"""Spread of landmarks, pixels, from which on the planes may say what only their noise does; the share of it, and of the
planes that agree, at most and at least, with which an answer that landmarks lead to is the better one."""
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
    blind : ndarray of shape (k, 6), float64
        Motions in the world (rotation, translation; of unit length, perturbations on the left) along which nothing says
        where the frame was: without landmarks the one along a corridor, those along and about a tunnel, the three in
        the plane of a wall. The pose is the start's along them, and the covariance large.
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
    blind: Float64Array


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
    blind : ndarray of shape (6, k), float64
        Motions, in the frame of the form that was fitted, of which the pairs say no more than the normals' noise does.
    """

    source: Float64Array
    target: Float64Array
    normals: Float64Array
    weights: Float64Array
    residuals: Float64Array
    n_tried: int
    spread: float
    blind: Float64Array


def locate(
    measured: Measured,
    prediction: Prediction,
    sightings: Sightings,
    T_world_camera: Float64Array,
    lens: PinholeCamera,
    *,
    terms: str = "fused",
    loose: bool = False,
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

    Returns
    -------
    Located
    """
    lead = (_LEADING if loose and terms == "fused" else 0, _MANY, _FAR_OFF, False)
    found = _fit(measured, prediction, sightings, T_world_camera, lens, terms, lead)
    if terms == "fused" and found.n_landmarks >= _MANY and found.landmark_spread > _APART:
        lead = (_LEADING, _MANY, _APART, True)
        led = _fit(measured, prediction, sightings, T_world_camera, lens, terms, lead)
        if led.landmark_spread < _NEARER * found.landmark_spread and led.n_planes >= _AS_WELL * found.n_planes:
            return led
    return found


def _fit(
    measured: Measured,
    prediction: Prediction,
    sightings: Sightings,
    T_world_camera: Float64Array,
    lens: PinholeCamera,
    terms: str,
    lead: tuple[int, int, float, bool],
) -> Located:
    """Fit a frame from a pose; ``lead`` is what :func:`~seismo3d.robot._kernels_pose.fit_frame` takes."""
    coarse, near = _step_of(measured, _COARSE), fine_step(measured)
    n_steps, T, form, has_pairs, planes, has_rays, landmarks = kernels.fit_frame(
        T_world_camera, measured.vertices, measured.normals, (coarse, near), prediction.points, prediction.normals,
        prediction.T_world_camera, prediction.lens, _REACHES, _PER_PLANE, sightings.points, sightings.T_depth_pixel,
        sightings.rays, (lens.fx, lens.fy), _USES[terms],
        lead, (_NEARLY, _STILL), _MOST_STEPS,
    )  # fmt: skip
    weights, spread, n_agreeing = landmarks
    if n_steps == 0:
        unknown = np.full((6, 6), np.inf)
        unweighed = np.zeros(len(sightings))
        return Located(T_world_camera, unknown, 0, 0, 0.0, np.inf, np.inf, False, None, unweighed, _NONE)
    pairs = PlanePairs(*planes) if has_pairs else None
    n_planes = 0 if pairs is None else int(np.count_nonzero(pairs.weights))
    unseen = pairs.blind if pairs is not None and not (has_rays and n_agreeing >= _ENOUGH) else _NONE.T
    covariance, blind = _covariance(form, unseen)
    return Located(
        T_world_camera=T,
        covariance=covariance,
        n_planes=n_planes,
        n_landmarks=n_agreeing if has_rays else 0,
        share=0.0 if pairs is None else n_planes / max(pairs.n_tried, 1),
        plane_spread=np.inf if pairs is None else pairs.spread,
        landmark_spread=spread if has_rays else np.inf,
        converged=True,
        planes=pairs,
        landmark_weights=weights if has_rays else np.zeros(len(sightings)),
        blind=blind,
    )


def fine_step(measured: Measured) -> int:
    """Return every how manieth vertex of a row, and row, is paired near the solution."""
    return _step_of(measured, _FINE)


def _step_of(measured: Measured, least: tuple[int, int]) -> int:
    rows, columns, _ = measured.vertices.shape
    return max(least[0], int(np.sqrt(rows * columns / least[1])))


def _covariance(form: tuple[Any, ...], unseen: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return how sure the last step's form is of its minimum, and what is ``unseen`` (6, k) as motions in the world."""
    Q, A, t, source, target, size = form
    frame = Frame(source, target, size)
    if unseen.shape[1] == 0:
        sure = assess(Q, Q / size**2, A, t, model="rigid", frame=frame, ratio=kernels.RATIO, limits=_FREE)
        return sure.covariance, _NONE
    J, change = parameter_jacobian(A, RIGID), to_input_units(A, t, "rigid", frame)
    seen = np.linalg.qr(unseen, mode="complete")[0][:, unseen.shape[1] :]
    known = seen.T @ J.T @ Q[:-1, :-1] @ J @ seen * size**2
    blind = (change @ unseen).T
    blind /= np.linalg.norm(blind, axis=1, keepdims=True)
    root = change @ seen @ np.linalg.cholesky(np.linalg.inv(known))
    return root @ root.T + _UNKNOWN * blind.T @ blind, blind
