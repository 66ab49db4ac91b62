"""Kernels of the layer graph kept as arrays of the grid: rows of the normal equations, each by itself.

Vertices are samples of a grid (row, trace, coarse sample). A field of links goes from every vertex to its place on the
trace `hop` further along an axis; links down a trace go to the next vertex; links across faults are listed. What a row
is given depends neither on the rows that are worked on beside it nor on the number of threads.

Kernels write one of three things (`kind`): the normal matrix times values, the gradient of the squared residuals at
values, or the diagonal of the matrix.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d.seismic._kernels_shifts import follow

NORMAL, GRADIENT, DIAGONAL = 0, 1, 2
# columns of a row between which what links pull is kept
_COLUMNS = 16


@njit(cache=True, nogil=True, inline="always")
def _snap(part, gap, size):  # type: ignore[no-untyped-def]
    """Return the share of the next vertex for an end in a gap that a fault parts: the vertex on its side, alone."""
    return np.float32(0.0) if part * size < np.float32(gap) - np.float32(0.5) else np.float32(1.0)


@njit(cache=True, nogil=True, inline="always")
def find_head(shift, gaps, k, step, m):  # type: ignore[no-untyped-def]
    """Return where a link from vertex k ends on its trace: a vertex, -1 beyond the ends, and the share of the next."""
    size = np.float32(step)
    ahead = np.float32(k) + shift / size
    if ahead < np.float32(0.0) or ahead > np.float32(m - 1):
        return -1, np.float32(0.0)
    low = min(np.int32(ahead), np.int32(m - 2))
    part = ahead - np.float32(low)
    gap = gaps[low]
    if gap > 0:
        part = _snap(part, gap, size)
    return low, part


@njit(cache=True, nogil=True)
def _find_trace_heads(shift, weight, gaps, step, low, part):  # type: ignore[no-untyped-def]
    """Write where all links of a trace that have a weight end, as `find_head` does; the others end at the first vertex.

    Without branches, so that the loops run on vector units.
    """
    m, size, broken = len(shift), np.float32(step), np.uint8(0)
    last = np.int32(m - 2)
    for k in range(m):
        broken |= gaps[k]
        ahead = np.float32(k) + shift[k] / size
        ahead = ahead if weight[k] != np.float32(0.0) else np.float32(0.0)
        low[k] = min(np.int32(ahead), last)
        part[k] = ahead - np.float32(low[k])
    if broken == 0:
        return
    for n in range(m - 1):
        if gaps[n] > 0:
            for k in range(m):
                snapped = _snap(part[k], gaps[n], size)
                part[k] = snapped if low[k] == n else part[k]


@njit(cache=True, nogil=True)
def _pull(tail, head, shift, weight, low, part, kind, pull):  # type: ignore[no-untyped-def]
    """Write what links pull at their heads: values there less those at their tails, or what is measured less that."""
    one, m = np.float32(1.0), len(tail)
    if kind == DIAGONAL:
        pull[:] = weight
        return
    for k in range(m):
        at = np.uint32(low[k])
        difference = (one - part[k]) * head[at] + part[k] * head[at + np.uint32(1)] - tail[k]
        if kind == GRADIENT:
            # nothing is measured where there is no link
            difference = -shift[k] - difference if weight[k] != np.float32(0.0) else np.float32(0.0)
        pull[k] = weight[k] * difference


@njit(cache=True, nogil=True)
def _take(out, pull, kind):  # type: ignore[no-untyped-def]
    """Add pulls to the tails of links."""
    for k in range(len(out)):
        out[k] += pull[k] if kind == DIAGONAL else -pull[k]


@njit(cache=True, nogil=True)
def _give(out, low, part, pull, kind):  # type: ignore[no-untyped-def]
    """Add pulls to the two vertices about each head.

    Neighbouring links end at neighbouring vertices: those about the last head are kept in registers.
    """
    one, next_ = np.float32(1.0), np.uint32(1)
    at = np.uint32(low[0])
    here, below = out[at], out[at + next_]
    for k in range(len(out)):
        head = np.uint32(low[k])
        if head != at:
            out[at] = here
            if head == at + next_:
                here = below
            else:
                out[at + next_] = below
                here = out[head]
            below = out[head + next_]
            at = head
        if kind == DIAGONAL:
            here += (one - part[k]) * (one - part[k]) * pull[k]
            below += part[k] * part[k] * pull[k]
        else:
            here += (one - part[k]) * pull[k]
            below += part[k] * pull[k]
    out[at], out[at + next_] = here, below


@njit(cache=True, nogil=True)
def _pull_along(values, shift, weight, breaks, hop, step, start, stop, kind, out):  # type: ignore[no-untyped-def]
    """Add to rows from start to stop what links within them pull."""
    _, n1, m = values.shape
    low, part, pull = np.empty(m, np.int32), np.empty(m, np.float32), np.empty(m, np.float32)
    for i in range(start, stop):
        for j in range(n1 - hop):
            _find_trace_heads(shift[i, j], weight[i, j], breaks[i, j + hop], step, low, part)
            _pull(values[i, j], values[i, j + hop], shift[i, j], weight[i, j], low, part, kind, pull)
            _take(out[i, j], pull, kind)
            _give(out[i, j + hop], low, part, pull, kind)


@njit(cache=True, nogil=True)
def _pull_across(values, shift, weight, breaks, hop, step, start, stop, kind, out):  # type: ignore[no-untyped-def]
    """Add to rows from start to stop what links to the row `hop` further, and from the one before, pull.

    What the links of the last rows pull is kept until the row comes that they lead to, for some columns at a time.
    """
    n0, n1, m = values.shape
    kept = (hop + 1, min(n1, _COLUMNS), m)
    low, part, pull = np.empty(kept, np.int32), np.empty(kept, np.float32), np.empty(kept, np.float32)
    for first in range(0, n1, _COLUMNS):
        for i in range(max(start - hop, 0), stop):
            now, before = i % (hop + 1), (i - hop) % (hop + 1)
            for j in range(first, min(first + _COLUMNS, n1)):
                c = j - first
                if i + hop < n0:
                    _find_trace_heads(shift[i, j], weight[i, j], breaks[i + hop, j], step, low[now, c], part[now, c])
                    _pull(
                        values[i, j], values[i + hop, j], shift[i, j], weight[i, j], low[now, c], part[now, c], kind,
                        pull[now, c],
                    )  # fmt: skip
                    if i >= start:
                        _take(out[i, j], pull[now, c], kind)
                if i >= start and i >= hop:
                    _give(out[i, j], low[before, c], part[before, c], pull[before, c], kind)


@njit(cache=True, nogil=True)
def _pull_down(values, thickness, weight, i, kind, out):  # type: ignore[no-untyped-def]
    """Add to row i what links down its traces pull; thickness is what they measure."""
    _, n1, m = values.shape
    sign = np.float32(1.0) if kind == DIAGONAL else np.float32(-1.0)
    for j in range(n1):
        for k in range(m - 1):
            w = weight[i, j, k]
            if w == 0.0:
                continue
            pull = w
            if kind != DIAGONAL:
                pull *= values[i, j, k + 1] - values[i, j, k]
            if kind == GRADIENT:
                pull = w * thickness[i, j, k] - pull
            out[i, j, k] += sign * pull
            out[i, j, k + 1] += pull


@njit(cache=True, nogil=True)
def _pull_listed(values, faults, i, kind, out):  # type: ignore[no-untyped-def]
    """Add to row i what listed links pull."""
    vertices, shares, measured, weight, ends, first_of_row = faults
    flat, given = values.reshape(-1), out.reshape(-1)
    one = np.float32(1.0)
    for n in range(first_of_row[i], first_of_row[i + 1]):
        e, side = ends[n] // 2, ends[n] % 2
        at, part, w = vertices[side, e], shares[side, e], weight[e]
        if kind == DIAGONAL:
            given[at] += (one - part) * (one - part) * w
            if part > 0:
                given[at + 1] += part * part * w
            continue
        difference = _end_value(flat, vertices[1, e], shares[1, e]) - _end_value(flat, vertices[0, e], shares[0, e])
        pull = w * (measured[e] - difference) if kind == GRADIENT else w * difference
        if side == 0:
            pull = -pull
        given[at] += (one - part) * pull
        if part > 0:
            given[at + 1] += part * pull


@njit(cache=True, nogil=True, parallel=True)
def pull_rows(values, links, breaks, step, down, faults, start, stop, rows, kind, out, other, sums):  # type: ignore[no-untyped-def]
    """Write rows from start to stop of what all links pull, and each one's inner product with the same of `other`.

    Parameters
    ----------
    links : tuple
        Shifts and weights of shape (field, row, trace, coarse sample), and the axis and hop of each field.
    down : tuple
        What links down the traces measure, and their weights.
    faults : tuple
        Of listed links: the two ends' vertices and shares, each of shape (2, n); what they measure; their weights; the
        numbers of their ends, 2 e for the foot of link e and 2 e + 1 for its head, in the order of the rows that they
        lie in; and where each row begins in there.
    rows : int
        How many of them a thread works on in one go.
    """
    shift, weight, axes, hops = links
    _, n1, m = values.shape
    for part in prange((stop - start + rows - 1) // rows):
        begin = start + np.int64(part) * rows
        end = min(begin + rows, stop)
        out[begin:end] = np.float32(0.0)
        for f in range(len(axes)):
            if axes[f] == 0:
                _pull_across(values, shift[f], weight[f], breaks, hops[f], step, begin, end, kind, out)
            else:
                _pull_along(values, shift[f], weight[f], breaks, hops[f], step, begin, end, kind, out)
        for i in range(begin, end):
            _pull_down(values, down[0], down[1], i, kind, out)
            _pull_listed(values, faults, i, kind, out)
            total = 0.0
            for j in range(n1):
                for k in range(m):
                    total += np.float64(out[i, j, k]) * np.float64(other[i, j, k])
            sums[i] = total


@njit(cache=True, nogil=True)
def _solve_trace(pivots, ties, gradient, out):  # type: ignore[no-untyped-def]
    """Write what a trace's own equations make of a gradient: its diagonal, and the links down it."""
    m = len(gradient)
    out[0] = gradient[0]
    for k in range(1, m):
        out[k] = gradient[k] + ties[k - 1] * pivots[k - 1] * out[k - 1]
    out[m - 1] *= pivots[m - 1]
    for k in range(m - 2, -1, -1):
        out[k] = pivots[k] * (out[k] + ties[k] * out[k + 1])


