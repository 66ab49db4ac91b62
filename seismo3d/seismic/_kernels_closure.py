"""Loops of shifts between four traces: along the inlines and then the crosslines, against the other way round."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d.seismic._kernels_shifts import follow, read_coarse


@njit(cache=True, nogil=True, parallel=True)
def close_loops(first, second, near_first, near_second, cuts, length, step, error):  # type: ignore[no-untyped-def]
    """Write by how many samples the two ways round a square of traces differ; NaN where a way is not known.

    `first` and `second` are shifts over `length` traces along the inline and the crossline axis, NaN where they were
    not measured; `near_first` and `near_second` those to the next trace, which tell whether a fault is crossed. Row
    (i, j) of `error` belongs to the square from trace (i, j) to trace (i + length, j + length).
    """
    n0, n1, m = error.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for k in range(m):
                start = np.float64(k * step)
                over = start + read_coarse(first[i, j], start, step)
                far = over + read_coarse(second[i + length, j], over, step)
                beside = start + read_coarse(second[i, j], start, step)
                other = beside + read_coarse(first[i, j + length], beside, step)
                error[i, j, k] = np.nan
                if np.isnan(far) or np.isnan(other):
                    continue
                _, free = follow(near_first, cuts, i, j, start, 0, length, step)
                _, free_over = follow(near_second, cuts, i + length, j, over, 1, length, step)
                _, free_beside = follow(near_second, cuts, i, j, start, 1, length, step)
                _, free_other = follow(near_first, cuts, i, j + length, beside, 0, length, step)
                if free and free_over and free_beside and free_other:
                    error[i, j, k] = far - other
