"""Measurements of the planner, for anyone to run: ``python -m seismo3d.experiments.planning``.

Parts: ``changes`` (1,000 random changes of a map, each repair against a fresh A*), ``small`` (a small change of a map
of 1,000 x 1,000 cells: vertices expanded by the repair and from scratch), ``paths`` (every path of random maps against
the robot's limits).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.experiments._command import run_command
from seismo3d.experiments._kernels_planning import a_star
from seismo3d.robot.dstar import DStarLite
from seismo3d.robot.lattice import lattice_motions
from seismo3d.robot.motions import UNIT, Motions, grid_motions
from seismo3d.robot.occupancy import Occupancy
from seismo3d.robot.planning import Path, RobotLimits, plan_path
from seismo3d.robot.traversability import find_traversability

PARTS = ("changes", "small", "paths")
CELL = 0.05


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts that are asked for and print their figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="parts to run; all by default")
    parser.add_argument("--changes", type=int, default=1000, help="random changes of the map")
    parser.add_argument("--side", type=int, default=1000, help="cells along a side of the large map")
    parser.add_argument(
        "--trials", type=int, default=15, help="obstacles on the large map, of each kind; a third on the lattice"
    )
    parser.add_argument("--maps", type=int, default=40, help="random maps whose paths are checked")
    given = parser.parse_args(arguments)
    runs: dict[str, Any] = {
        "changes": lambda: report_changes(given.changes),
        "small": lambda: report_small(given.side, given.trials),
        "paths": lambda: report_paths(given.maps),
    }
    for part in given.parts or PARTS:
        runs[part]()


def scattered_map(rng: np.random.Generator, side: int, *, share: float = 0.12) -> Occupancy:
    """Return a square map of free, bumpy ground with boxes and discs on it, until so large a share is covered."""
    cells = np.zeros((side, side), dtype=np.uint8)
    rows, columns = np.indices(cells.shape)
    while cells.mean() < share:
        r, c = rng.uniform(0, side, 2)
        half = rng.uniform(2.0, max(0.03 * side, 6.0), 2)
        low, high = np.maximum(np.array([r, c]) - half.max() - 1, 0).astype(int), np.array([r, c]) + half.max() + 2
        window = (slice(low[0], int(high[0])), slice(low[1], int(high[1])))
        y, x = rows[window] - r, columns[window] - c
        if rng.random() < 0.5:
            cells[window][x * x + y * y < half[0] ** 2] = 1
        else:
            angle = rng.uniform(0.0, np.pi)
            u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
            cells[window][(np.abs(u) < half[0]) & (np.abs(v) < half[1])] = 1
    bumps = ndimage.gaussian_filter(rng.standard_normal(cells.shape), 12.0, mode="wrap")
    return Occupancy(cells, 0.05 * bumps / bumps.std(), CELL)


def random_open(rng: np.random.Generator, cost: AnyArray, low: float, high: float) -> tuple[int, int, int]:
    """Return a random cell that can be entered, with row and column between two shares of the side."""
    side = np.array(cost.shape)
    while True:
        row, column = (rng.uniform(low, high, 2) * side).astype(int)
        if cost[row, column] > 0:
            return int(row), int(column), -1


def report_changes(n: int) -> None:
    """Print how many repairs cost what a fresh A* says, and what they and the A* expanded."""
    cases = (("grid", grid_motions(), 200), ("lattice", lattice_motions(10.0), 120))
    for name, motions, side in cases:
        rng = np.random.default_rng(3)
        cost = find_traversability(scattered_map(rng, side), RobotLimits(radius=0.1, margin=0.1)).cost
        start, goal = random_open(rng, cost, 0.05, 0.25), random_open(rng, cost, 0.75, 0.95)
        search = DStarLite(cost, motions, start=start, goal=goal)
        first = search.repair().expansions
        same = most = lost = spent = fresh = 0
        for _ in range(n):
            k = int(rng.integers(1, 11))
            where = rng.integers(0, side, (k, 2))
            where = where[~((where == start[:2]).all(axis=1) | (where == goal[:2]).all(axis=1))]
            values = rng.integers(UNIT, 4 * UNIT, len(where))
            values[rng.random(len(where)) < 0.2] = 0
            search.update(where, values)
            repair = search.repair()
            expected, expansions = a_star(search.cost, search.start, search.goal, motions.table)
            same += repair.cost == expected
            lost += repair.state != "found"
            most, spent, fresh = max(most, repair.most), spent + repair.expansions, fresh + expansions
        print(
            f"changes: {name} {side} x {side}, {same} of {n} repairs cost what A* says ({lost} without a way); a "
            f"vertex expanded {most} times at most; expansions a repair {spent / n:.0f}, A* {fresh / n:.0f}, first "
            f"plan {first}"
        )


def report_small(side: int, trials: int) -> None:
    """Print what a repair expands after an obstacle appears, and what a search from scratch does."""
    cases: tuple[tuple[str, Motions], ...] = (("grid", grid_motions()), ("lattice", lattice_motions(10.0)))
    robot = RobotLimits()
    for name, motions in cases:
        rng = np.random.default_rng(5)
        occupancy = scattered_map(rng, side)
        cost = find_traversability(occupancy, robot).cost
        start, goal = random_open(rng, cost, 0.02, 0.1), random_open(rng, cost, 0.9, 0.98)
        clock = time.perf_counter()
        search = DStarLite(cost, motions, start=start, goal=goal)
        first = search.repair()
        seconds = time.perf_counter() - clock
        print(f"small: {name} {side} x {side}, first plan {first.expansions} expansions, {seconds:.2f} s")
        for where in ("up to 3 m ahead", "anywhere on the way", "anywhere on the map"):
            rows = [
                _one_change(search, motions, occupancy, robot, rng, where)
                for _ in range(trials if name == "grid" else max(trials // 3, 1))
            ]
            spent, fresh, clock_spent, clock_fresh = np.array(rows).T
            ratio = fresh / np.maximum(spent, 1)
            print(
                f"small: {name}, 0.6 m wide obstacle {where}: repair {np.median(spent):.0f} expansions "
                f"({1e3 * np.median(clock_spent):.1f} ms), scratch {np.median(fresh):.0f} "
                f"({1e3 * np.median(clock_fresh):.0f} ms); {np.median(ratio):.0f} times fewer in the median, "
                f"{ratio.min():.1f} at the least, {fresh.sum() / max(spent.sum(), 1):.1f} in sum"
            )


def _one_change(
    search: DStarLite, motions: Motions, occupancy: Occupancy, robot: RobotLimits, rng: np.random.Generator, where: str
) -> tuple[int, int, float, float]:
    """Put an obstacle somewhere, repair, plan from scratch beside it, and take the obstacle away again."""
    rows, columns = np.indices(occupancy.shape)
    r, c = _obstacle_place(search, motions, occupancy.cell, rng, where)
    near = np.hypot(rows - r, columns - c) * occupancy.cell < 0.3
    blocked = Occupancy(np.where(near, 1, occupancy.cells), occupancy.height, occupancy.cell)
    new, old = find_traversability(blocked, robot).cost.copy(), search.cost.copy()
    new[search.start[:2]] = old[search.start[:2]]
    changed = np.argwhere(new != old)
    clock = time.perf_counter()
    search.update(changed, new[changed[:, 0], changed[:, 1]])
    spent = search.repair()
    middle = time.perf_counter()
    fresh = DStarLite(search.cost, motions, start=search.start, goal=search.goal)
    scratch = fresh.repair()
    seconds = middle - clock, time.perf_counter() - middle
    if scratch.cost != spent.cost:
        raise AssertionError(f"repair {spent.cost}, scratch {scratch.cost}")
    search.update(changed, old[changed[:, 0], changed[:, 1]])
    search.repair()
    return spent.expansions, scratch.expansions, *seconds


def _obstacle_place(
    search: DStarLite, motions: Motions, cell: float, rng: np.random.Generator, where: str
) -> tuple[int, int]:
    """Draw a cell a metre or more from the goal and 0.8 m from the start."""
    if where == "anywhere on the map":
        while True:
            row, column = (int(v) for v in rng.integers(0, search.cost.shape))
            ends = np.array([search.start[:2], search.goal[:2]])
            if search.cost[row, column] > 0 and (np.hypot(*(ends - (row, column)).T) * cell > 1.0).all():
                return row, column
    _, route = search.route()
    ahead = np.cumsum([motions.steps[m].points[-1, 3] for m in route]) * cell
    steps = np.array([(motions.steps[m].rows, motions.steps[m].columns) for m in route])
    places = np.array(search.start[:2]) + np.cumsum(steps, axis=0)
    apart = np.hypot(*(places - search.goal[:2]).T) * cell
    most = 3.5 if where == "up to 3 m ahead" else np.inf
    row, column = places[rng.choice(np.flatnonzero((ahead > 0.8) & (ahead < most) & (apart > 1.0)))]
    return int(row), int(column)


def path_excess(path: Path, occupancy: Occupancy, robot: RobotLimits) -> dict[str, float]:
    """Return by how much a path breaks each limit, measured on its points alone; where it is kept, zero or less.

    Parameters
    ----------
    path : Path
        One that was found, of two points or more.
    occupancy : Occupancy
        The map that it was found on; only what is occupied counts here.
    robot : RobotLimits

    Returns
    -------
    dict of str to float
        curvature (1/m), speed (m/s), acceleration and lateral (m/s^2), clearance (m), and "joints": the largest
        distance (m) between a step's length and the arc that its ends' headings ask for.
    """
    s, (x, y, heading) = path.length, path.poses.T
    ds, dt, turn = np.diff(s), np.diff(path.times), np.diff(heading)
    bend = np.abs(turn) / ds
    chord = np.hypot(np.diff(x), np.diff(y))
    along = np.arctan2(np.diff(y), np.diff(x)) - heading[:-1] - 0.5 * turn
    fast = np.maximum(path.speeds[1:], path.speeds[:-1])
    finer = np.concatenate([_between(path, share) for share in np.linspace(0.0, 1.0, 9)])
    return {
        "curvature": float(bend.max() - robot.max_curvature),
        "speed": float(path.speeds.max() - robot.max_speed),
        "acceleration": float(np.abs(np.diff(path.speeds) / dt).max() - robot.max_acceleration),
        "lateral": float((fast**2 * bend).max() - robot.max_lateral_acceleration),
        "clearance": robot.radius - least_clearance(finer, occupancy),
        "joints": float(
            max(np.abs(chord - ds * np.sinc(turn / (2 * np.pi))).max(), (chord * np.abs(np.sin(along))).max())
        ),
    }


def _between(path: Path, share: float) -> Float64Array:
    """Points on the arcs between a path's points, at a share of each."""
    turn, ds = np.diff(path.poses[:, 2]), np.diff(path.length)
    part = share * ds * np.sinc(share * turn / (2 * np.pi))
    along = path.poses[:-1, 2] + 0.5 * share * turn
    return np.column_stack([path.poses[:-1, 0] + part * np.cos(along), path.poses[:-1, 1] + part * np.sin(along)])


