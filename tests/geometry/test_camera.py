"""The pinhole camera: projecting undoes looking, with and without distortion."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry._kernels_camera import straighten_rows
from seismo3d.geometry.camera import PinholeCamera, as_camera

LENSES = [(), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)]


@pytest.mark.parametrize("distortion", LENSES)
def test_project_undoes_rays(distortion, rng):
    camera = PinholeCamera(517.3, 516.5, 318.6, 255.3, distortion)
    pixels = rng.uniform([40, 40], [600, 440], size=(200, 2))
    rays = np.concatenate([camera.rays(pixels), np.ones((200, 1))], axis=1)
    np.testing.assert_allclose(camera.project(3.0 * rays), pixels, atol=1e-3)  # twelve rounds of a contraction


def test_depth_comes_back_as_z():
    camera = PinholeCamera(100.0, 100.0, 2.0, 1.0, depth_scale=5000)
    points = camera.back_project(np.array([[5000, 0, 10000, 0, 0], [0, 0, 5000, 0, 0], [0, 0, 0, 0, 0]]))
    assert points[0, 0, 2] == 1.0
    assert np.isnan(points[0, 1]).all()
    np.testing.assert_allclose(points[0, 2], [0.0, -0.02, 2.0])


def test_depth_of_another_size_than_the_cameras_is_refused():
    camera = PinholeCamera(100.0, 100.0, 2.0, 1.0, width=5, height=3)
    assert camera.back_project(np.ones((3, 5))).shape == (3, 5, 3)
    with pytest.raises(ShapeError, match=r"shape \(2, 5\); the camera says \(3, 5\). Give the intrinsics"):
        camera.back_project(np.ones((2, 5)))


def test_behind_the_camera_is_nowhere():
    assert np.isnan(PinholeCamera(1.0, 1.0, 0.0, 0.0).project([[0.0, 0.0, -1.0]])).all()


def test_fields_make_a_camera_and_missing_ones_are_named():
    assert as_camera({"fx": 1, "fy": 2, "cx": 3, "cy": 4, "distortion": [0.1]}).distortion == (0.1,)
    with pytest.raises(ParameterError, match="no fy, cx"):
        as_camera({"fx": 1, "cy": 4})
    with pytest.raises(ParameterError, match="fx is 0"):
        PinholeCamera(0.0, 1.0, 0.0, 0.0)


@pytest.mark.parametrize("distortion", LENSES)
def test_rays_of_an_image_are_those_of_its_pixels(distortion):
    camera = PinholeCamera(51.7, 51.6, 31.8, 25.5, distortion)
    out = np.full((48, 64, 2), np.nan, dtype=np.float32)
    bend = np.array((*distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5])
    for rows in ((0, 20), (20, 48)):
        straighten_rows(*rows, np.array([camera.fx, camera.fy, camera.cx, camera.cy]), bend, out)
    grid = np.stack(np.meshgrid(np.arange(64), np.arange(48)), axis=-1).reshape(-1, 2).astype(float)
    np.testing.assert_allclose(out.reshape(-1, 2), camera.rays(grid), atol=1e-7)
