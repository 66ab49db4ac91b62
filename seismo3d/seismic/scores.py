"""Scores of traced faults against truth: voxels found, voxels called in vain, throws."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import as_number, as_real_array
from seismo3d.errors import ShapeError


@dataclass(frozen=True, slots=True)
class FaultScore:
    """How well the voxels called fault cover the true ones.

    Attributes
    ----------
    precision : float
        Share of called voxels within the tolerance of a true one; NaN where none was called.
    recall : float
        Share of true voxels within the tolerance of a called one; NaN where there are none.
    f1 : float
        Harmonic mean of both: 0 where one of them is 0 or nothing was called; NaN where there is no true fault.
    called : float
        Share of all voxels that are called fault.
    """

    precision: float
    recall: float
    f1: float
    called: float


@dataclass(frozen=True, slots=True)
class ThrowScore:
    """How well throws agree, at the called voxels that lie within the tolerance of a true fault voxel.

    Attributes
    ----------
    n_found : int
        Number of those voxels.
    known : float
        Share of them with a finite throw.
    within : float
        Share of them (of all, not only of those with a finite throw) whose throw is within the allowed error of the
        throw at the nearest true voxel.
    median_error : float
        Median absolute error over those with a finite throw, in samples.
    """

    n_found: int
    known: float
    within: float
    median_error: float


def fault_score(labels: ArrayLike, truth: ArrayLike, *, tolerance: float = 2.0) -> FaultScore:
    """Score called fault voxels against true ones.

    Parameters
    ----------
    labels, truth : array_like of one shape, two or three axes
        Fault where positive (numbers or booleans).
    tolerance : float
        Largest Euclidean distance in voxels at which two voxels agree.

    Returns
    -------
    FaultScore
        Precision, recall, F1 and the share of voxels called.

    Raises
    ------
    ShapeError
        If the shapes differ.

    Examples
    --------
    >>> import numpy as np
    >>> truth = np.zeros((8, 8)); truth[:, 4] = 1
    >>> labels = np.zeros((8, 8)); labels[:4, 5] = 1; labels[0, 0] = 1
    >>> score = fault_score(labels, truth, tolerance=1.0)
    >>> score.precision, score.recall
    (0.8, 0.5)
    """
    called, true = _points(labels, truth)
    limit = as_number(tolerance, "tolerance", low=0.0)
    size = int(np.asarray(labels).size)
    precision = float(np.isfinite(_nearest(called, true, limit)[0]).mean()) if len(called) else math.nan
    recall = float(np.isfinite(_nearest(true, called, limit)[0]).mean()) if len(true) else math.nan
    f1 = math.nan
    if len(true):
        f1 = 2.0 * precision * recall / (precision + recall) if len(called) and precision + recall > 0.0 else 0.0
    return FaultScore(precision, recall, f1, len(called) / size)


def throw_score(
    labels: ArrayLike,
    throw: ArrayLike,
    truth: ArrayLike,
    true_throw: ArrayLike,
    *,
    tolerance: float = 2.0,
    allowed: float = 1.5,
) -> ThrowScore:
    """Score throws at the called voxels that agree with a true fault voxel.

    Parameters
    ----------
    labels, truth : array_like of one shape, two or three axes
        Fault where positive.
    throw, true_throw : array_like of the same shape
        Throws in samples, positive where the hanging wall is down; NaN where not known.
    tolerance : float
        Largest distance in voxels at which a called voxel agrees with a true one.
    allowed : float
        Allowed error in samples.

    Returns
    -------
    ThrowScore
        All shares are NaN where no called voxel agrees.
    """
    called, true = _points(labels, truth)
    limit = as_number(tolerance, "tolerance", low=0.0)
    margin = as_number(allowed, "allowed", low=0.0)
    for name, values in (("throw", throw), ("true_throw", true_throw)):
        if np.shape(values) != np.shape(truth):
            raise ShapeError(f"{name} has shape {np.shape(values)}; expected truth's, {np.shape(truth)}.")
    distance, index = _nearest(called, true, limit)
    found = np.isfinite(distance)
    if not found.any():
        return ThrowScore(0, math.nan, math.nan, math.nan)
    at = tuple(called[found].T.astype(np.int64))
    nearest = tuple(true[index[found]].T.astype(np.int64))
    error = np.abs(np.asarray(throw, dtype=np.float64)[at] - np.asarray(true_throw, dtype=np.float64)[nearest])
    known = np.isfinite(np.asarray(throw)[at])
    finite = error[np.isfinite(error)]
    median = float(np.median(finite)) if finite.size else math.nan
    return ThrowScore(int(found.sum()), float(known.mean()), float((error <= margin).mean()), median)


def _points(labels: ArrayLike, truth: ArrayLike) -> tuple[Float64Array, Float64Array]:
    called = as_real_array(labels, "labels", ndim=(2, 3))
    true = as_real_array(truth, "truth", ndim=(2, 3))
    if called.shape != true.shape:
        raise ShapeError(f"labels has shape {called.shape} and truth {true.shape}; expected the same shape.")
    return np.argwhere(called > 0).astype(np.float64), np.argwhere(true > 0).astype(np.float64)


def _nearest(points: Float64Array, others: Float64Array, limit: float) -> tuple[Float64Array, AnyArray]:
    """Distance from each point to the nearest other one (infinite past the limit) and that one's number."""
    from scipy.spatial import cKDTree

    if not len(points) or not len(others):
        return np.full(len(points), np.inf), np.zeros(len(points), np.int64)
    tree = cKDTree(others)
    # The bound is exclusive in the tree and inclusive here; squares of distances between voxels are whole numbers.
    distance, index = tree.query(points, distance_upper_bound=limit + 1e-6)
    return np.asarray(distance), np.asarray(index)
