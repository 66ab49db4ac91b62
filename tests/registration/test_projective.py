"""Partners by projection: the pixels' own elements, the same answer as the nearest, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.experiments.rotated_frames import draw_room
from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.registration.dense import prepare_pair
from seismo3d.registration.projective import pixel_tables
from seismo3d.registration.register import register
from seismo3d.registration.settings import LoopSettings
from seismo3d.scan import Scan


@pytest.fixture
def frames(rng):
    """Two noisy depth frames of one room from one place, and the motion that the second is given."""
    frame = draw_room(size=(120, 160))
    noisy = [frame.depth + 0.001 * frame.depth**2 * rng.normal(size=frame.depth.shape) for _ in range(2)]
    target, source = (Scan.from_rgbd(None, depth, frame.camera) for depth in noisy)
    T = make_transform(exp_rotation([0.01, -0.02, 0.015]), [0.02, -0.01, 0.015])
    return target, Scan.from_points(transform_points(np.linalg.inv(T), source.points)), T


def test_a_points_own_pixel_shows_its_voxel(frames):
    target, _, _ = frames
    pair = prepare_pair(target, target, voxel_size=None, n_threads=1, symmetric=False)
    for table, level in zip(pixel_tables(target.raster, pair.frame, pair.target), pair.target):
        elements = np.zeros((len(target.points), 8), dtype=np.float32)
        elements[:, :3] = pair.frame.target(target.points)
        found = table.partners(elements, level.surface, np.eye(3), np.zeros(3), np.inf)
        assert (found >= 0).all()
        off = np.abs(level.surface[found, :3] - elements[:, :3])
        assert off.max() <= level.size * 1.001  # both lie in one voxel
        near = table.partners(elements, level.surface, np.eye(3), np.zeros(3), 0.5 * level.size)
        distance = np.linalg.norm(level.surface[found, :3] - elements[:, :3], axis=1)
        np.testing.assert_array_equal(near >= 0, distance <= 0.5 * level.size)


def test_projective_and_nearest_agree(frames):
    target, source, T = frames
    settings = LoopSettings(wide_search=False)
    found = [
        register(target, source, stages=("local",), settings=settings, correspondences=kind)
        for kind in ("nearest", "projective")
    ]
    for one in found:
        assert one.converged
        np.testing.assert_allclose(one.T_target_source, T, atol=0.004)
    np.testing.assert_allclose(found[0].T_target_source, found[1].T_target_source, atol=0.004)


def test_points_that_project_nowhere_have_no_partner(frames):
    target, _, _ = frames
    pair = prepare_pair(target, target, voxel_size=None, n_threads=1, symmetric=False)
    table, level = pixel_tables(target.raster, pair.frame, pair.target)[0], pair.target[0]
    behind = np.zeros((3, 8), dtype=np.float32)
    behind[:, :3] = pair.frame.target(np.array([[0.0, 0.0, -1.0], [50.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    assert (table.partners(behind, level.surface, np.eye(3), np.zeros(3), 1e9) == -1).all()


def test_refusals(frames):
    target, source, _ = frames
    with pytest.raises(ParameterError, match="no depth image"):
        register(source, target, correspondences="projective")
    with pytest.raises(ParameterError, match="expected one of nearest"):
        register(target, source, correspondences="closest")
