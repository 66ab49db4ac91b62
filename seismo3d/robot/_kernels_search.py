"""Compiled D* Lite: a shortest way that is repaired, not sought anew, when the map changes.

The search runs backwards from the goal. Vertex ``(heading * rows + row) * columns + column`` has two values: ``g``,
the distance that its neighbours were told of, and ``rhs``, what its own neighbours promise; where they differ it waits
in a queue, a binary heap with places from 1 (place 0: not in it).
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np
from numba import njit

FAR = 1 << 60
SIZE, CHANGED, REPAIRS, STAMP = 0, 1, 2, 3


@njit(cache=True, nogil=True)
def motion_cost(m, row, column, cost, table):
    """Cost of motion m from a cell; -1 where it leaves the map or sweeps a cell that cannot be entered (cost 0)."""
    rows, columns = cost.shape
    total = 0
    for n in range(table.swept_first[m], table.swept_first[m + 1]):
        r, c = row + table.swept[n, 0], column + table.swept[n, 1]
        if r < 0 or c < 0 or r >= rows or c >= columns:
            return -1
        value = np.int64(cost[r, c])
        if value == 0:
            return -1
        total += table.swept[n, 2] * value
    return total


@njit(cache=True, nogil=True)
def least_cost(rows, columns, table):
    """Lower bound on the cost of any way by so many rows and columns."""
    most = 0
    for n in range(len(table.floor)):
        most = max(most, table.floor[n, 0] * abs(columns) + table.floor[n, 1] * abs(rows))
    return 128 * most


@njit(cache=True, nogil=True)
def best_step(s, g, cost, table):
    """Return the least promise of a vertex's neighbours, and the motion to the one that makes it (-1: none)."""
    rows, columns = cost.shape
    k, place = s // (rows * columns), s % (rows * columns)
    row, column = place // columns, place % columns
    least, motion = FAR, -1
    for m in range(table.leaving[k], table.leaving[k + 1]):
        r, c = row + table.rows[m], column + table.columns[m]
        if r < 0 or c < 0 or r >= rows or c >= columns:
            continue
        beyond = g[(table.end[m] * rows + r) * columns + c]
        if beyond >= least:
            continue
        step = motion_cost(m, row, column, cost, table)
        if step >= 0 and step + beyond < least:
            least, motion = step + beyond, m
    return least, motion


@njit(cache=True, nogil=True, inline="always")
def _before(a1, a2, b1, b2):
    return a1 < b1 or (a1 == b1 and a2 < b2)


