from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plane_motions import ALONG_INLINES, in_parts, plane_motion

from seismo3d.seismic.fault_motion import find_motion, undo_parts


@pytest.mark.parametrize(("cotangent", "throw"), [(0.4, 10.0), (0.4, -6.0), (-0.3, 5.0)])
def test_the_hanging_wall_goes_back_up_the_surface(cotangent, throw):
    motion = plane_motion(ALONG_INLINES, cotangent=cotangent, throw=throw)
    hanging = 32.0 + motion.hanging_side * 9.0
    points = np.array([[20.0, hanging, 40.0], [20.0, 64.0 - hanging, 40.0]])
    np.testing.assert_array_equal(np.sign(motion.side(points)), [1.0, -1.0])
    moved = motion.undo(points)
    np.testing.assert_allclose(moved[0], [20.0, hanging - cotangent * throw, 40.0 - throw], atol=1e-3)
    np.testing.assert_array_equal(moved[1], points[1])


def test_slip_along_strike_goes_back_too():
    motion = plane_motion(ALONG_INLINES, share=0.5)
    moved = motion.undo(np.array([[20.0, 40.0, 40.0]]))
    # the frame's `along` is against growing inlines
    np.testing.assert_allclose(moved[0], [25.0, 36.0, 30.0], atol=1e-3)


def test_a_plane_goes_on_beyond_its_grid():
    motion = plane_motion(ALONG_INLINES)
    np.testing.assert_allclose(motion.height_at(np.array([-90.0]), np.array([110.0])), [28.0], atol=1e-6)
    assert motion.apart_at(np.array([[90.0, 32.0, 40.0]]))[0] == pytest.approx(27.0)


@pytest.mark.parametrize("cotangent", [0.4, -0.3])
def test_points_near_a_motion_are_those_that_its_distances_tell(cotangent):
    rng = np.random.default_rng(0)
    motion = plane_motion(ALONG_INLINES, cotangent=cotangent, offset=2.0 * np.sin(0.2 * np.arange(80.0)))
    points = rng.uniform([-20.0, -20.0, -20.0], [90.0, 90.0, 110.0], (3000, 3))
    found, side = motion.find_near(points, clear=2.0, reach=20.0, edge=6.0)
    away = np.abs(motion.side(points))
    expected = (away > 2.0) & (away < 20.0) & (motion.apart_at(points) <= 6.0)
    np.testing.assert_array_equal(found, np.flatnonzero(expected))
    np.testing.assert_allclose(side, motion.side(points[found]), atol=1e-9)
    assert 100 < len(found) < 1500


def test_a_motion_keeps_the_top_of_a_bell_that_matches_badly():
    rows, samples = np.indices((64, 64)) * 2.0
    bell = 18.0 * np.exp(-0.5 * (((rows - 60.0) / 45.0) ** 2 + ((samples - 70.0) / 40.0) ** 2))
    noise = np.random.default_rng(2).normal(0.0, 0.5, bell.shape)
    motion = find_motion(
        ALONG_INLINES, (0.0, 0.0), np.full((128, 128), 32.0), (bell + noise).astype(np.float32),
        np.full(bell.shape, 0.6, np.float32), hanging_side=1, share=0.0, stiffness=1000.0,
    )  # fmt: skip
    off = motion.throw[::2, ::2] - bell
    assert np.abs(off).max() < 0.4
    # and how it changes, which strains what lies beside it
    change = np.abs(np.gradient(off, 2.0)).max()
    assert change < 0.05


def test_a_fault_found_in_parts_moves_nothing_twice():
    whole = plane_motion(ALONG_INLINES, throw=8.0)
    first, second = in_parts(heave=0.0)
    points = np.random.default_rng(1).uniform([0.0, 0.0, 10.0], [63.0, 63.0, 70.0], (400, 3))
    parts = [replace(part, throw=np.full(part.throw.shape, 8.0)) for part in (first, second)]
    np.testing.assert_allclose(undo_parts(parts, points), whole.undo(points), atol=1e-6)
    np.testing.assert_array_equal(undo_parts(parts[:1], points), parts[0].undo(points))
    # each by its own throw
    parts[1] = replace(parts[1], throw=np.full(second.throw.shape, 3.0))
    moved = points[:, 2] - undo_parts(parts, points)[:, 2]
    hanging = whole.side(points) > 0
    s = ALONG_INLINES.lay(points)[0]
    np.testing.assert_allclose(moved[hanging & (s < -34.0)], 8.0, atol=1e-6)
    np.testing.assert_allclose(moved[hanging & (s > -29.0)], 3.0, atol=1e-6)
    np.testing.assert_array_equal(moved[~hanging], 0.0)
