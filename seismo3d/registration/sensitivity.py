"""How much of the form's curvature is left once pairs are allowed to change: the covariance's correction for noise."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration import _kernels_newton as kernels
from seismo3d.registration.constraints import model_number
from seismo3d.registration.matching import match_surface
from seismo3d.registration.quadratic import stack
from seismo3d.registration.solvers import Prior, moved_from

STEP = 0.3
"""Displacement to probe with, in robust standard deviations of the residuals."""
FEWEST = 0.1
"""Least share of the curvature that is left."""
LEAST = 1e-6
"""Share of the largest curvature below which directions are not probed."""


def rematched_form(
    form: Float64Array,
    target: VoxelMap,
    source: Float32Array,
    A: Float64Array,
    t: Float64Array,
    *,
    model: str,
    cutoff: float,
    spread: float,
) -> Float64Array:
    """Return a form whose curvature is what is left of it with pairs matched anew, direction by direction.

    Nearest pairs follow the source as it moves, so that residuals of noisy surfaces grow by less than it moves, and
    noise of the normals adds to the curvature with pairs held; so the transform is known less well than its pairs
    pretend, least along what surfaces tell least of. Where noise is small next to the voxels nothing changes.

    Parameters
    ----------
    form : ndarray
        Of all pairs, held.
    target : VoxelMap
    source : ndarray of shape (n, 8), float32
        Surface elements to probe with; a thousand are plenty.
    A, t : ndarray
        The solution in the frame.
    model : str
    cutoff, spread : float
        Of the loop's last pass.
    """
    J = kernels.parameter_jacobian(A, model_number(model))
    n, m = J.shape
    held = match_surface(source, target, A, t, radius=1.5 * target.size, cutoff=cutoff)
    if held.weight <= 0.0 or spread <= 0.0:
        return form
    curvature = J.T @ held.form[:n, :n] @ J * max(held.slope / held.weight, 0.2)
    values, directions = np.linalg.eigh(curvature)
    slope = J.T @ (held.form @ stack(A, t))[:n]
    roots = np.ones(m)
    for k in np.flatnonzero(values > LEAST * values[-1]):
        step = STEP * spread / float(np.sqrt(values[k] / held.weight))
        B, u = moved_from(Prior(A, t), step * directions[:, k], model)
        seen = match_surface(source, target, B, u, radius=1.5 * target.size, cutoff=cutoff)
        change_of_slope = directions[:, k] @ (J.T @ (seen.form @ stack(B, u))[:n] - slope)
        roots[k] = np.sqrt(np.clip(change_of_slope / (step * values[k]), FEWEST, 1.0))
    change = np.eye(n + 1)
    change[:n, :n] -= J @ (directions * (1.0 - roots)) @ directions.T @ np.linalg.pinv(J)
    return np.asarray(change.T @ form @ change)