@njit(cache=True, nogil=True, parallel=True)
def begin_rows(pivots, ties, gradient, start, stop, step, direction, energies):  # type: ignore[no-untyped-def]
    """Turn the diagonal into the inverse pivots of each trace's own equations, and begin a solution at nothing.

    Its first direction is what those equations make of the gradient. `ties` are the weights of the links down a trace.
    """
    _, n1, m = step.shape
    for line in prange(start, stop):
        i = np.int64(line)
        total = 0.0
        for j in range(n1):
            row = pivots[i, j]
            for k in range(m):
                left = row[k]
                if k > 0:
                    left -= ties[i, j, k - 1] * ties[i, j, k - 1] * row[k - 1]
                # what rounding leaves of a trace that hangs on nothing but itself
                row[k] = np.float32(1.0) / left if left > np.float32(1e-6) * row[k] else np.float32(0.0)
            _solve_trace(row, ties[i, j], gradient[i, j], direction[i, j])
            for k in range(m):
                step[i, j, k] = 0.0
                total += np.float64(gradient[i, j, k]) * np.float64(direction[i, j, k])
        energies[i] = total


@njit(cache=True, nogil=True, inline="always")
def _end_value(flat, at, part):  # type: ignore[no-untyped-def]
    """Return the value at an end of a listed link."""
    if part > 0:
        return (np.float32(1.0) - part) * flat[at] + part * flat[at + 1]
    return flat[at]


