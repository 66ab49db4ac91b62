from __future__ import annotations

import numpy as np

from seismo3d.features.homography import carry, count_on_plane, fit_plane
from seismo3d.features.pairs import Pairs

H = np.array([[0.9, -0.2, 12.0], [0.15, 1.1, -7.0], [2e-4, -1e-4, 1.0]])


def pairs_of(target, source):
    linear = np.repeat(np.eye(2)[None], len(target), axis=0)
    return Pairs(np.arange(len(target)), target, source, linear, np.ones(len(target)))


def test_points_are_carried_with_their_surroundings(rng):
    points = rng.uniform(0, 200, (5, 2))
    places, linear = carry(H, points)
    step = 1e-4
    for axis in (0, 1):
        beside, _ = carry(H, points + step * np.eye(2)[axis])
        np.testing.assert_allclose((beside - places) / step, linear[:, :, axis], atol=1e-6)


def test_a_plane_is_fitted_beside_what_is_off_it(rng):
    points = rng.uniform(0, 200, (40, 2))
    places, _ = carry(H, points)
    places[:10] += 30.0
    found, on_plane = fit_plane(pairs_of(points, places), 2.0)
    np.testing.assert_allclose(found / found[2, 2], H, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(on_plane, [False] * 10 + [True] * 30)
    assert fit_plane(pairs_of(points[:11], places[:11]), 2.0) is None


def test_matches_of_a_plane_are_counted(rng):
    p = rng.uniform(0, 300, (40, 2))
    q = p @ np.array([[0.9, 0.1], [-0.1, 0.95]]) + [5, 9]
    q[30:] += 40.0 * rng.normal(size=(10, 2))
    pairs = pairs_of(p, q)
    assert 30 <= count_on_plane(pairs) <= 31
    assert count_on_plane(pairs.take(np.arange(5))) == 0
