r"""What two pictures of one rigid scene in depth have in common: each point of one lies on a line of the other.

With the fundamental matrix F, homogeneous points fulfil :math:`q^T F p = 0`. The derivative of that along the picture
ties the local affine map A of a match to the two lines as well: :math:`A^T n_q = -n_p`, where :math:`n_q, n_p` are the
first two entries of :math:`F p` and :math:`F^T q` [1]_.

References
----------
.. [1] J. Bentolila, J. M. Francos, "Conic epipolar constraints from affine correspondences", Computer Vision and Image
   Understanding 122, 2014. :doi:`10.1016/j.cviu.2014.02.004`
"""

from __future__ import annotations

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.features.pairs import Pairs

# matches below which no motion of a camera is told
_FEWEST = 12
# pixels within which a match is on its line
_ON_LINE = 1.0


def fit_epipolar(pairs: Pairs) -> Float64Array | None:
    """Find the fundamental matrix that most matches fulfil.

    Parameters
    ----------
    pairs : Pairs
        Matches, wrong ones among them.

    Returns
    -------
    ndarray of shape (3, 3), float64, or None
        None where fewer than twelve matches are given or none fits.
    """
    import cv2

    if len(pairs) < _FEWEST:
        return None
    best, most = None, 0
    for method in (cv2.USAC_DEFAULT, cv2.USAC_MAGSAC, cv2.USAC_ACCURATE):
        try:
            found, _ = cv2.findFundamentalMat(pairs.target, pairs.source, method, _ON_LINE, 0.999, 5000)
        except cv2.error:  # its answer to matches of which no seven fix a matrix
            continue
        if found is None or found.shape != (3, 3) or not np.isfinite(found).all():
            continue
        F = np.asarray(found, dtype=np.float64)
        n = int(fits_epipolar(F, pairs).sum())
        if n > most:
            best, most = F, n
    return best


def _homogeneous(points: Float64Array) -> Float64Array:
    return np.column_stack([points, np.ones(len(points))])


def distance_to_lines(F: Float64Array, target: Float64Array, source: Float64Array) -> Float64Array:
    """Distance of matched points (n, 2) from each other's lines, in pixels: the larger of both (n,)."""
    p, q = _homogeneous(target), _homogeneous(source)
    line_q, line_p = p @ F.T, q @ F
    product = np.abs(np.einsum("ij,ij->i", q, line_q))
    shortest = np.minimum(np.hypot(line_q[:, 0], line_q[:, 1]), np.hypot(line_p[:, 0], line_p[:, 1]))
    return np.asarray(product / np.maximum(shortest, 1e-300))


def near_lines(F: Float64Array, target: Float64Array, source: Float64Array, limit: Float64Array) -> BoolArray:
    """Say which of all pairs of points (n, 2) and (m, 2) are within a limit (n, m) of each other's lines."""
    p, q = _homogeneous(target), _homogeneous(source)
    line_q, line_p = p @ F.T, q @ F
    product = np.abs(line_q @ q.T)
    shortest = np.minimum(np.hypot(line_q[:, 0], line_q[:, 1])[:, None], np.hypot(line_p[:, 0], line_p[:, 1])[None])
    return np.asarray(product <= limit * shortest)


def affine_misfit(F: Float64Array, pairs: Pairs) -> Float64Array:
    """How far each match's affine map is from carrying lines to lines, as a share (n,): zero where it does."""
    line_q = (_homogeneous(pairs.target) @ F.T)[:, :2]
    line_p = (_homogeneous(pairs.source) @ F)[:, :2]
    left = np.einsum("nji,nj->ni", pairs.linear, line_q) + line_p
    return np.asarray(np.linalg.norm(left, axis=1) / np.maximum(np.linalg.norm(line_p, axis=1), 1e-300))


def fits_epipolar(F: Float64Array, pairs: Pairs, *, distance: float = 1.0, max_misfit: float = 0.3) -> BoolArray:
    """Say which matches lie on their lines and carry them to lines."""
    on_line = distance_to_lines(F, pairs.target, pairs.source) <= distance
    return np.asarray(on_line & (affine_misfit(F, pairs) <= max_misfit))
