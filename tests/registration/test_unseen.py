"""Directions that surfaces do not see: feigned and real curvature told apart, forms that keep the rest."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.registration._kernels_newton import parameter_jacobian
from seismo3d.registration.constraints import model_number
from seismo3d.registration.dense import prepare_pair
from seismo3d.registration.matching import match_surface
from seismo3d.registration.quadratic import stack
from seismo3d.registration.register import register
from seismo3d.registration.unseen import Look, is_weak, unseen_directions, weak_directions, without
from seismo3d.scan import Scan


def floor(rng, height, noise=0.015):
    """A floor whose middle swells by a height, in noise."""
    u, v = rng.uniform(-1, 1, size=(2, 30000))
    z = height * np.exp(-4.0 * (u**2 + 0.5 * v**2 + 0.5 * u * v))
    return np.column_stack([u, v, z]) + noise * rng.normal(size=(30000, 3))


def looks(rng, height):
    pair = prepare_pair(
        Scan.from_points(floor(rng, height)),
        Scan.from_points(floor(rng, height)),
        voxel_size=0.03,
        n_threads=1,
        symmetric=False,
    )
    out = []
    for target, source in zip(pair.target, pair.source):
        seen = match_surface(
            source.surface, target, np.eye(3), np.zeros(3), radius=1.5 * target.size, cutoff=target.size
        )
        out.append(Look(seen, source.surface))
    return out


def test_a_noisy_floor_feigns_three_directions(rng):
    seen = looks(rng, 0.0)
    assert len(seen) > 1
    assert is_weak(seen[0].surface, np.eye(3), "rigid")
    unseen = unseen_directions(seen, np.eye(3), "rigid")
    assert unseen.shape == (6, 3)
    np.testing.assert_allclose(unseen.T @ unseen, np.eye(3), atol=1e-9)
    assert np.abs(unseen[[0, 1, 5]]).max() < 0.1  # turning about the normal and sliding along the floor


def test_coarser_levels_show_that_a_gentle_swell_is_real(rng):
    seen = looks(rng, 0.05)
    assert unseen_directions(seen[:1], np.eye(3), "rigid").shape[1] >= 2
    assert unseen_directions(seen, np.eye(3), "rigid").shape[1] == 1  # only turning about it is still in doubt


def test_weak_directions_are_those_below_a_share(rng):
    seen = looks(rng, 0.0)[0].surface
    assert weak_directions(seen, np.eye(3), "rigid", 1.0 + 1e-9).shape[1] == 6  # the largest is its own share
    assert weak_directions(seen, np.eye(3), "rigid", 0.0).shape[1] == 0


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_a_form_without_a_direction_is_level_along_it_and_keeps_the_rest(rng, model):
    form = looks(rng, 0.05)[0].surface.form
    A, t = np.eye(3), np.array([0.01, 0.02, -0.03])
    J = parameter_jacobian(A, model_number(model))
    n, m = J.shape
    turn = np.linalg.qr(rng.normal(size=(m, m)))[0]
    unseen, rest = turn[:, :2], turn[:, 2:]
    out = without(form, A, t, model, unseen)
    H, before = (J.T @ Q[:n, :n] @ J for Q in (out, form))
    z = stack(A, t)
    slope, slope_before = (J.T @ (Q @ z)[:n] for Q in (out, form))
    small = 1e-9 * np.abs(before).max()
    np.testing.assert_allclose(H @ unseen, 0.0, atol=small)
    np.testing.assert_allclose(slope @ unseen, 0.0, atol=small)
    np.testing.assert_allclose(rest.T @ H @ rest, rest.T @ before @ rest, rtol=1e-7, atol=small)
    np.testing.assert_allclose(slope @ rest, slope_before @ rest, rtol=1e-7, atol=small)
    np.testing.assert_allclose(z @ out @ z, z @ form @ z, rtol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.002, 0.005, 0.01])
def test_a_corridor_hides_one_direction(rng, noise):
    def walls(n=30000):
        p = rng.uniform(-1, 1, size=(n, 3)) * [3.0, 1.0, 1.0]
        side = rng.integers(0, 3, n)
        p[side == 0, 1], p[side == 1, 1], p[side == 2, 2] = -1.0, 1.0, -1.0
        return p + noise * rng.normal(size=(n, 3))

    found = register(walls(), walls() + np.array([0.0, 0.02, 0.01]), stages=("local",))
    assert len(found.unobservable) == 1
    along = np.abs(found.unobservable[0].translation)
    assert along[0] > 10 * along[1:].max()
    np.testing.assert_allclose(found.T_target_source[1:3, 3], [-0.02, -0.01], atol=0.003)


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.005])
@pytest.mark.parametrize(("shape", "hidden"), [("ball", (2, 3)), ("pipe", (2,))])
def test_round_shapes_hide_their_own_motions(rng, shape, hidden, noise):
    def points(n=4000):
        p = rng.normal(size=(n, 3))
        if shape == "pipe":
            p[:, 2] = 0.0
        p /= np.linalg.norm(p, axis=1, keepdims=True)
        if shape == "pipe":
            p[:, 2] = rng.uniform(-2, 2, n)
        return p + noise * rng.normal(size=p.shape)

    shift = np.array([0.02, 0.01, 0.0])
    found = register(points(), points() + shift, stages=("local",))
    assert len(found.unobservable) in hidden  # noise and sampling may feign the third of a ball
    np.testing.assert_allclose(found.apply(shift[None])[0, :2], 0.0, atol=0.01)


def test_a_gentle_swell_without_noise_is_seen(rng):
    shift = np.array([0.02, -0.01, 0.01])
    found = register(floor(rng, 0.03, noise=0.0), floor(rng, 0.03, noise=0.0) + shift, stages=("local",))
    assert not found.unobservable
    np.testing.assert_allclose(found.T_target_source[:3, 3], -shift, atol=1e-3)


@pytest.mark.parametrize("noise", [0.001, 0.003, 0.01])
@pytest.mark.parametrize("shape", ["corridor", "two planes"])
def test_walls_that_are_sampled_thinly_hide_what_slides_along_all_of_them(rng, shape, noise):
    # Few points a voxel: each scan's own normals hold the motion along the walls, and those of the other do not agree.
    def points(n=10000):
        if shape == "corridor":
            p = rng.uniform(-1, 1, size=(n, 3)) * [3.0, 1.0, 1.0]
            p[np.arange(n), rng.integers(1, 3, n)] = rng.choice([-1.0, 1.0], n)
        else:  # a floor, and a wall on it, along y
            p = np.column_stack([rng.uniform(-1, 1, size=(n, 2)), np.zeros(n)])
            p[: n // 2] = np.column_stack([np.zeros(n // 2), p[: n // 2, 0], np.abs(p[: n // 2, 1])])
        return p + noise * rng.normal(size=(n, 3))

    truth = make_transform(exp_rotation([0.02, -0.03, 0.05]), [0.05, 0.02, -0.04])
    found = register(transform_points(truth, points()), points(), stages=("local",))
    assert len(found.unobservable) == 1
    along = truth[:3, 0] if shape == "corridor" else truth[:3, 1]
    hidden = found.unobservable[0].translation
    assert np.abs(hidden @ along) > 0.99 * np.linalg.norm(hidden)
    assert np.isinf(found.covariance).any()
