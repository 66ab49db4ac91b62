"""Kernels that tell the motions which planes do not see from those that only the noise of normals seems to see.

A pair's normal is looked at twice, by the map and by the frame, and the noise of one look knows nothing of the other's:
what both say together is real, what they differ by is noise. Along a wall, a corridor or a tunnel nothing is left of
what thousands of noisy normals seem to say.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._typing import Float64Array

FEIGNED = 0.2
"""Share of the information that the difference of two looks feigns, below which what both agree on is no information:
their chance agreement, and noise that they have in common."""


@nb.njit(cache=True, nogil=True)
def two_looks(
    arms: Float64Array, normals: Float64Array, turned: Float64Array, weights: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the information (6, 6) on (rotation, translation) that two looks at normals agree on, and their noise's.

    ``arms`` (n, 3) lead from the centre of rotation to the points, ``normals`` and ``turned`` are the map's and the
    frame's.
    """
    agreed, noise = np.zeros((6, 6)), np.zeros((6, 6))
    both, off = np.empty(6), np.empty(6)
    for i in range(arms.shape[0]):
        if weights[i] == 0.0:
            continue
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            one = arms[i, b] * normals[i, c] - arms[i, c] * normals[i, b]
            two = arms[i, b] * turned[i, c] - arms[i, c] * turned[i, b]
            both[a], off[a] = one + two, one - two
            both[3 + a], off[3 + a] = normals[i, a] + turned[i, a], normals[i, a] - turned[i, a]
        for a in range(6):
            for b in range(a, 6):
                differing = weights[i] * off[a] * off[b]
                noise[a, b] += differing
                # half of one two' + two one'
                agreed[a, b] += 0.25 * (weights[i] * both[a] * both[b] - differing)
    for a in range(6):
        for b in range(a):
            noise[a, b], agreed[a, b] = noise[b, a], agreed[b, a]
    return agreed, noise


@nb.njit(cache=True, nogil=True)
def blind_motions(agreed: Float64Array, noise: Float64Array, ratio: float) -> Float64Array:
    """Return the motions (6, k), orthonormal columns, of which looks say no more than noise does.

    ``ratio`` is the share of the largest information below which nothing is said even where there is no noise.
    """
    least = ratio * np.linalg.eigvalsh(agreed)[5]
    if not least > 0.0:
        return np.eye(6)
    root = np.linalg.inv(np.linalg.cholesky(FEIGNED * noise + least * np.eye(6)))
    values, vectors = np.linalg.eigh(root @ agreed @ root.T)
    count = np.count_nonzero(values < 1.0)
    if count == 0:
        return np.empty((6, 0))
    return np.ascontiguousarray(np.linalg.qr(np.ascontiguousarray((root.T @ vectors)[:, :count]))[0])
