"""Traces on either side of a fault told apart: how well every break between them explains them."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, inline="always")
def _off(t, reach):  # type: ignore[no-untyped-def]
    """Return how far off the surface a trace lies: -reach .. -1, then 1 .. reach."""
    return t - reach if t < reach else t - reach + 1


@njit(cache=True, nogil=True, parallel=True)
def split_profiles(values, known, farthest, within, contrast):  # type: ignore[no-untyped-def]
    """Write, for every break from -farthest to farthest, what its two sides leave, and how far their means lie apart.

    `values` of shape (2 reach, rows, samples) are the traces at -reach .. -1 and 1 .. reach off the surface. `within`
    is the mean square about the means of what lies before and beyond the break, times the share of the traces that are
    known; the trace at the break itself does not count.
    """
    n_traces, n_rows, n_samples = values.shape
    reach = n_traces // 2
    for line in prange(n_rows):
        r = np.int64(line)
        for k in range(n_samples):
            n_known, n_before = 0.0, 0.0
            total, before = 0.0, 0.0
            square, square_before = 0.0, 0.0
            for t in range(n_traces):
                if known[t, r, k]:
                    value = float(values[t, r, k])
                    n_known += 1.0
                    total += value
                    square += value * value
            t = 0
            for place in range(2 * farthest + 1):
                b = place - farthest
                # what lies before the break; the trace at it is passed by below
                while t < n_traces and _off(t, reach) < b:
                    if known[t, r, k]:
                        value = float(values[t, r, k])
                        n_before += 1.0
                        before += value
                        square_before += value * value
                    t += 1
                n_beyond, beyond, square_beyond = n_known - n_before, total - before, square - square_before
                if t < n_traces and _off(t, reach) == b and known[t, r, k]:
                    value = float(values[t, r, k])
                    n_beyond -= 1.0
                    beyond -= value
                    square_beyond -= value * value
                left = 0.0
                if n_before > 0.0:
                    left += max(square_before - before * before / n_before, 0.0)
                if n_beyond > 0.0:
                    left += max(square_beyond - beyond * beyond / n_beyond, 0.0)
                within[place, r, k] = left * n_known / (n_traces * max(n_before + n_beyond, 1.0))
                apart = before / n_before - beyond / n_beyond if n_before > 0.0 and n_beyond > 0.0 else 0.0
                contrast[place, r, k] = apart * apart
