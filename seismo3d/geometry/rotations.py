"""Rotations and rigid motions in two and three dimensions.

Frame conventions, here once for the whole package:

- A transform is called ``T_target_source``: a homogeneous matrix of shape (d+1, d+1) that maps column vectors of the
  source frame into the target frame, ``p_target = T_target_source @ [p_source, 1]``.
- A rotation vector is axis times angle in radians (d = 3), or the angle alone in an array of one element (d = 2).
- A tangent vector of a rigid motion is (rotation, translation); perturbations act on the left, in the target frame.
"""

from __future__ import annotations

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d.errors import ShapeError

# radians below which the closed forms lose their digits and series are taken
_SMALL = 1e-6


def skew(vector: ArrayLike) -> Float64Array:
    """Return the cross-product matrix of a 3-vector, or the turned unit matrix times the angle in 2D.

    Parameters
    ----------
    vector : array_like of shape (3,) or (1,)
        Rotation vector in radians.

    Returns
    -------
    ndarray of shape (3, 3) or (2, 2), float64
    """
    v = np.asarray(vector, dtype=np.float64).ravel()
    if v.size == 1:
        return np.array([[0.0, -v[0]], [v[0], 0.0]])
    if v.size != 3:
        raise ShapeError(f"vector has {v.size} elements; expected 3 (in space) or 1 (in the plane).")
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def exp_rotation(vector: ArrayLike) -> Float64Array:
    """Return the rotation matrix of a rotation vector (Rodrigues' formula).

    Parameters
    ----------
    vector : array_like of shape (3,) or (1,)
        Axis times angle, or the angle alone, in radians.

    Returns
    -------
    ndarray of shape (3, 3) or (2, 2), float64

    Examples
    --------
    >>> exp_rotation([0.0, 0.0, np.pi / 2]).round(6) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    """
    W = skew(vector)
    if W.shape[0] == 2:
        c, s = np.cos(W[1, 0]), np.sin(W[1, 0])
        return np.array([[c, -s], [s, c]])
    angle = float(np.linalg.norm(np.asarray(vector, dtype=np.float64)))
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + first * W + second * (W @ W)


def log_rotation(R: ArrayLike) -> Float64Array:
    """Return the rotation vector of a rotation matrix; the inverse of :func:`exp_rotation` up to the angle pi.

    Parameters
    ----------
    R : array_like of shape (3, 3) or (2, 2)
        Rotation matrix.

    Returns
    -------
    ndarray of shape (3,) or (1,), float64
        Radians, of length at most pi.
    """
    matrix = _square(R, "R")
    if matrix.shape[0] == 2:
        return np.array([np.arctan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1])])
    w, *xyz = quaternion_from_rotation(matrix)
    vector = np.array(xyz)
    length = float(np.linalg.norm(vector))
    if length < _SMALL:
        return 2.0 * vector / w
    return 2.0 * np.arctan2(length, w) / length * vector


def rotation_angle(R: ArrayLike) -> float:
    """Return the angle of a rotation matrix in radians, 0 to pi."""
    return float(np.linalg.norm(log_rotation(R)))


def quaternion_from_rotation(R: ArrayLike) -> Float64Array:
    """Return the unit quaternion (w, x, y, z), w not negative, of a rotation matrix of shape (3, 3)."""
    m = _square(R, "R")
    K = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [0.0, m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [0.0, 0.0, m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [0.0, 0.0, 0.0, m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    q = np.linalg.eigh(K, UPLO="U")[1][:, -1]
    return q if q[0] >= 0.0 else -q


def rotation_from_quaternion(quaternion: ArrayLike) -> Float64Array:
    """Return the rotation matrix of a quaternion (w, x, y, z), normalised first."""
    q = np.asarray(quaternion, dtype=np.float64)
    if q.shape != (4,) or not np.linalg.norm(q) > 0.0:
        raise ShapeError(f"quaternion is {quaternion!r}; expected four numbers (w, x, y, z), not all zero.")
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def nearest_rotation(A: ArrayLike) -> Float64Array:
    """Return the rotation nearest to a square matrix in the Frobenius norm; never a reflection."""
    U, _, Vt = np.linalg.svd(_square(A, "A"))
    U[:, -1] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    return np.asarray(U @ Vt)


def random_rotation(rng: np.random.Generator, *, dim: int = 3) -> Float64Array:
    """Return a rotation drawn evenly from all rotations of the plane (dim 2) or of space (dim 3)."""
    if dim == 2:
        return exp_rotation([rng.uniform(-np.pi, np.pi)])
    return rotation_from_quaternion(rng.normal(size=4))


def left_jacobian(vector: ArrayLike) -> Float64Array:
    """Return J with exp(v + w) = exp(J w) exp(v) to first order in w, for a rotation vector v."""
    W = skew(vector)
    if W.shape[0] == 2:
        return np.eye(1)
    angle = float(np.linalg.norm(np.asarray(vector, dtype=np.float64)))
    if angle < _SMALL:
        return np.eye(3) + W / 2
    return np.asarray(np.eye(3) + (1 - np.cos(angle)) / angle**2 * W + (angle - np.sin(angle)) / angle**3 * (W @ W))


def make_transform(A: ArrayLike, t: ArrayLike) -> Float64Array:
    """Return the homogeneous matrix of ``p -> A p + t``; shape (d+1, d+1)."""
    linear = _square(A, "A")
    d = linear.shape[0]
    T = np.eye(d + 1)
    T[:d, :d] = linear
    T[:d, d] = np.asarray(t, dtype=np.float64)
    return T


def split_transform(T: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the rotation and the translation of a rigid transform, each contiguous in memory."""
    return np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3])


def transform_points(T: ArrayLike, points: ArrayLike) -> Float64Array:
    """Apply a homogeneous matrix to points, one a row; shape (n, d) in, (n, d) out."""
    matrix = _square(T, "T")
    d = matrix.shape[0] - 1
    return np.asarray(np.asarray(points, dtype=np.float64) @ matrix[:d, :d].T + matrix[:d, d])


def invert_transform(T: ArrayLike) -> Float64Array:
    """Return the inverse of a homogeneous matrix; for a rigid motion it is rigid again."""
    matrix = _square(T, "T")
    d = matrix.shape[0] - 1
    linear = np.linalg.inv(matrix[:d, :d])
    return make_transform(linear, -linear @ matrix[:d, d])


def _square(matrix: ArrayLike, name: str) -> Float64Array:
    array = np.asarray(matrix, dtype=np.float64)
    if array.ndim != 2 or array.shape[0] != array.shape[1] or array.shape[0] < 2:
        raise ShapeError(f"{name} has shape {array.shape}; expected a square matrix.")
    return array


def adjoint(T: Float64Array) -> Float64Array:
    """Return the matrix (6, 6) that carries a twist (rotation, translation) from the source to the target frame."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = T[:3, :3]
    out[3:, :3] = skew(T[:3, 3]) @ T[:3, :3]
    return out
