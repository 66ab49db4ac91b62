r"""A proof that a rotation is the best of all for its quadratic form, or the size of the doubt.

With y = [vec(R); 1] and P_k any symmetric matrices with :math:`y^T P_k y = 0` on all of SO(3), every choice of
multipliers gives

.. math:: \min_{SO(3)} y^T F y \ge f^* - 4 \max(0, -\lambda_{\min}(S)), \quad S = F - \sum_k \lambda_k P_k - f^* E,

since :math:`|y|^2 = 4`. The constraints are R'R = I, R R' = I and the cross products of the columns: 20 independent
ones. The certificate speaks for the given correspondences; it says nothing about whether those are the right ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import permutations, product

import numpy as np

from seismo3d._typing import Float64Array

TOLERANCE = 1e-8
"""A certificate holds where its gap is below this share of the form's norm."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """How far from the global minimum, at most, a solution is.

    Attributes
    ----------
    gap : float
        No transformation of the model has an energy lower than the solution's by more than this. Units of the weighted
        squared residuals: the input's units squared, for weights without unit.
    relative_gap : float
        The gap over the Frobenius norm of the quadratic form in the centred, scaled frame.
    holds : bool
        The relative gap is zero to numerical accuracy: the solution is the global minimum.
    """

    gap: float
    relative_gap: float
    holds: bool


@cache
def octahedral_rotations() -> Float64Array:
    """Return the 24 rotations that carry the axes onto themselves; shape (24, 3, 3)."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0:
                found.append(R)
    return np.array(found)


@cache
def constraint_matrices() -> Float64Array:
    """Return an orthonormal basis of the matrices P with y' P y = 0 on SO(3); shape (20, 10, 10)."""
    rows = []
    for i in range(3):
        for j in range(i, 3):
            for stride, step in ((3, 1), (1, 3)):
                P = np.zeros((10, 10))
                for k in range(3):
                    a, b = stride * i + step * k, stride * j + step * k
                    P[a, b] += 0.5
                    P[b, a] += 0.5
                P[9, 9] -= float(i == j)
                rows.append(P.ravel())
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            a, b = (c + 1) % 3, (c + 2) % 3
            P = np.zeros((10, 10))
            for p, q, sign in ((3 * i + a, 3 * j + b, 0.5), (3 * i + b, 3 * j + a, -0.5), (3 * k + c, 9, -0.5)):
                P[p, q] += sign
                P[q, p] += sign
            rows.append(P.ravel())
    _, values, Vt = np.linalg.svd(np.array(rows))
    n = int((values > 1e-10 * values[0]).sum())
    return np.ascontiguousarray(Vt[:n].reshape(n, 10, 10))


@cache
def multiplier_tables() -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return what does not depend on the form, in the frame where the found rotation is I.

    Returns
    -------
    correction : ndarray of shape (10, 10, 10)
        Sum of lambda_k P_k for each unit vector as right-hand side of the least-squares multipliers.
    null : ndarray of shape (k, 10, 10)
        Basis of the combinations of constraints that y is in the null space of.
    small : ndarray of shape (k, 81)
        The same on y's complement, flat.
    basis : ndarray of shape (10, 9)
        Orthonormal basis of y's complement.
    """
    P = constraint_matrices()
    y = np.append(np.eye(3).ravel(), 1.0)
    K = (P @ y).T
    correction = np.einsum("kc,kab->cab", np.linalg.pinv(K, rcond=1e-10), P)
    _, values, Vt = np.linalg.svd(K)
    rank = int((values > 1e-10 * values[0]).sum())
    null = np.einsum("jk,kab->jab", Vt[rank:], P)
    basis = np.linalg.svd(y[:, None])[0][:, 1:]
    small = np.einsum("ap,jab,bq->jpq", basis, null, basis).reshape(len(null), 81)
    return (
        np.ascontiguousarray(correction),
        np.ascontiguousarray(null),
        np.ascontiguousarray(small),
        np.ascontiguousarray(basis),
    )
