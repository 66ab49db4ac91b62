from __future__ import annotations

import numpy as np
import pytest

from seismo3d import match
from seismo3d.experiments import matching_depth
from seismo3d.experiments.matching_peers import opencv_matcher
from seismo3d.experiments.matching_scenes import add_noise
from seismo3d.features import epipolar
from seismo3d.features.pairs import Pairs

F_TRUE_SHIFT = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Of a camera that moved to its side: a point keeps its row."""


def side_view(rng, n, wrong=0):
    """Points, and where they are seen from the side: rows stay, columns move by depth; the last ones are wrong."""
    p = rng.uniform(20, 400, (n, 2))
    q = p + np.column_stack([rng.uniform(5, 60, n), np.zeros(n)])
    q[n - wrong :] = rng.uniform(20, 400, (wrong, 2))
    shear = np.tile(np.eye(2), (n, 1, 1))
    shear[:, 0, :] = rng.uniform(0.7, 1.3, (n, 2)) - [0.0, 1.0]  # slanted surfaces stretch along rows only
    return Pairs(np.arange(n), p, q, shear, np.ones(n))


def test_lines_are_found_among_wrong_matches(rng):
    pairs = side_view(rng, 90, wrong=30)
    F = epipolar.fit_epipolar(pairs)
    good = epipolar.fits_epipolar(F, pairs)
    assert good[:60].all()
    assert good[60:].sum() <= 3  # one in a hundred places lies near its line
    np.testing.assert_allclose(epipolar.distance_to_lines(F, pairs.target[:60], pairs.source[:60]), 0.0, atol=0.05)
    assert epipolar.affine_misfit(F, pairs)[:60].max() < 0.02


def test_distances_of_a_camera_that_moved_sideways(rng):
    p, q = rng.uniform(0, 100, (5, 2)), rng.uniform(0, 100, (7, 2))
    apart = np.abs(p[:, None, 1] - q[None, :, 1])
    np.testing.assert_allclose(epipolar.distance_to_lines(F_TRUE_SHIFT, p, q[:5]), np.diag(apart[:, :5]))
    np.testing.assert_array_equal(epipolar.near_lines(F_TRUE_SHIFT, p, q, np.full((5, 7), 20.0)), apart <= 20.0)


def test_affine_maps_that_leave_the_lines_are_told(rng):
    pairs = side_view(rng, 6)
    np.testing.assert_allclose(epipolar.affine_misfit(F_TRUE_SHIFT, pairs), 0.0, atol=1e-12)
    turned = Pairs(pairs.row, pairs.target, pairs.source, np.tile([[0.0, -1.0], [1.0, 0.0]], (6, 1, 1)), np.ones(6))
    np.testing.assert_allclose(epipolar.affine_misfit(F_TRUE_SHIFT, turned), np.sqrt(2.0))


def test_no_lines_without_enough_matches(rng):
    assert epipolar.fit_epipolar(side_view(rng, 8)) is None
    same = side_view(rng, 1).take(np.zeros(30, int))
    found = epipolar.fit_epipolar(same)
    assert found is None or found.shape == (3, 3)


@pytest.fixture(scope="module")
def motorcycle():
    return matching_depth.load_depth_scenes()[0]


@pytest.mark.parametrize("angle_deg", [10.0, 20.0, 30.0])
def test_a_real_scene_of_many_depths_seen_from_the_side(motorcycle, angle_deg):
    rng = np.random.default_rng(5)
    view = matching_depth.turn(motorcycle, angle_deg)
    pair = add_noise(motorcycle.image, 2.0, rng), add_noise(view.image, 2.0, rng)
    found = match(*pair)
    good = matching_depth.distance_to_truth(view, found.points_target, found.points_source) < 3.0
    assert good.mean() >= 0.9
    sift = matching_depth.distance_to_truth(view, *opencv_matcher("SIFT", 500)(*pair)) < 3.0
    assert good.sum() > 1.5 * sift.sum()
