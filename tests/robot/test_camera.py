"""Cameras and their frames at the door."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot import Camera, Occupancy, RgbdFrame

LENS = PinholeCamera(500.0, 500.0, 320.0, 240.0)
DEPTH = np.ones((4, 6), np.float32)


def test_a_place_that_is_no_matrix_of_numbers_is_named() -> None:
    with pytest.raises(ShapeError, match=r"^T_body_camera is 'here'; expected an array of numbers"):
        Camera(LENS, T_body_camera="here")  # type: ignore[arg-type]
    with pytest.raises(ShapeError, match=r"^T_body_camera makes no array"):
        Camera(LENS, T_body_camera=[[1.0, 0.0], [1.0]])  # type: ignore[arg-type]
    with pytest.raises(ShapeError, match=r"^T_world_map is 'here'; expected an array of numbers"):
        Occupancy(np.zeros((4, 4)), np.zeros((4, 4)), 0.05, T_world_map="here")  # type: ignore[arg-type]


def test_images_that_are_no_arrays_are_told_how_to_be_given() -> None:
    words = r"expected ndarray\. Make the frame by RgbdFrame\.of\(rgb, depth, time\)"
    with pytest.raises(ParameterError, match=rf"^rgb is \[1, 2\]; {words}"):
        RgbdFrame(0.0, 0.0, [1, 2], DEPTH)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=rf"^depth is 'depth\.png'; {words}"):
        RgbdFrame(0.0, 0.0, None, "depth.png")  # type: ignore[arg-type]
    with pytest.raises(ShapeError, match=r"^depth has shape \(4, 6, 3\); expected 2 axes"):
        RgbdFrame.of(None, np.ones((4, 6, 3)), 0.5)
    assert RgbdFrame.of(None, DEPTH.tolist(), 0.5).depth.shape == (4, 6)


def test_a_list_of_coefficients_is_kept_as_numbers() -> None:
    assert PinholeCamera(500.0, 500.0, 320.0, 240.0, [0.1, 0]).distortion == (0.1, 0.0)  # type: ignore[arg-type]
