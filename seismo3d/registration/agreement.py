r"""Which curvature of the surfaces' form is real: what the normals of both scans agree on.

Noise makes the normals of a plane waver, and wavering normals seem to hold what slides along it: their squares add up
to curvature that is not there. Noise of the two scans is independent, though. With rows :math:`a_i` of residuals taken
along the target's normals and rows :math:`b_i` along the source's, the noise's part of :math:`\sum w a_i a_i^T` grows
with the number of pairs, that of :math:`\sum w (a_i b_i^T + b_i a_i^T) / 2` averages to zero: the second normal is an
instrument for the first. The generalised eigenvectors of the two matrices are the directions along which the scans
agree most and least, whatever the units; along a direction the sum over patches of the surface, next to their scatter,
tells whether any of the curvature is real.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, Int64Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.constraints import model_number
from seismo3d.registration.matching import Pass
from seismo3d.registration.quadratic import stack

AGREED = 0.5
"""Share of a direction's curvature from which it counts as real without a further look."""
SURE, PERHAPS = 2.5, 0.0
"""Standard deviations by which less than that must exceed zero to be real: in the end, and on the way there, where a
direction that is held in vain loses the way, and one that is let go in vain is led back in the end."""
HELD = 0.01
"""Curvature that holds a direction where it is, as a share of the largest."""
PATCH = 4.0
"""Width of a patch whose noise is taken as independent of its neighbours', in voxels."""
LEAST = 1e-9
"""Share of the largest curvature below which none is real."""
FEWEST = 40
"""Fewest pairs, and fewest directions' patches, to tell from."""


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Directions of the parameters in which most curvature is noise, and whether any of it is real.

    Attributes
    ----------
    directions, duals : ndarray of shape (m, k), float64
        Columns: a step x goes as far as ``duals[:, i] @ x`` along ``directions[:, i]``.
    real : ndarray of shape (k,), bool
    """

    directions: Float64Array
    duals: Float64Array
    real: BoolArray


def agreement(
    surface: Pass, source: Float32Array, target: VoxelMap, A: Float64Array, cutoff: float, model: str, *, final: bool
) -> Agreement | None:
    """Return the directions in which the scans agree little, with their real shares; None where all is well agreed.

    Parameters
    ----------
    surface : Pass
    source : ndarray of shape (n, 8), float32
        The elements of that pass.
    target : VoxelMap
    A : ndarray of shape (d, d), float64
        Linear part of the transform of that pass.
    cutoff : float
        Of that pass.
    model : str
    final : bool
        Ask for certainty, as on the finest level.
    """
    d = A.shape[0]
    turned = source[:, 4 : 4 + d] @ A.T.astype(np.float32)
    length = np.sqrt((turned * turned).sum(axis=1))
    usable = np.flatnonzero((np.abs(surface.residuals) < cutoff) & (length > 0.0))
    if len(usable) < FEWEST:
        return None
    normals = surface.normals[usable, :d].astype(np.float64)
    others = turned[usable] / length[usable, None].astype(np.float64)
    others *= np.where((normals * others).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    places = np.ones((len(usable), d + 1))
    places[:, :d] = source[usable, :d]
    weights = source[usable, 7] * (1.0 - (surface.residuals[usable] / cutoff) ** 2) ** 2
    J = parameter_jacobian(A, model_number(model))
    a, b = (_rows(places, n) @ J for n in (normals, others))
    weighted = a * weights[:, None]
    directions, duals, agreed = _least_agreed(weighted.T @ a, weighted.T @ b)
    weak = agreed < AGREED
    if not weak.any():
        return None
    directions, duals = directions[:, weak], duals[:, weak]
    patches = _patches(target.surface[surface.partners[usable], :d], PATCH * target.size)
    parts = (weighted @ directions) * (b @ directions)
    sums = np.stack([np.bincount(patches, column) for column in parts.T], axis=1)
    scatter = np.sqrt((sums**2).sum(axis=0))
    return Agreement(directions, duals, sums.sum(axis=0) > (SURE if final else PERHAPS) * scatter)


def agreed_form(form: Float64Array, A: Float64Array, t: Float64Array, model: str, found: Agreement) -> Float64Array:
    """Return the surfaces' form without the curvature and the gradient along directions of which nothing is real."""
    J = parameter_jacobian(A, model_number(model))
    n = J.shape[0]
    feigned = ~found.real
    along = found.directions[:, feigned] @ found.duals[:, feigned].T
    back = np.linalg.pinv(J)
    bend = np.eye(n) - J @ along @ back
    turn = J @ (np.eye(J.shape[1]) - along) @ back
    z = stack(A, t)[:n]
    gradient = turn.T @ (form[:n, :n] @ z + form[:n, n])
    out = np.empty_like(form)
    out[:n, :n] = bend.T @ form[:n, :n] @ bend
    out[:n, n] = out[n, :n] = gradient - out[:n, :n] @ z
    value = float(z @ form[:n, :n] @ z + 2.0 * form[:n, n] @ z + form[n, n])
    out[n, n] = value - 2.0 * gradient @ z + z @ out[:n, :n] @ z
    return out


def holding_form(
    form: Float64Array, A: Float64Array, t: Float64Array, model: str, unseen: Float64Array
) -> Float64Array:
    """Return a form that holds unseen directions (columns) at (A, t): without any curvature rounding leads off."""
    J = parameter_jacobian(A, model_number(model))
    n = J.shape[0]
    rows = unseen.T @ np.linalg.pinv(J)
    z = stack(A, t)[:n]
    held = HELD * float(np.linalg.eigvalsh(J.T @ form[:n, :n] @ J)[-1]) * rows.T @ rows
    out = np.empty_like(form)
    out[:n, :n] = held
    out[:n, n] = out[n, :n] = -held @ z
    out[n, n] = z @ held @ z
    return out


def _rows(places: Float64Array, normals: Float64Array) -> Float64Array:
    """Return the rows of residuals in [vec(A); t], one a pair."""
    return np.asarray((places[:, :, None] * normals[:, None, :]).reshape(len(places), -1))


def _least_agreed(own: Float64Array, cross: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return generalised eigenvectors of the symmetric part of ``cross`` by ``own``, duals, eigenvalues (ascending)."""
    values, vectors = np.linalg.eigh(own)
    root = np.sqrt(np.maximum(values, LEAST * values[-1]))
    both = (vectors / root).T @ (0.5 * (cross + cross.T)) @ (vectors / root)
    agreed, turn = np.linalg.eigh(both)
    return (vectors / root) @ turn, (vectors * root) @ turn, agreed


def _patches(points: Float32Array, width: float) -> Int64Array:
    """Return the number of the patch that each point lies in."""
    cells = np.floor((points - points.min(axis=0)) / width).astype(np.int64)
    keys = cells[:, 0]
    for column in cells.T[1:]:
        keys = keys * (int(column.max()) + 1) + column
    return np.asarray(np.unique(keys, return_inverse=True)[1], dtype=np.int64)