@njit(cache=True, nogil=True, inline="always")
def _robust(residual, variance, cutoff):  # type: ignore[no-untyped-def]
    square = residual * residual / variance
    shrink = np.float32(1.0) / (np.float32(1.0) + square / (cutoff * cutoff))
    return shrink * shrink / variance


@njit(cache=True, nogil=True, parallel=True)
def weigh_links(values, shift, variance, breaks, axis, hop, step, cutoff, start, stop, weight, counts):  # type: ignore[no-untyped-def]
    """Write the robust weights of the links that begin in rows from start to stop: 0 where the variance is infinite.

    Row i of `counts` gets how many there are, and how many lie beyond the cutoff.
    """
    n0, n1, m = values.shape
    di, dj = (hop, 0) if axis == 0 else (0, hop)
    for line in prange(start, stop):
        i = np.int64(line)
        counts[i, 0] = counts[i, 1] = 0
        for j in range(n1):
            for k in range(m):
                weight[i, j, k] = 0.0
                if i + di >= n0 or j + dj >= n1 or np.isinf(variance[i, j, k]):
                    continue
                low, part = find_head(shift[i, j, k], breaks[i + di, j + dj], k, step, m)
                if low < 0:
                    continue
                head = values[i + di, j + dj]
                value = (np.float32(1.0) - part) * head[low] + part * head[low + 1]
                residual = -shift[i, j, k] - (value - values[i, j, k])
                weight[i, j, k] = _robust(residual, variance[i, j, k], cutoff)
                counts[i, 0] += 1
                if abs(residual) > cutoff * np.sqrt(variance[i, j, k]):
                    counts[i, 1] += 1


