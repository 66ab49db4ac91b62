"""Which directions surfaces do not see, told apart from what noise feigns by comparing levels.

Noise makes the normals of a plane waver, and wavering normals seem to hold what slides along it; so do those of a
cylinder or a ball that two scans sample at other points. Coarser voxels take their normals from more points, so that
feigned curvature shrinks from level to level; real curvature stays. Directions that noise may have feigned on a level
are seen where the harmonic mean of their curvature over it and the coarser levels, which the level that sees least
rules, is more than noise can feign on the best of them, or where it stays while noise falls far. Voxels on an edge have
normals of neither side, and feign curvature without noise: the more, the coarser they are. Last, what holds a pair is
told by the normals of both scans: what is real is in both, on some level at least.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.registration._kernels_newton import parameter_jacobian, weakest_share, without_motions
from seismo3d.registration.constraints import model_number
from seismo3d.registration.matching import Pass

NORMAL_NOISE = 3.0
"""Curvature that noise of the normals feigns, in medians of the squared sine between matched normals."""
MOST_FEIGNED = 0.004
"""Most that one level is believed of it: far from the solution normals differ because pairs are wrong."""
DOUBTFUL = 0.04
"""Most of it where coarser levels are asked too."""
LEAST_REAL = 5e-4
"""Curvature, as a share of the largest, that edges and corners feign in coarse voxels even without noise."""
STEADY, FALLEN = 0.7, 0.1
"""Share of a level's curvature that the mean over it and coarser levels has where it stays, and of its noise, where it
has fallen far."""
GROWS = 1.5
"""How many times as large it is on a coarser level where edges feign it."""
LEAST_AGREED = 0.1
"""Share of a direction's curvature that both scans' normals must agree on, on one level at least, for it to be seen."""
LYING_TOGETHER = 0.01
"""Noise of the normals beyond which, on all levels, surfaces are not known to lie together: nothing agrees then."""
SURE = 3.0
"""Standard deviations of chance that are taken off what they agree on."""
HARDLY_KNOWN = 0.5
"""Length, of 1, that a direction keeps beside those known to be unseen, for it to be another one."""
# what is added to a curvature, so that one of zero can be divided by
LEAST_CURVATURE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A pass over one level and the source elements that it matched."""

    surface: Pass
    source: Float32Array


def is_weak(surface: Pass, A: Float64Array, model: str) -> bool:
    """Return whether there are directions that noise may have feigned."""
    return surface.weight > 0.0 and weakest_share(surface.form, A, model_number(model)) < DOUBTFUL


def unseen_directions(looks: list[Look], A: Float64Array, model: str) -> Float64Array:
    """Return the directions of the parameters that the surfaces do not see.

    Parameters
    ----------
    looks : list of Look
        At one transform, the level in question first, then coarser ones.
    A : ndarray of shape (d, d), float64
    model : str

    Returns
    -------
    ndarray of shape (m, k), float64
        Orthonormal columns.
    """
    unseen = _unseen_by_levels(looks, A, model)
    if min(NORMAL_NOISE * normal_noise(look.surface, look.source, A) for look in looks) > LYING_TOGETHER:
        return unseen
    values, vectors = np.linalg.eigh(_curvature_shares(looks[0].surface.form, A, model))
    doubtful = vectors[:, values <= DOUBTFUL]
    doubtful = doubtful - unseen @ (unseen.T @ doubtful)
    left, sizes, _ = np.linalg.svd(doubtful, full_matrices=False)
    doubtful = left[:, sizes > HARDLY_KNOWN]
    shared = np.max([_agreed_shares(look, A, model, doubtful) for look in looks], axis=0)
    return np.hstack([unseen, doubtful[:, shared <= LEAST_AGREED]])


def _unseen_by_levels(looks: list[Look], A: Float64Array, model: str) -> Float64Array:
    """Return the directions that noise or edges may have feigned, by how curvature changes from level to level."""
    noise = [NORMAL_NOISE * normal_noise(look.surface, look.source, A) for look in looks]
    shares = [_curvature_shares(look.surface.form, A, model) for look in looks]
    values, vectors = np.linalg.eigh(shares[0])
    by_noise = values <= min(noise[0], MOST_FEIGNED if len(looks) == 1 else DOUBTFUL)
    if len(looks) == 1:
        return np.asarray(vectors[:, by_noise])
    coarser = np.max([np.einsum("ik,ij,jk->k", vectors, share, vectors) for share in shares[1:]], axis=0)
    by_edges = ~by_noise & (values <= LEAST_REAL) & (coarser > GROWS * values)
    unseen = _feigned_by_noise(vectors[:, by_noise], shares, noise)
    return np.hstack([vectors[:, by_edges], unseen])


