"""The planar scan: evidence summed over small planes of every orientation, as lines along strike and then along dip."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from seismo3d._multiply_add import multiply_add

_BATCH = 2560
"""Samples of rows that are laid end to end."""


@njit(cache=True, nogil=True, inline="always")
def _between_lines(i, moved, tap, n0):  # type: ignore[no-untyped-def]
    """Return the two lines that a plane passes between, `moved` lines off line i, with the tap's shares of each.

    A line that is not there is line i itself, with no share.
    """
    base = math.floor(moved)
    w1 = tap * np.float32(moved - base)
    w0 = tap - w1
    a = i + base
    b = a + 1
    if a < 0 or a >= n0:
        a = i
        w0 = np.float32(0.0)
    if b < 0 or b >= n0:
        b = i
        w1 = np.float32(0.0)
    return a, b, w0, w1


@njit(cache=True, nogil=True, parallel=True)
def sum_strike_lines(first, second, w_first, w_second, shear, taps, pad, corner, out):  # type: ignore[no-untyped-def]
    """Write the weighted mean of w_first * first + w_second * second along a line in the time slice.

    The axes are (across the plane, along its strike, sample): the line runs along the second axis and moves by `shear`
    along the first. What lies outside the cube is left out of the mean. Rows of `out` carry `pad` zeros at either end;
    its first row is that of `first` at `corner`.
    """
    n0, n1, n2 = first.shape
    half = len(taps) // 2
    for line in prange(out.shape[0]):
        row = np.int64(line)
        i = row + corner[0]
        for column in range(out.shape[1]):
            j = column + corner[1]
            out[row, column] = 0.0
            values = out[row, column, pad : pad + n2]
            total = np.float32(0.0)
            for t in range(-half, half + 1):
                jj = j + t
                if jj < 0 or jj >= n1:
                    continue
                a, b, w0, w1 = _between_lines(i, shear * t, taps[t + half], n0)
                total += w0 + w1
                first0, second0, first1, second1 = first[a, jj], second[a, jj], first[b, jj], second[b, jj]
                u0, v0, u1, v1 = w0 * w_first, w0 * w_second, w1 * w_first, w1 * w_second
                for k in range(n2):
                    part = multiply_add(u0, first0[k], multiply_add(v0, second0[k], values[k]))
                    values[k] = multiply_add(u1, first1[k], multiply_add(v1, second1[k], part))
            scale = np.float32(1.0) / max(total, np.float32(0.2))
            for k in range(n2):
                values[k] *= scale


@njit(cache=True, nogil=True, inline="always")
def _add_half(flat, i, shear, taps, part, start, n0, into):  # type: ignore[no-untyped-def]
    """Add to `into` the sums down a dip, above line i (part 0) or below it (part 1), of lines laid end to end.

    Two steps at a time: the sums are read and written half as often.
    """
    half = len(taps) // 2
    length = len(into)
    end = part * half
    for t in range(end - half, end + 1, 2):
        a, b, u0, u1 = _between_lines(i, shear * t, taps[t + half], n0)
        after = min(t + 1, end)
        tap = taps[after + half] if after > t else np.float32(0.0)
        d, e, v0, v1 = _between_lines(i, shear * after, tap, n0)
        if u0 + u1 + v0 + v1 <= np.float32(0.0):
            continue
        from_t, to_t = start + t, start + t + length
        from_after, to_after = start + after, start + after + length
        row0, row1 = flat[a, from_t:to_t], flat[b, from_t:to_t]
        row2, row3 = flat[d, from_after:to_after], flat[e, from_after:to_after]
        for m in range(length):
            one = multiply_add(u0, row0[m], multiply_add(u1, row1[m], into[m]))
            into[m] = multiply_add(v0, row2[m], multiply_add(v1, row3[m], one))


@njit(cache=True, nogil=True, parallel=True)
def keep_best_dip(lines, shares, first, shears, taps, prior, prior_weight, evenness, code, best, arg):  # type: ignore[no-untyped-def]
    """Sum the lines down every dip; keep the largest mean and the number of its orientation.

    A plane's mean is drawn towards that of its poorer half, above or below, by `evenness`: a bright patch beside an
    empty one is no plane. What lies outside the cube counts as the prior, with a small weight. `shares` tells how much
    of each line is known, with zeros in its padding, and lines are sums over that; no lines of shares: all is known.
    Rows are worked on in batches, laid end to end with their padding between them, so that one shift serves them all.
    The first row of `best` is that of `lines` at `first`.
    """
    n1, n2 = best.shape[1], best.shape[2]
    n0 = lines.shape[0]
    half = len(taps) // 2
    width = n2 + 2 * half
    flat, flat_shares = lines.reshape(n0, n1 * width), shares.reshape(len(shares), n1 * width)
    whole = len(shares) == 0
    # sums and what is added to them stay in the nearest cache
    batch = max(1, _BATCH // width)
    for line in prange(best.shape[0]):
        r = np.int64(line)
        i = r + first
        sums = np.empty((2, batch * width), np.float32)
        counted = np.empty((2, 0 if whole else batch * width), np.float32)
        top, number = np.empty((batch, n2), np.float32), np.empty((batch, n2), np.int32)
        weights = np.empty((len(shears), 2, n2), np.float32)
        for c in range(len(shears)):
            _weigh_halves(i, shears[c], taps, prior_weight, n0, weights[c])
        for j0 in range(0, n1, batch):
            n_rows = min(batch, n1 - j0)
            # the outermost padding of the batch is never read: shifts stay within `half`
            start = j0 * width + half
            length = n_rows * width - 2 * half
            for row in range(n_rows):
                top[row] = best[r, j0 + row]
                for k in range(n2):
                    number[row, k] = arg[r, j0 + row, k]
            for c in range(len(shears)):
                sums[:] = prior_weight * prior
                counted[:] = prior_weight
                for part in range(2):
                    _add_half(flat, i, shears[c], taps, part, start, n0, sums[part, :length])
                    if not whole:
                        _add_half(flat_shares, i, shears[c], taps, part, start, n0, counted[part, :length])
                for row in range(n_rows):
                    own = slice(row * width, row * width + n2)
                    above, below = sums[0, own], sums[1, own]
                    if whole:
                        _even_means(above, below, weights[c, 0], weights[c, 1], evenness)
                    else:
                        _even_means(above, below, counted[0, own], counted[1, own], evenness)
                    _keep_larger(above, np.int32(code + c), top[row], number[row])
            for row in range(n_rows):
                best[r, j0 + row] = top[row]
                for k in range(n2):
                    arg[r, j0 + row, k] = number[row, k]


@njit(cache=True, nogil=True)
def _weigh_halves(i, shear, taps, prior_weight, n0, weights):  # type: ignore[no-untyped-def]
    """Write the weights of what of a dip lies within the cube, above line i and below it, at every sample."""
    n2 = weights.shape[1]
    half = len(taps) // 2
    weights[:] = prior_weight
    for t in range(-half, half + 1):
        _, _, w0, w1 = _between_lines(i, shear * t, taps[t + half], n0)
        weight = w0 + w1
        if weight > np.float32(0.0):
            for part in range(0 if t <= 0 else 1, 2 if t >= 0 else 1):
                counted = weights[part]
                for k in range(max(0, -t), min(n2, n2 - t)):
                    counted[k] += weight


@njit(cache=True, nogil=True, inline="always")
def _even_means(above, below, w_above, w_below, evenness):  # type: ignore[no-untyped-def]
    """Write the mean of two halves, drawn towards that of the poorer one, over the sums of the first."""
    whole = np.float32(1.0) - evenness
    for k in range(len(above)):
        mean = (above[k] + below[k]) / (w_above[k] + w_below[k])
        first, second = above[k] / w_above[k], below[k] / w_below[k]
        above[k] = whole * mean + evenness * min(first, second)


@njit(cache=True, nogil=True, inline="always")
def _keep_larger(values, number, top, numbers):  # type: ignore[no-untyped-def]
    """Take values, and the number they go by, where they are larger; numbers as wide as values, for the speed."""
    for k in range(len(values)):
        better = values[k] > top[k]
        top[k] = values[k] if better else top[k]
        numbers[k] = number if better else numbers[k]


@njit(cache=True, nogil=True, parallel=True)
def merge_best(best, arg, other, other_arg):  # type: ignore[no-untyped-def]
    """Take the larger of two scans, the second with its first two axes exchanged."""
    n0, n1, n2 = best.shape
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                if other[j, i, k] > best[i, j, k]:
                    best[i, j, k] = other[j, i, k]
                    arg[i, j, k] = other_arg[j, i, k]


@njit(cache=True, nogil=True, parallel=True)
def find_ridges(best, arg, normals, least, offset):  # type: ignore[no-untyped-def]
    """Mark voxels that are largest across their plane, horizontally; write how far off the voxel the crest lies.

    Returns a boolean volume; `offset` gets the signed distance, in traces, along the plane's horizontal normal.
    """
    n0, n1, n2 = best.shape
    keep = np.zeros(best.shape, np.bool_)
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for k in range(n2):
                value = best[i, j, k]
                if value < least:
                    continue
                nx = normals[arg[i, j, k], 0]
                ny = normals[arg[i, j, k], 1]
                before = _at(best, i - nx, j - ny, k)
                after = _at(best, i + nx, j + ny, k)
                # a crest needs both its flanks: at the cube's edge it could not be told from a rise towards it
                if before > -np.inf and after > -np.inf and value >= before and value > after:
                    keep[i, j, k] = True
                    bend = before - 2.0 * value + after
                    offset[i, j, k] = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return keep


@njit(cache=True, nogil=True, inline="always")
def _at(volume, x, y, k):  # type: ignore[no-untyped-def]
    """Bilinear value in a time slice, minus infinity outside."""
    n0, n1 = volume.shape[0], volume.shape[1]
    if x < 0.0 or y < 0.0 or x > n0 - 1 or y > n1 - 1:
        return np.float32(-np.inf)
    i = min(int(x), max(n0 - 2, 0))
    j = min(int(y), max(n1 - 2, 0))
    fx = np.float32(x - i)
    fy = np.float32(y - j)
    ii = min(i + 1, n0 - 1)
    jj = min(j + 1, n1 - 1)
    low = volume[i, j, k] * (1 - fx) + volume[ii, j, k] * fx
    high = volume[i, jj, k] * (1 - fx) + volume[ii, jj, k] * fx
    return low * (1 - fy) + high * fy
