"""Where a transform leaves the source: near, far, or near with nothing that holds along some direction."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.voxels import voxel_levels
from seismo3d.registration.matching import match_surface
from seismo3d.registration.register import register
from seismo3d.registration.wide_search import WideSearch, is_far, is_loose


def room_corner(rng, n=20000):
    p = rng.uniform(0, 1, size=(n, 3)) * [2.0, 3.0, 1.5]
    p[np.arange(n), rng.integers(0, 3, n)] = 0.0
    return p


def coarse(points):
    return voxel_levels(
        points,
        center=np.zeros(3),
        factor=1.0,
        voxel_size=0.1,
        n_levels=1,
        low=points.min(axis=0),
        high=points.max(axis=0),
    )[0]


def look(target, source, shift):
    size = target.size
    return match_surface(source, target, np.eye(3), np.array(shift), radius=1.5 * size, cutoff=size)


@pytest.mark.parametrize(
    ("shift", "far", "loose"),
    [
        ([0.0, 0.0, 0.0], False, False),
        ([0.02, -0.01, 0.02], False, False),
        ([0.2, 0.0, 0.0], False, True),
        ([0.0, 0.2, 0.0], False, True),
        ([0.4, 0.4, 0.4], True, True),
    ],
)
def test_a_wall_out_of_reach_leaves_its_direction_loose(rng, shift, far, loose):
    target, source = coarse(room_corner(rng)), coarse(room_corner(rng)).surface
    assert is_far(target, source, np.eye(3), np.array(shift)) == far
    assert is_loose(look(target, source, shift), source, target.size) == loose


def test_a_lone_plane_has_nothing_to_lose(rng):
    def plane():
        return coarse(np.column_stack([rng.uniform(-1, 1, size=(8000, 2)), np.zeros(8000)]))

    target, source = plane(), plane().surface
    assert not is_loose(look(target, source, [0.5, 0.5, 0.0]), source, target.size)


def test_elements_without_a_near_partner_set_the_radius(rng):
    target, source = coarse(room_corner(rng)), coarse(room_corner(rng)).surface
    t = np.array([0.3, 0.0, 0.0])
    rows, radius = WideSearch(target, source, keeps_all=True).partners(np.eye(3), t, 0)
    _, usual = WideSearch(target, source, keeps_all=False).partners(np.eye(3), t, 0)
    assert usual == pytest.approx(1.5 * target.size)
    assert radius > 0.3
    assert (rows >= 0).mean() > 0.95


@pytest.mark.parametrize("shift", [[0.22, 0.0, 0.0], [0.0, -0.25, 0.0], [0.1, 0.1, 0.2]])
def test_the_local_loop_brings_back_a_wall_that_was_out_of_reach(rng, shift):
    found = register(room_corner(rng) + shift, room_corner(rng), stages=("local",))
    assert found.overlap > 0.9
    np.testing.assert_allclose(found.T_target_source[:3, 3], shift, atol=1e-3)
