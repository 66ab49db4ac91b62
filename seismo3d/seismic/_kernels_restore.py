"""Values at scattered places spread onto a grid."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def spread(rows, columns, values, sums, weight):  # type: ignore[no-untyped-def]
    """Add values (m, n) at n fractional places to the four grid places around each, by bilinear weights."""
    n_rows, n_columns = weight.shape
    for n in range(len(rows)):
        if not (0.0 <= rows[n] < n_rows - 1 and 0.0 <= columns[n] < n_columns - 1):
            continue
        i, j = int(rows[n]), int(columns[n])
        fr, fc = rows[n] - i, columns[n] - j
        for a in range(2):
            for b in range(2):
                share = (fr if a == 1 else 1.0 - fr) * (fc if b == 1 else 1.0 - fc)
                weight[i + a, j + b] += share
                for m in range(values.shape[0]):
                    sums[m, i + a, j + b] += share * np.float64(values[m, n])
