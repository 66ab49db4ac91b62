"""The kernel that follows patches, on images whose motion is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from seismo3d.robot import _kernels_follow as following
from seismo3d.robot.landmarks import _follow, _padded_levels

Picture = Callable[[np.ndarray, np.ndarray], np.ndarray]


def make_picture(rng: np.random.Generator) -> Picture:
    """Brightness as a function of place: waves of all directions, from 16 to 200 pixels long."""
    waves = 2.0 * np.pi / np.geomspace(16.0, 200.0, 60)
    turn, phase = rng.uniform(0.0, 2.0 * np.pi, (2, 60))

    def picture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        along = x[..., None] * np.cos(turn) + y[..., None] * np.sin(turn)
        return np.clip(np.rint(128.0 + 12.0 * np.sin(along * waves + phase).sum(axis=-1)), 0, 255).astype(np.uint8)

    return picture


def grid(rows: int = 240, columns: int = 320) -> list[np.ndarray]:
    return np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))


PIXELS = np.stack(np.meshgrid(np.linspace(50.3, 270.1, 7), np.linspace(50.0, 190.6, 6)), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.37, -0.81), (6.4, 3.2), (-17.7, 21.3)])
def test_patches_are_found_where_they_went(rng: np.random.Generator, shift: tuple[float, float]) -> None:
    x, y = grid()
    picture = make_picture(rng)
    before, now = (_padded_levels(picture(x - s * shift[0], y - s * shift[1])) for s in (0.0, 1.0))
    there, good = _follow(before, now, PIXELS, PIXELS)
    assert good.mean() > 0.95
    # the last step is up to 0.03 long, grey values are whole numbers, and the patch is interpolated linearly
    off = np.abs(there - PIXELS - shift)[good]
    assert off.max() < 0.06
    assert np.median(off) < 0.02


@pytest.mark.parametrize(("contrast", "brightness"), [(0.35, 0.0), (0.5, 60.0), (2.5, -60.0)])
def test_patches_are_found_under_another_exposure(rng: np.random.Generator, contrast: float, brightness: float) -> None:
    x, y = grid()
    picture = make_picture(rng)

    def exposed(shift: np.ndarray, contrast: float, brightness: float) -> np.ndarray:
        even = 128.0 + 0.4 * (picture(x - shift[0], y - shift[1]) - 128.0)
        return np.clip(np.rint(128.0 + contrast * (even - 128.0) + brightness), 0, 255).astype(np.uint8)

    shift = np.array([6.4, -3.2])
    before, now = exposed(np.zeros(2), 1.0, 0.0), exposed(shift, contrast, brightness)
    there, good = _follow(_padded_levels(before), _padded_levels(now), PIXELS, PIXELS)
    assert good.mean() > 0.85
    assert np.median(np.abs(there - PIXELS - shift)[good]) < 0.05


def test_a_guess_serves_where_the_shift_is_too_large_without_one(rng: np.random.Generator) -> None:
    x, y = grid()
    picture = make_picture(rng)
    before, now = _padded_levels(picture(x, y)), _padded_levels(picture(x + 45.0, y))
    inner = PIXELS[PIXELS[:, 0] > 70.0]
    there, good = _follow(before, now, inner, inner - [43.0, -1.0])
    assert good.all()
    np.testing.assert_allclose(there, inner - [45.0, 0.0], atol=0.06)


def test_what_tells_nothing_or_has_left_is_not_found(rng: np.random.Generator) -> None:
    x, y = grid()
    picture = make_picture(rng)
    image, edge = picture(x, y), np.where(x < 160.0, 60, 190).astype(np.uint8)
    flat = np.full_like(image, 99)
    for one in (flat, edge):  # an edge tells nothing along itself
        levels = _padded_levels(one)
        assert not _follow(levels, levels, PIXELS, PIXELS)[1].any()
    levels = _padded_levels(image)
    for gone in ([-3.0, 40.0], [400.0, 100.0], [100.0, 239.6]):
        out = np.array([gone])
        assert not _follow(levels, levels, out, out)[1].any()
    other = _padded_levels(make_picture(np.random.default_rng(5))(x, y))
    assert _follow(levels, other, PIXELS, PIXELS)[1].mean() < 0.3


def test_noise_of_a_bare_wall_is_followed_nowhere(rng: np.random.Generator) -> None:
    one, other = (np.clip(128.0 + 3.0 * rng.standard_normal((240, 320)), 0, 255).astype(np.uint8) for _ in range(2))
    assert not _follow(_padded_levels(one), _padded_levels(other), PIXELS, PIXELS)[1].any()
    assert _follow(_padded_levels(one), _padded_levels(one), PIXELS, PIXELS)[1].all()


def test_likeness_is_the_correlation_of_the_patches(rng: np.random.Generator) -> None:
    one, other = rng.integers(0, 256, (2, 60, 70)).astype(np.uint8)
    other = np.roll(one, 2, axis=1) // 2 + other // 8
    pixels = np.array([[30.0, 25.0], [40.0, 33.0]])
    places = pixels + np.array([2.0, 0.0])
    found = np.empty(2)
    following.compare_patches(np.pad(one, following.PAD), np.pad(other, following.PAD), pixels, places, found)
    for (x, y), (u, v), like in zip(pixels.astype(int), places.astype(int), found):
        patches = [one[y - 7 : y + 8, x - 7 : x + 8].ravel(), other[v - 7 : v + 8, u - 7 : u + 8].ravel()]
        assert like == pytest.approx(np.corrcoef(patches)[0, 1], abs=1e-6)


def test_gradients_are_scharrs(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (60, 70)).astype(np.uint8)
    patch, gx, gy = (np.zeros((15, 16), np.float32) for _ in range(3))
    padded = np.pad(image, following.PAD)
    following.take_patch(padded, 30.0, 25.0, np.zeros((17, 18), np.float32), patch, gx, gy)
    whole = image.astype(float)
    np.testing.assert_allclose(patch[:, :15], whole[18:33, 23:38])
    for found, over, across in ((gx, 1, 0), (gy, 0, 1)):
        step = (np.roll(whole, -1, axis=over) - np.roll(whole, 1, axis=over)) / 2.0
        smooth = (3.0 * np.roll(step, 1, axis=across) + 10.0 * step + 3.0 * np.roll(step, -1, axis=across)) / 16.0
        np.testing.assert_allclose(found[:, :15], smooth[18:33, 23:38], atol=1e-4)
        assert not found[:, 15].any()


def test_small_images_are_followed_without_smaller_ones(rng: np.random.Generator) -> None:
    x, y = grid(24, 32)
    picture = make_picture(rng)
    before, now = _padded_levels(picture(x, y)), _padded_levels(picture(x - 1.2, y + 0.7))
    pixel = np.array([[15.0, 12.0]])
    there, good = _follow(before, now, pixel, pixel)
    assert good.all()
    np.testing.assert_allclose(there - pixel, [[1.2, -0.7]], atol=0.06)
