from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.experiments._kernels_planning import a_star
from seismo3d.robot.dstar import DStarLite
from seismo3d.robot.lattice import lattice_motions
from seismo3d.robot.motions import UNIT, Motions, grid_motions


def random_cost(rng: np.random.Generator, shape: tuple[int, int], *, blocked: float = 0.25):
    cost = rng.integers(UNIT, 3 * UNIT, shape)
    cost[rng.random(shape) < blocked] = 0
    cost[0, 0] = cost[-1, -1] = UNIT
    return cost


def oracle(cost, motions: Motions, start, goal) -> int:
    """Dijkstra's way over a graph that plain loops make of the motions' descriptions."""
    rows, columns = cost.shape
    edges: dict[tuple[int, int], int] = {}
    for step in motions.steps:
        for row in range(rows):
            for column in range(columns):
                cells = [(row + r, column + c, w) for r, c, w in step.swept]
                r, c = row + step.rows, column + step.columns
                inside = all(0 <= a < rows and 0 <= b < columns for a, b, _ in [*cells, (r, c, 0)])
                if not inside or any(cost[a, b] == 0 for a, b, _ in cells):
                    continue
                edge = ((step.start * rows + row) * columns + column, (step.end * rows + r) * columns + c)
                edges[edge] = sum(w * int(cost[a, b]) for a, b, w in cells)
    n = len(motions.headings) * rows * columns
    i, j = np.array(list(edges)).T
    graph = sparse.csr_array((np.array(list(edges.values()), float), (i, j)), shape=(n, n))
    headings = range(len(motions.headings))
    begin = [(k * rows + start[0]) * columns + start[1] for k in headings if start[2] in (-1, k)]
    end = [(k * rows + goal[0]) * columns + goal[1] for k in headings if goal[2] in (-1, k)]
    best = dijkstra(graph, indices=begin).min(axis=0)[end].min()
    return int(best) if np.isfinite(best) else -1


def cost_of(search: DStarLite) -> int:
    """Sum the cost of the route's motions and check that it leads from the start to the goal."""
    heading, motions = search.route()
    row, column, total = *search.start[:2], 0
    if search.start[2] >= 0:
        assert heading == search.start[2]
    for number in motions:
        step = search.motions.steps[number]
        assert step.start == heading
        assert all(search.cost[row + r, column + c] > 0 for r, c, _ in step.swept)
        total += sum(w * int(search.cost[row + r, column + c]) for r, c, w in step.swept)
        row, column, heading = row + step.rows, column + step.columns, step.end
    assert (row, column) == search.goal[:2]
    assert search.goal[2] in (-1, heading)
    return total


@pytest.mark.parametrize("kind", ["grid", "lattice"])
def test_first_plan_costs_what_dijkstra_says(kind, rng):
    motions = grid_motions() if kind == "grid" else lattice_motions(2.0)
    reached = 0
    for n in range(12):
        cost = random_cost(rng, (14, 17), blocked=0.3 if kind == "grid" else 0.06)
        start, goal = (0, 0, -1), (13, 16, -1 if n % 2 or kind == "grid" else 4)
        found = DStarLite(cost, motions, start=start, goal=goal).repair()
        assert found.cost == oracle(cost, motions, start, goal)
        assert found.cost == a_star(cost.astype(np.int32), start, goal, motions.table)[0]
        assert found.most <= 1
        reached += found.state == "found"
    assert reached >= 6


