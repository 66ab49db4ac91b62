"""Poses to start from where the local loop fails: from matched features by sampling, from local shape by voting."""

from __future__ import annotations

from collections.abc import Iterator

import numba as nb
import numpy as np

from seismo3d._typing import BoolArray, Float64Array, Int64Array
from seismo3d.registration import quadratic
from seismo3d.registration.solvers import Limits, Prior, solve_form
from seismo3d.registration.terms import FeatureTerm

N_DRAWS = 10000
N_DRAWS_A_ROUND = 500
MISSED = 1e-9
"""Chance that draws may leave of having missed a pose that as many matches agree with as with the best so far."""
# most fits to what agrees with the fit before
REFITS = 6


def poses_by_features(
    term: FeatureTerm, *, n_poses: int, reach: float, seed: int = 0
) -> Iterator[tuple[Float64Array, Float64Array]]:
    """Give rigid poses (A, t) that many matched features agree with, best first; each is sought when it is asked for.

    Samples of d matches whose mutual distances agree fix a pose each; it is counted how many matches agree with it,
    and the best is fitted again to all that do. The next pose is sought among the matches that are left. Draws end
    when a pose that as many agree with as with the best so far is missed with a chance of 1e-9 only: few are needed
    where most matches agree (Fischler and Bolles 1981).

    Parameters
    ----------
    term : FeatureTerm
    n_poses : int
        The most that are given.
    reach : float
        Distance in the frame up to which a match agrees.
    seed : int
        Of the draws.
    """
    d = term.source.shape[1]
    rng = np.random.default_rng(seed)
    left = np.ones(len(term.source), dtype=np.bool_)
    for _ in range(n_poses):
        best = _draw_pose(term.target[left], term.source[left], reach, rng)
        if best is None:
            return
        A, t = refit(term, best[: d * d].reshape(d, d), best[d * d :], reach)
        yield A, t
        left &= ~_agree(term, A, t, reach)


def _draw_pose(
    target: Float64Array, source: Float64Array, reach: float, rng: np.random.Generator
) -> Float64Array | None:
    """Return the pose from a sample (row of A and t) that most matches agree with; None where no sample is rigid."""
    n, d = source.shape
    if n < d:
        return None
    draws = rng.integers(0, n, size=(N_DRAWS, d))
    poses = np.empty((N_DRAWS, d * d + d))
    votes = np.zeros(N_DRAWS, dtype=np.int64)
    done, needed = 0, float(N_DRAWS)
    while done < min(needed, N_DRAWS):
        now = slice(done, done + N_DRAWS_A_ROUND)
        _sample(target, source, draws[now], reach, poses[now], votes[now])
        done = now.stop
        share = min(0.999, float(votes[:done].max()) / n)
        needed = np.log(MISSED) / np.log1p(-(share**d)) if share > 0.0 else np.inf
    best = int(votes[:done].argmax())
    return poses[best] if votes[best] >= d else None


def _agree(term: FeatureTerm, A: Float64Array, t: Float64Array, reach: float) -> BoolArray:
    return np.asarray(((term.source @ A.T + t - term.target) ** 2).sum(axis=1) < reach * reach)


def refit(term: FeatureTerm, A: Float64Array, t: Float64Array, reach: float) -> tuple[Float64Array, Float64Array]:
    """Fit a rigid pose again and again to the matches that agree with it."""
    d = t.size
    free = Limits(np.full(d * (d + 1) // 2, -np.inf), np.full(d * (d + 1) // 2, np.inf))
    before: BoolArray | None = None
    for _ in range(REFITS):
        agree = _agree(term, A, t, reach)
        if agree.sum() < d or (before is not None and np.array_equal(agree, before)):
            break
        before = agree
        Q = quadratic.point_form(term.target[agree], term.source[agree], term.information[agree])
        found = solve_form(Q / np.trace(Q), model="rigid", prior=Prior(A, t), limits=free)
        A, t = found.A, found.t
    return A, t


@nb.njit(cache=True, nogil=True)
def _sample(
    target: Float64Array, source: Float64Array, draws: Int64Array, reach: float, poses: Float64Array, votes: Int64Array
) -> None:
    """Fix a pose from each draw of d matches and count the matches that agree; 0 where a draw contradicts itself."""
    n, d = source.shape
    limit = reach * reach
    fs = np.empty((d, d))
    ft = np.empty((d, d))
    for k in range(draws.shape[0]):
        votes[k] = 0
        if not (_basis(source, draws[k], reach, fs) and _basis(target, draws[k], reach, ft)):
            continue
        fits = True
        for a in range(d):
            for b in range(a):
                ls = 0.0
                lt = 0.0
                for c in range(d):
                    ls += (source[draws[k, a], c] - source[draws[k, b], c]) ** 2
                    lt += (target[draws[k, a], c] - target[draws[k, b], c]) ** 2
                fits = fits and abs(np.sqrt(ls) - np.sqrt(lt)) < reach
        if not fits:
            continue
        R = ft @ fs.T
        t = np.zeros(d)
        for a in range(d):
            for c in range(d):
                t[c] += target[draws[k, a], c] / d
                for e in range(d):
                    t[c] -= R[c, e] * source[draws[k, a], e] / d
        count = 0
        for i in range(n):
            e2 = 0.0
            for c in range(d):
                offset = t[c] - target[i, c]
                for e in range(d):
                    offset += R[c, e] * source[i, e]
                e2 += offset * offset
            if e2 < limit:
                count += 1
        votes[k] = count
        for c in range(d):
            for e in range(d):
                poses[k, c * d + e] = R[c, e]
            poses[k, d * d + c] = t[c]


@nb.njit(cache=True, nogil=True)
def _basis(points: Float64Array, rows: Int64Array, least: float, out: Float64Array) -> bool:
    """Write a right-handed orthonormal frame of d points as columns; False where they are too close or on one line."""
    d = points.shape[1]
    x = points[rows[1]] - points[rows[0]]
    length = np.sqrt(np.sum(x * x))
    if length < 2.0 * least:
        return False
    x /= length
    if d == 2:
        out[0, 0], out[1, 0] = x[0], x[1]
        out[0, 1], out[1, 1] = -x[1], x[0]
        return True
    y = points[rows[2]] - points[rows[0]]
    y -= np.sum(x * y) * x
    length = np.sqrt(np.sum(y * y))
    if length < least:
        return False
    y /= length
    out[:, 0] = x
    out[:, 1] = y
    out[0, 2] = x[1] * y[2] - x[2] * y[1]
    out[1, 2] = x[2] * y[0] - x[0] * y[2]
    out[2, 2] = x[0] * y[1] - x[1] * y[0]
    return True
