"""When closures say that a trajectory has drifted."""

from __future__ import annotations

import numpy as np

from seismo3d.graph.poses import PoseGraph
from seismo3d.robot.closures import Closure, is_strained, make_graph
from seismo3d.robot.ekf import exp_motion

N = 20
SIGMA = np.array([0.006] * 3 + [0.008] * 3)


def closed_graph(misses: np.ndarray) -> PoseGraph:
    """Keyframes that stand still, tied by closures that are off by some motions (n, 6)."""
    information = np.diag(SIGMA**-2)
    links = [Closure(k, k + N, exp_motion(miss), information) for k, miss in enumerate(misses)]
    return make_graph(np.repeat(np.eye(4)[None], 2 * N, axis=0), links)


def strained(misses: np.ndarray, weight: float = 1.0) -> bool:
    graph = closed_graph(misses)
    return is_strained(graph, np.where(graph.doubtful, weight, 1.0))


def test_closures_that_are_off_as_their_covariances_say_act_once_in_a_hundred(rng: np.random.Generator) -> None:
    acted = [strained(rng.standard_normal((N, 6)) * SIGMA) for _ in range(400)]
    assert np.mean(acted) < 0.03  # three standard deviations above one in a hundred


def test_one_closure_among_many_that_is_off_does_not_act(rng: np.random.Generator) -> None:
    misses = 0.5 * rng.standard_normal((N, 6)) * SIGMA
    misses[7, 3] += 5.0 * SIGMA[3]
    assert not strained(misses)
    assert strained(misses[7:8])  # alone it is all that is known


def test_drift_that_all_closures_see_acts(rng: np.random.Generator) -> None:
    drift = np.array([0.0, 0.0, 0.0, 3.0, 0.0, 0.0]) * SIGMA
    misses = 0.7 * rng.standard_normal((N, 6)) * SIGMA + drift
    assert strained(misses)
    assert not strained(misses, weight=0.1)  # those that the solution has cast out don't count


def test_without_closures_nothing_is_strained() -> None:
    assert not strained(np.empty((0, 6)))
