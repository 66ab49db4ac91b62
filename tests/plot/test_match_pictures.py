from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from skimage import data

from seismo3d.errors import FileAccessError, ParameterError, ShapeError
from seismo3d.features.matching import Matches, match
from seismo3d.plot.match_pictures import matches, save_matches


@pytest.fixture(scope="module")
def photo():
    return data.camera()[100:260, 150:330]


@pytest.fixture(scope="module")
def found(photo):
    return match(photo[:, :-20], photo[:, 20:], n_points=60)


def drawn_lines(ax):
    return next(c for c in ax.collections if isinstance(c, LineCollection)).get_segments()


def test_lines_join_matched_places(photo, found):
    ax = Figure().add_subplot()
    assert matches(photo[:, :-20], photo[:, 20:], found, ax=ax) is ax
    lines = np.array(drawn_lines(ax))
    assert len(lines) == len(found) > 20
    # The source stands beside the target, 160 columns and the gap further right; each match moved by 20 columns.
    np.testing.assert_allclose(lines[:, 1] - lines[:, 0], np.tile([160 + 12 - 20, 0], (len(lines), 1)), atol=0.3)


def test_draws_no_more_than_asked(photo, found):
    ax = matches(photo[:, :-20], photo[:, 20:], found, n_shown=7, ax=Figure().add_subplot())
    assert len(drawn_lines(ax)) == 7
    assert "7 shown" in ax.get_title(loc="left")


def volume_matches(n):
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 20, (n, 3))
    return Matches(
        places, places + 1.0, np.ones(n), np.zeros(n), np.ones(n), np.repeat(np.eye(3)[None], n, axis=0), (n, n)
    )


def test_volumes_show_an_inline_with_samples_downwards():
    volume = np.zeros((20, 30, 40))
    found = volume_matches(9)
    ax = matches(volume, volume, found, ax=Figure().add_subplot())
    assert ax.images[0].get_array().shape == (40, 30 + 12 + 30)
    np.testing.assert_allclose(np.array(drawn_lines(ax))[:, 0], found.points_target[:, 1:])


def test_no_matches_and_no_data_are_drawn_too():
    ax = matches(
        np.full((20, 20), np.nan),
        np.zeros((20, 20)),
        match(np.zeros((20, 20)), np.zeros((20, 20))),
        ax=Figure().add_subplot(),
    )
    assert ax.get_title(loc="left") == "0 matches"


def test_saves_a_picture(photo, found, tmp_path):
    save_matches(tmp_path / "a.png", photo[:, :-20], photo[:, 20:], found)
    from PIL import Image

    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert (np.ptp(pixels, axis=2) > 60).sum() > 500  # coloured lines on a grey picture


def test_refuses(photo, found, tmp_path):
    with pytest.raises(ShapeError, match="matches 3"):
        matches(photo, photo, volume_matches(3), ax=Figure().add_subplot())
    with pytest.raises(FileAccessError, match="is not a folder"):
        save_matches(tmp_path / "none" / "a.png", photo, photo, found)
    with pytest.raises(ParameterError, match=r"ends in '\.xyz'; expected \.png"):
        save_matches(tmp_path / "a.xyz", photo, photo, found)