def least_clearance(points: Float64Array, occupancy: Occupancy) -> float:
    """Return the least distance in metres between points and the squares of occupied cells."""
    from scipy.spatial import cKDTree

    centres = occupancy.centres(np.argwhere(occupancy.cells == 1))
    if not len(centres):
        return np.inf
    half, tree = 0.5 * occupancy.cell, cKDTree(centres)
    near = tree.query(points, k=min(12, len(centres)))[1].reshape(len(points), -1)
    over = np.maximum(np.abs(centres[near] - points[:, None, :]) - half, 0.0)
    return float(np.hypot(over[:, :, 0], over[:, :, 1]).min())


def report_paths(n: int) -> None:
    """Print how far the paths of random maps stay within each limit."""
    rng = np.random.default_rng(8)
    worst: dict[str, float] = {}
    found, seconds = 0, []
    for _ in range(n):
        occupancy = scattered_map(rng, 160)
        robot = RobotLimits(
            radius=float(rng.uniform(0.1, 0.3)),
            max_curvature=float(rng.uniform(0.8, 4.0)),
            margin=float(rng.uniform(0.0, 0.3)),
        )
        cost = find_traversability(occupancy, robot).cost
        ends = [occupancy.centres([random_open(rng, cost, *part)[:2]])[0] for part in ((0.1, 0.4), (0.6, 0.9))]
        clock = time.perf_counter()
        path = plan_path(occupancy, ends[0], ends[1], robot=robot)
        seconds.append(time.perf_counter() - clock)
        if path.state == "found":
            found += 1
            for name, value in path_excess(path, occupancy, robot).items():
                worst[name] = max(worst.get(name, -np.inf), value)
    said = ", ".join(f"{name} {value:.2g}" for name, value in worst.items())
    print(f"paths: {found} of {n} found, {np.median(seconds):.2f} s each; limit passed by at most: {said}")


if __name__ == "__main__":
    run_command(main)
