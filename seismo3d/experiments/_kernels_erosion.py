"""Running water that wears a map down: each cell drains to its steepest neighbour, and cuts in as its water allows."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def drain(z, receiver, order, area):  # type: ignore[no-untyped-def]
    """Find the neighbour that each cell drains to, an order from the mouths upstream, and the cells that drain through.

    Cells on the map's edge, and pits, drain to themselves. `z` is of shape (rows, columns), the rest are flat.
    """
    rows, columns = z.shape
    n = rows * columns
    donors = np.zeros(n + 1, np.int64)
    for i in range(rows):
        for j in range(columns):
            own = i * columns + j
            receiver[own] = own
            steepest = 0.0
            if i == 0 or j == 0 or i == rows - 1 or j == columns - 1:
                continue
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    if di == 0 and dj == 0:
                        continue
                    slope = (z[i, j] - z[i + di, j + dj]) / math.sqrt(di * di + dj * dj)
                    if slope > steepest:
                        steepest = slope
                        receiver[own] = (i + di) * columns + j + dj
    for own in range(n):
        if receiver[own] != own:
            donors[receiver[own] + 1] += 1
    for own in range(n):
        donors[own + 1] += donors[own]
    listed = np.empty(n, np.int64)
    filled = donors.copy()
    for own in range(n):
        if receiver[own] != own:
            listed[filled[receiver[own]]] = own
            filled[receiver[own]] += 1
    # breadth first from the mouths and pits: a cell stands behind the one that it drains to
    last = 0
    for own in range(n):
        if receiver[own] == own:
            order[last] = own
            last += 1
    first = 0
    while first < last:
        own = order[first]
        first += 1
        for k in range(donors[own], donors[own + 1]):
            order[last] = listed[k]
            last += 1
    for own in range(n):
        area[own] = 1.0
    for k in range(n - 1, -1, -1):
        own = order[k]
        if receiver[own] != own:
            area[receiver[own]] += area[own]


@njit(cache=True, nogil=True)
def cut_in(z, receiver, order, area, strength):  # type: ignore[no-untyped-def]
    """Lower each cell towards the one that it drains to, by the stream power law with exponents 1/2 and 1, in place.

    Implicit in time: stable at any step. `z` and `strength`, the erodibility times the step, are flat; cells.
    """
    columns = np.int64(math.sqrt(len(z)) + 0.5)
    for k in range(len(order)):
        own = order[k]
        other = receiver[own]
        if other == own:
            continue
        apart = abs(own - other)
        length = 1.0 if apart in (1, columns) else math.sqrt(2.0)
        factor = strength[own] * math.sqrt(area[own]) / length
        z[own] = (z[own] + factor * z[other]) / (1.0 + factor)