@njit(cache=True, nogil=True, parallel=True)
def find_heads(shift, weight, breaks, axis, hop, step, heads):  # type: ignore[no-untyped-def]
    """Write the vertex nearest to where each link ends; -1 where a link has no weight."""
    n0, n1, m = heads.shape
    di, dj = (hop, 0) if axis == 0 else (0, hop)
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for k in range(m):
                heads[i, j, k] = -1
                if weight[i, j, k] > 0.0:
                    low, part = find_head(shift[i, j, k], breaks[i + di, j + dj], k, step, m)
                    heads[i, j, k] = ((i + di) * n1 + j + dj) * m + low + (part > np.float32(0.5))


@njit(cache=True, nogil=True, parallel=True)
def weigh_samples(values, thickness, breaks, variance, cutoff, start, stop, weight, counts):  # type: ignore[no-untyped-def]
    """Write the robust weights of links down the traces of rows from start to stop: 0 across a fault."""
    _, n1, m = values.shape
    for line in prange(start, stop):
        i = np.int64(line)
        counts[i, 0] = counts[i, 1] = 0
        for j in range(n1):
            weight[i, j, m - 1] = 0.0
            for k in range(m - 1):
                weight[i, j, k] = 0.0
                if breaks[i, j, k] == 0:
                    residual = thickness[i, j, k] - (values[i, j, k + 1] - values[i, j, k])
                    weight[i, j, k] = _robust(residual, variance, cutoff)
                    counts[i, 0] += 1
                    if abs(residual) > cutoff * np.sqrt(variance):
                        counts[i, 1] += 1


@njit(cache=True, nogil=True, parallel=True)
def advance(length, direction, product, pivots, ties, start, stop, step, gradient, energies):  # type: ignore[no-untyped-def]
    """Take a step along the direction; row i of `energies` gets what is left in row i.

    In place of the product stands afterwards what the traces' own equations make of the gradient.
    """
    _, n1, m = step.shape
    for line in prange(start, stop):
        i = np.int64(line)
        total = 0.0
        for j in range(n1):
            for k in range(m):
                step[i, j, k] += length * direction[i, j, k]
                gradient[i, j, k] -= length * product[i, j, k]
            solved = product[i, j]
            _solve_trace(pivots[i, j], ties[i, j], gradient[i, j], solved)
            for k in range(m):
                total += np.float64(gradient[i, j, k]) * np.float64(solved[k])
        energies[i] = total


@njit(cache=True, nogil=True, parallel=True)
def turn(factor, solved, start, stop, direction):  # type: ignore[no-untyped-def]
    """Write the next direction, from what the traces' own equations make of the gradient."""
    _, n1, m = direction.shape
    for line in prange(start, stop):
        i = np.int64(line)
        for j in range(n1):
            for k in range(m):
                direction[i, j, k] = factor * direction[i, j, k] + solved[i, j, k]


@njit(cache=True, nogil=True, parallel=True)
def keep_free(nearest, cuts, variance, axis, length, stride, step, i0, j0, out):  # type: ignore[no-untyped-def]
    """Write the variances of the links that begin at every stride-th trace from (i0, j0); infinite across a fault.

    `out` is a part of the grid of every stride-th trace.
    """
    n0, n1, m = out.shape
    most0, most1 = nearest.shape[:2]
    di, dj = (length, 0) if axis == 0 else (0, length)
    for line in prange(n0):
        i = i0 + np.int64(line) * stride
        for column in range(n1):
            j = j0 + column * stride
            for k in range(m):
                out[line, column, k] = np.inf
                if i + di < most0 and j + dj < most1:
                    _, free = follow(nearest, cuts, i, j, np.float64(k * step), axis, length, step)
                    if free:
                        out[line, column, k] = variance[i, j, k]
