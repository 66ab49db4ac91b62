"""Depths of one layer, and the waveforms along it."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

# samples on either side of a depth from which an amplitude there is made
_TAPS = 8


@njit(cache=True, nogil=True, inline="always")
def _between(y0, y1, y2, y3, f):  # type: ignore[no-untyped-def]
    """Value between the second and the third of four samples, at a share of the way, by cubic convolution."""
    c1 = np.float32(0.5) * (y2 - y0)
    c2 = y0 - np.float32(2.5) * y1 + np.float32(2.0) * y2 - np.float32(0.5) * y3
    c3 = np.float32(0.5) * (y3 - y0) + np.float32(1.5) * (y1 - y2)
    return y1 + f * (c1 + f * (c2 + f * c3))


@njit(cache=True, nogil=True, parallel=True)
def level_depths(times, cuts, target, depth):  # type: ignore[no-untyped-def]
    """Write the fractional sample at which every trace reaches its target; NaN where it does not, or in a fault."""
    n0, n1, n2 = times.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            depth[i, j] = np.nan
            row, wanted = times[i, j], target[i, j]
            if not (wanted >= row[0] and wanted <= row[n2 - 1]):
                continue
            low, high = 0, n2 - 1
            while high - low > 1:
                middle = (low + high) // 2
                if row[middle] <= wanted:
                    low = middle
                else:
                    high = middle
            if cuts[i, j, low] & np.uint8(4) and row[high] - row[low] > 2.0:
                continue
            depth[i, j] = low + (wanted - row[low]) / (row[high] - row[low])


@njit(cache=True, nogil=True, parallel=True)
def read_waveforms(volume, valid, depth, half, out):  # type: ignore[no-untyped-def]
    """Write amplitudes from `half` samples above every depth to `half` below; 0 where there are none."""
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for t in range(2 * half + 1):
                out[i, j, t] = 0.0
                if not np.isfinite(depth[i, j]):
                    continue
                z = depth[i, j] + t - half
                b = int(np.floor(z))
                if b < 1 or b + 2 >= n2 or not (valid[i, j, b] and valid[i, j, b + 1]):
                    continue
                f = np.float32(z - b)
                y0, y1 = volume[i, j, b - 1], volume[i, j, b]
                y2, y3 = volume[i, j, b + 1], volume[i, j, b + 2]
                out[i, j, t] = _between(y0, y1, y2, y3, f)


@njit(cache=True, nogil=True)
def lies_in_data(valid, z, reach):  # type: ignore[no-untyped-def]
    """Tell whether a trace has data at a depth, or both above and below it within `reach` samples."""
    middle = min(max(int(np.rint(z)), 0), len(valid) - 1)
    above = below = False
    for t in range(reach + 1):
        above |= middle - t >= 0 and valid[middle - t]
        below |= middle + t < len(valid) and valid[middle + t]
    return above and below


@njit(cache=True, nogil=True, parallel=True)
def part_untold(valid, reach, depth):  # type: ignore[no-untyped-def]
    """Set to NaN the depths that do not lie in data."""
    n0, n1, _ = valid.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            if np.isfinite(depth[i, j]) and not lies_in_data(valid[i, j], depth[i, j], reach):
                depth[i, j] = np.nan


@njit(cache=True, nogil=True, parallel=True)
def read_finely(volume, valid, depth, lag, out):  # type: ignore[no-untyped-def]
    """Write band-limited amplitudes `lag` samples above, at and below every depth; NaN where there are none.

    By a sinc in Lanczos' window over the samples that are known; the four around the depth must be.
    """
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for t in range(3):
                out[i, j, t] = np.nan
                if not np.isfinite(depth[i, j]):
                    continue
                z = depth[i, j] + (t - 1) * lag
                b = int(np.floor(z))
                if b < 1 or b + 2 >= n2 or not valid[i, j, b - 1 : b + 3].all():
                    continue
                total, weight = 0.0, 0.0
                for k in range(max(b + 1 - _TAPS, 0), min(b + 1 + _TAPS, n2)):
                    if valid[i, j, k]:
                        x = np.pi * (z - k)
                        tap = 1.0
                        if abs(x) > 1e-9:
                            tap = np.sin(x) / x * np.sin(x / _TAPS) * _TAPS / x
                        total += tap * volume[i, j, k]
                        weight += tap
                out[i, j, t] = total / weight


@njit(cache=True, nogil=True, parallel=True)
def cross_levels(times, cuts, target, beyond, crossings):  # type: ignore[no-untyped-def]
    """Write the fractional samples at which every trace reaches its target, from above; NaN for those it lacks.

    Layer time goes on for half a sample at faults, and for `beyond` samples above and below the cube.
    """
    n0, n1, n2 = times.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            crossings[:, i, j] = np.nan
            row, cut, wanted = times[i, j], cuts[i, j], target[i, j]
            found = 0
            for k in range(n2):
                if found == len(crossings):
                    break
                above = k > 0 and not cut[k - 1] & np.uint8(4)
                below = k < n2 - 1 and not cut[k] & np.uint8(4)
                if below and row[k] <= wanted < row[k + 1]:
                    crossings[found, i, j] = k + (wanted - row[k]) / (row[k + 1] - row[k])
                    found += 1
                elif not above and wanted < row[k] and wanted >= row[k] - (np.float32(0.5) if k > 0 else beyond):
                    crossings[found, i, j] = k - (row[k] - wanted)
                    found += 1
                elif not below and wanted >= row[k] and wanted <= row[k] + (np.float32(0.5) if k < n2 - 1 else beyond):
                    crossings[found, i, j] = k + (wanted - row[k])
                    found += 1


@njit(cache=True, nogil=True, inline="always")
def _read_cubic(row, z, first, last):  # type: ignore[no-untyped-def]
    """Amplitude at a fractional sample from those of one run alone."""
    b = min(int(z), last - 1)
    f = np.float32(z - b)
    y1, y2 = row[b], row[b + 1]
    y0 = row[b - 1] if b > first else np.float32(2.0) * y1 - y2
    y3 = row[b + 2] if b + 2 <= last else np.float32(2.0) * y2 - y1
    return _between(y0, y1, y2, y3, f)


@njit(cache=True, nogil=True, inline="always")
def _find_run(cut, middle, half, n2):  # type: ignore[no-untyped-def]
    """First and last sample, at most so far from the middle, that no fault separates from it."""
    first, last = middle, middle
    while first > max(0, middle - half) and not cut[first - 1] & np.uint8(4):
        first -= 1
    while last < min(n2 - 1, middle + half) and not cut[last] & np.uint8(4):
        last += 1
    return first, last


@njit(cache=True, nogil=True, parallel=True)
def read_runs(volume, valid, cuts, depth, half, clear, out, known):  # type: ignore[no-untyped-def]
    """Write amplitudes from `half` samples above every depth to `half` below, and 1 where there are any, else 0.

    There are none beyond a fault that the trace crosses, nor less than `clear` samples before it.
    """
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            out[i, j, :] = 0.0
            known[i, j, :] = 0.0
            if not np.isfinite(depth[i, j]):
                continue
            middle = min(max(int(np.rint(depth[i, j])), 0), n2 - 1)
            first, last = _find_run(cuts[i, j], middle, half + 1, n2)
            if last <= first:
                continue
            low = first + (clear if first > 0 and cuts[i, j, first - 1] & np.uint8(4) else 0)
            high = last - (clear if cuts[i, j, last] & np.uint8(4) else 0)
            for t in range(2 * half + 1):
                z = depth[i, j] + t - half
                b = int(np.floor(z))
                if b >= low and b + 1 <= high and valid[i, j, b] and valid[i, j, b + 1]:
                    out[i, j, t] = _read_cubic(volume[i, j], z, first, last)
                    known[i, j, t] = 1.0


@njit(cache=True, nogil=True, parallel=True)
def read_known(volume, valid, depth, half, out):  # type: ignore[no-untyped-def]
    """Write amplitudes from `half` samples above every depth to `half` below, of data alone; NaN where there are none.

    There are some from the first sample of a run of data to its last.
    """
    n0, n1, n2 = volume.shape
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            row, known = volume[i, j], valid[i, j]
            for t in range(2 * half + 1):
                out[i, j, t] = np.nan
                z = depth[i, j] + t - half
                if not (z >= 0.0 and z <= n2 - 1.0):
                    continue
                b = int(z)
                if z == b and b > 0 and (b + 1 == n2 or not known[b + 1]):
                    b -= 1
                if b + 1 < n2 and known[b] and known[b + 1]:
                    first = b - 1 if b > 0 and known[b - 1] else b
                    last = b + 2 if b + 2 < n2 and known[b + 2] else b + 1
                    out[i, j, t] = _read_cubic(row, z, first, last)


@njit(cache=True, nogil=True, parallel=True)
def weigh_runs(cuts, depth, taper, clear, out):  # type: ignore[no-untyped-def]
    """Write the share of a window about every depth that lies on its side of faults, `clear` samples off them."""
    n0, n1, n2 = cuts.shape
    half, whole = len(taper) // 2, taper.sum()
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            out[i, j] = 0.0
            if not np.isfinite(depth[i, j]):
                continue
            middle = min(max(int(np.rint(depth[i, j])), 0), n2 - 1)
            first, last = _find_run(cuts[i, j], middle, half + 1, n2)
            low, high = np.float64(first - n2), np.float64(last + n2)
            if first > 0 and cuts[i, j, first - 1] & np.uint8(4):
                low = np.float64(first + clear)
            if cuts[i, j, last] & np.uint8(4):
                high = np.float64(last - clear)
            total = 0.0
            for t in range(2 * half + 1):
                z = depth[i, j] + t - half
                if low <= z <= high:
                    total += taper[t]
            out[i, j] = total / whole


@njit(cache=True, nogil=True, parallel=True)
def read_layers(volume, valid, times, cuts, depth, half, out, known):  # type: ignore[no-untyped-def]
    """Write amplitudes at every unit of layer time up to `half` before and after every depth's; 1 where there are any.

    There are none (0) beyond a fault that the trace crosses, nor where the layer time hardly grows.
    """
    n0, n1, n2 = volume.shape
    steepest, flattest, slack = np.float32(3.0), np.float32(0.3), np.float32(1e-3)
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            out[i, j, :] = 0.0
            known[i, j, :] = 0.0
            if not np.isfinite(depth[i, j]):
                continue
            middle = min(max(int(np.rint(depth[i, j])), 0), n2 - 1)
            first, last = _find_run(cuts[i, j], middle, 2 * half, n2)
            if last <= first:
                continue
            row, z = times[i, j], depth[i, j]
            b = min(max(int(np.floor(z)), first), last - 1)
            centre = row[b] + (z - b) * (row[b + 1] - row[b])
            for sign in (1, -1):
                k = b
                for t in range(0 if sign > 0 else 1, half + 1):
                    wanted = centre + sign * t
                    while sign > 0 and k < last - 1 and row[k + 1] < wanted:
                        k += 1
                    while sign < 0 and k > first and row[k] > wanted:
                        k -= 1
                    rise = row[k + 1] - row[k]
                    if wanted < row[k] - slack or wanted > row[k + 1] + slack:
                        continue
                    if not (flattest < rise < steepest and valid[i, j, k] and valid[i, j, k + 1]):
                        continue
                    at = min(max(k + (wanted - row[k]) / rise, np.float64(first)), np.float64(last))
                    out[i, j, half + sign * t] = _read_cubic(volume[i, j], at, first, last)
                    known[i, j, half + sign * t] = 1.0


@njit(cache=True, nogil=True, parallel=True)
def match_waveforms(waves, known, references, in_reference, taper, least, scores):  # type: ignore[no-untyped-def]
    """Write the correlation of every row with shorter references at every lag; -1 where too little is known.

    References are of shape (k, width), and scores (k, row, lag). What is known of them is of shape (k, width) too, or
    (1, width) where they are all known alike.
    """
    n, width = references.shape
    n_known, n_lags = len(in_reference), scores.shape[2]
    whole = taper.sum()
    for row in prange(len(waves)):
        p = np.int64(row)
        share, left = np.zeros((n_known, n_lags)), np.zeros((n_known, n_lags))
        product, right = np.zeros((n, n_lags)), np.zeros((n, n_lags))
        # all lags side by side, which the processor's vectors take several of in a step
        for t in range(width):
            for k in range(n_known):
                weight = taper[t] * in_reference[k, t]
                for lag in range(n_lags):
                    w, x = weight * known[p, lag + t], waves[p, lag + t]
                    share[k, lag] += w
                    left[k, lag] += w * x * x
            for k in range(n):
                weight, r = taper[t] * in_reference[k if n_known > 1 else 0, t], references[k, t]
                for lag in range(n_lags):
                    w, x = weight * known[p, lag + t], waves[p, lag + t]
                    product[k, lag] += w * x * r
                    right[k, lag] += w * r * r
        for k in range(n):
            own = k if n_known > 1 else 0
            for lag in range(n_lags):
                if share[own, lag] < least * whole or left[own, lag] <= 0.0 or right[k, lag] <= 0.0:
                    scores[k, p, lag] = -1.0
                else:
                    scores[k, p, lag] = product[k, lag] / np.sqrt(left[own, lag] * right[k, lag])


@njit(cache=True, nogil=True, parallel=True)
def sum_parts(waves, known, order, begin, labels, sums, counts):  # type: ignore[no-untyped-def]
    """Add the known amplitudes of each part's rows to its sums, and count them.

    Rows of part ``labels[p]`` are those that `order` names from ``begin[p]`` to before ``begin[p + 1]``.
    """
    width = waves.shape[1]
    for place in prange(len(labels)):
        p = np.int64(place)
        total, count = sums[labels[p]], counts[labels[p]]
        for n in range(begin[p], begin[p + 1]):
            row = order[n]
            for t in range(width):
                total[t] += waves[row, t] * known[row, t]
                count[t] += known[row, t]
