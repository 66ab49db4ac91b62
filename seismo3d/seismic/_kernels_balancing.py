"""The strength of every trace."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def mean_sizes(volume, valid, most, kept, out):  # type: ignore[no-untyped-def]
    """Write the mean size of the smaller samples of every trace, a share of them; 0 where none is valid.

    At most about so many samples of a trace are looked at.
    """
    n0, n1, n2 = volume.shape
    step = max(1, n2 // most)
    for line in prange(n0):
        i = np.int64(line)
        row = np.empty(n2, np.float32)
        for j in range(n1):
            n = 0
            for k in range(0, n2, step):
                if valid[i, j, k]:
                    row[n] = abs(volume[i, j, k])
                    n += 1
            counted = int(np.ceil(kept * n))
            total = 0.0
            for size in np.sort(row[:n])[:counted]:
                total += size
            out[i, j] = total / max(counted, 1)
