from __future__ import annotations

import cv2
import numpy as np
import pytest

from seismo3d import PlaceIndex, describe
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.experiments.matching_scenes import add_noise, load_photos, rotation, scaling, tilt, warp_image


@pytest.fixture(scope="module")
def photos():
    return {name: cv2.resize(image, (280, 240)) for name, image in load_photos().items()}


@pytest.fixture(scope="module")
def index(photos):
    index = PlaceIndex()
    for k, image in enumerate(photos.values()):
        assert index.add(describe(image, n_points=300)) == k
    return index


@pytest.mark.parametrize("warp", [rotation(37.0), rotation(180.0), scaling(0.8), tilt(25.0)])
def test_turned_scaled_and_tilted_places_are_recognised(photos, index, warp, rng):
    for k, image in enumerate(photos.values()):
        H = warp(image.shape)
        seen = add_noise(warp_image(image, H), 2.0, rng)
        inside = warp_image(np.ones(image.shape), H) > 0.99  # the frame around would be a place of its own
        found = index.query(describe(seen, mask=inside, n_points=300))
        assert found.index[0] == k
        assert len(found) == 5
        assert (np.diff(found.votes) <= 0.0).all()


def test_half_of_a_place_is_recognised(photos, index):
    hits = [index.query(describe(image[:, 120:], n_points=300)).index[0] for image in photos.values()]
    assert (np.array(hits) == np.arange(len(photos))).all()


def test_what_came_later_can_be_left_out(photos, index):
    asked = describe(list(photos.values())[7], n_points=300)
    assert index.query(asked).index[0] == 7
    found = index.query(asked, n_best=100, until=7)
    assert sorted(found.index) == list(range(7))


def test_adding_after_a_query_counts(photos):
    index = PlaceIndex(n_points=50)
    one, other = (describe(photos[name], n_points=300) for name in ("coins", "page"))
    index.add(one)
    assert list(index.query(one).index) == [0]
    index.add(other)
    assert index.query(other).index[0] == 1


def test_places_without_points_are_never_found(photos):
    index = PlaceIndex()
    coins = describe(photos["coins"])
    assert len(index.query(coins)) == 0
    index.add(describe(np.zeros((40, 40))))
    assert len(index.query(coins)) == 0
    index.add(coins)
    index.add(describe(photos["page"]))
    assert set(index.query(coins, n_best=9).index) == {1, 2}
    assert len(index.query(describe(np.zeros((40, 40))))) == 0


def test_refuses_volumes_and_no_points(photos):
    index = PlaceIndex()
    with pytest.raises(ShapeError, match="expected an image"):
        index.add(describe(np.zeros((20, 20, 20))))
    for ask in (index.add, index.query):
        with pytest.raises(ParameterError, match=r"features is a ndarray.*Describe the image first"):
            ask(photos["coins"])
    with pytest.raises(ParameterError, match="n_points"):
        PlaceIndex(n_points=0)
    with pytest.raises(ParameterError, match="n_best"):
        index.query(describe(photos["coins"]), n_best=0)
