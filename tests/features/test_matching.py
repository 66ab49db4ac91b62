from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from skimage import data

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.features.matching import Matches, match
from seismo3d.synthetic import fault_section

# Photographs carry noise of two grey levels on both sides; refined matches are good to a tenth of a pixel on average.
MEDIAN_ERROR = 0.2


@pytest.fixture(scope="module")
def photo():
    return cv2.resize(data.camera(), (360, 360), interpolation=cv2.INTER_AREA)


def noisy(image, seed):
    grey = image.astype(np.float32) + np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def about_centre(shape, angle_deg=0.0, scale=1.0, squeeze=1.0):
    a = math.radians(angle_deg)
    A = scale * np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]) @ np.diag([squeeze, 1.0])
    centre = (np.array(shape[::-1]) - 1.0) / 2.0
    return np.column_stack([A, centre - A @ centre])


def warped(image, A):
    smooth = cv2.GaussianBlur(image, (0, 0), 0.6) if abs(np.linalg.det(A[:, :2])) < 0.9 else image
    return cv2.warpAffine(smooth, A, image.shape[::-1], flags=cv2.INTER_CUBIC)


def errors(found: Matches, A):
    return np.linalg.norm(found.points_source @ A[:, :2].T + A[:, 2] - found.points_target, axis=1)


@pytest.mark.parametrize("angle_deg", [0.0, 11.25, 30.0, 56.25, 101.0, 180.0, -75.0])
def test_rotation_is_found_and_reported(photo, angle_deg):
    A = about_centre(photo.shape, angle_deg)
    found = match(noisy(warped(photo, A), 1), noisy(photo, 2), n_points=300)
    assert len(found) > 120
    assert (errors(found, A) < 3.0).mean() > 0.99
    assert np.median(errors(found, A)) < MEDIAN_ERROR
    turn = (found.angle - math.radians(angle_deg) + math.pi) % (2.0 * math.pi) - math.pi
    assert np.median(np.abs(turn)) < math.radians(1.0)
    assert np.median(found.scale) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("scale", [0.5, 0.7, 1.3, 2.0])
def test_scale_is_target_over_source(photo, scale):
    A = about_centre(photo.shape, 20.0, scale)
    found = match(noisy(warped(photo, A), 1), noisy(photo, 2), n_points=400)
    assert len(found) > 40
    assert (errors(found, A) < 3.0).mean() > 0.98
    assert np.median(found.scale) == pytest.approx(scale, rel=0.02)
    assert np.abs(found.A_target_source - A[:, :2]).max(axis=(1, 2)).mean() < 0.15 * scale


def test_swapping_the_images_inverts_angle_and_scale(photo):
    other = noisy(warped(photo, about_centre(photo.shape, 40.0, 0.8)), 1)
    forth, back = match(other, photo, n_points=300), match(photo, other, n_points=300)
    assert np.median(forth.angle) == pytest.approx(-np.median(back.angle), abs=0.01)
    assert np.median(forth.scale) * np.median(back.scale) == pytest.approx(1.0, abs=0.01)


def test_sixty_degrees_of_tilt(photo):
    A = about_centre(photo.shape, 15.0, squeeze=0.5)
    found = match(noisy(warped(photo, A), 1), noisy(photo, 2), n_points=400)
    assert len(found) > 100
    assert (errors(found, A) < 3.0).mean() > 0.97


def test_tilts_always_finds_what_tilts_never_cannot(photo):
    A = about_centre(photo.shape, 0.0, squeeze=0.3)
    never = match(noisy(warped(photo, A), 1), noisy(photo, 2), n_points=200, tilts="never")
    always = match(noisy(warped(photo, A), 1), noisy(photo, 2), n_points=200, tilts="always")
    assert (errors(always, A) < 3.0).sum() > 5 + 2 * (errors(never, A) < 3.0).sum()


def test_brightness_contrast_and_type_do_not_matter(photo):
    A = about_centre(photo.shape, 30.0)
    other = warped(photo, A)
    plain = match(other, photo, n_points=200)
    scaled = match(other.astype(np.float64) * 1e-6 - 3.0, photo.astype(np.float32) * 50.0, n_points=200)
    assert abs(len(plain) - len(scaled)) <= 0.03 * len(plain)  # another grey level here and there
    assert (errors(scaled, A) < 3.0).all()


def test_result_does_not_depend_on_the_number_of_threads(photo):
    other = warped(photo, about_centre(photo.shape, 30.0))
    n_threads = cv2.getNumThreads()
    results = []
    try:
        for n in (1, 4):
            cv2.setNumThreads(n)
            results.append(match(other, photo, n_points=200))
    finally:
        cv2.setNumThreads(n_threads)
    np.testing.assert_array_equal(results[0].points_source, results[1].points_source)
    np.testing.assert_array_equal(results[0].score, results[1].score)


