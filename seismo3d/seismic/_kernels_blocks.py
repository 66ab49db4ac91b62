"""What lies on the two sides of a fault as a function of layer time, and how well the two agree."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, parallel=True)
def stack_layers(  # type: ignore[no-untyped-def]
    values,
    blocks,
    breaks,
    volume,
    valid,
    places,
    planes,
    sides,
    wanted,
    centres,
    stride,
    step,
    reach,
    clear,
    out,
    weight,
):
    """Write the mean trace of a block beside every place, as a function of layer time about a centre.

    Traces count that lie within reach, on the place's side of its plane; of these the samples that belong to the block.
    Entries without any are 0, with weight 0.
    """
    n0, n1, m = values.shape
    n2 = volume.shape[2]
    length = out.shape[1]
    half = length // 2
    for p in prange(len(places)):
        out[p, :] = 0.0
        weight[p, :] = 0.0
        block = wanted[p]
        if block < 0:
            continue
        a0, a1 = max(0, int(np.ceil((places[p, 0] - reach) / stride))), int((places[p, 0] + reach) / stride)
        b0, b1 = max(0, int(np.ceil((places[p, 1] - reach) / stride))), int((places[p, 1] + reach) / stride)
        for a in range(a0, min(a1, n0 - 1) + 1):
            for b in range(b0, min(b1, n1 - 1) + 1):
                i, j = a * stride, b * stride
                dx, dy = i - places[p, 0], j - places[p, 1]
                square = (dx * dx + dy * dy) / (reach * reach)
                if square > 1.0:
                    continue
                flat = sides[p] * (dx * planes[p, 0] + dy * planes[p, 1])
                share = np.float32(np.exp(-2.0 * square))
                for k in range(m - 1):
                    if breaks[i, j, k] > 0 or blocks[i, j, k] != block or blocks[i, j, k + 1] != block:
                        continue
                    if flat + sides[p] * planes[p, 2] * ((k + 0.5) * step - places[p, 2]) < clear:
                        continue
                    low = values[a, b, k] + k * step - centres[p] + half
                    rise = values[a, b, k + 1] - values[a, b, k] + step
                    if rise < 0.2 * step or low + rise < 0.0 or low > length - 1:
                        continue
                    first, last = max(0, int(np.ceil(low))), min(length - 1, int(np.ceil(low + rise)) - 1)
                    for t in range(first, last + 1):
                        z = (k + (t - low) / rise) * step
                        c = int(z)
                        if c + 1 >= n2 or not (valid[i, j, c] and valid[i, j, c + 1]):
                            continue
                        f = np.float32(z - c)
                        out[p, t] += share * ((np.float32(1.0) - f) * volume[i, j, c] + f * volume[i, j, c + 1])
                        weight[p, t] += share
        for t in range(length):
            if weight[p, t] > 0.0:
                out[p, t] /= weight[p, t]


@njit(cache=True, nogil=True, parallel=True)
def match_layers(one, in_one, other, in_other, taper, least, scores):  # type: ignore[no-untyped-def]
    """Write the correlation of the middle of a trace with another one, at every lag; -1 where too little is known.

    It is made smaller with the share of the taper that both know, by its square root.
    """
    n_lags = scores.shape[1]
    width = len(taper)
    first = (one.shape[1] - width) // 2
    begin = (other.shape[1] - width - n_lags + 1) // 2
    whole = taper.sum()
    for p in prange(len(one)):
        for lag in range(n_lags):
            product, left, right, known = 0.0, 0.0, 0.0, 0.0
            for t in range(width):
                a, b = first + t, begin + lag + t
                if in_one[p, a] > 0.0 and in_other[p, b] > 0.0:
                    w = taper[t]
                    known += w
                    product += w * one[p, a] * other[p, b]
                    left += w * one[p, a] * one[p, a]
                    right += w * other[p, b] * other[p, b]
            if known < least * whole or left <= 0.0 or right <= 0.0:
                scores[p, lag] = -1.0
            else:
                scores[p, lag] = product / np.sqrt(left * right) * np.sqrt(known / whole)


@njit(cache=True, nogil=True)
def locate_levels(values, blocks, breaks, traces, wanted, targets, stride, step, low, share, beyond):  # type: ignore[no-untyped-def]
    """Write the coarse sample of a trace below which a block has a layer time, and how far below; -1 where nowhere.

    Where the block ends before it on this trace, its end is written, and how much older than that the layer time is.
    """
    m = values.shape[2]
    for p in range(len(traces)):
        low[p] = -1
        beyond[p] = np.inf
        i, j = traces[p, 0], traces[p, 1]
        if i < 0 or wanted[p] < 0:
            continue
        row = values[i // stride, j // stride]
        for k in range(m - 1):
            if breaks[i, j, k] > 0 or blocks[i, j, k] != wanted[p] or blocks[i, j, k + 1] != wanted[p]:
                continue
            above, below = row[k] + k * step, row[k + 1] + (k + 1) * step
            if below - above <= 0.2 * step:
                continue
            off = min(targets[p] - above, 0.0) + max(targets[p] - below, 0.0)
            if abs(off) < abs(beyond[p]):
                low[p] = k
                share[p] = min(max((targets[p] - above) / (below - above), 0.0), 1.0)
                beyond[p] = off
