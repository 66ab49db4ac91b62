"""A given start: brought into the model's class where it is rounded, refused where it is far from it."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.registration.align import align_pairs
from seismo3d.registration.constraints import Constraints
from seismo3d.registration.register import register
from seismo3d.registration.start import as_start

ROTATION = exp_rotation([0.3, -0.5, 0.8])
EXACT = 1e-12  # products of rotations, in double precision
LINEAR = {
    "translation": ROTATION,
    "rigid": ROTATION,
    "similarity": 2.5 * ROTATION,
    "scaled": ROTATION * [0.5, 1.0, 4.0],
    "affine": ROTATION @ [[1.0, 0.4, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.3]],
}


@pytest.mark.parametrize("model", LINEAR)
def test_what_is_of_the_class_stays(model):
    T = make_transform(LINEAR[model], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(as_start(T, "start", 3, model), T, atol=EXACT)


@pytest.mark.parametrize("model", ["translation", "rigid", "similarity", "scaled"])
def test_rounded_start_is_brought_into_the_class(model):
    T = make_transform(LINEAR[model], [1.0, 2.0, 3.0]).round(2)
    start = as_start(T, "start", 3, model)
    shape = start[:3, :3] / np.linalg.norm(LINEAR[model], axis=0)
    np.testing.assert_allclose(start, T, atol=0.03)
    np.testing.assert_allclose(shape.T @ shape, np.diag(np.diag(shape.T @ shape)), atol=EXACT)
    if model in ("translation", "rigid"):
        np.testing.assert_allclose(np.diag(shape.T @ shape), 1.0, atol=EXACT)
    if model == "similarity":
        np.testing.assert_allclose(np.ptp(np.diag(shape.T @ shape)), 0.0, atol=EXACT)


def test_rigid_answers_from_a_rounded_start_are_rigid(rng):
    u, v = rng.uniform(-1, 1, size=(2, 3000))
    hill = np.column_stack([u, v, 0.25 * np.sin(4 * u) * np.cos(3 * v) + 0.1 * u * v])
    T = make_transform(ROTATION, [0.05, 0.04, -0.03])
    rounded = T.round(2)
    rows = slice(30)
    moved = transform_points(T, hill)
    for found in (
        register(moved, hill[:2000], start=rounded, stages=("local",)),
        align_pairs(moved[rows], hill[rows], prior=rounded, constraints=Constraints(rotation=(0.1, 0.1, 0.1))),
    ):
        R = found.T_target_source[:3, :3]
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=EXACT)


@pytest.mark.parametrize("model", ["translation", "rigid", "similarity", "scaled"])
def test_a_start_far_from_the_class_is_refused(rng, model):
    p = rng.normal(size=(20, 3))
    sheared = np.eye(4) + np.eye(4, k=1) * 0.2
    sheared[:3, 3] = 0.0
    with pytest.raises(ParameterError, match=f"prior stretches by .* with model '{model}'"):
        align_pairs(p, p, prior=sheared, model=model)


def test_a_scaled_start_is_refused_for_what_keeps_sizes(rng):
    p = rng.normal(size=(20, 3))
    with pytest.raises(ParameterError, match="start stretches by 100 %"):
        register(p, p, start=np.diag([2.0, 2.0, 2.0, 1.0]))
