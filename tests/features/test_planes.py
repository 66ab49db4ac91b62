from __future__ import annotations

import numpy as np
import pytest

from seismo3d.features.inputs import Grey, as_grey
from seismo3d.features.pairs import Pairs
from seismo3d.features.planar import PlanarSettings, describe_image
from seismo3d.features.planes import settle_on_plane


def pairs_of(target, source):
    linear = np.repeat(np.eye(2)[None], len(target), axis=0)
    return Pairs(np.arange(len(target)), target, source, linear, np.ones(len(target)))


@pytest.mark.parametrize("hole", [False, True])
def test_a_match_off_the_plane_needs_the_planes_own_place_to_look_otherwise(rng, hole):
    from scipy.ndimage import gaussian_filter

    # one texture, repeated after 100 columns
    tile = gaussian_filter(rng.normal(size=(160, 100)), 1.5, mode="wrap")
    image = np.tile(tile, (1, 2))
    seen = image.copy()
    if hole:
        seen[60:100, 60:100] = np.nan
    target, source = (describe_image(as_grey(one, None, "image"), PlanarSettings()) for one in (image, seen))
    points = target.view.keypoints.points
    away = (np.abs(points - [80.0, 80.0]) > 30.0).any(axis=1) & (points[:, 0] < 90.0)
    inside = (np.abs(points - [80.0, 80.0]) < 10.0).all(axis=1)
    rows = np.concatenate([np.flatnonzero(away)[:80], np.flatnonzero(inside)[:4]])
    pairs = pairs_of(points[rows], points[rows].copy())
    pairs = Pairs(rows, pairs.target, pairs.source, pairs.linear, pairs.correlation)
    pairs.source[-4:, 0] += 100.0
    settled = settle_on_plane(
        target.view, source.view, source.image, pairs, distance=2.0, share=0.8, min_correlation=0.8
    )
    if hole:  # what cannot be seen is not proved
        np.testing.assert_array_equal(settled.row, rows[:-4])
    else:
        np.testing.assert_array_equal(settled.row, rows)
    assert np.linalg.norm(settled.source - settled.target, axis=1).max() < 0.05


def test_without_a_plane_nothing_is_changed(rng):
    view = describe_image(Grey(rng.normal(100, 30, (80, 80)).astype(np.float32)), PlanarSettings())
    pairs = pairs_of(view.view.keypoints.points[:30], rng.uniform(0, 80, (30, 2)))
    same = settle_on_plane(view.view, view.view, view.image, pairs, distance=2.0, share=0.8, min_correlation=0.8)
    np.testing.assert_array_equal(same.source, pairs.source)
