"""Compiled loops of the 2D histograms: votes, sliding windows, descriptors. Arrays in, arrays out, no checks."""

from __future__ import annotations

import numba
import numpy as np

from seismo3d._multiply_add import multiply_add
from seismo3d._typing import AnyArray, Float32Array, Int32Array


@numba.njit(cache=True, nogil=True)
def quantise(magnitude: AnyArray, angle: AnyArray, valid: AnyArray, n_bins: int, bins_per_radian: float) -> tuple:
    rows, columns = magnitude.shape
    bins = np.zeros((rows, columns), np.uint8)
    low = np.zeros((rows, columns), np.uint16)
    high = np.zeros((rows, columns), np.uint16)
    masked = valid.shape[0] == rows and valid.shape[1] == columns
    for y in range(1, rows - 1):
        for x in range(1, columns - 1):
            if masked and not (
                valid[y, x - 1] and valid[y, x + 1] and valid[y - 1, x] and valid[y + 1, x] and valid[y, x]
            ):
                continue
            position = angle[y, x] * bins_per_radian
            first = int(position)
            share = int((position - first) * np.float32(16.0) + np.float32(0.5))
            weight = int(np.sqrt(magnitude[y, x]) * np.float32(16.0) + np.float32(0.5))
            bins[y, x] = first if first < n_bins else first - n_bins
            low[y, x] = weight * (16 - share)
            high[y, x] = weight * share
    return bins, low, high


@numba.njit(cache=True, nogil=True)
def votes_to_planes(bins: AnyArray, low: AnyArray, high: AnyArray, n_bins: int) -> Int32Array:
    rows, columns = bins.shape
    planes = np.zeros((n_bins, rows, columns), np.int32)
    for y in range(rows):
        for x in range(columns):
            first = bins[y, x]
            second = first + 1 if first + 1 < n_bins else 0
            planes[first, y, x] += low[y, x]
            planes[second, y, x] += high[y, x]
    return planes


@numba.njit(cache=True, nogil=True)
def _running_sums(padded: Int32Array, sums: Int32Array, first: int) -> None:
    rows, columns = padded.shape
    for y in range(first, rows):  # above there is nothing to sum
        for x in range(2, columns - 2):
            here = padded[y, x]
            pair = here + padded[y - 1, x]
            sums[0, y, x] = sums[0, y - 1, x] + here
            sums[1, y, x] = sums[1, y - 2, x - 1] + pair
            sums[2, y, x] = sums[2, y - 2, x + 1] + pair
            sums[3, y, x] = sums[3, y - 1, x - 1] + here
            sums[4, y, x] = sums[4, y - 1, x + 1] + here
            sums[5, y, x] = sums[5, y - 1, x - 2] + here
            sums[6, y, x] = sums[6, y - 1, x + 2] + here


@numba.njit(cache=True, nogil=True)
def slide_window(planes: Int32Array, taps: Int32Array, reach: int) -> Int32Array:
    n_planes, rows, columns = planes.shape
    above, beside = reach + 3, 2 * reach + 6  # so that no running sum is asked for outside the padded plane
    padded = np.zeros((rows + 2 * above, columns + 2 * beside), np.int32)
    sums = np.zeros((7, rows + 2 * above, columns + 2 * beside), np.int32)
    start = beside - reach - 2  # the window touches no pixel yet
    n_steps = columns + reach + 2
    change = np.empty(n_steps, np.int32)
    out = np.empty((n_planes, rows, columns), np.int32)
    for p in range(n_planes):
        padded[above : above + rows, beside : beside + columns] = planes[p]
        _running_sums(padded, sums, above)
        for y in range(rows):
            change[:] = 0
            for t in range(taps.shape[0]):
                first = start + taps[t, 2]
                line = sums[taps[t, 0], y + above + taps[t, 1], first : first + n_steps]
                if taps[t, 3] > 0:
                    for x in range(n_steps):
                        change[x] += line[x]
                else:
                    for x in range(n_steps):
                        change[x] -= line[x]
            total = 0
            for x in range(reach + 2):
                total += change[x]
            for x in range(columns):
                total += change[x + reach + 2]
                out[p, y, x] = total
    return out


