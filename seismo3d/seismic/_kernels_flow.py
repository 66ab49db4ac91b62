"""The cheapest way from voxel to voxel."""

from __future__ import annotations

import heapq

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def find_way(resistance, offsets, lengths, starts, is_end):  # type: ignore[no-untyped-def]
    """Return the voxels of the cheapest way from any start to any end, and its cost; Dijkstra's.

    `offsets` leads to a voxel's neighbours, and a step costs its length times the mean resistance of its two voxels.
    """
    n0, n1, n2 = resistance.shape
    cost = np.full(resistance.shape, np.inf)
    came = np.full(resistance.shape, -1, np.int8)
    heap = [(0.0, (i * n1 + j) * n2 + k) for i, j, k in starts]
    for i, j, k in starts:
        cost[i, j, k] = 0.0
    i, j, k = starts[0]
    while len(heap) > 0:
        least, flat = heapq.heappop(heap)
        i, j, k = flat // (n1 * n2), flat // n2 % n1, flat % n2
        if least > cost[i, j, k]:
            continue
        if is_end[i, j, k]:
            break
        for number in range(len(offsets)):
            a, b, c = i + offsets[number, 0], j + offsets[number, 1], k + offsets[number, 2]
            if a < 0 or b < 0 or c < 0 or a >= n0 or b >= n1 or c >= n2:
                continue
            reached = least + lengths[number] * 0.5 * (resistance[i, j, k] + resistance[a, b, c])
            if reached < cost[a, b, c]:
                cost[a, b, c], came[a, b, c] = reached, number
                heapq.heappush(heap, (reached, (a * n1 + b) * n2 + c))
    total = cost[i, j, k]
    way = [(i, j, k)]
    while came[i, j, k] >= 0:
        step = offsets[came[i, j, k]]
        i, j, k = i - step[0], j - step[1], k - step[2]
        way.append((i, j, k))
    return np.array(way[::-1]), total
