"""Compiled A*, forwards and from scratch, over the same motions: what a repaired search is compared with."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import heapq

import numpy as np
from numba import njit

from seismo3d.robot._kernels_search import FAR, is_goal, least_cost, motion_cost


@njit(cache=True, nogil=True)
def a_star(cost, start, goal, table):
    """Return the cost of the best way (-1: none) and the vertices expanded; headings of -1 are any."""
    rows, columns = cost.shape
    n_headings = len(table.leaving) - 1
    g = np.full(n_headings * rows * columns, FAR, dtype=np.int64)
    closed = np.zeros(len(g), dtype=np.bool_)
    queue = [(np.int64(0), np.int64(0), np.int64(0)) for _ in range(0)]
    for k in range(n_headings):
        if start[2] in (-1, k) and cost[start[0], start[1]] > 0:
            s = (k * rows + start[0]) * columns + start[1]
            g[s] = 0
            heapq.heappush(queue, (least_cost(goal[0] - start[0], goal[1] - start[1], table), np.int64(0), np.int64(s)))
    expansions = 0
    while queue:
        _, _, s = heapq.heappop(queue)
        if closed[s]:
            continue
        if is_goal(s, goal, cost.shape):
            return g[s], expansions
        closed[s] = True
        expansions += 1
        k, place = s // (rows * columns), s % (rows * columns)
        row, column = place // columns, place % columns
        for m in range(table.leaving[k], table.leaving[k + 1]):
            r, c = row + table.rows[m], column + table.columns[m]
            if r < 0 or c < 0 or r >= rows or c >= columns:
                continue
            t = (table.end[m] * rows + r) * columns + c
            if closed[t]:
                continue
            step = motion_cost(m, row, column, cost, table)
            if step >= 0 and g[s] + step < g[t]:
                g[t] = g[s] + step
                ahead = least_cost(goal[0] - r, goal[1] - c, table)
                heapq.heappush(queue, (g[t] + ahead, -g[t], np.int64(t)))
    return np.int64(-1), expansions
