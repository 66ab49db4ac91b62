"""How thick the layers between two layer times are on the mean, and layer time drawn out so that it tells that."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

UNIT = 1 << 16
"""How many make up a whole sample, or a whole trace."""


@njit(cache=True, nogil=True)
def find_span(values, step):  # type: ignore[no-untyped-def]
    """Return the least and the largest layer time; values are layer time less sample at every `step`-th sample."""
    low, high = np.inf, -np.inf
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                time = np.float64(values[i, j, k]) + k * step
                low, high = min(low, time), max(high, time)
    return low, high


@njit(cache=True, nogil=True)
def count_levels(values, breaks, step, low, width, samples, covered):  # type: ignore[no-untyped-def]
    """Add, for bins of layer time, how many coarse samples lie in them, and how many traces' layers cover them.

    A coarse sample goes from one to the next, where no fault lies between. Both are counted in whole numbers of
    1 / `UNIT`, which come to the same in any order.
    """
    last = len(samples) - 1
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2] - 1):
                if breaks[i, j, k] > 0:
                    continue
                above = (np.float64(values[i, j, k]) + k * step - low) / width
                below = (np.float64(values[i, j, k + 1]) + (k + 1) * step - low) / width
                if below - above < 1e-6:
                    samples[min(max(int(above), 0), last)] += UNIT
                    continue
                for b in range(min(int(above), last), min(int(below), last) + 1):
                    share = UNIT * (min(below, b + 1.0) - max(above, float(b)))
                    covered[b] += int(share + 0.5)
                    samples[b] += int(share / (below - above) + 0.5)


@njit(cache=True, nogil=True, parallel=True)
def draw_out(values, step, low, width, drawn):  # type: ignore[no-untyped-def]
    """Replace layer times, in place, by what those at the bounds of bins become; between these it goes on evenly."""
    n = len(drawn) - 1
    for line in prange(values.shape[0]):
        i = np.int64(line)
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                place = (np.float64(values[i, j, k]) + k * step - low) / width
                b = min(max(int(place), 0), n - 1)
                time = drawn[b] + (place - b) * (drawn[b + 1] - drawn[b])
                values[i, j, k] = np.float32(time - k * step)
