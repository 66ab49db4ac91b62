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
FEWEST = 0.3


def rematched_share(
    target: VoxelMap,
    source: Float32Array,
    A: Float64Array,
    t: Float64Array,
    *,
    model: str,
    cutoff: float,
    spread: float,
) -> float:
    """Return the curvature along translations with pairs matched anew, over that with pairs held; at most 1.

    Nearest pairs follow the source as it moves, so that residuals of noisy surfaces grow by less than it moves, and the
    transform is known less well than its pairs pretend. Where noise is small next to the voxels the share is 1.

    Parameters
    ----------
    target : VoxelMap
    source : ndarray of shape (n, 8), float32
        Surface elements to probe with; a thousand are plenty.
    A, t : ndarray
        The solution in the frame.
    model : str
    cutoff, spread : float
        Of the loop's last pass.
    """
    d = t.size
    number = model_number(model)
    J = kernels.parameter_jacobian(A, number)
    n, m = J.shape
    first = d * d if model == "affine" else kernels.n_rotation(number, d)
    held = match_surface(source, target, A, t, radius=1.5 * target.size, cutoff=cutoff)
    if held.weight <= 0.0 or spread <= 0.0:
        return 1.0
    curvature = np.diag(J.T @ held.form[:n, :n] @ J) * max(held.slope / held.weight, 0.2)
    shares = []
    for k in range(first, first + d):
        if curvature[k] < 1e-3 * curvature[first : first + d].max():
            continue
        step = STEP * spread / float(np.sqrt(curvature[k] / held.weight))
        slopes = []
        for sign in (1.0, -1.0):
            offset = np.zeros(m)
            offset[k] = sign * step
            B, u = moved_from(Prior(A, t), offset, model)
            seen = match_surface(source, target, B, u, radius=1.5 * target.size, cutoff=cutoff)
            slopes.append(float(J[:, k] @ (seen.form @ stack(B, u))[:n]))
        shares.append((slopes[0] - slopes[1]) / (2.0 * step) / curvature[k])
    return float(np.clip(np.mean(shares), FEWEST, 1.0)) if shares else 1.0