@njit(cache=True, nogil=True)
def _settle(heap, keys, place, size, at):
    """Move the element at a place of the heap up or down to where its key belongs."""
    s, k1, k2 = heap[at], keys[at, 0], keys[at, 1]
    while at > 1 and _before(k1, k2, keys[at // 2, 0], keys[at // 2, 1]):
        up = at // 2
        heap[at], keys[at, 0], keys[at, 1] = heap[up], keys[up, 0], keys[up, 1]
        place[heap[at]] = at
        at = up
    while 2 * at <= size:
        down = 2 * at
        if down < size and _before(keys[down + 1, 0], keys[down + 1, 1], keys[down, 0], keys[down, 1]):
            down += 1
        if not _before(keys[down, 0], keys[down, 1], k1, k2):
            break
        heap[at], keys[at, 0], keys[at, 1] = heap[down], keys[down, 0], keys[down, 1]
        place[heap[at]] = at
        at = down
    heap[at], keys[at, 0], keys[at, 1] = s, k1, k2
    place[s] = at


@njit(cache=True, nogil=True)
def _remove(heap, keys, place, state, s):
    at, size = place[s], state[SIZE]
    place[s] = 0
    state[SIZE] = size - 1
    if at < size:
        heap[at], keys[at, 0], keys[at, 1] = heap[size], keys[size, 0], keys[size, 1]
        place[heap[at]] = at
        _settle(heap, keys, place, size - 1, at)


@njit(cache=True, nogil=True)
def _key(s, g, rhs, shape, start, offset, table):
    m = min(g[s], rhs[s])
    if m >= FAR:
        return FAR, FAR
    at = s % (shape[0] * shape[1])
    return m + least_cost(at // shape[1] - start[0], at % shape[1] - start[1], table) + offset, m


@njit(cache=True, nogil=True)
def refresh(s, g, rhs, heap, keys, place, state, shape, start, offset, table):
    """Put a vertex into the queue, move it there, or take it out, by whether its two values differ."""
    if g[s] == rhs[s]:
        if place[s] > 0:
            _remove(heap, keys, place, state, s)
        return
    k1, k2 = _key(s, g, rhs, shape, start, offset, table)
    at = place[s]
    if at == 0:
        state[SIZE] += 1
        at = state[SIZE]
    elif keys[at, 0] == k1 and keys[at, 1] == k2:
        return
    heap[at], keys[at, 0], keys[at, 1] = s, k1, k2
    _settle(heap, keys, place, state[SIZE], at)


@njit(cache=True, nogil=True)
def is_goal(s, goal, shape):
    """Whether a vertex is a goal: at the goal's cell, with its heading where that matters (not -1)."""
    at = s % (shape[0] * shape[1])
    at_cell = at // shape[1] == goal[0] and at % shape[1] == goal[1]
    return at_cell and (goal[2] < 0 or s // (shape[0] * shape[1]) == goal[2])


@njit(cache=True, nogil=True)
def best_start(g, rhs, shape, start, n_headings):
    """Return the start's vertex of least value; of all headings where the start has none (-1)."""
    cell = start[0] * shape[1] + start[1]
    if start[2] >= 0:
        return start[2] * shape[0] * shape[1] + cell
    best, least = cell, FAR + 1
    for k in range(n_headings):
        s = k * shape[0] * shape[1] + cell
        if min(g[s], rhs[s]) < least:
            best, least = s, min(g[s], rhs[s])
    return best


@njit(cache=True, nogil=True)
def repair(g, rhs, heap, keys, place, state, visits, cost, start, goal, offset, table):
    """Settle vertices until the start's distance is final; return its vertex, the expansions, and the most of one."""
    shape = cost.shape
    n_headings = len(table.leaving) - 1
    state[REPAIRS] += 1
    tag = state[REPAIRS] * 4
    expansions, most = 0, 0
    while state[SIZE] > 0:
        first = best_start(g, rhs, shape, start, n_headings)
        k1, k2 = _key(first, g, rhs, shape, start, offset, table)
        if not _before(keys[1, 0], keys[1, 1], k1, k2) and not rhs[first] > g[first]:
            break
        u = heap[1]
        k1, k2 = _key(u, g, rhs, shape, start, offset, table)
        if _before(keys[1, 0], keys[1, 1], k1, k2):
            keys[1, 0], keys[1, 1] = k1, k2
            _settle(heap, keys, place, state[SIZE], 1)
            continue
        expansions += 1
        visits[u] = visits[u] + 1 if visits[u] >= tag else tag + 1
        most = max(most, visits[u] - tag)
        lowered, old = g[u] > rhs[u], g[u]
        g[u] = rhs[u] if lowered else FAR
        if not lowered:
            refresh(u, g, rhs, heap, keys, place, state, shape, start, offset, table)
        else:
            _remove(heap, keys, place, state, u)
        _tell(u, lowered, old, g, rhs, heap, keys, place, state, cost, start, goal, offset, table)
    return best_start(g, rhs, shape, start, n_headings), expansions, most


@njit(cache=True, nogil=True)
def _tell(u, lowered, old, g, rhs, heap, keys, place, state, cost, start, goal, offset, table):
    """Tell a vertex's predecessors of its new distance."""
    rows, columns = cost.shape
    k, at = u // (rows * columns), u % (rows * columns)
    row, column = at // columns, at % columns
    for n in range(table.entering_first[k], table.entering_first[k + 1]):
        m = table.entering[n]
        r, c = row - table.rows[m], column - table.columns[m]
        if r < 0 or c < 0 or r >= rows or c >= columns:
            continue
        s = (table.start[m] * rows + r) * columns + c
        if (lowered and rhs[s] <= g[u]) or is_goal(s, goal, cost.shape):
            continue
        if not lowered and rhs[s] < old:
            continue
        step = motion_cost(m, r, c, cost, table)
        if step < 0:
            continue
        if lowered:
            if step + g[u] >= rhs[s]:
                continue
            rhs[s] = step + g[u]
        elif rhs[s] == step + old:
            rhs[s] = best_step(s, g, cost, table)[0]
        else:
            continue
        refresh(s, g, rhs, heap, keys, place, state, cost.shape, start, offset, table)


@njit(cache=True, nogil=True)
def change_cells(where, values, g, rhs, heap, keys, place, state, seen, cost, start, goal, offset, table):
    """Write new costs of cells (row, column), and renew the promise of every vertex with a motion over one of them."""
    rows, columns = cost.shape
    for n in range(len(where)):
        cost[where[n, 0], where[n, 1]] = values[n]
    state[STAMP] += 1
    stamp = state[STAMP]
    for n in range(len(where)):
        for m in range(len(table.start)):
            for j in range(table.swept_first[m], table.swept_first[m + 1]):
                r, c = where[n, 0] - table.swept[j, 0], where[n, 1] - table.swept[j, 1]
                if r < 0 or c < 0 or r >= rows or c >= columns:
                    continue
                s = (table.start[m] * rows + r) * columns + c
                if seen[s] == stamp or is_goal(s, goal, cost.shape):
                    continue
                seen[s] = stamp
                promise = best_step(s, g, cost, table)[0]
                if promise != rhs[s]:
                    rhs[s] = promise
                    refresh(s, g, rhs, heap, keys, place, state, cost.shape, start, offset, table)


@njit(cache=True, nogil=True)
def follow(first, g, cost, goal, table, out):
    """Write the motions from a vertex to the goal into ``out``; return how many, or -1 where there is no way."""
    rows, columns = cost.shape
    s = first
    for n in range(len(out)):
        if is_goal(s, goal, cost.shape):
            return n
        m = best_step(s, g, cost, table)[1]
        if m < 0:
            return -1
        out[n] = m
        at = s % (rows * columns)
        s = (table.end[m] * rows + at // columns + table.rows[m]) * columns + at % columns + table.columns[m]
    return len(out) if is_goal(s, goal, cost.shape) else -1
