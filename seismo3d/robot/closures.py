"""Closures between keyframes that show the same place, the graph of all, and corrections carried over to frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array, Int64Array
from seismo3d.geometry.rotations import adjoint, invert_transform
from seismo3d.graph.poses import PoseGraph, edge_errors
from seismo3d.registration.result import Registration
from seismo3d.robot.drift import step_errors
from seismo3d.robot.ekf import exp_motion, log_motion
from seismo3d.robot.keyframes import PlaceMemory
from seismo3d.robot.pose_errors import PoseErrors

_STEP_TURN, _STEP_SHIFT = 0.002, 0.003
"""Standard deviations of the pose from one keyframe to the next, rad and m."""
_CLOSURE_TURN, _CLOSURE_SHIFT = 0.006, 0.008
"""The same that a closure has at least."""
LEAST_WEIGHT = 0.25
"""Weight in the graph's solution below which an edge counts as wrong."""
_BY_CHANCE = 0.01
"""How often closures that are no more off than their covariances say would be taken for strained."""


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """Two keyframes that show the same place.

    Attributes
    ----------
    target, source : int
    T_target_source : ndarray of shape (4, 4), float64
    information : ndarray of shape (6, 6), float64
        For a perturbation on the right, (rotation, translation).
    """

    target: int
    source: int
    T_target_source: Float64Array
    information: Float64Array


def find_closures(memory: PlaceMemory, *, gap: int = 8, every: int = 2) -> list[Closure]:
    """Find keyframes that show the same place, by position and by looks, and verify each pair.

    A pair that lies near by the poses is registered from there. Only where none does, the keyframe that looks most
    alike is registered from anywhere.

    Parameters
    ----------
    memory : PlaceMemory
    gap : int
        Keyframes nearer in order are not compared: tracking ties them already.
    every : int
        Every so many keyframes one is compared.

    Returns
    -------
    list of Closure
        At most one a keyframe.
    """
    out = []
    for number in range(gap, len(memory.keyframes), every):
        keyframe = memory.keyframes[number]
        alike = memory.recall(keyframe.features, n_best=2, until=number - gap + 1).tolist()
        near = memory.near(number, gap=gap)
        both = [other for other in alike if other in near] or near[:1]
        for other, far in [*((k, False) for k in both[:1]), *((k, True) for k in alike[:1])]:
            guess = invert_transform(memory.keyframes[other].T_world_camera) @ keyframe.T_world_camera
            found = memory.compare(other, keyframe, start=guess, far=far)
            if found is not None:
                out.append(Closure(other, number, found.T_target_source, closure_information(found)))
                break
    return out


def make_graph(
    poses: Float64Array,
    closures: list[Closure],
    *,
    parts: Sequence[int] | None = None,
    errors: Sequence[PoseErrors] | None = None,
) -> PoseGraph:
    """Return the graph of keyframes (n, 4, 4) with their closures, which count as doubtful.

    Each is tied to the one before it of the same part; all are one part by default. The tie is the looser the more the
    errors of the two differ.
    """
    step = np.diag([_STEP_TURN**2] * 3 + [_STEP_SHIFT**2] * 3)
    last: dict[int, int] = {}
    edges = []
    for k, part in enumerate([0] * len(poses) if parts is None else parts):
        if part in last:
            before = last[part]
            spread = step if errors is None else step + step_errors(errors[before], errors[k], poses[k])
            edges.append((before, k, invert_transform(poses[before]) @ poses[k], np.linalg.inv(spread), False))
        last[part] = k
    doubtful = [(c.target, c.source, c.T_target_source, c.information, True) for c in closures]
    return PoseGraph.of(list(poses), edges + doubtful)


def is_strained(graph: PoseGraph, weights: Float64Array) -> bool:
    """Whether a graph's poses are off from its doubtful edges, all together, by more than their errors explain.

    Tracking against the map ties keyframes more closely than a registration of two of them can: where the closures are
    explained, moving the poses towards them would add their noise. Drift strains all that reach across it; a single
    one among many that is off is itself in error.

    Parameters
    ----------
    graph : PoseGraph
    weights : ndarray of shape (m,), float64
        Of the edges in the graph's solution; those below ``LEAST_WEIGHT`` don't count.
    """
    from scipy.special import chdtri

    errors = edge_errors(graph, graph.poses)
    squared = np.einsum("ni,nij,nj->n", errors, graph.information, errors)[graph.doubtful & (weights > LEAST_WEIGHT)]
    # without drift the sum follows a chi-square law with six degrees of freedom an edge
    return bool(squared.size > 0 and squared.sum() > chdtri(6 * squared.size, _BY_CHANCE))


def correct_poses(
    T_world_camera: Float64Array, frames: Int64Array, before: Float64Array, after: Float64Array, keys: Int64Array
) -> Float64Array:
    """Carry a correction of keyframes over to all frames, evenly from one keyframe to the next.

    Parameters
    ----------
    T_world_camera : ndarray of shape (n, 4, 4), float64
    frames : ndarray of shape (n,), int64
        Numbers of the frames.
    before, after : ndarray of shape (m, 4, 4), float64
        The keyframes' poses.
    keys : ndarray of shape (m,), int64
        Numbers of the keyframes' frames, ascending.

    Returns
    -------
    ndarray of shape (n, 4, 4), float64
    """
    change = np.array([a @ invert_transform(b) for a, b in zip(after, before)])
    out = np.empty_like(T_world_camera)
    for i, (T, frame) in enumerate(zip(T_world_camera, frames)):
        k = int(np.clip(np.searchsorted(keys, frame, side="right") - 1, 0, len(keys) - 1))
        C = change[k]
        if k + 1 < len(keys) and frame > keys[k]:
            share = (frame - keys[k]) / (keys[k + 1] - keys[k])
            C = C @ exp_motion(share * log_motion(invert_transform(C) @ change[k + 1]))
        out[i] = C @ T
    return out


def closure_information(found: Registration) -> Float64Array:
    """Return the information (6, 6) of a registration of two keyframes, with the errors that two of them share."""
    least = np.diag([_CLOSURE_TURN**2] * 3 + [_CLOSURE_SHIFT**2] * 3)
    turned = adjoint(invert_transform(found.T_target_source))
    return np.asarray(np.linalg.inv(turned @ found.covariance @ turned.T + least))
