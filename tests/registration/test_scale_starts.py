"""A free scale, far from one: found from both scans' extents, whatever their densities, and never a collapse."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation
from seismo3d.registration import scale_starts
from seismo3d.registration.constraints import Constraints
from seismo3d.registration.register import register


def terrain(rng, n):
    """Points of ground with hills of several sizes, 400 by 300 m."""
    x, y = rng.uniform(0, 400, n), rng.uniform(0, 300, n)
    z = (
        12 * np.sin(x / 37) * np.cos(y / 29)
        + 6 * np.sin(x / 15 + y / 21)
        + 0.1 * x
        + 20 * np.exp(-((x - 120) ** 2) / 900)
    )
    return np.column_stack([x, y, z])


def moved(points, scale):
    """Return the points in another survey's frame, and the transform that brings them back."""
    R, t = exp_rotation([0.02, -0.03, 0.09]), np.array([8.0, -5.0, 3.0])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = scale * R, t
    return ((points - t) @ R) / scale, T


@pytest.mark.parametrize("scale", [1 / 2.5, 1 / 1.5, 1.5, 2.5])
def test_scale_between_surveys_of_other_density_is_recovered(rng, scale):
    source, T = moved(terrain(rng, 2500), scale)
    found = register(terrain(rng, 25000), source, model="similarity")
    assert found.state == "converged"
    np.testing.assert_allclose(found.scale, scale, rtol=2e-3)
    corner = np.array([400.0, 300.0, 0.0, 1.0])
    assert np.linalg.norm((found.T_target_source @ np.linalg.inv(T) @ corner - corner)[:3]) < 1.5


@pytest.mark.parametrize("model", ["similarity", "scaled", "affine"])
@pytest.mark.parametrize("scale", [0.001, 100.0])
def test_other_units_are_told(rng, scale, model):
    source, T = moved(terrain(rng, 4000), scale)
    found = register(terrain(rng, 4000), source, model=model)
    assert found.state == "converged"
    assert found.at_bounds == ()
    np.testing.assert_allclose(found.scale, scale, rtol=0.02)
    assert (np.diag(found.covariance) >= 0.0).all()
    corner = np.array([400.0, 300.0, 0.0, 1.0])
    assert np.linalg.norm((found.T_target_source @ np.linalg.inv(T) @ corner - corner)[:3]) < 3.0


def test_gross_outliers_do_not_mislead_the_extent(rng):
    target = terrain(rng, 12000)
    target[:60, 2] += rng.uniform(300, 900, 60)
    found = register(target, moved(terrain(rng, 6000), 1.5)[0], model="similarity")
    np.testing.assert_allclose(found.scale, 1.5, rtol=3e-3)


def test_scales_of_the_axes_start_there_too(rng):
    source, _ = moved(terrain(rng, 6000), 1.5)
    found = register(terrain(rng, 12000), source, model="affine")
    np.testing.assert_allclose(np.cbrt(np.linalg.det(found.T_target_source[:3, :3])), 1.5, rtol=5e-3)


def test_a_part_keeps_its_size(rng):
    whole, part = terrain(rng, 20000), terrain(rng, 20000)
    found = register(whole, part[part[:, 0] < 240] + [2.0, -1.0, 0.5], model="similarity")
    np.testing.assert_allclose(found.scale, 1.0, atol=2e-3)


def test_bounds_keep_the_extents_out(rng):
    source, _ = moved(terrain(rng, 3000), 1.5)
    found = register(terrain(rng, 6000), source, model="similarity", constraints=Constraints(scale=(0.9, 1.1)))
    assert 0.9 - 1e-9 <= float(found.scale[0]) <= 1.1 + 1e-9
    assert found.at_bounds == ("scale",)
    assert found.state == "poor_fit"


def test_local_stage_alone_stays_local(rng):
    source, _ = moved(terrain(rng, 3000), 1.05)
    found = register(terrain(rng, 6000), source, model="similarity", stages=("local",))
    assert found.stage == "local"


def test_extents_are_measured_only_for_a_size_that_is_free(rng, monkeypatch):
    def refuse(points):
        raise AssertionError(f"extents of {len(points)} points were measured")

    monkeypatch.setattr(scale_starts, "_extent", refuse)
    scan = terrain(rng, 2000)
    held = Constraints(scale=(1.0, 1.0))
    register(scan, scan, stages=("local",))
    register(scan, scan, model="similarity", constraints=held, stages=("local",))
    with pytest.raises(AssertionError, match="2000 points were measured"):
        register(scan, scan, model="similarity", stages=("local",))