def test_results_are_read_only_and_best_first(photo):
    found = match(photo, photo, n_points=100)
    assert (np.diff(found.score) <= 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        found.points_target[0, 0] = 1.0


def test_colour_counts_as_grey():
    colour = data.astronaut()[:256, 100:356]
    grey = colour.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
    np.testing.assert_allclose(
        match(colour, colour, n_points=50).points_target, match(grey, grey, n_points=50).points_target
    )


def test_missing_data_is_left_out(photo):
    A = about_centre(photo.shape, 25.0)
    other = warped(photo, A).astype(np.float32)
    hole = photo.astype(np.float32)
    hole[100:220, 120:260] = np.nan
    found = match(other, hole, n_points=300)
    x, y = np.rint(found.points_source).astype(int).T
    assert np.isfinite(hole[y, x]).all()
    assert len(found) > 60
    assert (errors(found, A) < 3.0).mean() > 0.98


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_scattered_missing_pixels_are_told_by_those_around(photo, rng, share):
    A = about_centre(photo.shape, 25.0)
    target, source = warped(photo, A).astype(np.float32), photo.astype(np.float32)
    for image in (target, source):
        image[rng.random(image.shape) < share] = np.nan
    found = match(target, source, n_points=300)
    assert len(found) > 100
    assert errors(found, A).max() < 2.0
    assert np.median(errors(found, A)) < MEDIAN_ERROR
    for image, points in ((target, found.points_target), (source, found.points_source)):
        x, y = np.rint(points).astype(int).T
        assert np.isfinite(image[y, x]).all()


@pytest.mark.parametrize("sigma", [1.0, 2.0])
def test_a_blur_is_no_change_of_size(photo, sigma):
    found = match(cv2.GaussianBlur(photo, (0, 0), sigma), photo)
    assert len(found) > 200
    assert np.abs(np.log(found.scale)).max() < 0.15
    # The corner of a blurred patch lies a fraction of the blur's width further in.
    assert np.median(np.linalg.norm(found.points_target - found.points_source, axis=1)) < 0.3 * sigma


def test_mask_equals_nan(photo):
    other = warped(photo, about_centre(photo.shape, 25.0)).astype(np.float32)
    live = np.ones(photo.shape, dtype=bool)
    live[:, 140:170] = False
    hole = np.where(live, photo, np.float32(np.nan)).astype(np.float32)
    masked = match(other, photo.astype(np.float32), mask_source=live, n_points=200)
    missing = match(other, hole, n_points=200)
    np.testing.assert_array_equal(masked.points_source, missing.points_source)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((64, 80)),
        np.full((64, 80), 7, dtype=np.uint8),
        np.full((64, 80), np.nan),
        np.full((16, 16), 3.0),
        np.tile(np.arange(80.0), (64, 1)),
        np.pad([[1.0]], ((30, 33), (40, 39))),
        np.full((20, 20, 20), 2.0),
        np.tile(np.sin(np.arange(90) / 5.0), (80, 1)),
        np.tile(np.sin(np.arange(40) / 3.0), (40, 40, 1)),
        np.zeros((64, 80), dtype=bool),
    ],
)
def test_nothing_to_see_gives_no_matches(image):
    found = match(image, image)
    assert isinstance(found, Matches)
    assert len(found) == 0
    assert found.points_target.shape == (0, image.ndim)
    assert found.A_target_source.shape == (0, image.ndim, image.ndim)


def test_spikes_do_no_harm(photo):
    spiked = photo.astype(np.float64)
    spiked[50, 60], spiked[200, 10], spiked[7, 300] = 1e12, -1e12, np.inf
    found = match(spiked, photo, n_points=200)
    assert len(found) > 100
    assert np.abs(found.points_target - found.points_source).max() < 1.0


def test_noise_is_not_matched(rng):
    found = match(rng.normal(size=(240, 320)), rng.normal(size=(240, 320)), tilts="always", n_points=300)
    assert len(found) <= 0.01 * found.n_points[0]


@pytest.mark.parametrize(
    ("one", "other"),
    [("camera", "coins"), ("brick", "grass"), ("page", "text"), ("moon", "gravel"), ("camera", "chelsea")],
)
def test_unrelated_images_are_not_matched(one, other):
    found = match(getattr(data, one)(), getattr(data, other)())
    assert len(found) <= 0.01 * min(found.n_points)


@pytest.mark.parametrize(("one", "other"), [("clean", "crossing"), ("folded", "low_dips")])
def test_sections_of_different_cubes_are_not_matched(one, other):
    first, second = (fault_section(kind, seed=s, shape=(64, 240, 200)).seismic.T for kind, s in ((one, 3), (other, 8)))
    found = match(first, second)
    assert len(found) <= 0.01 * min(found.n_points)


def test_a_photograph_and_a_section_are_not_matched(photo):
    found = match(photo, fault_section("crossing", seed=3, shape=(64, 240, 200)).seismic.T)
    assert len(found) <= 0.01 * min(found.n_points)


@pytest.mark.parametrize(
    ("target", "source", "message"),
    [
        (np.zeros((8, 40)), np.zeros((40, 40)), "target has shape"),
        (np.zeros((40, 40)), np.zeros((100, 3)), "register"),
        (np.zeros((40, 40)), np.zeros((40, 40, 40)), "two images or two volumes"),
        (np.zeros((40, 40), complex), np.zeros((40, 40)), "complex"),
        (np.zeros(40), np.zeros((40, 40)), "expected an image"),
        ([["a"] * 20] * 20, np.zeros((40, 40)), "real numbers"),
    ],
)
def test_refuses_what_is_no_image(target, source, message):
    with pytest.raises(ShapeError, match=message):
        match(target, source)


def test_refuses_settings_out_of_bounds(photo):
    with pytest.raises(ShapeError, match="mask of source has shape"):
        match(photo, photo, mask_source=np.ones((3, 3), bool))
    with pytest.raises(ParameterError, match="n_points"):
        match(photo, photo, n_points=0)
    with pytest.raises(ParameterError, match=r"n_points is 2\.5; expected a whole number"):
        match(photo, photo, n_points=2.5)
    with pytest.raises(ParameterError, match="tilts"):
        match(photo, photo, tilts="sometimes")