def _agreed_shares(look: Look, A: Float64Array, model: str, directions: Float64Array) -> Float64Array:
    """Return the share of the curvature along directions (columns) on which the normals of both scans agree.

    Both normals of a pair tell what holds it there. What is real is in both, and the product of what they tell adds up;
    noise, and where on a round shape its samples lie, is each scan's own, and the products cancel.
    """
    d = A.shape[0]
    usable = np.isfinite(look.surface.residuals)
    points = look.source[usable, :d].astype(np.float64)
    turned = look.source[usable, 4 : 4 + d] @ A.T
    turned /= np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)
    there = look.surface.normals[usable, :d].astype(np.float64)
    turned *= np.where((turned * there).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    J = parameter_jacobian(A, model_number(model)) @ directions
    one, other = (_rows(points, normals) @ J for normals in (there, turned))
    product = (one * other).sum(axis=0) - SURE * np.sqrt(((one * other) ** 2).sum(axis=0))
    return np.asarray(product / np.maximum((one * one).sum(axis=0), 1e-300))


def _rows(points: Float64Array, normals: Float64Array) -> Float64Array:
    """Return the residuals' derivatives by the entries of A, column by column, and t."""
    by_A = (points[:, :, None] * normals[:, None, :]).reshape(len(points), -1)
    return np.hstack([by_A, normals])


def _feigned_by_noise(doubtful: Float64Array, shares: list[Float64Array], noise: list[float]) -> Float64Array:
    """Return the directions among doubtful ones (columns) of which no level sees more than its noise feigns."""
    if doubtful.shape[1] == 0:
        return doubtful
    least = LEAST_CURVATURE * np.eye(doubtful.shape[1])
    inverses = [np.linalg.inv(doubtful.T @ share @ doubtful + least) for share in shares]
    agreed, turn = np.linalg.eigh(np.linalg.inv(np.mean(inverses, axis=0)))
    sure = agreed > min(MOST_FEIGNED, *noise)
    if min(noise) < FALLEN * noise[0]:
        own = np.einsum("ik,ij,jk->k", doubtful @ turn, shares[0], doubtful @ turn)
        sure |= agreed > STEADY * own
    return np.asarray(doubtful @ turn[:, ~sure | (agreed <= LEAST_REAL)])


def weak_directions(surface: Pass, A: Float64Array, model: str, ratio: float) -> Float64Array:
    """Return the directions whose curvature is at most a share of the largest; shape (m, k)."""
    values, vectors = np.linalg.eigh(_curvature_shares(surface.form, A, model))
    return np.asarray(vectors[:, values <= ratio])


def without(form: Float64Array, A: Float64Array, t: Float64Array, model: str, unseen: Float64Array) -> Float64Array:
    """Return a form that does not change along some directions (columns) at (A, t)."""
    return np.asarray(without_motions(form, A, t, model_number(model), np.ascontiguousarray(unseen)))


def normal_noise(surface: Pass, source: Float32Array, A: Float64Array) -> float:
    """Return the median squared sine of the angle between matched normals: information that noise feigns.

    A plane with noisy normals seems to hold what slides along it, by as much as its normals waver.
    """
    d = A.shape[0]
    turned = source[:, 4 : 4 + d] @ A.T.astype(np.float32)
    length2 = (turned * turned).sum(axis=1)
    usable = np.isfinite(surface.residuals) & (length2 > 0.0)
    if not usable.any():
        return 0.0
    cosine = (turned[usable] * surface.normals[usable, :d]).sum(axis=1)
    return float(np.median(np.maximum(0.0, 1.0 - cosine * cosine / length2[usable])))


def _curvature_shares(form: Float64Array, A: Float64Array, model: str) -> Float64Array:
    """Return the curvature by the parameters, in shares of its largest eigenvalue."""
    J = parameter_jacobian(A, model_number(model))
    n = J.shape[0]
    curvature = J.T @ form[:n, :n] @ J
    return np.asarray(curvature / max(float(np.linalg.eigvalsh(curvature)[-1]), 1e-300))
