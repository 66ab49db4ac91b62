"""Traces on either side of a fault told apart: how well every break between them explains them."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True)
def _between(values, known, at, r, k):  # type: ignore[no-untyped-def]
    """Return the value of a profile at a fractional trace, and whether it is known."""
    low = int(np.floor(at))
    share = at - low
    value = 0.0
    for t, weight in ((low, 1.0 - share), (low + 1, share)):
        if weight > 1e-3:
            if t < 0 or t >= values.shape[0] or not known[t, r, k]:
                return 0.0, False
            value += weight * values[t, r, k]
    return value, True


@njit(cache=True, nogil=True, parallel=True)
def split_profiles(values, known, moved, within, contrast):  # type: ignore[no-untyped-def]
    """Write, for every break, the variance that its two sides leave, and the squared distance of their means.

    `values` of shape (traces, rows, samples) are the traces of a profile across the surface, whose middle one lies on
    it, and `moved` of shape (rows, samples) is how far the surface has been moved since. `within` and `contrast` of
    shape (2 reach - 1, rows, samples) are of the breaks -reach + 1 .. reach - 1 off it, of the traces up to reach off
    it; the trace at the break itself does not count. Both are 0 where nothing is known on one side of the surface.
    """
    n_breaks, n_rows, n_samples = within.shape
    reach, middle = (n_breaks + 1) // 2, values.shape[0] // 2
    for line in prange(n_rows):
        r = np.int64(line)
        trace, told = np.empty(2 * reach + 1), np.empty(2 * reach + 1, np.bool_)
        for k in range(n_samples):
            n_known, total, square = 0.0, 0.0, 0.0
            on_left, on_right = False, False
            for t in range(2 * reach + 1):
                trace[t], told[t] = _between(values, known, middle + moved[r, k] + t - reach, r, k)
                if told[t]:
                    on_left |= t < reach
                    on_right |= t > reach
                    n_known += 1.0
                    total += trace[t]
                    square += trace[t] ** 2
            n_before, before, square_before = 0.0, 0.0, 0.0
            for b in range(n_breaks):
                within[b, r, k], contrast[b, r, k] = 0.0, 0.0
                if not (on_left and on_right):
                    continue
                # traces up to b lie before the break, the next is the one at it
                if told[b]:
                    n_before += 1.0
                    before += trace[b]
                    square_before += trace[b] ** 2
                n_beyond, beyond, square_beyond = n_known - n_before, total - before, square - square_before
                if told[b + 1]:
                    n_beyond -= 1.0
                    beyond -= trace[b + 1]
                    square_beyond -= trace[b + 1] ** 2
                left = 0.0
                if n_before > 0.0:
                    left += max(square_before - before * before / n_before, 0.0)
                if n_beyond > 0.0:
                    left += max(square_beyond - beyond * beyond / n_beyond, 0.0)
                within[b, r, k] = left / max(n_before + n_beyond, 1.0)
                if n_before > 0.0 and n_beyond > 0.0:
                    contrast[b, r, k] = (before / n_before - beyond / n_beyond) ** 2
