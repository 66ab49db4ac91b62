from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fake_faults import make_cube, make_faults
from PIL import Image

from seismo3d.errors import FileAccessError
from seismo3d.experiments.front_picture import draw_front_picture, main, trim
from seismo3d.plot.rendering import find_windowless


def test_margins_are_cut_off() -> None:
    picture = np.full((9, 12, 3), 255, dtype=np.uint8)
    assert trim(picture).shape == picture.shape
    picture[2:5, 3:11] = (10, 200, 30)
    np.testing.assert_array_equal(trim(picture), picture[2:5, 3:11])


def test_scene_and_section_stand_side_by_side(tmp_path: Path) -> None:
    if problem := find_windowless()[1]:
        pytest.skip(f"no renderer: {problem}")
    cube = make_cube()
    path = draw_front_picture(tmp_path / "a.png", cube, faults=make_faults(cube))
    with Image.open(path) as image:
        picture = np.asarray(image.convert("RGB")).astype(int)
    assert picture.shape == (480, 1200, 3)
    coloured = np.ptp(picture, axis=2) > 60
    assert coloured[:, :600].sum() > 500
    assert coloured[:, 600:].sum() > 100


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileAccessError, match="is not a folder"):
        draw_front_picture(tmp_path / "no" / "a.png", make_cube(), faults=make_faults(make_cube()))
    with pytest.raises(FileAccessError, match="is not a folder"):
        main([str(tmp_path / "no" / "a.png")])
