from __future__ import annotations

import csv

import numpy as np
import pytest

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.experiments._kernels_planning import a_star
from seismo3d.experiments.planning import least_clearance, path_excess, random_open, scattered_map
from seismo3d.geometry.rotations import exp_rotation, make_transform
from seismo3d.robot import Occupancy, Planner, RobotLimits, plan_path
from seismo3d.robot.speeds import find_speeds
from seismo3d.robot.traversability import find_traversability

ROBOT = RobotLimits(radius=0.15, margin=0.1, max_curvature=2.5)


def empty(side=80, cell=0.05):
    return Occupancy(np.zeros((side, side)), np.zeros((side, side)), cell)


def walled():
    """Two rooms with a door 0.6 m wide."""
    cells = np.zeros((80, 80), np.uint8)
    cells[:, 40:42] = 1
    cells[50:62, 40:42] = 0
    return Occupancy(cells, np.zeros((80, 80)), 0.05)


def test_straight_way_has_the_length_time_and_cost_of_a_line():
    path = plan_path(empty(), (1.0, 2.0), (3.0, 2.0), robot=ROBOT)
    assert path.state == "found"
    assert path.length[-1] == pytest.approx(2.0)
    assert path.cost == pytest.approx(2.0, abs=0.01)
    np.testing.assert_allclose(path.poses[:, 1:], [[2.0, 0.0]] * len(path.poses), atol=1e-9)
    np.testing.assert_array_equal(path.points_world, np.column_stack([path.poses[:, :2], 0 * path.times]))
    # half the way gaining speed at 0.5 m/s^2 up to 0.8 m/s (0.64 m, 1.6 s), the rest at 0.8
    assert path.times[-1] == pytest.approx(2 * 1.6 + (2.0 - 2 * 0.64) / 0.8, rel=0.01)
    assert path.speeds.max() == pytest.approx(0.8)
    assert path.speeds[0] == path.speeds[-1] == 0.0


def test_paths_of_random_maps_keep_every_limit():
    rng = np.random.default_rng(6)
    found = 0
    for _ in range(12):
        occupancy = scattered_map(rng, 110)
        robot = RobotLimits(
            radius=float(rng.uniform(0.1, 0.25)),
            max_curvature=float(rng.uniform(1.0, 4.0)),
            margin=float(rng.uniform(0, 0.3)),
        )
        cost = find_traversability(occupancy, robot).cost
        ends = [occupancy.centres([random_open(rng, cost, *part)[:2]])[0] for part in ((0.1, 0.4), (0.6, 0.9))]
        path = plan_path(occupancy, ends[0], (*ends[1], 1.0) if found % 2 else ends[1], robot=robot)
        if path.state != "found":
            assert np.isinf(path.cost)
            assert not len(path.poses)
            continue
        found += 1
        np.testing.assert_allclose(path.poses[[0, -1], :2], ends, atol=1e-9)
        for name, excess in path_excess(path, occupancy, robot).items():
            assert excess < 1e-9, name
        assert (np.diff(path.times) > 0).all()
        assert (np.diff(path.length) > 0).all()
    assert found >= 8


