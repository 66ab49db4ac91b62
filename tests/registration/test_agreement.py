"""What both scans' normals agree on: real and feigned curvature told apart, forms that keep what is real."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.agreement import Agreement, agreed_form, agreement, holding_form
from seismo3d.registration.constraints import model_number
from seismo3d.registration.dense import prepare_pair
from seismo3d.registration.matching import match_surface
from seismo3d.scan import Scan


def look(rng, bumps, noise=0.01):
    """Match two noisy samples of a plane with gentle bumps; return the pass, source, target map and cutoff."""

    def sample():
        u, v = rng.uniform(-1, 1, size=(2, 8000))
        z = bumps * np.sin(6 * u) * np.cos(5 * v)
        return np.column_stack([u, v, z]) + noise * rng.normal(size=(8000, 3))

    pair = prepare_pair(
        Scan.from_points(sample()), Scan.from_points(sample()), voxel_size=None, n_threads=1, symmetric=False
    )
    target, source = pair.target[0], pair.source[0].surface
    cutoff = target.size
    seen = match_surface(source, target, np.eye(3), np.zeros(3), radius=1.5 * cutoff, cutoff=cutoff)
    return seen, source, target, cutoff


def test_a_noisy_plane_feigns_three_directions(rng):
    seen, source, target, cutoff = look(rng, 0.0)
    found = agreement(seen, source, target, np.eye(3), cutoff, "rigid", final=True)
    assert (~found.real).sum() == 3
    np.testing.assert_allclose(found.duals.T @ found.directions, np.eye(found.real.size), atol=1e-9)


def test_bumps_as_high_as_the_noise_are_real(rng):
    found = agreement(*_with_eye(look(rng, 0.03)), "rigid", final=True)
    assert found is None or found.real.all()


def _with_eye(looked):
    seen, source, target, cutoff = looked
    return seen, source, target, np.eye(3), cutoff


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_only_what_is_feigned_is_taken_out(rng, model):
    seen, *_ = look(rng, 0.03)
    A, t = np.eye(3), np.array([0.01, 0.02, -0.03])
    J = parameter_jacobian(A, model_number(model))
    n, m = J.shape
    duals = rng.normal(size=(m, m))
    directions = np.linalg.inv(duals).T
    found = Agreement(directions[:, :2], duals[:, :2], np.array([False, True]))
    out = agreed_form(seen.form, A, t, model, found)
    H, before = (J.T @ Q[:n, :n] @ J for Q in (out, seen.form))
    np.testing.assert_allclose(H @ directions[:, 0], 0.0, atol=1e-9 * np.abs(before).max())
    kept = directions[:, 1:]
    np.testing.assert_allclose(kept.T @ H @ kept, kept.T @ before @ kept, rtol=1e-9)
    z = np.concatenate([A.ravel(order="F"), t, [1.0]])
    np.testing.assert_allclose(z @ out @ z, z @ seen.form @ z, rtol=1e-9)
    slope, slope_before = (J.T @ (Q @ z)[:n] for Q in (out, seen.form))
    np.testing.assert_allclose(kept.T @ slope, kept.T @ slope_before, rtol=1e-7, atol=1e-9)
    assert abs(directions[:, 0] @ slope) < 1e-9 * np.abs(slope_before).max()


def test_what_holds_has_its_minimum_where_it_holds(rng):
    seen, *_ = look(rng, 0.0)
    A, t = np.eye(3), np.array([0.1, 0.2, 0.3])
    J = parameter_jacobian(A, 1)
    unseen = np.linalg.qr(rng.normal(size=(6, 2)))[0]
    held = holding_form(seen.form, A, t, "rigid", unseen)
    z = np.concatenate([A.ravel(order="F"), t, [1.0]])
    np.testing.assert_allclose(held @ z, 0.0, atol=1e-9 * np.abs(held).max())
    values = np.linalg.eigvalsh(J.T @ held[:12, :12] @ J)
    assert values[-2] > 0.0
    np.testing.assert_allclose(values[:4], 0.0, atol=1e-9 * values[-1])