@numba.njit(cache=True, nogil=True)
def window_sums(planes: Int32Array, half_widths: Int32Array) -> Int32Array:
    """Sum each plane over the window around every pixel afresh: what :func:`slide_window` is measured against."""
    n_planes, rows, columns = planes.shape
    reach = half_widths.size // 2
    out = np.zeros((n_planes, rows, columns), np.int32)
    for p in range(n_planes):
        for y in range(rows):
            for x in range(columns):
                total = 0
                for j in range(half_widths.size):
                    v = y + j - reach
                    if v < 0 or v >= rows:
                        continue
                    for u in range(max(0, x - half_widths[j]), min(columns, x + half_widths[j] + 1)):
                        total += planes[p, v, u]
                out[p, y, x] = total
    return out


@numba.njit(cache=True, nogil=True)
def describe(
    bins: AnyArray,
    low: AnyArray,
    high: AnyArray,
    xy: Float32Array,
    centres: Float32Array,
    ring: Int32Array,
    widths: Int32Array,
    reach: Int32Array,
    n_bins: int,
    out: Int32Array,
) -> None:
    """Add up the votes in each window of each point: out (points, windows, bins)."""
    rows, columns = bins.shape
    hist = np.empty(n_bins + 1, np.int32)
    for i in range(xy.shape[0]):
        for k in range(centres.shape[0]):
            cx = int(np.floor(xy[i, 0] + centres[k, 0] + np.float32(0.5)))
            cy = int(np.floor(xy[i, 1] + centres[k, 1] + np.float32(0.5)))
            hist[:] = 0
            r = ring[k]
            for j in range(-reach[r], reach[r] + 1):
                y = cy + j
                if y < 0 or y >= rows:
                    continue
                w = widths[r, j + reach[r]]
                for x in range(max(0, cx - w), min(columns, cx + w + 1)):
                    b = bins[y, x]
                    hist[b] += low[y, x]
                    hist[b + 1] += high[y, x]
            hist[0] += hist[n_bins]
            for b in range(n_bins):
                out[i, k, b] = hist[b]


@numba.njit(cache=True, nogil=True)
def nearest_apart(similarity: Float32Array, points: AnyArray, apart: float) -> tuple:
    """Best column of each row, and its distance over that of the best one more than ``apart`` away."""
    n, m = similarity.shape
    best = np.zeros(n, np.int64)
    ratio = np.ones(n, np.float64)
    for i in range(n):
        k = 0
        for j in range(1, m):
            if similarity[i, j] > similarity[i, k]:
                k = j
        second = np.float32(-1.0)
        for j in range(m):
            if similarity[i, j] > second:
                far = 0.0
                for c in range(points.shape[1]):
                    far += (points[j, c] - points[k, c]) ** 2
                if far > apart * apart:
                    second = similarity[i, j]
        best[i] = k
        if second > 0.0:
            ratio[i] = np.sqrt(max(0.0, 2.0 - 2.0 * similarity[i, k]) / max(1e-12, 2.0 - 2.0 * second))
        else:
            ratio[i] = 0.0
    return best, ratio


@numba.njit(cache=True, nogil=True)
def corner_strength(gx: Float32Array, gy: Float32Array) -> Float32Array:
    """Smaller eigenvalue of the gradient's mean outer product over 5 x 5 pixels; zero near the border."""
    rows, columns = gx.shape
    out = np.zeros((rows, columns), np.float32)
    a, b, c = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    share = np.float32(1.0 / 25.0)
    for y in range(3, rows - 3):
        a[:], b[:], c[:] = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for k in range(y - 2, y + 3):
            u, v = gx[k], gy[k]
            for x in range(columns):
                a[x] = multiply_add(u[x], u[x], a[x])
                b[x] = multiply_add(u[x], v[x], b[x])
                c[x] = multiply_add(v[x], v[x], c[x])
        line = out[y]
        for x in range(3, columns - 3):
            p = (a[x - 2] + a[x - 1] + a[x] + a[x + 1] + a[x + 2]) * share
            q = (b[x - 2] + b[x - 1] + b[x] + b[x + 1] + b[x + 2]) * share
            r = (c[x - 2] + c[x - 1] + c[x] + c[x + 1] + c[x + 2]) * share
            half = np.float32(0.5) * (p - r)
            line[x] = np.float32(0.5) * (p + r) - np.sqrt(half * half + q * q)
    return out
