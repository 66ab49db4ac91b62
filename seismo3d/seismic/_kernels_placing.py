"""Traces on either side of a fault told apart: how well every break between them explains them."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


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
            for place in range(2 * farthest + 1):
                b = place - farthest
                count = np.zeros(2, np.float32)
                total = np.zeros(2, np.float32)
                square = np.zeros(2, np.float32)
                n_known = np.float32(0.0)
                for t in range(n_traces):
                    off = t - reach if t < reach else t - reach + 1
                    if not known[t, r, k]:
                        continue
                    n_known += np.float32(1.0)
                    if off == b:
                        continue
                    side = 0 if off < b else 1
                    value = values[t, r, k]
                    count[side] += np.float32(1.0)
                    total[side] += value
                    square[side] += value * value
                left = np.float32(0.0)
                for side in range(2):
                    if count[side] > 0.0:
                        left += max(square[side] - total[side] * total[side] / count[side], np.float32(0.0))
                n_counted = max(count[0] + count[1], np.float32(1.0))
                within[place, r, k] = left * n_known / (np.float32(n_traces) * n_counted)
                contrast[place, r, k] = np.float32(0.0)
                if count[0] > 0.0 and count[1] > 0.0:
                    apart = total[0] / count[0] - total[1] / count[1]
                    contrast[place, r, k] = apart * apart
