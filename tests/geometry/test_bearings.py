"""Directions on a map."""

import numpy as np
import pytest

from seismo3d.geometry.bearings import bearing_deg, wrap_deg


@pytest.mark.parametrize(
    ("east", "north", "expected"), [(0.0, 1.0, 0.0), (1.0, 0.0, 90.0), (0.0, -1.0, 180.0), (-1.0, 0.0, 270.0)]
)
def test_bearings_run_clockwise_from_north(east, north, expected):
    assert bearing_deg(east, north) == pytest.approx(expected)


@pytest.mark.parametrize("angle", [-1e-15, -1e-6, 360.0 - 1e-9, 720.0, -360.0])
def test_a_full_turn_is_none_in_single_precision_too(angle):
    assert np.float32(wrap_deg(angle)) == 0.0


def test_angles_keep_their_shape_and_unknown_ones():
    np.testing.assert_array_equal(wrap_deg([[-90.0, np.nan], [450.0, 5.0]]), [[270.0, np.nan], [90.0, 5.0]])
