"""Local vertical shifts between traces: predicted by following shorter ones, refined by least squares."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d._multiply_add import multiply_add


@njit(cache=True, nogil=True, inline="always")
def read_coarse(row, z, step):  # type: ignore[no-untyped-def]
    """Linear interpolation, at sample z, of values kept at every step-th sample; the ends repeat."""
    at = z / step
    n = row.shape[0]
    if at <= 0.0:
        return row[0]
    if at >= n - 1:
        return row[n - 1]
    k = int(at)
    share = np.float32(at - k)
    return row[k] + share * (row[k + 1] - row[k])


@njit(cache=True, nogil=True)
def follow(shift, cuts, i, j, z, axis, length, step):  # type: ignore[no-untyped-def]
    """Follow shifts from trace to trace: where sample z comes out, and whether no fault is crossed on the way."""
    di, dj = (1, 0) if axis == 0 else (0, 1)
    n2 = cuts.shape[2]
    bit = np.uint8(1 << axis)
    free = True
    for t in range(length):
        x, y = i + t * di, j + t * dj
        ahead = z + read_coarse(shift[x, y], z, step)
        k = min(max(int(np.rint(0.5 * (z + ahead))), 0), n2 - 1)
        if cuts[x, y, k] & bit:
            free = False
        z = ahead
    return z, free


@njit(cache=True, nogil=True)
def refine(coarse, step, fine):  # type: ignore[no-untyped-def]
    """Interpolate values kept at every step-th sample; the last one goes on."""
    last, size = coarse.shape[0] - 1, fine.shape[0]
    for n in range(last):
        change = coarse[n + 1] - coarse[n]
        for k in range(n * step, min((n + 1) * step, size)):
            fine[k] = coarse[n] + np.float32(k - n * step) / np.float32(step) * change
    for k in range(last * step, size):
        fine[k] = coarse[last]


@njit(cache=True, nogil=True)
def add_windows(values, taps, step, phases, sums):  # type: ignore[no-untyped-def]
    """Add to coarse sample n the taps times the values from n * step on.

    `phases`, of shape (step, any), is room for the values laid out anew, value e at [e % step, e // step]: neighbouring
    windows then lie side by side, and the loop over them runs on vector units. The values fill it.
    """
    m = sums.shape[0]
    for p in range(step):
        row = phases[p]
        for q in range(phases.shape[1]):
            row[q] = values[q * step + p]
    for t in range(len(taps)):
        weight, first = taps[t], t // step
        window = phases[t - first * step, first : first + m]
        for n in range(m):
            sums[n] = multiply_add(weight, window[n], sums[n])


@njit(cache=True, nogil=True, parallel=True)
def match_products(volume, valid, cuts, any_cut, shift, axis, length, start, step, taps, products):  # type: ignore[no-untyped-def]
    """Write, at every step-th sample, what the least-squares shift between traces `length` apart needs.

    `shift` is from a trace to the next, `start` the shift over the whole length to begin with; `any_cut` tells whether
    `cuts` has any. The five products are the weight, g g, g (a - b), (a - b)^2 and a a + b b, each smoothed along the
    samples by the taps, with a one trace, b the other one carried over and g the mean of their derivatives.
    """
    n0, n1, n2 = volume.shape
    di, dj = (length, 0) if axis == 0 else (0, length)
    half = len(taps) // 2
    m = start.shape[2]
    for line in prange(n0):
        i = np.int64(line)
        phases = np.empty((step, m + 2 * half // step + 2), np.float32)
        rows = np.zeros((5, phases.size), np.float32)
        fine = np.empty(n2, np.float32)
        for j in range(n1):
            products[:, i, j] = 0.0
            if i + di >= n0 or j + dj >= n1:
                continue
            rows[:] = 0.0
            refine(start[i, j], step, fine)
            own, usable = volume[i, j], valid[i, j]
            other, known = volume[i + di, j + dj], valid[i + di, j + dj]
            for k in range(1, n2 - 1):
                z = k + fine[k]
                if z < 1.0 or z >= n2 - 2:
                    continue
                b = int(z)
                if not (usable[k] and usable[k - 1] and usable[k + 1]):
                    continue
                if not (known[b] and known[b + 1] and known[b - 1] and known[b + 2]):
                    continue
                if any_cut and not follow(shift, cuts, i, j, np.float64(k), axis, length, step)[1]:
                    continue
                f = np.float32(z - b)
                y0, y1, y2, y3 = other[b - 1], other[b], other[b + 1], other[b + 2]
                c1 = np.float32(0.5) * (y2 - y0)
                c2 = y0 - np.float32(2.5) * y1 + np.float32(2.0) * y2 - np.float32(0.5) * y3
                c3 = np.float32(0.5) * (y3 - y0) + np.float32(1.5) * (y1 - y2)
                value = y1 + f * (c1 + f * (c2 + f * c3))
                rise = c1 + f * (np.float32(2.0) * c2 + f * np.float32(3.0) * c3)
                g = np.float32(0.5) * (rise + np.float32(0.5) * (own[k + 1] - own[k - 1]))
                d = own[k] - value
                at = k + half
                rows[0, at], rows[1, at], rows[2, at], rows[3, at] = 1.0, g * g, g * d, d * d
                rows[4, at] = own[k] * own[k] + value * value
            for c in range(5):
                add_windows(rows[c], taps, step, phases, products[c, i, j])


@njit(cache=True, nogil=True, parallel=True)
def finish_shifts(products, start, floor, most, n_free, shift, variance):  # type: ignore[no-untyped-def]
    """Turn smoothed products into shifts and their variances, in samples; the variance is `most` where unknown.

    The weight is overwritten by the misfit ratio: what is left over the energy, 0 where unknown.
    """
    n0, n1, m = start.shape
    for i in prange(n0):
        for j in range(n1):
            for k in range(m):
                weight = products[0, i, j, k]
                strength = products[1, i, j, k]
                if weight < np.float32(0.05) or strength <= floor * weight:
                    shift[i, j, k] = start[i, j, k]
                    variance[i, j, k] = most
                    products[0, i, j, k] = 0.0
                    continue
                move = products[2, i, j, k] / strength
                move = min(max(move, np.float32(-1.0)), np.float32(1.0))
                left = max(products[3, i, j, k] - move * products[2, i, j, k], np.float32(0.0))
                shift[i, j, k] = start[i, j, k] + move
                spread = left / strength / (n_free * weight) + np.float32(4e-4)
                variance[i, j, k] = min(spread, most)
                products[0, i, j, k] = left / max(products[4, i, j, k], np.float32(1e-20))


@njit(cache=True, nogil=True, parallel=True)
def compose_shifts(nearest, axis, length, step, out):  # type: ignore[no-untyped-def]
    """Write shifts over `length` traces: those from trace to trace, one after the other."""
    n0, n1, m = nearest.shape
    di, dj = (1, 0) if axis == 0 else (0, 1)
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for k in range(m):
                z = np.float64(k * step)
                for t in range(length):
                    x, y = min(i + t * di, n0 - 1), min(j + t * dj, n1 - 1)
                    z += read_coarse(nearest[x, y], z, step)
                out[i, j, k] = z - k * step
