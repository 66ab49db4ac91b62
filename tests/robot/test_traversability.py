from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.robot import Occupancy, RobotLimits
from seismo3d.robot._kernels_ground import find_steps, fit_slopes
from seismo3d.robot.traversability import (
    BLOCKED,
    OPEN,
    STEEP,
    STEP,
    TOO_NEAR,
    UNSEEN,
    find_traversability,
    reach_of,
    renew,
)

LIMITS = RobotLimits(radius=0.2, margin=0.0, max_slope_deg=20.0, max_step=0.08)


def make(shape=(60, 60), *, cell=0.05, height=None):
    return np.zeros(shape, np.uint8), np.zeros(shape, np.float32) if height is None else height, cell


@pytest.mark.parametrize("slope_deg", [0.0, 10.0, 19.5, 20.5, 35.0])
def test_a_tilted_plane_has_its_slope(slope_deg):
    rows, columns = np.indices((40, 40))
    rise = np.tan(np.radians(slope_deg))
    height = (0.05 * rise * (0.6 * rows + 0.8 * columns)).astype(np.float32)
    slope = np.empty((40, 40))
    fit_slopes(height, 0.05, 4, slope)
    np.testing.assert_allclose(slope, rise, atol=1e-5)
    found = find_traversability(Occupancy(np.zeros((40, 40)), height, 0.05), LIMITS)
    expected = STEEP if slope_deg > 20.0 else OPEN
    assert (found.reason[8:-8, 8:-8] == expected).all()
    if expected == OPEN:
        price = 1.0 + 2.0 * (rise / np.tan(np.radians(20.0))) ** 2
        np.testing.assert_allclose(found.cost[8:-8, 8:-8] / 128, price, atol=0.005)


def test_slope_of_noisy_ground_with_holes_is_that_of_least_squares(rng):
    height = rng.normal(0.0, 0.05, (12, 13)).astype(np.float32)
    height[rng.random((12, 13)) < 0.3] = np.nan
    slope = np.empty((12, 13))
    fit_slopes(height, 0.1, 2, slope)
    for r, c in np.argwhere(np.isfinite(height)):
        i, j = np.mgrid[max(r - 2, 0) : min(r + 3, 12), max(c - 2, 0) : min(c + 3, 13)]
        z = height[i, j]
        known = np.isfinite(z)
        A = np.column_stack([j[known] * 0.1, i[known] * 0.1, np.ones(known.sum())])
        fit = np.linalg.lstsq(A, z[known].astype(float), rcond=None)[0]
        assert slope[r, c] == pytest.approx(np.hypot(fit[0], fit[1]), rel=1e-6)
    assert np.isnan(slope[np.isnan(height)]).all()


def test_kernels_equal_their_plain_selves(rng):
    height = rng.normal(0.0, 0.1, (9, 8)).astype(np.float32)
    height[2, 3] = np.nan
    for kernel, words in ((fit_slopes, (0.1, 2)), (find_steps, ())):
        compiled, plain = np.empty((9, 8)), np.empty((9, 8))
        kernel(height, *words, compiled)
        kernel.py_func(height, *words, plain)
        np.testing.assert_allclose(compiled, plain, rtol=1e-12)


def test_a_kerb_stops_the_robot_and_a_ramp_of_the_same_height_does_not():
    cells, height, cell = make((60, 60))
    height[:, 30:] = 0.15
    found = find_traversability(Occupancy(cells, height, cell), LIMITS)
    assert (found.reason[20:40, 29:31] == STEP).all()
    assert (found.reason[20:40, 25:29] == TOO_NEAR).all()
    assert (found.reason[20:40, 10:25] == OPEN).all()
    ramp = np.tile(np.linspace(0.0, 0.15, 60, dtype=np.float32), (60, 1))
    found = find_traversability(Occupancy(cells, ramp, cell), LIMITS)
    assert (found.reason[10:-10, 10:-10] == OPEN).all()


