"""Scans from points, images, volumes, depth frames and elevation maps."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.scan import Scan, as_scan


def test_from_points_normalises_normals_and_keeps_its_own_copy(rng):
    points = rng.normal(size=(20, 3))
    scan = Scan.from_points(points, 3.0 * points)
    points[:] = 0.0
    assert np.abs(scan.points).max() > 0.1
    np.testing.assert_allclose(np.linalg.norm(scan.normals, axis=1), 1.0, atol=1e-6)
    assert (scan.dim, len(scan)) == (3, 20)


def test_image_edge_lies_where_it_is_and_across_it():
    image = np.zeros((60, 80))
    image[:, 30:] = 1.0  # the step is between columns 29 and 30
    scan = Scan.from_image(image)
    np.testing.assert_allclose(scan.points[:, 0], 29.5, atol=0.05)
    np.testing.assert_allclose(np.abs(scan.normals[:, 0]), 1.0, atol=1e-5)


def test_volume_surface_lies_where_it_is():
    volume = np.zeros((20, 24, 30))
    volume[:, :, 14:] = 2.0
    scan = Scan.from_volume(volume)
    np.testing.assert_allclose(scan.points[:, 2], 13.5, atol=0.05)
    np.testing.assert_allclose(np.abs(scan.normals[:, 2]), 1.0, atol=1e-5)


def test_depth_frame_of_a_wall_is_a_plane():
    camera = PinholeCamera(50.0, 50.0, 19.5, 14.5, depth_scale=1000.0)
    depth = np.full((30, 40), 2000)
    depth[5:8, 5:8] = 0
    scan = Scan.from_rgbd(np.zeros((30, 40, 3), np.uint8), depth, camera)
    np.testing.assert_allclose(scan.points[:, 2], 2.0)
    assert len(scan) < 28 * 38
    assert scan.raster.kind == "rgbd"


def test_elevation_map_of_a_slope():
    z = np.add.outer(np.arange(10) * 2.0, np.arange(12) * 0.5)
    scan = Scan.from_elevation(z, (0.5, 2.0))
    normal = np.array([-1.0, -1.0, 1.0]) / np.sqrt(3)
    np.testing.assert_allclose(np.abs(scan.normals @ normal), 1.0, atol=1e-6)


def test_spacing_of_an_elevation_map_is_a_number_or_two(rng):
    z = rng.normal(size=(10, 12))
    for spacing in (2, np.int64(2), np.float32(2), [2.0, 2.0], np.array([2, 2])):
        np.testing.assert_array_equal(Scan.from_elevation(z, spacing).points, Scan.from_elevation(z, 2.0).points)
    for wrong in ((1.0, 2.0, 3.0), "wide", np.ones((2, 2)), (1.0, -2.0), ()):
        with pytest.raises(ParameterError, match="spacing is"):
            Scan.from_elevation(z, wrong)


def test_downsampling_keeps_normals_of_both_signs(rng):
    points = rng.uniform(size=(500, 3))
    normals = np.tile([0.0, 0.0, 1.0], (500, 1)) * rng.choice([-1.0, 1.0], size=(500, 1))
    thin = Scan.from_points(points, normals, weights=np.ones(500)).downsampled(0.3)
    assert len(thin) < 100
    np.testing.assert_allclose(np.abs(thin.normals[:, 2]), 1.0, atol=1e-6)
    np.testing.assert_allclose(thin.weights, 1.0)


def test_normals_are_estimated_where_a_scan_has_none(rng):
    flat = Scan.from_points(np.column_stack([rng.uniform(size=(200, 2)), np.full(200, 3.0)]))
    np.testing.assert_allclose(np.abs(flat.with_normals().normals), np.tile([0.0, 0.0, 1.0], (200, 1)), atol=1e-5)
    given = flat.with_normals()
    assert given.with_normals() is given


def test_arrays_become_what_they_are(rng):
    assert as_scan(rng.normal(size=(9, 2)), "a").dim == 2
    assert as_scan(rng.normal(size=(30, 40)), "a").raster.kind == "image"
    assert as_scan(rng.normal(size=(12, 12, 12)), "a").raster.kind == "volume"
    colours = rng.integers(0, 255, size=(30, 40, 3)).astype(np.uint8)
    assert as_scan(colours, "a").raster.kind == "image"
    assert as_scan(colours / 255.0, "a").raster.kind == "image"


def test_refusals(rng):
    with pytest.raises(ShapeError, match="empty"):
        Scan.from_points(np.zeros((0, 3)))
    with pytest.raises(GeometryError, match="no edges"):
        Scan.from_image(np.ones((20, 20)))
    with pytest.raises(GeometryError, match="length zero"):
        Scan.from_points(rng.normal(size=(5, 3)), np.zeros((5, 3)))
    with pytest.raises(ParameterError, match="negative"):
        Scan.from_points(rng.normal(size=(5, 3)), weights=-np.ones(5))
    with pytest.raises(
        GeometryError, match=r"no pixel with a depth .* depth_scale of 1 .* Millimetres have one of 1000"
    ):
        Scan.from_rgbd(None, np.zeros((9, 9)), PinholeCamera(9, 9, 4, 4))
    with pytest.raises(ParameterError, match=r"camera has no fx, fy, cx, cy; .* Give PinholeCamera\(fx, fy, cx, cy\)"):
        Scan.from_rgbd(None, np.ones((9, 9)), np.eye(3))
    with pytest.raises(ShapeError, match="Register them first"):
        Scan.from_rgbd(np.zeros((8, 9)), np.ones((9, 9)), PinholeCamera(9, 9, 4, 4))
    with pytest.raises(ShapeError, match=r"rgb has shape \(3, 9, 9\); expected .* channels last"):
        Scan.from_rgbd(np.zeros((3, 9, 9)), np.ones((9, 9)), PinholeCamera(9, 9, 4, 4))
    with pytest.raises(ShapeError, match="an image or a volume"):
        as_scan(np.zeros(5), "a")
