"""The transform that a caller gives to start from: checked, and brought into the class of the model."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_real_array
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.rotations import make_transform, nearest_rotation

MOST_OFF = 0.05
"""Share by which a start may stretch beyond what its model does: what rounding to two decimals leaves."""
_CLASSES = {
    "translation": "a rotation",
    "rigid": "a rotation",
    "similarity": "a rotation times one factor",
    "scaled": "a rotation times a factor an axis",
}


def as_start(T: ArrayLike, name: str, d: int, model: str) -> Float64Array:
    """Return a homogeneous matrix whose linear part is the nearest one of a model, or refuse it by name.

    Parameters
    ----------
    T : array_like of shape (d+1, d+1)
        Rounded a little, perhaps.
    name : str
    d : int
    model : str
        Its linear part stays as it is with ``affine``, and is turned into a rotation with ``translation``, which keeps
        it.

    Returns
    -------
    ndarray of shape (d+1, d+1), float64

    Raises
    ------
    ShapeError
        If it has another shape.
    ParameterError
        If it is no homogeneous matrix, mirrors, or is far from the model's class.
    """
    matrix = np.asarray(as_real_array(T, name, ndim=2), dtype=np.float64)
    if matrix.shape != (d + 1, d + 1):
        raise ShapeError(f"{name} has shape {matrix.shape}; expected {(d + 1, d + 1)}, a homogeneous matrix.")
    bottom = np.append(np.zeros(d), 1.0)
    A = matrix[:d, :d]
    if not np.isfinite(matrix).all() or not np.allclose(matrix[d], bottom) or not np.linalg.det(A) > 0.0:
        raise ParameterError(
            f"{name} is not a homogeneous matrix; expected a proper linear part and a last row of {bottom}."
        )
    return matrix if model == "affine" else make_transform(_of_class(A, name, model), matrix[:d, d])


def _of_class(A: Float64Array, name: str, model: str) -> Float64Array:
    """Return the linear part of a model's class that is nearest to another one."""
    sizes = np.ones(len(A))
    if model == "similarity":
        sizes = np.full(len(A), np.linalg.det(A) ** (1.0 / len(A)))
    elif model == "scaled":
        sizes = np.linalg.norm(A, axis=0)
    off = float(np.abs(np.linalg.svd(A / sizes, compute_uv=False) - 1.0).max())
    if off > MOST_OFF:
        raise ParameterError(
            f"{name} stretches by {100 * off:.3g} % beyond {_CLASSES[model]}; expected at most {100 * MOST_OFF:g} % "
            f"with model {model!r}. Give it with more digits, or choose a model that may stretch so."
        )
    return nearest_rotation(A / sizes) * sizes
