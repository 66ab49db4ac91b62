"""Layer time moved along its traces, between faults, by what levels say."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def number_runs(cuts, crossings, runs):  # type: ignore[no-untyped-def]
    """Write how many faults a trace has crossed above each crossing; -1 where there is no crossing."""
    n, n0, n1 = crossings.shape
    last = cuts.shape[2] - 1
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for c in range(n):
                runs[c, i, j] = -1
                if not np.isfinite(crossings[c, i, j]):
                    continue
                middle = min(max(int(np.rint(crossings[c, i, j])), 0), last)
                count = 0
                for k in range(middle):
                    if cuts[i, j, k] & np.uint8(4):
                        count += 1
                runs[c, i, j] = count


@njit(cache=True, nogil=True)
def _gather(depth, move, first, last, n2, at, by):  # type: ignore[no-untyped-def]
    """Write at what depths the layers of a run lie, in order, and how they are moved; return how many there are."""
    n = 0
    for c in range(len(depth)):
        if not (np.isfinite(depth[c]) and np.isfinite(move[c])):
            continue
        middle = min(max(int(np.rint(depth[c])), 0), n2 - 1)
        if middle < first or middle > last:
            continue
        k = n
        while k > 0 and at[k - 1] > depth[c]:
            at[k], by[k] = at[k - 1], by[k - 1]
            k -= 1
        at[k], by[k] = depth[c], move[c]
        n += 1
    return n


@njit(cache=True, nogil=True)
def _keep_order(at, by, n, thinnest, length, change, before):  # type: ignore[no-untyped-def]
    """Keep the most layers of a run, in place, that stay in their order and apart; return how many these are.

    Of as many layers those are kept whose moves change least from one to the next.
    """
    top = 0
    for c in range(n):
        length[c], before[c], change[c] = 1, -1, 0.0
        for b in range(c):
            step = by[c] - by[b]
            if step < (thinnest - np.float32(1.0)) * (at[c] - at[b]):
                continue
            total = change[b] + abs(step)
            if length[b] + 1 > length[c] or (length[b] + 1 == length[c] and total < change[c]):
                length[c], before[c], change[c] = length[b] + 1, b, total
        if length[c] > length[top] or (length[c] == length[top] and change[c] < change[top]):
            top = c
    kept = length[top]
    # lengths are told: their room takes the numbers of those that are kept, in order
    for k in range(kept - 1, -1, -1):
        length[k] = top
        top = before[top]
    for k in range(kept):
        at[k], by[k] = at[length[k]], by[length[k]]
    return kept


@njit(cache=True, nogil=True, parallel=True)
def mend_runs(times, cuts, depth, move, thinnest):  # type: ignore[no-untyped-def]
    """Move layer time, in place, down the runs of every trace by what is known at some of its depths.

    Moves that would leave less than such a share of what lies between two of them are left out.
    """
    n0, n1, n2 = times.shape
    n_levels = depth.shape[2]
    one = np.float32(1.0)
    for line in prange(n0):
        i = np.int64(line)
        at, by, old = np.empty(n_levels, np.float32), np.empty(n_levels, np.float32), np.empty(n2, np.float32)
        length, before = np.empty(n_levels, np.int64), np.empty(n_levels, np.int64)
        change = np.empty(n_levels, np.float32)
        for j in range(n1):
            old[:] = times[i, j]
            first = 0
            for last in range(n2):
                if last < n2 - 1 and not cuts[i, j, last] & np.uint8(4):
                    continue
                n = _gather(depth[i, j], move[i, j], first, last, n2, at, by)
                if n > 1:
                    n = _keep_order(at, by, n, thinnest, length, change, before)
                for c in range(n):
                    at[c] += by[c]
                c = 0
                for k in range(first, last + 1):
                    if n == 0:
                        break
                    while c < n and at[c] <= k:
                        c += 1
                    if c == 0:
                        moved = by[0]
                    elif c == n:
                        moved = by[n - 1]
                    else:
                        part = (k - at[c - 1]) / (at[c] - at[c - 1])
                        moved = (one - part) * by[c - 1] + part * by[c]
                    z = k - moved
                    if z <= first:
                        times[i, j, k] = old[first] + (z - first)
                    elif z >= last:
                        times[i, j, k] = old[last] + (z - last)
                    else:
                        low = int(z)
                        times[i, j, k] = old[low] + (z - low) * (old[low + 1] - old[low])
                first = last + 1
