from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments import matching_depth, matching_scenes, matching_tables
from seismo3d.experiments.matching_scenes import project, rotation, scaling, tilt, warp_image


def test_there_are_at_least_twenty_real_images():
    photos = matching_scenes.load_photos()
    assert len(photos) >= 20
    assert all(p.dtype == np.uint8 and max(p.shape) <= 640 and p.std() > 5 for p in photos.values())


@pytest.mark.parametrize("warp", [rotation(30.0), scaling(0.7), tilt(25.0)])
def test_warped_image_shows_at_the_projected_place_what_was_there(warp):
    y, x = np.mgrid[:120, :160].astype(float)
    image = 128.0 + 60.0 * np.sin(x / 9.0) * np.cos(y / 11.0)
    H = warp((120, 160))
    carried = warp_image(image, H)
    places = np.array([[60.0, 50.0], [80.0, 70.0], [100.0, 60.0]])
    there = np.rint(project(H, places)).astype(int)
    back = project(np.linalg.inv(H), there.astype(float))
    expected = 128.0 + 60.0 * np.sin(back[:, 0] / 9.0) * np.cos(back[:, 1] / 11.0)
    # Cubic interpolation and the blur against aliasing take a little of the contrast of 60.
    np.testing.assert_allclose(carried[there[:, 1], there[:, 0]], expected, atol=4.0)


def test_tilt_keeps_the_centre_and_foreshortens():
    H = tilt(60.0)((101, 101))
    np.testing.assert_allclose(project(H, np.array([[50.0, 50.0]])), [[50.0, 50.0]], atol=1e-9)
    ends = project(H, np.array([[49.0, 50.0], [51.0, 50.0]]))
    assert ends[1, 0] - ends[0, 0] == pytest.approx(1.0, rel=0.01)  # cos 60 = 1 / 2, of two pixels


def test_a_plane_in_depth_turns_like_a_homography():
    photo = matching_scenes.load_photos()["coins"]
    depth = np.full(photo.shape, float(photo.shape[1]))
    scene = matching_depth.DepthScene("plane", photo, depth, matching_depth._camera(photo.shape))
    view = matching_depth.turn(scene, 20.0)
    points = np.array([[100.0, 90.0], [200.5, 150.25], [300.0, 220.0]])
    expected = project(tilt(20.0)(photo.shape), points)
    assert matching_depth.distance_to_truth(view, points, expected).max() < 1.0
    assert matching_depth.distance_to_truth(view, points, expected + np.array([0.0, 9.0])).min() > 7.0
    flat = warp_image(photo, tilt(20.0)(photo.shape))
    inner = np.s_[100:200, 150:250]
    assert np.corrcoef(flat[inner].ravel(), view.image[inner].ravel())[0, 1] > 0.98


def test_what_stands_in_front_hides_what_is_behind():
    image = np.full((60, 80), 50, np.uint8)
    image[20:40, 30:50] = 200
    depth = np.full((60, 80), 80.0)
    depth[20:40, 30:50] = 60.0
    view = matching_depth.turn(matching_depth.DepthScene("block", image, depth, (80.0, 80.0, 39.5, 29.5)), 20.0)
    assert not view.seen.all()  # something is uncovered
    bright = view.image[:, :] > 150
    assert bright.any()
    # The block, nearer than the axis of rotation, moves against the turn.
    assert np.argwhere(bright)[:, 1].mean() < 39.5


def test_cells_count_and_divide():
    cell = matching_tables.Cell(n_images=2, kept=8, correct=6)
    assert (cell.accuracy, cell.correct_per_image) == (75.0, 3.0)
    assert np.isnan(matching_tables.Cell(1, 0, 0).accuracy)
    pooled = matching_tables.pool_tables([{"a": {"5": cell}}, {"a": {"5": matching_tables.Cell(1, 2, 0)}}])
    assert pooled == {"a": {"5": matching_tables.Cell(n_images=3, kept=10, correct=6)}}


def test_table_measures_ours_above_sift():
    photos = {"coins": matching_scenes.load_photos()["coins"]}
    matchers = matching_tables.all_matchers(200)
    chosen = {name: matchers[name] for name in ("seismo3d", "SIFT")}
    measured = matching_tables.measure_planar(photos, {"30": rotation(30.0), "60": tilt(60.0)}, chosen)
    for label in ("30", "60"):
        ours, sift = measured["seismo3d"][label], measured["SIFT"][label]
        assert ours.accuracy > 97.0
        assert ours.accuracy >= sift.accuracy
        assert ours.correct > sift.correct
    text = matching_tables.format_table("title", measured, {"SIFT": (1, 2)})
    assert "paper: SIFT" in text
    assert f"{measured['seismo3d']['30'].correct:.0f}" in text
