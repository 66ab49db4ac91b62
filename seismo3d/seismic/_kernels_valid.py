"""Which samples hold data."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def mark_valid(volume, longest_run, valid):  # type: ignore[no-untyped-def]
    """Mark samples that are finite and not in a run of equal values of at least `longest_run` samples.

    Zeros with which a trace begins or ends are none either, however few: a mute that slopes leaves a few on some.
    """
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            start = 0
            for k in range(n2 + 1):
                if k == n2 or volume[i, j, k] != volume[i, j, start]:
                    muted = volume[i, j, start] == 0.0 and (start == 0 or k == n2)
                    usable = np.isfinite(volume[i, j, start]) and k - start < longest_run and not muted
                    for m in range(start, k):
                        valid[i, j, m] = usable
                    start = k


@njit(cache=True, nogil=True, parallel=True)
def same_as_next(volume, valid, same):  # type: ignore[no-untyped-def]
    """Mark traces that equal their next crossline neighbour in every sample, where any is valid."""
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1 - 1):
            equal = True
            data = False
            for k in range(n2):
                if valid[i, j, k]:
                    data = True
                    if volume[i, j, k] != volume[i, j + 1, k]:
                        equal = False
                        break
            same[i, j] = equal and data
