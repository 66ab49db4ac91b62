"""Where the traces of a finer layer graph start, between those of the coarser one."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d.seismic._kernels_layer_solve import find_head


@njit(cache=True, nogil=True)
def _lead(tail, head, shift, variance, gaps, step, is_head, best, out):  # type: ignore[no-untyped-def]
    """Put on a trace what its links to the next one say, where they are surer than the best so far."""
    m = len(tail)
    for k in range(m):
        if not variance[k] < np.inf:
            continue
        low, part = find_head(shift[k], gaps, k, step, m)
        if low < 0:
            continue
        if is_head:
            near = low + 1 if part > 0.5 else low
            value = tail[k] - shift[k]
        else:
            near = k
            value = (np.float32(1.0) - part) * head[low] + part * head[low + 1] + shift[k]
        if variance[k] < best[near]:
            best[near], out[near] = variance[k], value


@njit(cache=True, nogil=True)
def _spread(gaps, best, out):  # type: ignore[no-untyped-def]
    """Give samples without a link the value of the nearest one above, else below, that no fault parts them from."""
    m = len(out)
    for k in range(1, m):
        if np.isinf(best[k]) and gaps[k - 1] == 0 and best[k - 1] < np.inf:
            out[k], best[k] = out[k - 1], best[k - 1]
    for k in range(m - 2, -1, -1):
        if np.isinf(best[k]) and gaps[k] == 0 and best[k + 1] < np.inf:
            out[k], best[k] = out[k + 1], best[k + 1]


@njit(cache=True, nogil=True, parallel=True)
def lead_traces(values, rows, columns, breaks, step, start, stop, crossed):  # type: ignore[no-untyped-def]
    """Write the values of traces new to a graph, in rows from start to stop, as the surest of their links say.

    New is what lies on an odd row or column; `rows` and `columns` are the shifts and variances of the links to the next
    row and to the next column. First, where `crossed` is false, traces with one odd number are led on from the old ones
    beside them; then those with two, from the first. Runs of a trace that no link leads to stay as they are.
    """
    n0, n1, m = values.shape
    for line in prange(start, stop):
        i = np.int64(line)
        best = np.empty(m, np.float32)
        for j in range(n1):
            by_row, by_column = i % 2 == 1, j % 2 == 1
            if not (by_row or by_column) or (by_row and by_column) != crossed:
                continue
            best[:] = np.inf
            out, gaps = values[i, j], breaks[i, j]
            if by_row:
                _lead(values[i - 1, j], out, rows[0][i - 1, j], rows[1][i - 1, j], gaps, step, True, best, out)
                if i + 1 < n0:
                    head, beyond = values[i + 1, j], breaks[i + 1, j]
                    _lead(out, head, rows[0][i, j], rows[1][i, j], beyond, step, False, best, out)
            if by_column:
                _lead(values[i, j - 1], out, columns[0][i, j - 1], columns[1][i, j - 1], gaps, step, True, best, out)
                if j + 1 < n1:
                    head, beyond = values[i, j + 1], breaks[i, j + 1]
                    _lead(out, head, columns[0][i, j], columns[1][i, j], beyond, step, False, best, out)
            _spread(gaps, best, out)
