"""Voxel maps: moments against plain numpy, nearest voxels against brute force, normals of known surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry._kernels_nearest_voxel import nearest_voxel
from seismo3d.geometry._kernels_voxel_elements import centroids_only
from seismo3d.geometry.rotations import exp_rotation
from seismo3d.geometry.voxels import TURN, downsample_points, estimate_normals, voxel_levels


def make_levels(points, size, n_levels=3, **options):
    d = points.shape[1]
    return voxel_levels(
        points,
        center=np.zeros(d),
        factor=1.0,
        voxel_size=size,
        n_levels=n_levels,
        low=points.min(axis=0),
        high=points.max(axis=0),
        **options,
    )


@pytest.mark.parametrize("d", [2, 3])
def test_centroids_are_the_means_of_their_points(d, rng):
    points = rng.uniform(-5, 5, size=(4000, d))
    centroids, owner = downsample_points(points, 0.7)
    sums = np.stack([np.bincount(owner, column) for column in points.T], axis=1)
    np.testing.assert_allclose(centroids, sums / np.bincount(owner)[:, None], atol=1e-12)
    cells = np.floor((points - points.min(axis=0)) / 0.7 + 1e-12).astype(int)
    assert len(centroids) == len(np.unique(cells, axis=0))


def test_moments_on_every_level_are_the_sums_of_the_points(rng):
    points = rng.uniform(-1, 1, size=(3000, 3))
    for level in make_levels(points, 0.1):
        assert level.moments[:, 0].sum() == 3000
        np.testing.assert_allclose(level.moments[:, 1:4].sum(axis=0), points.sum(axis=0), atol=1e-9)
        np.testing.assert_allclose(level.moments[:, 5].sum(), (points[:, 0] * points[:, 1]).sum(), atol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_nearest_voxel_is_the_nearest_within_a_cell(d, rng):
    points = rng.uniform(-1, 1, size=(1500, d))
    level = make_levels(points, 0.1, 1)[0]
    centroids_only(level.moments, 0.0, level.surface)  # each in its own cell
    centroids = level.surface[:, :d].astype(np.float64)
    for place in rng.uniform(-1, 1, size=(300, d)):
        x, y, z = (*place, 0.0)[:3]
        found, others2 = nearest_voxel(
            x,
            y,
            z,
            level.turn,
            level.origin,
            1 / level.size,
            d,
            level.table_keys,
            level.table,
            level.shift,
            level.surface,
            0.1**2,
            0.03,
        )
        distances = np.linalg.norm(centroids - place, axis=1)
        assert found == (np.argmin(distances) if distances.min() < 0.1 - 1e-7 else -1)
        others = np.delete(distances, found).min() if found >= 0 else distances.min()
        bound = min(others, min(distances.min(), 0.1) + 0.03, 0.1)  # within a voxel nothing lies outside of the cells
        assert bound - 1e-7 <= np.sqrt(others2) <= max(others, 0.1) + 0.03 + 1e-7


def test_normals_of_a_tilted_plane(rng):
    p = rng.uniform(-1, 1, size=(5000, 3))
    p[:, 2] = 0.3 * p[:, 0] - 0.2 * p[:, 1]
    normal = np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([-0.3, 0.2, 1.0])
    surface = make_levels(p, 0.1)[0].surface
    good = surface[:, 3] > 0.5
    assert good.mean() > 0.95
    np.testing.assert_allclose(np.abs(surface[good, 4:7] @ normal), 1.0, atol=1e-5)


def test_normals_asked_for_equal_normals_of_all(rng):
    p = rng.normal(size=(3000, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    whole, lazy = make_levels(p, 0.1)[0], make_levels(p, 0.1, fine_normals="asked")[0]
    assert (lazy.surface[:, 3] == -1.0).all()
    lazy.complete(np.arange(0, len(lazy.keys), 2))
    np.testing.assert_array_equal(lazy.surface[::2], whole.surface[::2])
    assert (lazy.surface[1::2, 3] == -1.0).all()


def test_given_normals_are_used_whatever_their_sign(rng):
    p = rng.uniform(-1, 1, size=(2000, 3))
    normals = np.tile(np.float32([0.6, 0.0, 0.8]), (2000, 1)) * rng.choice([-1, 1], size=(2000, 1)).astype(np.float32)
    surface = make_levels(p, 0.2, normals=normals)[1].surface
    np.testing.assert_allclose(np.abs(surface[:, 4:7] @ [0.6, 0.0, 0.8]), 1.0, atol=1e-6)


def test_estimated_normals_of_a_sphere_point_along_the_radius(rng):
    p = rng.normal(size=(4000, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    normals, thickness = estimate_normals(p, viewpoint=[0.0, 0.0, 0.0])
    assert np.median((normals * -p).sum(axis=1)) > 0.999
    assert thickness.max() < 0.05


def test_refusals(rng):
    with pytest.raises(ParameterError, match="millionth"):
        downsample_points([[0.0, 0.0], [1e9, 0.0]], 1e-3)
    with pytest.raises(ShapeError, match="NaN"):
        downsample_points([[0.0, np.nan]], 1.0)
    with pytest.raises(ShapeError, match="empty"):
        downsample_points(np.zeros((0, 3)), 1.0)
    with pytest.raises(GeometryError, match="more than 3"):
        estimate_normals(rng.normal(size=(3, 3)))


def noisy_wall(rng, turn):
    p = np.column_stack([0.01 * rng.normal(size=20000), rng.uniform(0, 1, size=(20000, 2))]) @ turn
    return voxel_levels(
        p, center=np.zeros(3), factor=1.0, voxel_size=0.03, n_levels=3, low=p.min(axis=0), high=p.max(axis=0)
    )[0]


def test_a_noisy_wall_along_the_voxels_keeps_its_place(rng):
    turn = exp_rotation(TURN)
    level = noisy_wall(rng, turn)
    assert len(level.keys) > 2 * (1 / 0.03) ** 2  # the wall fills more than one layer
    own = level.moments[:, 1:4] @ turn[0] / level.moments[:, 0]
    weights = level.surface[:, 7].astype(float)
    assert abs(weights @ own / weights.sum()) > 0.0008  # the layers' own centroids are drawn aside
    assert abs(weights @ (level.surface[:, :3].astype(float) @ turn[0]) / weights.sum()) < 0.0004


def test_voxels_are_askew_so_that_a_wall_along_the_axes_lies_anywhere_in_them(rng):
    level = noisy_wall(rng, np.eye(3))
    own = level.moments[:, 1] / level.moments[:, 0]
    weights = level.surface[:, 7].astype(float)
    assert abs(weights @ own / weights.sum()) < 0.0004
    middle = level.moments[:, 1:4] / level.moments[:, :1] * [0.0, 1.0, 1.0]
    place = (middle @ level.turn[0] - level.origin[0]) / level.size % 1.0
    assert np.histogram(place, bins=4, range=(0.0, 1.0))[0].min() > 0.1 * len(place)


def test_joined_layers_equal_numpy_and_leave_other_surfaces_alone(rng):
    def sheets(gap):
        p = np.column_stack([rng.uniform(0, 1, size=(6000, 2)), 0.1 + 0.005 * rng.normal(size=6000)])
        p[::2, 2] += gap
        return p

    p = sheets(0.04)
    level = voxel_levels(
        p, center=np.zeros(3), factor=1.0, voxel_size=0.05, n_levels=1, low=p.min(axis=0), high=p.max(axis=0)
    )[0]
    number = {int(key): k for k, key in enumerate(level.keys)}
    counts, centres = level.moments[:, 0], level.moments[:, 1:4] / level.moments[:, :1]
    for k, (key, element) in enumerate(zip(level.keys, level.surface.astype(float))):
        normal = element[4:7]
        step = (1 << 42, 1 << 21, 1)[int(np.argmax(np.abs(normal)))]
        rows = [k] + [number[other] for other in (int(key) - step, int(key) + step) if other in number]
        gaps = (centres[rows] - centres[k]) @ normal
        near = np.abs(gaps) < 0.75 * level.size
        along = (counts[rows] * gaps)[near].sum() / counts[rows][near].sum()
        np.testing.assert_allclose(element[:3], centres[k] + along * normal, atol=1e-6)
    p = sheets(0.2)
    level = voxel_levels(
        p, center=np.zeros(3), factor=1.0, voxel_size=0.05, n_levels=1, low=p.min(axis=0), high=p.max(axis=0)
    )[0]
    z = level.surface[level.moments[:, 0] > 5, 2]
    assert np.minimum(np.abs(z - 0.1), np.abs(z - 0.3)).max() < 0.01
