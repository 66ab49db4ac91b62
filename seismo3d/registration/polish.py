"""The last digits where both scans hold the same samples: exact pairs of points instead of surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration import quadratic
from seismo3d.registration.icp import LoopResult
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.solvers import Limits, Prior, walk

N_PROBES = 300
MOST_STEPS = 30
CLOSE = 0.25
"""Samples count as the same where they lie closer than this share of the samples' own spacing."""

IDENTICAL = 1e-3
"""The same, for samples that are looked for around where the loop ended, and where it began."""

LEAST_DISTINCT = 0.5
"""Share of the samples that must have partners of their own to be the same."""

STILL, HARDLY_NEARER = 0.999, 0.9
"""Share of their last distance, in the median, from which on samples come no nearer: at last, and while looked for."""


def polish(
    target: Float64Array,
    source: Float64Array,
    frame: Frame,
    found: LoopResult,
    model: str,
    prior: Prior,
    limits: Limits,
) -> tuple[Float64Array, Float64Array] | None:
    """Return (A, t) from pairs of identical samples, or None where the scans do not hold the same samples.

    Parameters
    ----------
    target, source : ndarray of shape (n, d), float64
        In the input's units.
    frame : Frame
    found : LoopResult
        Answer of the loop, as good as its voxels.
    model, prior, limits
        As for the loop.
    """
    from scipy.spatial import cKDTree

    q, p = frame.target(target), frame.source(source)
    tree: Any = cKDTree(q)
    probes = p[:: max(1, len(p) // N_PROBES)]

    def settled(
        samples: Float64Array, A: Float64Array, t: Float64Array, still: float = STILL
    ) -> tuple[Float64Array, Float64Array]:
        last = np.inf
        for _ in range(MOST_STEPS):
            near, rows = tree.query(samples @ A.T + t)
            close = near <= max(4.0 * float(np.median(near)), 1e-12)
            Q = quadratic.point_form(q[rows[close]], samples[close], np.full(int(close.sum()), 1.0 / close.sum()))
            step = walk(Q, A, t, model=model, prior=prior, limits=limits, ratio=1e-9)
            A, t = step.A, step.t
            middle = float(np.median(near))
            if middle >= still * last or middle < 1e-13:
                break
            last = middle
        return A, t

    def are_same(A: Float64Array, t: Float64Array, share: float) -> bool:
        near, rows = tree.query(probes @ A.T + t)
        if len(np.unique(rows)) < LEAST_DISTINCT * len(rows):  # a source of free size has shrunk onto a few samples
            return False
        spacing = tree.query(q[rows], k=2)[0][:, 1]
        return bool(np.median(near) < share * np.median(spacing[near <= np.quantile(near, 0.75)]))

    A, t = found.A, found.t
    if are_same(A, t, CLOSE):
        return settled(p, A, t)
    # a thinned or filtered copy has surfaces of its own: the loop may end next to where all its samples are the same
    for start in (Prior(A, t), prior):
        A, t = settled(probes, start.A, start.t, HARDLY_NEARER)
        if are_same(A, t, IDENTICAL):
            return settled(p, A, t)
    return None
