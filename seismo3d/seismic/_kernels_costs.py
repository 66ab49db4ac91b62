"""Both sides of a fault compared: for every throw, how much of their energy it leaves over in a window at each place.

Each throw is gone through from the differences to the ratio while its numbers are in the cache, and only where a window
holds anything.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True)
def find_spans(known, reach_rows, reach_samples):  # type: ignore[no-untyped-def]
    """Return, for every row, from where to where anything is known, and a window in it or in rows near it sees that.

    Three arrays of shape (row, 2), of a start and a stop: of what is known; as far as a window along the samples
    reaches to it; and the same of the rows within reach together. Where there is nothing both are 0.
    """
    n_rows, n_samples = known.shape
    spans = np.zeros((3, n_rows, 2), np.int64)
    own, along, around = spans[0], spans[1], spans[2]
    for r in range(n_rows):
        for k in range(n_samples):
            if known[r, k] > 0:
                if own[r, 1] == 0:
                    own[r, 0] = k
                own[r, 1] = k + 1
        if own[r, 1] > 0:
            along[r, 0] = max(0, own[r, 0] - reach_samples)
            along[r, 1] = min(n_samples, own[r, 1] + reach_samples)
    for r in range(n_rows):
        for other in range(max(0, r - reach_rows), min(n_rows, r + reach_rows + 1)):
            if along[other, 1] > 0:
                around[r, 0] = along[other, 0] if around[r, 1] == 0 else min(around[r, 0], along[other, 0])
                around[r, 1] = max(around[r, 1], along[other, 1])
    return own, along, around


@njit(cache=True, nogil=True)
def match_throw(hanging, foot, in_hanging, in_foot, throw, thin, loud, own, sums):  # type: ignore[no-untyped-def]
    """Compare every `thin`-th place of the hanging wall with the one `throw` samples above it in the footwall.

    Written are, for every place, the squared difference, at most `loud`, the energy of both sides, and 1 where both are
    known, as is the footwall a row further on.
    """
    n_rows, n_samples = hanging.shape
    zero, one = np.float32(0.0), np.float32(1.0)
    sums[:] = zero
    for a in range(sums.shape[1]):
        r = a * thin
        start = max(own[a, 0], -(-throw // thin))
        n = min(own[a, 1], (n_samples - 1 + throw) // thin + 1) - start
        if n <= 0:
            continue
        here, there = start * thin, start * thin - throw
        cost, energy, weight = sums[0, a, start:], sums[1, a, start:], sums[2, a, start:]
        up, down, in_up = hanging[r, here::thin], foot[r, there::thin], in_hanging[r, here::thin]
        in_down, in_after = in_foot[r, there::thin], in_foot[min(r + 1, n_rows - 1), there::thin]
        for k in range(n):
            known = (in_up[k] > zero) & (in_down[k] > zero) & (in_after[k] > zero)
            difference = up[k] - down[k]
            square = min(difference * difference, loud)
            both = up[k] * up[k] + down[k] * down[k]
            cost[k] = square if known else zero
            energy[k] = both if known else zero
            weight[k] = one if known else zero


@njit(cache=True, nogil=True)
def match_throw_about(hanging, foot, in_hanging, in_foot, usual, shift, share, thin, loud, own, sums):  # type: ignore[no-untyped-def]
    """Compare every `thin`-th place of the hanging wall with where the usual throw there plus `shift` says it was.

    The place has moved along the rows by `share` times that throw. Written is what :func:`match_throw` writes.
    """
    n_rows, n_samples = hanging.shape
    one = np.float32(1.0)
    sums[:] = np.float32(0.0)
    for a in range(sums.shape[1]):
        for b in range(own[a, 0], own[a, 1]):
            r, k = a * thin, b * thin
            throw = usual[a, b] + shift
            row, above = r - share * throw, k - throw
            inside = 0.0 <= row <= n_rows - 1 and 0.0 <= above <= n_samples - 1
            if not inside or in_hanging[r, k] <= 0:
                continue
            i, j = int(row), int(above)
            fr, fk = np.float32(row - i), np.float32(above - j)
            i1 = i + 1 if fr > 0 else i
            j1 = j + 1 if fk > 0 else j
            if in_foot[i, j] > 0 and in_foot[i1, j] > 0 and in_foot[i, j1] > 0 and in_foot[i1, j1] > 0:
                value = (foot[i, j] * (one - fk) + foot[i, j1] * fk) * (one - fr)
                value += (foot[i1, j] * (one - fk) + foot[i1, j1] * fk) * fr
                difference = hanging[r, k] - value
                sums[0, a, b] = min(difference * difference, loud)
                sums[1, a, b] = hanging[r, k] * hanging[r, k] + value * value
                sums[2, a, b] = one


@njit(cache=True, nogil=True)
def _correlate(padded, taps, out):  # type: ignore[no-untyped-def]
    """Write a row, which has half the taps more at either end, correlated with them."""
    n = len(out)
    out[:] = np.float32(0.0)
    t = 0
    # the taps in their order, so that a sum is the same wherever it is taken
    while t + 3 < len(taps):
        a, b, c, d = taps[t], taps[t + 1], taps[t + 2], taps[t + 3]
        one, two, three, four = padded[t : t + n], padded[t + 1 :], padded[t + 2 :], padded[t + 3 :]
        for k in range(n):
            out[k] = (((out[k] + a * one[k]) + b * two[k]) + c * three[k]) + d * four[k]
        t += 4
    while t < len(taps):
        a, one = taps[t], padded[t : t + n]
        for k in range(n):
            out[k] += a * one[k]
        t += 1


@njit(cache=True, nogil=True)
def smooth_rows(values, taps, spans, padded, out):  # type: ignore[no-untyped-def]
    """Correlate with the taps along the samples, within the spans; the ends repeat. Elsewhere 0 is written.

    `padded` has room for a row and half the taps at either end.
    """
    n_rows, n = values.shape
    half = len(taps) // 2
    for r in range(n_rows):
        start, stop = spans[r, 0], spans[r, 1]
        out[r, :start] = np.float32(0.0)
        out[r, stop:] = np.float32(0.0)
        if stop == 0:
            continue
        padded[:half] = values[r, 0]
        padded[half : half + n] = values[r]
        padded[half + n : n + 2 * half] = values[r, n - 1]
        _correlate(padded[start:], taps, out[r, start:stop])


@njit(cache=True, nogil=True)
def smooth_columns(values, taps, spans, out):  # type: ignore[no-untyped-def]
    """Correlate with the taps along the rows, within the spans; the ends repeat. Elsewhere nothing is written."""
    n_rows = values.shape[0]
    half, last = len(taps) // 2, n_rows - 1
    for r in range(n_rows):
        start, stop = spans[r, 0], spans[r, 1]
        row = out[r, start:stop]
        n = len(row)
        row[:] = np.float32(0.0)
        t = 0
        while t + 2 < len(taps):
            a, b, c = taps[t], taps[t + 1], taps[t + 2]
            one = values[min(max(r + t - half, 0), last), start:stop]
            two = values[min(max(r + t + 1 - half, 0), last), start:stop]
            three = values[min(max(r + t + 2 - half, 0), last), start:stop]
            for k in range(n):
                row[k] = ((row[k] + a * one[k]) + b * two[k]) + c * three[k]
            t += 3
        while t < len(taps):
            a, one = taps[t], values[min(max(r + t - half, 0), last), start:stop]
            for k in range(n):
                row[k] += a * one[k]
            t += 1


@njit(cache=True, nogil=True)
def write_ratios(sums, quiet, unmatched, spans, ratio):  # type: ignore[no-untyped-def]
    """Turn smoothed squares, energies and weights into ratios; `unmatched` where the sides do not overlap."""
    least, one = np.float32(0.3), np.float32(1.0)
    for r in range(ratio.shape[0]):
        start, stop = spans[r, 0], spans[r, 1]
        ratio[r, :start] = unmatched
        ratio[r, stop:] = unmatched
        cost, energy, weight = sums[0, r, start:stop], sums[1, r, start:stop], sums[2, r, start:stop]
        row = ratio[r, start:stop]
        for k in range(len(row)):
            enough = weight[k] > least
            found = cost[k] / (energy[k] + quiet * weight[k] if enough else one)
            row[k] = found if enough else unmatched


@njit(cache=True, nogil=True)
def _smooth_and_divide(sums, row_taps, sample_taps, along, around, quiet, unmatched, ratio):  # type: ignore[no-untyped-def]
    buffer = np.empty(ratio.shape, np.float32)
    padded = np.empty(ratio.shape[1] + 2 * (len(sample_taps) // 2), np.float32)
    for part in range(3):
        smooth_rows(sums[part], sample_taps, along, padded, buffer)
        smooth_columns(buffer, row_taps, around, sums[part])
    write_ratios(sums, quiet, unmatched, around, ratio)


@njit(cache=True, nogil=True, parallel=True)
def _turn(ratio, out):  # type: ignore[no-untyped-def]
    """Write (throw, row, sample) as (row, sample, throw)."""
    n_throws, n_rows, n_samples = ratio.shape
    for r in prange(n_rows):
        for k in range(n_samples):
            for c in range(n_throws):
                out[r, k, c] = ratio[c, r, k]


@njit(cache=True, nogil=True, parallel=True)
def compare_throws(  # type: ignore[no-untyped-def]
    hanging, foot, in_hanging, in_foot, first, thin, every, loud, row_taps, sample_taps, quiet, unmatched, ratio, out
):
    """Write the misfit ratio of throws from the first on, a sample apart: (row, sample, throw).

    They are compared at every `thin`-th place, and told at every so many of these. `ratio` is room for the same as
    (throw, row, sample).
    """
    known = in_hanging[::thin, ::thin]
    own, along, around = find_spans(known, len(row_taps) // 2, len(sample_taps) // 2)
    for number in prange(ratio.shape[0]):
        sums, found = np.empty((3, *known.shape), np.float32), np.empty(known.shape, np.float32)
        match_throw(hanging, foot, in_hanging, in_foot, first + np.int64(number), thin, loud, own, sums)
        _smooth_and_divide(sums, row_taps, sample_taps, along, around, quiet, unmatched, found)
        ratio[number] = found[::every, ::every]
    _turn(ratio, out)


@njit(cache=True, nogil=True, parallel=True)
def compare_about(  # type: ignore[no-untyped-def]
    hanging, foot, in_hanging, in_foot, usual, share, thin, loud, row_taps, sample_taps, quiet, unmatched, ratio, out
):
    """Write the misfit ratio of throws about the usual one at every `thin`-th place: (row, sample, throw).

    Throw number c is the usual one plus c - n // 2 samples. `ratio` is room for the same as (throw, row, sample).
    """
    n_throws = ratio.shape[0]
    own, along, around = find_spans(in_hanging[::thin, ::thin], len(row_taps) // 2, len(sample_taps) // 2)
    for number in prange(n_throws):
        sums = np.empty((3, ratio.shape[1], ratio.shape[2]), np.float32)
        shift = np.float32(np.int64(number) - n_throws // 2)
        match_throw_about(hanging, foot, in_hanging, in_foot, usual, shift, share, thin, loud, own, sums)
        _smooth_and_divide(sums, row_taps, sample_taps, along, around, quiet, unmatched, ratio[number])
    _turn(ratio, out)
