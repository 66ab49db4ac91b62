"""The certificate: it holds at the global minimum, and is refused where the relaxation has a gap."""

from __future__ import annotations

import numpy as np

from seismo3d.geometry.rotations import random_rotation, rotation_from_quaternion
from seismo3d.registration import _kernels_rigid as kernels
from seismo3d.registration.certificate import constraint_matrices, multiplier_tables, octahedral_rotations
from seismo3d.registration.solvers import Limits, Prior, solve_form

FREE = Limits(np.full(6, -np.inf), np.full(6, np.inf))
ORIGIN = Prior(np.eye(3), np.zeros(3))


def choi_lam_form() -> np.ndarray:
    """The form whose value at a rotation is w^4 + x^2 y^2 + y^2 z^2 + z^2 x^2 - 4 x y z w of its quaternion.

    The quartic is not negative, with minimum 0, and is no sum of squares, so that no multipliers can prove the minimum.
    """
    q = np.random.default_rng(1).normal(size=(200, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    x, y, z, w = q.T
    values = w**4 + x * x * y * y + y * y * z * z + z * z * x * x - 4 * x * y * z * w
    Y = np.array([np.append(rotation_from_quaternion(row).ravel(order="F"), 1.0) for row in q])
    rows, columns = np.triu_indices(10)
    table = Y[:, rows] * Y[:, columns] * np.where(rows == columns, 1.0, 2.0)
    entries = np.linalg.lstsq(table, values, rcond=None)[0]
    assert np.abs(table @ entries - values).max() < 1e-12
    form = np.zeros((10, 10))
    form[rows, columns] = entries
    form.T[rows, columns] = entries
    Q = np.zeros((13, 13))
    keep = [*range(9), 12]
    Q[np.ix_(keep, keep)] = form
    return Q


def test_there_are_twenty_constraints_and_rotations_fulfil_them(rng):
    P = constraint_matrices()
    assert P.shape == (20, 10, 10)
    for _ in range(20):
        y = np.append(random_rotation(rng).ravel(order="F"), 1.0)
        np.testing.assert_allclose(np.einsum("a,kab,b->k", y, P, y), 0.0, atol=1e-13)


def test_null_combinations_keep_the_identity_in_their_null_space():
    y = np.append(np.eye(3).ravel(), 1.0)
    np.testing.assert_allclose(multiplier_tables()[1] @ y, 0.0, atol=1e-13)


def test_octahedral_rotations_are_a_group_of_24():
    R = octahedral_rotations()
    assert len({tuple(r.ravel()) for r in R}) == 24
    assert tuple((R[3] @ R[17]).ravel()) in {tuple(r.ravel()) for r in R}


def test_choi_lam_form_is_solved_and_its_certificate_refused():
    found = solve_form(choi_lam_form(), model="rigid", prior=ORIGIN, limits=FREE, ratio=0.0)
    assert abs(found.value) < 1e-12
    assert found.gap / found.norm > 1e-2


def test_bound_is_below_the_value_of_every_rotation(rng):
    X = rng.normal(size=(13, 13))
    Q = X + X.T
    Q[9:12, 9:12] = np.eye(3)
    found = solve_form(Q, model="rigid", prior=ORIGIN, limits=FREE, ratio=0.0)
    F, _ = kernels.reduce_translation(Q, np.zeros(3))
    values = [kernels.form_value(F, random_rotation(rng)) for _ in range(2000)]
    assert min(values) >= found.value - found.gap - 1e-9


def test_indefinite_random_forms_are_solved_globally(rng):
    for _ in range(40):
        X = rng.normal(size=(13, 13))
        Q = X + X.T
        Q[9:12, 9:12] = np.eye(3)
        found = solve_form(Q, model="rigid", prior=ORIGIN, limits=FREE, ratio=0.0)
        F, _ = kernels.reduce_translation(Q, np.zeros(3))
        best = min(kernels.newton_rotation(F, random_rotation(rng)) for _ in range(40))
        assert found.value <= best + 1e-9 * found.norm
        assert found.gap <= 1e-8 * found.norm
