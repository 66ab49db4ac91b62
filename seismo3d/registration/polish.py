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
    near, rows = tree.query(probes @ found.A.T + found.t)
    spacing = tree.query(q[rows], k=2)[0][:, 1]
    if not np.median(near) < CLOSE * np.median(spacing[near <= np.quantile(near, 0.75)]):
        return None
    A, t = found.A, found.t
    last = np.inf
    for _ in range(MOST_STEPS):
        near, rows = tree.query(p @ A.T + t)
        close = near <= max(4.0 * float(np.median(near)), 1e-12)
        Q = quadratic.point_form(q[rows[close]], p[close], np.full(int(close.sum()), 1.0 / close.sum()))
        step = walk(Q, A, t, model=model, prior=prior, limits=limits, ratio=1e-9)
        A, t = step.A, step.t
        middle = float(np.median(near))
        if middle >= 0.999 * last or middle < 1e-13:
            break
        last = middle
    return A, t
