from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation
from skimage import data

from seismo3d.features.matching import match
from seismo3d.registration.raster_matches import match_rasters
from seismo3d.registration.register import register
from seismo3d.scan import Scan
from seismo3d.synthetic import fault_cube


@pytest.fixture(scope="module")
def images():
    photo = cv2.resize(data.camera(), (256, 256), interpolation=cv2.INTER_AREA)
    a = np.radians(100.0)
    A = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    T = np.eye(3)
    T[:2, :2], T[:2, 2] = A, np.array([127.5, 127.5]) - A @ [127.5, 127.5] + [9.0, -6.0]
    return cv2.warpAffine(photo, T[:2], (256, 256), flags=cv2.INTER_CUBIC), photo, T


def test_images_turned_far_are_registered_without_given_matches(images):
    target, source, T = images
    found = register(Scan.from_image(target), Scan.from_image(source))
    assert found.stage == "global"
    error = np.linalg.inv(T) @ found.T_target_source
    assert abs(np.degrees(np.arctan2(error[1, 0], error[0, 0]))) < 0.2
    middle = np.array([127.5, 127.5, 1.0])
    assert np.linalg.norm((found.T_target_source @ middle - T @ middle)[:2]) < 0.5


def test_volumes_displaced_far_are_registered_without_given_matches():
    earth = fault_cube("clean", seed=7, shape=(96, 96, 96)).signal
    R = Rotation.from_rotvec([10.0, 20.0, 60.0], degrees=True).as_matrix()
    centre = np.full(3, 31.5)
    t = centre + np.array([2.0, -3.0, 1.0]) - R @ centre
    source = ndimage.affine_transform(earth, R, t + 16.0, output_shape=(64, 64, 64), order=3, mode="nearest")
    found = register(Scan.from_volume(earth[16:80, 16:80, 16:80]), Scan.from_volume(source))
    T = found.T_target_source
    assert np.degrees(Rotation.from_matrix(T[:3, :3].T @ R).magnitude()) < 1.0
    assert np.linalg.norm(T[:3, :3] @ centre + T[:3, 3] - (R @ centre + t)) < 0.5


def test_scans_are_matched_by_their_grids(images):
    target, source, _ = images
    scans = Scan.from_image(target), Scan.from_image(source)
    found = match_rasters(*scans)
    np.testing.assert_array_equal(found.points_target, match(*scans).points_target)


def test_no_matches_without_grids_of_one_kind(rng, images):
    points = Scan.from_points(rng.normal(size=(50, 2)))
    image = Scan.from_image(images[0])
    assert match_rasters(points, image) is None
    assert match_rasters(image, Scan.from_volume(rng.normal(size=(20, 20, 20)))) is None
