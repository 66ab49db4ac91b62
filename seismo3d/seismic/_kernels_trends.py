"""Trends of throw over a fault: quadratics and bells that cost least, and planes through what is known nearby."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

# logarithm of what a bell may grow by over its throw at 0, and the throw there below which it is level
_MOST, _LEAST = 1.5, 0.5
# places by which a bell is begun with and found: exponentials take their time
_FEW, _ENOUGH = 100, 400


@njit(cache=True, nogil=True)
def throw_of_trend(u, v, terms, bell):  # type: ignore[no-untyped-def]
    """Return the throw of a trend at a place: of second order in u and v, or the bell with the same slopes at 0."""
    first = terms[0]
    more = terms[1] * u + terms[2] * v + terms[3] * u * u + terms[4] * u * v + terms[5] * v * v
    if not bell:
        return first + more
    return first * np.exp(min(more / first, _MOST)) if np.abs(first) > _LEAST else first


@njit(cache=True, nogil=True)
def throws_of_trend(u, v, terms, bell, throws):  # type: ignore[no-untyped-def]
    """Write the throws of a trend at many places."""
    for i in range(len(u)):
        throws[i] = throw_of_trend(u[i], v[i], terms, bell)


@njit(cache=True, nogil=True)
def _price_of_change(terms, bell):  # type: ignore[no-untyped-def]
    """Return a trifle for each slope: where the costs cannot tell, the level trend is taken."""
    change = np.abs(terms[1:]).sum()
    # however steeply a bell bends down, its throws change by little more than the largest
    return 1e-4 * (min(change, 2.0 * np.abs(terms[0])) if bell else change)


@njit(cache=True, nogil=True)
def trend_cost(costs, u, v, terms, bell, beyond, every=1):  # type: ignore[no-untyped-def]
    """Mean cost of a trend's throws at every so many places, `beyond` out of range; a trifle for each slope."""
    n, n_shifts = costs.shape
    total = 0.0
    for i in range(0, n, every):
        c = int(np.floor(throw_of_trend(u[i], v[i], terms, bell) + n_shifts // 2 + 0.5))
        total += costs[i, c] if 0 <= c < n_shifts else beyond
    return total / ((n - 1) // every + 1) + _price_of_change(terms, bell)


@njit(cache=True, nogil=True)
def _list_trends(slopes, bends, bell):  # type: ignore[no-untyped-def]
    """Return the terms of the trends tried first, from a starting throw of 1 where they are bells, else of 0."""
    terms = np.zeros((len(bends) ** 2 * len(slopes) ** 2, 6))
    number = 0
    for c in range(len(bends)):
        for d in range(len(bends)):
            for a in range(len(slopes)):
                for b in range(len(slopes)):
                    # the mean stays as it is
                    terms[number, 0] = 1.0 + (bends[c] + bends[d]) / 3.0 if bell else 0.0
                    terms[number, 1], terms[number, 2] = slopes[a], slopes[b]
                    terms[number, 3], terms[number, 5] = -bends[c], -bends[d]
                    number += 1
    return terms


@njit(cache=True, nogil=True, parallel=True)
def _shapes(u, v, terms, bell, every):  # type: ignore[no-untyped-def]
    """Return the throws of trends at every so many places: (trend, place)."""
    shapes = np.empty((len(terms), (len(u) - 1) // every + 1))
    for m in prange(len(terms)):
        for i in range(shapes.shape[1]):
            shapes[m, i] = throw_of_trend(u[i * every], v[i * every], terms[m], bell)
    return shapes


@njit(cache=True, nogil=True)
def _best_of(costs, start, terms, shapes, bell, beyond, every, best):  # type: ignore[no-untyped-def]
    """Write the trend from a starting throw that costs least of those tried first."""
    n_shifts = costs.shape[1]
    scale, shift = (start, 0.0) if bell else (1.0, start)
    score = np.inf
    for m in range(len(terms)):
        total = 0.0
        for i in range(shapes.shape[1]):
            c = int(np.floor(scale * shapes[m, i] + shift + n_shifts // 2 + 0.5))
            total += costs[i * every, c] if 0 <= c < n_shifts else beyond
        cost = total / shapes.shape[1] + _price_of_change(scale * terms[m], bell)
        if cost < score:
            score = cost
            best[:] = scale * terms[m]
            best[0] += shift


@njit(cache=True, nogil=True)
def _descend(costs, u, v, bell, beyond, rounds, every, best, score):  # type: ignore[no-untyped-def]
    """Change one term at a time, by steps that are halved where none helps."""
    trial = np.empty(6)
    step = 6.0
    for _ in range(rounds):
        moved = False
        for term in range(6):
            for sign in (-1.0, 1.0):
                trial[:] = best
                change = sign * (0.5 * step if term == 0 else step)
                trial[term] += change
                if term == 3 or term == 5:  # a bend that keeps the mean
                    trial[0] -= change / 3.0
                if bell and (trial[3] * trial[0] > 0.0 or trial[5] * trial[0] > 0.0):
                    continue
                cost = trend_cost(costs, u, v, trial, bell, beyond, every)
                if cost < score - 1e-5:
                    score = cost
                    best[:] = trial
                    moved = True
        if not moved:
            step *= 0.5
            if step < 1.4:
                break


@njit(cache=True, nogil=True, parallel=True)
def search_trends(costs, u, v, starts, slopes, bends, bell, beyond, rounds, terms, scores):  # type: ignore[no-untyped-def]
    """Descend from every starting throw to a trend of least cost; places are in u and v from -1 to 1.

    Tried first are these slopes, of bells in shares of the starting throw, and bends down by these shares of it. A bell
    never bends up.
    """
    few, every = (max(len(costs) // _FEW, 1), max(len(costs) // _ENOUGH, 1)) if bell else (1, 1)
    first = _list_trends(slopes, bends, bell)
    shapes = _shapes(u, v, first, bell, few)
    for start in prange(len(starts)):
        best = np.zeros(6)
        _best_of(costs, starts[start], first, shapes, bell, beyond, few, best)
        score = trend_cost(costs, u, v, best, bell, beyond, every)
        _descend(costs, u, v, bell, beyond, rounds, every, best, score)
        scores[start] = trend_cost(costs, u, v, best, bell, beyond)
        for term in range(6):
            terms[start, term] = best[term]


@njit(cache=True, nogil=True)
def gather_blocks(values, known, size):  # type: ignore[no-untyped-def]
    """Return, for every block of `size` x `size` places, how many are known, and their mean row, column and value."""
    n_rows, n_columns = values.shape
    parts = np.zeros((4, (n_rows + size - 1) // size, (n_columns + size - 1) // size))
    for r in range(n_rows):
        for k in range(n_columns):
            if known[r, k]:
                block = parts[:, r // size, k // size]
                block[0] += 1.0
                block[1] += r
                block[2] += k
                block[3] += values[r, k]
    for i in range(parts.shape[1]):
        for j in range(parts.shape[2]):
            if parts[0, i, j] > 0.0:
                for m in range(1, 4):
                    parts[m, i, j] /= parts[0, i, j]
    return parts


@njit(cache=True, nogil=True)
def _smooth(grids, taps):  # type: ignore[no-untyped-def]
    """Smooth grids along both axes by weights of odd number; beyond their ends they are 0."""
    n_grids, n_rows, n_columns = grids.shape
    reach = len(taps) // 2
    across, out = np.zeros_like(grids), np.zeros_like(grids)
    for m in range(n_grids):
        for i in range(n_rows):
            for a in range(max(-reach, -i), min(reach, n_rows - 1 - i) + 1):
                weight = taps[a + reach]
                for j in range(n_columns):
                    across[m, i, j] += weight * grids[m, i + a, j]
        for i in range(n_rows):
            for j in range(n_columns):
                total = 0.0
                for b in range(max(-reach, -j), min(reach, n_columns - 1 - j) + 1):
                    total += taps[b + reach] * across[m, i, j + b]
                out[m, i, j] = total
    return out


@njit(cache=True, nogil=True)
def fit_block_planes(parts, size, taps, ridge):  # type: ignore[no-untyped-def]
    """Return, at the middle of every block, the value of the plane through the blocks around it, and their weight.

    `parts` is from :func:`gather_blocks`. A little of the window's own width, `ridge`, in the denominators keeps a
    plane through one row of blocks level across it.
    """
    n_rows, n_columns = parts.shape[1:]
    sums = np.empty((9, n_rows, n_columns))
    for i in range(n_rows):
        for j in range(n_columns):
            mass, r, c, t = parts[0, i, j], parts[1, i, j], parts[2, i, j], parts[3, i, j]
            sums[0, i, j], sums[1, i, j], sums[2, i, j], sums[3, i, j] = mass, mass * r, mass * c, mass * t
            sums[4, i, j], sums[5, i, j], sums[6, i, j] = mass * r * r, mass * c * c, mass * r * c
            sums[7, i, j], sums[8, i, j] = mass * r * t, mass * c * t
    sums = _smooth(sums, taps)
    found, weight = np.empty((n_rows, n_columns)), np.empty((n_rows, n_columns))
    for i in range(n_rows):
        for j in range(n_columns):
            total = max(sums[0, i, j], 1e-12)
            r, c, t = sums[1, i, j] / total, sums[2, i, j] / total, sums[3, i, j] / total
            rr, cc = sums[4, i, j] / total - r * r + ridge, sums[5, i, j] / total - c * c + ridge
            rc, rt, ct = sums[6, i, j] / total - r * c, sums[7, i, j] / total - r * t, sums[8, i, j] / total - c * t
            scale = max(rr * cc - rc * rc, 1e-12)
            down, along = (ct * rr - rt * rc) / scale, (rt * cc - ct * rc) / scale
            row, column = size * i + 0.5 * (size - 1), size * j + 0.5 * (size - 1)
            found[i, j], weight[i, j] = t + along * (row - r) + down * (column - c), total
    return found, weight
