r"""The quadratic form that every model of transformation is solved on.

For a linear map A and a translation t write :math:`z = [\mathrm{vec}(A); t; 1]`, vec column by column. Residuals of
planes, :math:`n^T (A p + t - q)`, and of points, :math:`A f + t - g`, are linear in z, so that their weighted squares
add up to :math:`z^T Q z` with one symmetric Q: 13 x 13 in space, 7 x 7 in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration import _kernels_form as kernels


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The centred, scaled frame in which a form is kept: cancellation would cost six digits otherwise.

    A target point q becomes ``(q - target_center) / size``, a source point p ``growth * (p - source_center) / size``:
    linear parts in the frame are free of the growth, so that curvatures along turns, growths and shifts compare.

    Attributes
    ----------
    source_center, target_center : ndarray of shape (d,), float64
    size : float
        Root mean square distance of the source points from their centre, times the growth; never zero.
    growth : float
        Size of the target over the source's, where it is known and free; else 1.
    """

    source_center: Float64Array
    target_center: Float64Array
    size: float
    growth: float = 1.0

    @classmethod
    def of(cls, target: Float64Array, source: Float64Array, *, size_is_free: bool = False) -> Frame:
        """Return the frame of two point sets, of shapes (m, d) and (n, d)."""
        (centre, size), (target_centre, target_size) = _spread(source), _spread(target)
        if not size > 0.0:
            size = float(np.abs(source).max()) or 1.0
        growth = target_size / size if size_is_free and target_size > 0.0 else 1.0
        return cls(centre, target_centre, growth * size, growth)

    def source(self, points: Float64Array) -> Float64Array:
        """Return source points in the frame."""
        return np.ascontiguousarray((points - self.source_center) / (self.size / self.growth))

    def target(self, points: Float64Array) -> Float64Array:
        """Return target points in the frame."""
        return np.ascontiguousarray((points - self.target_center) / self.size)

    def enter(self, T: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return (A, t) in the frame of a homogeneous ``T_target_source`` in the input's units."""
        d = self.source_center.size
        A = np.ascontiguousarray(T[:d, :d])
        return A / self.growth, (A @ self.source_center + T[:d, d] - self.target_center) / self.size

    def leave(self, A: Float64Array, t: Float64Array) -> Float64Array:
        """Return the homogeneous ``T_target_source`` in the input's units of (A, t) in the frame."""
        d = self.source_center.size
        T = np.eye(d + 1)
        T[:d, :d] = self.growth * A
        T[:d, d] = self.size * t + self.target_center - T[:d, :d] @ self.source_center
        return T


def _spread(points: Float64Array) -> tuple[Float64Array, float]:
    """Return the centre of points, and their root mean square distance from it."""
    centre = points.mean(axis=0)
    return centre, float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean()))


def plane_form(
    target: Float64Array, source: Float64Array, normals: Float64Array, weights: Float64Array
) -> Float64Array:
    """Return Q of plane pairs, row by row; arrays of shape (n, d), weights of shape (n,)."""
    return np.asarray(kernels.plane_form(*_float64(source, target, normals, weights)))


def point_form(target: Float64Array, source: Float64Array, weights: Float64Array) -> Float64Array:
    """Return Q of point pairs, row by row.

    Parameters
    ----------
    target, source : ndarray of shape (n, d)
    weights : ndarray of shape (n,) or (n, d, d)
        One number a pair, or one information matrix (inverse covariance) a pair.

    Returns
    -------
    ndarray of shape (d(d+1)+1, d(d+1)+1), float64
    """
    if weights.ndim == 3:
        return np.asarray(kernels.point_form_full(*_float64(source, target, weights)))
    return np.asarray(kernels.point_form(*_float64(source, target, weights)))


def stack(A: Float64Array, t: Float64Array) -> Float64Array:
    """Return z = [vec(A); t; 1], vec column by column."""
    return np.concatenate([A.ravel(order="F"), t, [1.0]])


def _float64(*arrays: Float64Array) -> tuple[Float64Array, ...]:
    return tuple(np.ascontiguousarray(a, dtype=np.float64) for a in arrays)
