"""The quadratic trend over a fault that costs least, given the cost of every throw at every place."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True)
def trend_cost(costs, u, v, terms, beyond):  # type: ignore[no-untyped-def]
    """Mean cost of the throws of a trend at all places, `beyond` for a throw out of range; a trifle for each slope."""
    n, n_shifts = costs.shape
    total = 0.0
    for i in range(n):
        throw = terms[0] + terms[1] * u[i] + terms[2] * v[i]
        throw += terms[3] * u[i] * u[i] + terms[4] * u[i] * v[i] + terms[5] * v[i] * v[i]
        c = int(np.floor(throw + n_shifts // 2 + 0.5))
        total += costs[i, c] if 0 <= c < n_shifts else beyond
    # where the costs cannot tell, the level trend is taken
    return total / n + 1e-4 * np.abs(terms[1:]).sum()


@njit(cache=True, nogil=True)
def _best_slopes(costs, u, v, start, slopes, beyond, best):  # type: ignore[no-untyped-def]
    """Write the straight trend from a starting throw, with the best of the given slopes; return its cost."""
    trial = np.zeros(6)
    trial[0] = start
    score = np.inf
    for a in range(len(slopes)):
        for b in range(len(slopes)):
            trial[1] = slopes[a]
            trial[2] = slopes[b]
            cost = trend_cost(costs, u, v, trial, beyond)
            if cost < score:
                score = cost
                best[:] = trial
    return score


@njit(cache=True, nogil=True)
def _descend(costs, u, v, beyond, rounds, best, score):  # type: ignore[no-untyped-def]
    """Change one term at a time, by steps that are halved where none helps; return the cost reached."""
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
                cost = trend_cost(costs, u, v, trial, beyond)
                if cost < score - 1e-5:
                    score = cost
                    best[:] = trial
                    moved = True
        if not moved:
            step *= 0.5
            if step < 1.4:
                break
    return score


@njit(cache=True, nogil=True, parallel=True)
def search_trends(costs, u, v, starts, slopes, beyond, rounds, terms, scores):  # type: ignore[no-untyped-def]
    """Descend from every starting throw to a quadratic trend of least cost; places are in u and v from -1 to 1."""
    for start in prange(len(starts)):
        best = np.zeros(6)
        score = _best_slopes(costs, u, v, starts[start], slopes, beyond, best)
        scores[start] = _descend(costs, u, v, beyond, rounds, best, score)
        for term in range(6):
            terms[start, term] = best[term]
