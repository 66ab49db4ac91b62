"""How far the map itself may be off: what is mapped is no surer than the poses that it was mapped from.

A frame is located against the map, and what the frame adds to the map inherits its error. So each view that the map
remembers keeps the errors of its pose against the map's first frame, and a frame that is located is as sure as the
surest view that shows nearly the same, and less by what its own registration leaves open. Coming back to where the map
began makes a camera sure again; what was mapped beyond a bare corridor stays as unsure as the way through it was.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Collection, Sequence

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.geometry.rotations import adjoint, invert_transform
from seismo3d.graph.poses import PoseGraph
from seismo3d.robot.landmarks import View, views_apart
from seismo3d.robot.pose_errors import PoseErrors, differ_alike

_SHARED = 0.3
"""Views that are no farther apart, by ``View.apart``, show so much in common that one is located by the other."""


def surest_view(
    views: Sequence[View],
    T_world_camera: Float64Array,
    *,
    foreseen: Float64Array | None = None,
    shown: Collection[int] = (),
) -> View | None:
    """Return the view that says best where the surfaces lie that a camera at a pose sees.

    Parameters
    ----------
    views : sequence of View
    T_world_camera : ndarray of shape (4, 4), float64
    foreseen : ndarray of shape (6, 6), float64, optional
        Covariance of the pose before it was located: by as much as a view is surer, the pose may be farther from it
        than it seems. By default that says nothing.
    shown : collection of int
        Views whose landmarks the camera sees, which it is by them not far from, whatever was foreseen.

    Returns
    -------
    View or None
        The one with the least covariance of those that show nearly the same, else the nearest; None without views.
    """
    if not views:
        return None
    apart = views_apart(views, T_world_camera)
    nearest = np.flatnonzero(apart <= max(_SHARED, apart.min())).tolist()
    if foreseen is not None:
        for k in nearest:
            if k not in shown:
                unsure = step_covariance(views[k].errors.total, foreseen, T_world_camera)
                apart[k] += np.sqrt(np.trace(unsure[:3, :3])) + 0.5 * np.sqrt(np.trace(unsure[3:, 3:]))
    shared = [views[k] for k in nearest if apart[k] <= max(_SHARED, apart[nearest].min())]
    return shared[int(np.argmin([_size(view.errors.total, T_world_camera) for view in shared]))]


def step_covariance(before: Float64Array, after: Float64Array, T_world_after: Float64Array) -> Float64Array:
    """Return what two poses' covariances say of the error of the motion from one to the other.

    Errors of both are mostly the same; by how much one is surer than the other, something came in between: a stretch
    along which nothing told where the camera was, or a place seen again, at which the drift of the way there ends.

    Parameters
    ----------
    before, after : ndarray of shape (6, 6), float64
        Of perturbations on the left.
    T_world_after : ndarray of shape (4, 4), float64

    Returns
    -------
    ndarray of shape (6, 6), float64
        Of a perturbation on the right, in the later pose's frame.
    """
    to_pose = adjoint(invert_transform(T_world_after))
    values, vectors = np.linalg.eigh(to_pose @ (after - before) @ to_pose.T)
    return np.asarray((vectors * np.abs(values)) @ vectors.T)


def step_errors(before: PoseErrors, after: PoseErrors, T_world_after: Float64Array) -> Float64Array:
    """Return what two poses' errors of all kinds but the lens's say of the motion from one to the other.

    As :func:`step_covariance`, and by how much what goes all the same way has grown.
    """
    to_pose = adjoint(invert_transform(T_world_after))
    grown = to_pose @ differ_alike(before.alike, after.alike) @ to_pose.T
    return np.asarray(step_covariance(before.covariance, after.covariance, T_world_after) + grown)


def tie_covariances(graph: PoseGraph, covariances: Float64Array, *, known: BoolArray, used: BoolArray) -> Float64Array:
    """Return the covariances of a graph's poses where edges tie some of them to surer ones.

    Each is that of the surest chain of edges from a pose that is known: an upper bound, as other chains only add to
    what is known.

    Parameters
    ----------
    graph : PoseGraph
    covariances : ndarray of shape (n, 6, 6), float64
        Of perturbations on the left, before the edges say anything.
    known : ndarray of shape (n,), bool
        Poses whose covariance means something yet.
    used : ndarray of shape (m,), bool
        Edges that count.

    Returns
    -------
    ndarray of shape (n, 6, 6), float64
    """
    ties: dict[int, list[tuple[int, Float64Array]]] = defaultdict(list)
    for (i, j), information in zip(graph.edges[used].tolist(), graph.information[used]):
        out = adjoint(graph.poses[j])
        between = out @ np.linalg.inv(information) @ out.T
        ties[i].append((j, between))
        ties[j].append((i, between))
    best = covariances.copy()
    sizes = np.array([_size(C, T) if k else np.inf for C, T, k in zip(best, graph.poses, known)])
    waiting = [(float(size), k) for k, size in enumerate(sizes) if np.isfinite(size)]
    heapq.heapify(waiting)
    while waiting:
        size, i = heapq.heappop(waiting)
        if size > sizes[i]:
            continue
        for j, between in ties[i]:
            there = best[i] + between
            reached = _size(there, graph.poses[j])
            if reached < sizes[j]:
                best[j], sizes[j] = there, reached
                heapq.heappush(waiting, (reached, j))
    return best


def _size(covariance: Float64Array, T_world_pose: Float64Array) -> float:
    """Sum of the variances at a pose, a radian counting as a metre."""
    to_pose = adjoint(invert_transform(T_world_pose))
    return float(np.einsum("ij,jk,ik->", to_pose, covariance, to_pose))