@pytest.mark.parametrize("kind", ["grid", "lattice"])
def test_repairs_equal_fresh_searches_after_every_random_change(kind, rng):
    motions = grid_motions() if kind == "grid" else lattice_motions(3.0)
    shape = (60, 70) if kind == "grid" else (36, 40)
    cost = random_cost(rng, shape, blocked=0.2 if kind == "grid" else 0.02)
    start, goal = (2, 3, -1), (shape[0] - 4, shape[1] - 5, -1)
    cost[2, 3] = cost[goal[0], goal[1]] = UNIT
    search = DStarLite(cost, motions, start=start, goal=goal)
    search.repair()
    states = set()
    for number in range(1000):
        n = int(rng.integers(1, 6))
        where = np.column_stack([rng.integers(0, shape[0], n), rng.integers(0, shape[1], n)])
        values = rng.integers(UNIT, 3 * UNIT, n)
        values[rng.random(n) < (0.35 if kind == "grid" else 0.1)] = 0
        keep = ~((where == start[:2]).all(axis=1) | (where == goal[:2]).all(axis=1))
        search.update(where[keep], values[keep])
        if number % 10 == 3:
            start = (int(rng.integers(1, 8)), int(rng.integers(1, 8)), int(rng.integers(-1, len(motions.headings))))
            search.move_to(start)
        repair = search.repair()
        expected = a_star(search.cost, search.start, search.goal, motions.table)[0]
        assert repair.cost == expected
        assert repair.most <= 2
        assert repair.expansions <= 2 * len(motions.headings) * cost.size
        states.add(repair.state)
        if repair.state == "found" and number % 5 == 0:
            assert cost_of(search) == expected
    assert states == {"found", "no way"}


def test_a_way_is_lost_and_found_again():
    cost = np.full((9, 9), UNIT)
    search = DStarLite(cost, grid_motions(), start=(4, 0, -1), goal=(4, 8, -1))
    straight = 8 * 408 * 128
    assert search.repair().cost == straight
    wall = np.column_stack([np.arange(9), np.full(9, 4)])
    search.update(wall, np.zeros(9, int))
    lost = search.repair()
    assert (lost.state, lost.cost) == ("no way", -1)
    with pytest.raises(ParameterError, match="no way to follow"):
        search.route()
    search.update(wall[:1], [UNIT])
    assert search.repair().cost == (6 * 577 + 4 * 408) * 128  # not around the wall's end corner to corner
    search.update(wall, np.full(9, UNIT))
    assert search.repair().cost == straight
    assert search.repair().expansions == 0


def test_no_step_between_cells_that_touch_at_a_corner():
    cost = np.full((2, 2), UNIT)
    cost[0, 1] = 0
    search = DStarLite(cost, grid_motions(), start=(0, 0, -1), goal=(1, 1, -1))
    assert search.repair().cost == 2 * 408 * 128
    search.update([[1, 0]], [0])
    assert search.repair().state == "no way"


def test_kernel_equals_plain_python(rng):
    from seismo3d.robot import _kernels_search as k

    motions = lattice_motions(2.5)
    cost = random_cost(rng, (12, 12), blocked=0.05).astype(np.int32)
    g = rng.integers(0, 10**7, 16 * 144)
    for s in range(0, len(g), 7):
        assert k.best_step(s, g, cost, motions.table) == k.best_step.py_func(s, g, cost, motions.table)
    for m in range(len(motions.steps)):
        swept = [(5 + r, 5 + c, w) for r, c, w in motions.steps[m].swept]
        inside = all(0 <= a < 12 and 0 <= b < 12 and cost[a, b] for a, b, _ in swept)
        expected = sum(w * int(cost[a, b]) for a, b, w in swept) if inside else -1
        assert k.motion_cost(m, 5, 5, cost, motions.table) == expected


def test_refusals():
    motions, cost = grid_motions(), np.full((4, 4), UNIT)
    with pytest.raises(ParameterError, match="start is"):
        DStarLite(cost, motions, start=(4, 0, -1), goal=(1, 1, -1))
    with pytest.raises(ParameterError, match="goal is"):
        DStarLite(cost, motions, start=(0, 0, -1), goal=(1, 1, 1))
    with pytest.raises(ParameterError, match="no costs"):
        DStarLite(cost // 2, motions, start=(0, 0, -1), goal=(1, 1, -1))
    search = DStarLite(cost, motions, start=(0, 0, -1), goal=(1, 1, -1))
    with pytest.raises(ParameterError, match="leaves the map"):
        search.update([[0, 4]], [UNIT])
    with pytest.raises(ShapeError, match="one a cell"):
        search.update([[0, 1]], [UNIT, UNIT])
    with pytest.raises(ShapeError, match=r"expected \(n, 2\)"):
        search.update([0, 1], [UNIT])
