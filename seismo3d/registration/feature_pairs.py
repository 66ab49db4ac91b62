"""Matched features as residuals: given pairs, in space or on images, with their covariance."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_points
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.terms import FeatureTerm
from seismo3d.scan import Raster, Scan

PIXEL_SIGMA = 0.7
"""Standard deviation of a matched keypoint in pixels."""
DEPTH_SIGMA = 0.0025
"""Standard deviation of a structured-light depth at one metre, in metres; it grows with the square of depth."""


def as_pairs(matches: Any) -> tuple[AnyArray, AnyArray]:
    """Return (target, source) of a pair of arrays, or of an object with ``points_target`` and ``points_source``."""
    if hasattr(matches, "points_target") and hasattr(matches, "points_source"):
        q, p = matches.points_target, matches.points_source
    elif isinstance(matches, tuple | list) and len(matches) == 2:
        q, p = matches
    else:
        raise ParameterError(
            f"matches is a {type(matches).__name__}; expected (points_target, points_source), "
            "or an object that has them."
        )
    q, p = as_points(q, "matches' target points"), as_points(p, "matches' source points")
    if q.shape != p.shape:
        raise ShapeError(f"matches have shapes {q.shape} and {p.shape}; expected the same, row by row.")
    return q, p


def feature_term(matches: Any, target: Scan, source: Scan, frame: Frame, floor: float) -> FeatureTerm | None:
    """Return matched features as a term in the frame; None where no pair has a place in both scans.

    Parameters
    ----------
    matches : pair of arrays, or object with ``points_target``, ``points_source``
        Points of shape (k, d) in the scans' frames; or pixels (column, row) of shape (k, 2) on the images of scans in
        space, which are lifted by their depth.
    target, source : Scan
    frame : Frame
    floor : float
        Least standard deviation, in the input's units, for pairs without a covariance of their own.
    """
    q, p = as_pairs(matches)
    d = target.dim
    if q.shape[1] == d:
        information = np.broadcast_to(np.eye(d), (len(q), d, d)).copy()
        return FeatureTerm(frame.target(q), frame.source(p), information, floor / frame.size) if len(q) else None
    if q.shape[1] != 2 or target.raster is None or source.raster is None:
        raise ShapeError(f"matches have {q.shape[1]} coordinates; expected {d}, as the scans have.")
    lifted_q, cov_q = lift_pixels(target.raster, q)
    lifted_p, cov_p = lift_pixels(source.raster, p)
    good = np.isfinite(lifted_q).all(axis=1) & np.isfinite(lifted_p).all(axis=1)
    if not good.any():
        return None
    information = np.asarray(np.linalg.inv((cov_q[good] + cov_p[good]) / frame.size**2), dtype=np.float64)
    return FeatureTerm(frame.target(lifted_q[good]), frame.source(lifted_p[good]), information, 0.5)


def lift_pixels(raster: Raster, pixels: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the points (k, 3) that pixels show, NaN where there is none, and their covariances (k, 3, 3)."""
    if raster.points is None:
        raise ParameterError(
            f"the scan's raster is of kind {raster.kind!r}; expected one with points, as an RGB-D frame has."
        )
    rows = np.clip(np.rint(pixels[:, 1]).astype(int), 0, raster.points.shape[0] - 1)
    columns = np.clip(np.rint(pixels[:, 0]).astype(int), 0, raster.points.shape[1] - 1)
    points = raster.points[rows, columns].copy()
    if raster.camera is None:
        spacing = float(np.nanmedian(np.linalg.norm(np.diff(raster.points[:, :, :2], axis=1), axis=2)))
        return points, np.broadcast_to(np.eye(3) * (PIXEL_SIGMA * spacing) ** 2, (len(points), 3, 3))
    z = points[:, 2]
    xy = raster.camera.rays(pixels)
    points[:, :2] = xy * z[:, None]
    ray = np.concatenate([xy, np.ones((len(z), 1))], axis=1)
    across = (PIXEL_SIGMA * z / raster.camera.fx) ** 2
    along = (DEPTH_SIGMA * z**2) ** 2
    covariance = across[:, None, None] * np.eye(3) + along[:, None, None] * ray[:, :, None] * ray[:, None, :]
    covariance[~np.isfinite(covariance).all(axis=(1, 2))] = np.eye(3)
    return points, covariance
