from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from seismo3d.features import poses, spheres
from seismo3d.features.matching import match
from seismo3d.synthetic import fault_cube

SIZE = 64


@pytest.fixture(scope="module")
def earth():
    return fault_cube("clean", seed=7, shape=(SIZE + 32,) * 3).signal


def displaced(earth, R, shift, noise, seed):
    """A sub-volume, and the same place turned and shifted, with noise on both; x_target = R x_source + t."""
    rng = np.random.default_rng(seed)
    centre = np.full(3, (SIZE - 1) / 2.0)
    target = earth[16 : 16 + SIZE, 16 : 16 + SIZE, 16 : 16 + SIZE]
    t = centre + shift - R @ centre
    grid = np.stack(np.meshgrid(*[np.arange(SIZE)] * 3, indexing="ij")).reshape(3, -1)
    source = ndimage.map_coordinates(earth, R @ grid + t[:, None] + 16.0, order=3, mode="nearest").reshape((SIZE,) * 3)
    sigma = noise * target.std()
    return target + rng.normal(0, sigma, target.shape), source + rng.normal(0, sigma, source.shape), t


@pytest.mark.parametrize("rotvec_deg", [(0, 0, 0), (4, -3, 8), (0, 0, 100), (150, 30, 0)])
def test_sub_volumes_are_matched_under_any_rotation(earth, rotvec_deg):
    R = Rotation.from_rotvec(rotvec_deg, degrees=True).as_matrix()
    target, source, t = displaced(earth, R, np.array([2.3, -1.6, 3.1]), 0.5, 3)
    found = match(target, source)
    assert len(found) > 40
    misfit = np.linalg.norm(found.points_source @ R.T + t - found.points_target, axis=1)
    assert (misfit < 2.0).mean() > 0.9
    pose = poses.fit_pose(found.points_target, found.points_source)
    # The bar: a quarter of a degree and 0.15 voxel, with noise at half the signal.
    assert np.degrees(Rotation.from_matrix(pose.R.T @ R).magnitude()) < 0.25
    centre = np.full(3, (SIZE - 1) / 2.0)
    assert np.linalg.norm(pose.to_target(centre[None])[0] - (R @ centre + t)) < 0.15
    assert found.angle[0] == pytest.approx(Rotation.from_matrix(R).magnitude(), abs=np.radians(0.25))
    assert (found.scale == 1.0).all()


def test_missing_traces_are_left_out(earth):
    target, source, t = displaced(earth, np.eye(3), np.array([3.0, 1.0, -2.0]), 0.2, 4)
    source[20:26, :, :] = np.nan
    live = np.ones(target.shape, bool)
    live[:, 40:45] = False
    found = match(target, source, mask_target=live)
    assert len(found) > 20
    assert not np.isin(np.rint(found.points_source[:, 0]), np.arange(20, 26)).any()
    assert not np.isin(np.rint(found.points_target[:, 1]), np.arange(40, 45)).any()
    assert (np.linalg.norm(found.points_source + t - found.points_target, axis=1) < 2.0).mean() > 0.9


def test_noise_volumes_have_no_pose(rng):
    assert len(match(rng.normal(size=(48, 48, 48)), rng.normal(size=(48, 48, 48)))) == 0


def test_unrelated_cubes_have_no_pose(earth):
    other = fault_cube("crossing", seed=11, shape=(SIZE,) * 3).seismic
    assert len(match(earth[:SIZE, :SIZE, :SIZE], other)) == 0


def test_flipped_descriptor_equals_description_in_the_flipped_frame(rng):
    volume = ndimage.gaussian_filter(rng.normal(size=(40, 40, 40)), 1.5).astype(np.float32)
    points = rng.uniform(14, 26, (5, 3)).round()
    frames = Rotation.random(5, random_state=3).as_matrix()
    layout = spheres.SphereLayout()
    corners = spheres.VolumePoints(points, frames, np.ones(5))
    turned = spheres.VolumePoints(points, spheres.flip_frames(frames), np.ones(5))
    _, flipped = spheres.describe_corners(volume, None, corners, layout)
    described, _ = spheres.describe_corners(volume, None, turned, layout)
    np.testing.assert_allclose(flipped, described, atol=1e-3)  # votes are added in another order, in float32


def test_turning_a_frame_shifts_the_descriptor(rng):
    volume = ndimage.gaussian_filter(rng.normal(size=(40, 40, 40)), 1.5).astype(np.float32)
    point = np.full((1, 3), 20.0)
    layout = spheres.SphereLayout()
    step = Rotation.from_euler("z", 4 * 22.5, degrees=True).as_matrix()
    straight, _ = spheres.describe_corners(
        volume, None, spheres.VolumePoints(point, np.eye(3)[None], np.ones(1)), layout
    )
    turned, _ = spheres.describe_corners(volume, None, spheres.VolumePoints(point, step[None], np.ones(1)), layout)
    np.testing.assert_allclose(turned, np.roll(straight, -4, axis=1), atol=1e-3)


def test_smallest_eigenvalue_equals_numpy(rng):
    a = rng.normal(size=(50, 3, 5))
    full = (a @ a.transpose(0, 2, 1)).astype(np.float32)
    packed = np.stack([full[:, 0, 0], full[:, 0, 1], full[:, 0, 2], full[:, 1, 1], full[:, 1, 2], full[:, 2, 2]])
    smallest = spheres._kernels_volume.smallest_eigenvalue(packed.reshape(6, 50, 1, 1)).ravel()
    np.testing.assert_allclose(smallest, np.linalg.eigvalsh(full.astype(float))[:, 0], atol=1e-4)


def test_fit_pose_recovers_a_rigid_motion(rng):
    R = Rotation.random(random_state=1).as_matrix()
    source = rng.normal(size=(10, 3))
    pose = poses.fit_pose(source @ R.T + [1, 2, 3], source)
    np.testing.assert_allclose(pose.R, R, atol=1e-12)
    np.testing.assert_allclose(pose.t, [1, 2, 3], atol=1e-12)