def test_open_cells_keep_the_radius_between_any_of_their_points_and_any_obstacle(rng):
    cells, height, cell = make((50, 50))
    cells[rng.random((50, 50)) < 0.01] = 1
    for radius in (0.0, 0.05, 0.12, 0.2, 0.31):
        robot = RobotLimits(radius=radius, margin=0.0)
        found = find_traversability(Occupancy(cells, height, cell), robot, unknown="passable")
        occupied = np.argwhere(cells == 1)
        gap = np.maximum(np.abs(np.argwhere(cells < 2)[:, None] - occupied) - 1, 0)
        least = cell * np.hypot(gap[..., 0], gap[..., 1]).min(axis=1).reshape(50, 50)
        free = (cells == 0) & (least >= radius - 1e-6)
        np.testing.assert_array_equal(found.reason == OPEN, free)
        np.testing.assert_array_equal(found.reason == BLOCKED, cells == 1)
        np.testing.assert_array_equal(found.cost > 0, free)


def test_unknown_ground_and_what_lies_beyond_the_map_stop_or_cost():
    cells, height, cell = make((60, 60))
    cells[20:40, 40:] = 2
    height[cells == 2] = np.nan
    shut = find_traversability(Occupancy(cells, height, cell), LIMITS)
    assert (shut.reason[20:40, 40:] == UNSEEN).all()
    assert (shut.reason[25:35, 36:40] == TOO_NEAR).all()
    assert (shut.reason[:4] == TOO_NEAR).all()
    assert (shut.reason[4:16, 4:-4] == OPEN).all()
    loose = find_traversability(Occupancy(cells, height, cell), LIMITS, unknown="passable")
    assert (loose.reason == OPEN).all()
    assert (loose.cost[cells == 2] == 3 * 128).all()
    assert (loose.cost[cells == 0] == 128).all()
    with pytest.raises(ParameterError, match="unknown is 'maybe'"):
        find_traversability(Occupancy(cells, height, cell), LIMITS, unknown="maybe")


def test_nearness_costs_up_to_the_margin():
    cells, height, cell = make((81, 81))
    cells[40, 40] = 1
    robot = RobotLimits(radius=0.2, margin=0.3)
    found = find_traversability(Occupancy(cells, height, cell), robot, unknown="passable")
    row = found.cost[40, 41:] / 128.0
    assert not row[:4].any()
    distance = cell * np.arange(4, 40)
    expected = 1.0 + 2.0 * np.clip(1.0 - (distance - 0.2) / 0.3, 0.0, 1.0)
    np.testing.assert_allclose(row[4:], expected, atol=0.005)


@pytest.mark.parametrize("unknown", ["blocked", "passable"])
def test_a_part_done_again_equals_the_whole(unknown, rng):
    cells = rng.choice(3, (70, 90), p=[0.97, 0.02, 0.01]).astype(np.uint8)
    height = rng.normal(0.0, 0.02, (70, 90)).astype(np.float32)
    robot = RobotLimits(radius=0.17, margin=0.13)
    old = find_traversability(Occupancy(cells, height, 0.05), robot, unknown=unknown)
    for area in ((0, 20, 0, 15), (30, 50, 40, 70), (55, 70, 80, 90), (0, 70, 0, 90)):
        cells[area[0] : area[0] + 2, area[2] : area[2] + 3] = 1
        whole = find_traversability(Occupancy(cells, height, 0.05), robot, unknown=unknown)
        part = renew(old, cells, height, 0.05, robot, blocks=unknown == "blocked", area=area)
        window = (slice(*area[:2]), slice(*area[2:]))
        for name in ("cost", "reason", "clearance"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[window])


def test_a_change_reaches_no_farther_than_said(rng):
    for cell, radius, margin in ((0.05, 0.2, 0.2), (0.1, 0.0, 0.0), (0.02, 0.3, 0.1)):
        robot = RobotLimits(radius=radius, margin=margin)
        cells, height = np.zeros((121, 121), np.uint8), rng.normal(0.0, 0.01, (121, 121)).astype(np.float32)
        before = find_traversability(Occupancy(cells, height, cell), robot).cost
        cells[60, 60], height[60, 60] = 1, 5.0
        where = np.argwhere(find_traversability(Occupancy(cells, height, cell), robot).cost != before)
        assert np.abs(where - 60).max() <= reach_of(robot, cell)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"radius": -0.1}, "radius is -0.1"),
        ({"max_curvature": 0.0}, "max_curvature is 0"),
        ({"max_slope_deg": 90.0}, "max_slope_deg is 90"),
        ({"max_speed": float("inf")}, "max_speed is inf"),
    ],
)
def test_limits_that_cannot_be_are_refused(words, message):
    with pytest.raises(ParameterError, match=message):
        RobotLimits(**words)