def test_the_way_leads_through_the_door_and_headings_are_kept():
    path = plan_path(walled(), (0.8, 0.8, 0.0), (3.2, 0.8, -np.pi / 2), robot=ROBOT)
    assert path.state == "found"
    crossing = path.poses[np.abs(path.poses[:, 0] - 2.05).argmin()]
    assert 2.5 < crossing[1] < 3.1
    assert path.poses[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert np.cos(path.poses[-1, 2] + np.pi / 2) == pytest.approx(1.0)
    assert least_clearance(path.poses[:, :2], walled()) >= 0.15


def test_a_robot_too_wide_for_the_door_gets_no_way():
    path = plan_path(walled(), (0.8, 0.8), (3.2, 0.8), robot=RobotLimits(radius=0.35, margin=0.0))
    assert (path.state, len(path.poses), path.cost) == ("no way", 0, np.inf)
    assert path.expansions > 0


def test_turned_and_shifted_map_gives_the_same_way_in_the_world():
    T = make_transform(exp_rotation([0.1, 0.2, 2.0]), [5.0, -3.0, 1.0])
    plain = walled()
    other = Occupancy(plain.cells, plain.height, plain.cell, (10.0, -4.0), T)
    a = plan_path(plain, (0.8, 0.8), (3.2, 0.8), robot=ROBOT)
    b = plan_path(other, (10.8, -3.2), (13.2, -3.2), robot=ROBOT)
    assert a.cost == b.cost
    moved = np.column_stack([b.poses[:, :2], np.zeros(len(b.poses))]) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(b.points_world, moved, atol=1e-9)
    np.testing.assert_allclose(a.poses[:, :2] + [10.0, -4.0], b.poses[:, :2], atol=1e-9)


def test_slopes_are_gone_around():
    rows, columns = np.indices((100, 100))
    hill = 0.6 * np.exp(-((rows - 50.0) ** 2 + (columns - 50.0) ** 2) / (2 * 14.0**2))
    occupancy = Occupancy(np.zeros((100, 100)), hill, 0.05)
    over = plan_path(occupancy, (0.6, 2.5), (4.4, 2.5), robot=RobotLimits(max_slope_deg=60.0))
    around = plan_path(occupancy, (0.6, 2.5), (4.4, 2.5), robot=RobotLimits(max_slope_deg=15.0))
    slope = np.degrees(np.arctan(np.hypot(*np.gradient(hill, 0.05))))
    climbed = [slope[tuple(occupancy.rows_columns(path.poses[:, :2]).T)].max() for path in (over, around)]
    assert climbed[1] < 16.0 < climbed[0]
    assert around.length[-1] > over.length[-1] + 0.2
    np.testing.assert_allclose(
        over.points_world[:, 2], hill[tuple(occupancy.rows_columns(over.poses[:, :2]).T)], atol=1e-6
    )


def test_plans_repaired_after_updates_equal_fresh_plans(rng):
    occupancy = scattered_map(np.random.default_rng(2), 90, share=0.05)
    cost = find_traversability(occupancy, ROBOT).cost
    start, goal = (occupancy.centres([random_open(rng, cost, *part)[:2]])[0] for part in ((0.1, 0.3), (0.7, 0.9)))
    planner = Planner(occupancy, start, goal, robot=ROBOT)
    planner.plan()
    cells, height = np.array(occupancy.cells), np.array(occupancy.height)
    states = set()
    for number in range(24):
        n = int(rng.integers(1, 5))
        where = rng.integers(0, 90, (n, 2))
        values = rng.choice(3, n, p=[0.7, 0.2, 0.1])
        rise = rng.normal(0.0, 0.04, n).astype(np.float32)
        near = np.hypot(*(where[:, None] - planner.occupancy.rows_columns([start, goal])).transpose(2, 0, 1)) < 14
        keep = ~near.any(axis=1)
        where, values, rise = where[keep], values[keep], rise[keep]
        if number % 3 == 0:
            cells[tuple(where.T)], height[tuple(where.T)] = values, rise
            planner.update_map(Occupancy(cells, height, 0.05))
        else:
            for place, value, up in zip(where, values, rise, strict=True):  # a place may come twice: the last counts
                cells[tuple(place)], height[tuple(place)] = value, up
            planner.update(where, cells[tuple(where.T)], height=height[tuple(where.T)])
        now = Occupancy(cells, height, 0.05)
        np.testing.assert_array_equal(planner.traversability.cost, find_traversability(now, ROBOT).cost)
        repaired, fresh = planner.plan(), plan_path(now, start, goal, robot=ROBOT)
        assert repaired.state == fresh.state
        assert repaired.cost == fresh.cost
        states.add(repaired.state)
        if repaired.state == "found":
            assert max(path_excess(repaired, now, ROBOT).values()) < 1e-9
    assert "found" in states


def test_small_changes_ahead_are_repaired_with_a_tenth_of_the_work():
    rng = np.random.default_rng(4)
    occupancy = scattered_map(rng, 300, share=0.08)
    planner = Planner(occupancy, (1.0, 1.0), (13.5, 13.5), robot=ROBOT)
    first = planner.plan()
    spent, fresh = [], []
    for _ in range(6):
        path = planner.plan()
        centre = path.poses[np.argmin(np.abs(path.length - rng.uniform(0.8, 2.0))), :2]
        rows, columns = np.indices(occupancy.shape)
        middle = occupancy.rows_columns([centre])[0]
        disc = (np.hypot(rows - middle[0], columns - middle[1]) < 3) & (occupancy.cells == 0)
        where = np.argwhere(disc)
        planner.update(where, np.ones(len(where)))
        repaired = planner.plan()
        again = plan_path(
            Occupancy(np.where(disc, 1, occupancy.cells), occupancy.height, 0.05), (1.0, 1.0), (13.5, 13.5), robot=ROBOT
        )
        assert repaired.cost == again.cost
        spent.append(repaired.expansions)
        fresh.append(again.expansions)
        planner.update(where, np.zeros(len(where)))
    assert np.median(fresh) > 10 * np.median(spent)
    assert planner.plan().cost == first.cost


def test_moving_obstacle_is_given_way():
    side, cell = 120, 0.05
    occupancy = empty(side, cell)
    rows, columns = np.indices((side, side))
    planner = Planner(occupancy, (0.6, 3.0), (5.4, 3.0), robot=ROBOT)
    shown = np.zeros((side, side), bool)
    pose, closest, waited = np.array([0.6, 3.0, 0.0]), np.inf, 0
    for tick in range(400):
        walker = np.array([3.0 + 0.3 * np.sin(0.1 * tick), 1.6 + 0.02 * tick])  # crosses the way
        disc = np.hypot(columns * cell - walker[0], rows * cell - walker[1]) < 0.3
        changed = np.argwhere(disc != shown)
        planner.update(changed, disc[tuple(changed.T)].astype(int))
        shown = disc
        now = least_clearance(pose[None, :2], Occupancy(disc, occupancy.height, cell))
        closest = min(closest, now)
        path = planner.plan()
        if path.state != "found":
            waited += 1
            continue
        if path.length[-1] < 1e-9:
            break
        excess = path_excess(path, Occupancy(disc, occupancy.height, cell), ROBOT)
        assert excess.pop("clearance") < max(0.15 - now, 0.0) + 1e-9
        assert max(excess.values()) < 1e-9
        ends = np.flatnonzero(np.hypot(*((path.poses[:, :2] / cell + 0.5) % 1.0 - 0.5).T) < 1e-6)
        pose = path.poses[ends[ends > 0][0]]
        planner.move_to(pose)
    assert np.hypot(*(pose[:2] - [5.4, 3.0])) < 1e-6
    assert tick > 40
    assert closest > 0.15 - 0.045  # the walker's own step between two plans


def test_blocked_ends_are_states_after_changes():
    planner = Planner(empty(), (1.0, 2.0), (3.0, 2.0), robot=ROBOT)
    assert planner.plan().state == "found"
    planner.update([[40, 60]], [1])
    assert planner.plan().state == "goal blocked"
    planner.update([[40, 60], [40, 20]], [0, 1])
    assert planner.plan().state == "start blocked"
    planner.move_to((1.5, 2.0))
    assert planner.plan().state == "found"
    with pytest.raises(GeometryError, match="outside the map"):
        planner.move_to((9.0, 0.0))


def test_a_robot_leaves_what_has_come_too_near():
    cells = np.zeros((80, 80), np.uint8)
    planner = Planner(empty(), (2.0, 2.0, 0.0), (3.5, 2.0), robot=ROBOT)
    planner.plan()
    cells[38:43, 37] = 1  # 0.125 m behind its middle
    planner.update_map(Occupancy(cells, np.zeros((80, 80)), 0.05))
    path = planner.plan()
    assert path.state == "found"
    gap = [least_clearance(p[None, :2], planner.occupancy) for p in path.poses]
    assert gap[0] == pytest.approx(0.125)
    assert min(gap) == gap[0]
    assert (np.array(gap)[path.length > 0.1] >= 0.15).all()
    planner.move_to((2.5, 2.0, 0.0))
    away = planner.plan()
    np.testing.assert_array_equal(planner._search.cost, planner.traversability.cost)
    assert away.cost == plan_path(planner.occupancy, (2.5, 2.0, 0.0), (3.5, 2.0), robot=ROBOT).cost
    cells[38:43, 51] = cells[38:43, 49] = 1
    planner.update_map(Occupancy(cells, np.zeros((80, 80)), 0.05))
    assert planner.plan().state == "start blocked"


def test_the_lattice_finds_what_a_star_finds():
    occupancy = walled()
    planner = Planner(occupancy, (0.8, 0.8), (3.2, 0.8), robot=ROBOT)
    path = planner.plan()
    search = planner._search
    expected = a_star(planner.traversability.cost, search.start, search.goal, search.motions.table)[0]
    assert path.cost == pytest.approx(expected / (408 * 128) * 0.05, rel=1e-12)


def test_speeds_brake_before_a_bend_and_gain_after_it():
    length = np.linspace(0.0, 10.0, 1001)
    curvature = np.where((length[1:] > 5.0) & (length[1:] < 6.0), 2.0, 0.0)
    robot = RobotLimits(max_speed=1.5, max_acceleration=0.4, max_lateral_acceleration=0.5)
    speeds, times = find_speeds(length, curvature, robot)
    bend = speeds[(length > 5.0) & (length < 5.99)]
    np.testing.assert_allclose(bend, 0.5, atol=1e-9)  # v^2 k = 0.5
    assert np.abs(np.diff(speeds**2) / (2 * np.diff(length))).max() <= 0.4 + 1e-9
    before = speeds[(length > 3.0) & (length < 4.9)]
    assert before.max() > 1.2
    np.testing.assert_allclose(np.diff(times), np.diff(length) / (0.5 * (speeds[1:] + speeds[:-1])))
    assert find_speeds(np.zeros(1), np.zeros(0), robot)[1].tolist() == [0.0]


def test_start_equal_to_goal_is_a_path_of_one_pose():
    path = plan_path(empty(), (2.0, 2.0), (2.0, 2.0), robot=ROBOT)
    assert (path.state, path.cost, len(path.poses), path.times.tolist()) == ("found", 0.0, 1, [0.0])


def test_csv_holds_the_path(tmp_path):
    path = plan_path(walled(), (0.8, 0.8), (3.2, 0.8), robot=ROBOT)
    path.save_csv(tmp_path / "path.csv")
    rows = list(csv.DictReader((tmp_path / "path.csv").read_text().splitlines()))
    table = np.array([[float(v) for v in row.values()] for row in rows])
    assert list(rows[0]) == ["time", "x", "y", "heading", "speed", "curvature", "world_x", "world_y", "world_z"]
    expected = np.column_stack([path.times, path.poses, path.speeds, path.curvature, path.points_world])
    np.testing.assert_allclose(table, expected, atol=6e-5)


def test_refusals():
    cells = np.zeros((80, 80), np.uint8)
    cells[40, 40], cells[60:, 60:] = 1, 2
    occupancy = Occupancy(cells, np.zeros((80, 80)), 0.05)
    with pytest.raises(GeometryError, match=r"start \(9, 1\) lies outside the map; expected x from -0.025 to 3.975"):
        plan_path(occupancy, (9.0, 1.0), (1.0, 1.0))
    with pytest.raises(GeometryError, match=r"goal \(2, 2\) is where the robot can't stand: it is occupied"):
        plan_path(occupancy, (1.0, 1.0), (2.0, 2.0))
    with pytest.raises(GeometryError, match=r"it lies too near .* \(there: 0.15 m\)"):
        plan_path(occupancy, (1.0, 1.0), (2.2, 2.0))
    with pytest.raises(GeometryError, match="it is unknown ground"):
        plan_path(occupancy, (3.5, 3.5), (1.0, 1.0))
    with pytest.raises(ParameterError, match=r"robot is of type dict; expected RobotLimits\. Give RobotLimits"):
        plan_path(occupancy, (1.0, 1.0), (2.0, 2.0), robot={"radius": 0.2})
    with pytest.raises(ParameterError, match=r"start is \(1.0,\); expected \(x, y\)"):
        plan_path(occupancy, (1.0,), (1.0, 1.0))
    planner = Planner(occupancy, (1.0, 1.0), (1.0, 3.0))
    with pytest.raises(ParameterError, match="leaves the map"):
        planner.update([[80, 0]], [1])
    with pytest.raises(ParameterError, match="other values than 0, 1 and 2"):
        planner.update([[8, 0]], [3])
    with pytest.raises(ShapeError, match="one cell a row"):
        planner.update([[8, 0]], [1, 1])
    assert planner.update(np.zeros((0, 2)), []) == 0
    with pytest.raises(ParameterError, match="Make a new Planner"):
        planner.update_map(empty(70))
