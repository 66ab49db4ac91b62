from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage
from skimage import data

from seismo3d import describe, match
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.synthetic import fault_cube


@pytest.fixture(scope="module")
def photo():
    return cv2.resize(data.camera(), (300, 300), interpolation=cv2.INTER_AREA)


def test_described_images_match_as_plain_ones_do(photo):
    one, other = photo[:, :-30], photo[20:, 30:]
    plain = match(one, other, n_points=200)
    described = [describe(image, n_points=200) for image in (one, other)]
    for found in (match(*described), match(*described, tilts="never")):
        np.testing.assert_array_equal(found.points_source, plain.points_source)
        np.testing.assert_array_equal(found.score, plain.score)
    assert plain.n_points == (len(described[0]), len(described[1]))


def test_one_described_serves_many(photo):
    described = describe(photo)
    for turns in (1, 2, 3):
        found = match(np.rot90(photo, turns), described)
        assert len(found) > 100
        assert np.median((found.angle + turns * np.pi / 2 + np.pi) % (2 * np.pi) - np.pi) == pytest.approx(
            0.0, abs=0.01
        )


def test_masks_are_given_to_describe(photo):
    live = np.ones(photo.shape, bool)
    live[100:180, 60:200] = False
    described = describe(photo, mask=live)
    x, y = np.rint(described.points).astype(int).T
    assert live[y, x].all()
    plain = match(photo, photo, mask_source=live)
    np.testing.assert_array_equal(match(photo, described).points_source, plain.points_source)


def test_described_volumes_match_as_plain_ones_do():
    cube = ndimage.gaussian_filter(fault_cube("clean", seed=3, shape=(48, 48, 48)).signal, 0.5)
    plain = match(cube, cube[2:])
    described = describe(cube[2:])
    found = match(cube, described)
    assert described.ndim == 3
    assert len(found) == len(plain) > 10
    np.testing.assert_array_equal(found.points_source, plain.points_source)


def test_refuses_settings_that_came_too_late(photo):
    described = describe(photo)
    with pytest.raises(ParameterError, match="source is described"):
        match(photo, described, mask_source=np.ones(photo.shape, bool))
    with pytest.raises(ParameterError, match="n_points"):
        match(described, photo, n_points=100)
    with pytest.raises(ParameterError, match="n_points"):
        describe(photo, n_points=0)


def test_refuses_an_image_and_a_volume(photo):
    with pytest.raises(ShapeError, match="two images or two volumes"):
        match(describe(photo), describe(np.zeros((20, 20, 20))))
    with pytest.raises(ShapeError, match="values has shape"):
        describe(photo[:5])


def test_nothing_to_see_has_no_points():
    assert len(describe(np.zeros((40, 40)))) == 0
    assert len(describe(np.full((20, 20, 20), np.nan))) == 0
    assert len(match(describe(np.zeros((40, 40))), data.camera())) == 0
