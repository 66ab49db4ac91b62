from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.features import _kernels
from seismo3d.features.windows import histogram_map, slide_window, window_half_widths


@pytest.mark.parametrize("radius", [1.0, 1.5, 2.0, 3.0, 4.5, 6.0, 8.0, 11.0, 14.3, 20.0, 28.0])
def test_sliding_is_bit_identical_to_summing_afresh(radius, rng):
    planes = rng.integers(0, 5000, (3, 41, 58)).astype(np.int32)
    np.testing.assert_array_equal(
        slide_window(planes, radius), _kernels.window_sums(planes, window_half_widths(radius))
    )


def test_compiled_sums_equal_plain_numpy(rng):
    planes = rng.integers(0, 5000, (1, 17, 19)).astype(np.int32)
    widths = window_half_widths(3.0)
    padded = np.pad(planes[0], 8)
    expected = np.zeros((17, 19), dtype=np.int64)
    for row, width in enumerate(widths):
        for dx in range(-width, width + 1):
            dy = row - widths.size // 2
            expected += padded[8 + dy : 25 + dy, 8 + dx : 27 + dx]
    np.testing.assert_array_equal(slide_window(planes, 3.0)[0], expected)


@pytest.mark.parametrize("radius", [6.0, 9.5, 15.0, 40.0, 100.0])
def test_window_is_round(radius):
    widths = window_half_widths(radius)
    np.testing.assert_array_equal(widths, widths[::-1])
    # A sixteen-sided polygon on the pixel grid: within 2 % of the radius and one pixel.
    y = np.arange(widths.size) - widths.size // 2
    assert np.abs(np.hypot(widths, y) - radius).max() <= 0.02 * radius + 1.0
    assert abs((2.0 * widths + 1.0).sum() / (np.pi * radius**2) - 1.0) < 0.07


def test_histogram_map_of_a_ramp_votes_for_its_direction():
    y, x = np.mgrid[:40, :50]
    ramp = np.cos(np.pi / 8) * x + np.sin(np.pi / 8) * y
    histogram = histogram_map(ramp, 5.0)
    assert histogram.shape == (16, 40, 50)
    assert (histogram[:, 10:30, 10:40].argmax(axis=0) == 1).all()
    # 22.5 degrees is the centre of bin 1: float32 rounding may give a neighbour at most a sixteenth of the votes.
    assert (
        histogram[1, 10:30, 10:40] >= 15 * (histogram[:, 10:30, 10:40].sum(axis=0) - histogram[1, 10:30, 10:40])
    ).all()


def test_histograms_turn_with_the_image(rng):
    image = rng.normal(size=(48, 48))
    straight, turned = histogram_map(image, 4.5), histogram_map(np.rot90(image, -1), 4.5)
    # np.rot90(-1) turns x towards y: four of sixteen bins. Votes next to a bin's edge may round the other way.
    expected = np.roll(np.rot90(straight, -1, axes=(1, 2)), 4, axis=0)
    assert np.abs(turned - expected).max() <= 0.02 * expected.max()


def test_constant_image_has_empty_histograms():
    assert not histogram_map(np.full((20, 20), 7.0), 3.0).any()


@pytest.mark.parametrize("radius", [0.5, 300.0, np.nan])
def test_refuses_radius_out_of_bounds(radius):
    with pytest.raises(ParameterError, match="radius"):
        window_half_widths(radius)


def test_refuses_a_single_plane():
    with pytest.raises(ShapeError, match="3 axes"):
        slide_window(np.zeros((5, 5)), 2.0)
