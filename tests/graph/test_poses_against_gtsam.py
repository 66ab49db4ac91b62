"""The pose graph's solution is that of an independent solver."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, left_jacobian, make_transform, rotation_angle
from seismo3d.graph.poses import PoseGraph, edge_errors, solve_poses

gtsam = pytest.importorskip("gtsam")


def noisy(rng: np.random.Generator, scale: float) -> np.ndarray:
    twist = scale * rng.normal(size=6)
    return make_transform(exp_rotation(twist[:3]), left_jacobian(twist[:3]) @ twist[3:])


@pytest.fixture
def graph(rng: np.random.Generator) -> PoseGraph:
    """Two rounds of a ring whose every edge is a little wrong, with information that differs by edge and direction."""
    angles = np.linspace(0.0, 4.0 * np.pi, 40, endpoint=False)
    truth = [make_transform(exp_rotation([0.1 * np.sin(a), a, 0.0]), [np.cos(a), 0.1 * a, np.sin(a)]) for a in angles]
    pairs = [(k, k + 1) for k in range(39)] + [(k, k + 20) for k in range(0, 20, 3)]
    edges, start = [], [truth[0]]
    for i, j in pairs:
        A = rng.normal(size=(6, 6))
        information = np.diag([4000.0] * 3 + [1000.0] * 3) + 100.0 * A @ A.T
        edges.append((i, j, np.linalg.inv(truth[i]) @ truth[j] @ noisy(rng, 0.01), information, False))
    for k in range(39):
        start.append(start[-1] @ edges[k][2] @ noisy(rng, 0.01))
    return PoseGraph.of(start, edges)


def solved_by_gtsam(graph: PoseGraph) -> np.ndarray:
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for (i, j), T, W in zip(graph.edges, graph.measured, graph.information):
        noise = gtsam.noiseModel.Gaussian.Information(W)
        factors.add(gtsam.BetweenFactorPose3(int(i), int(j), gtsam.Pose3(T), noise))
    factors.add(gtsam.NonlinearEqualityPose3(0, gtsam.Pose3(graph.poses[0])))
    for k, T in enumerate(graph.poses):
        values.insert(k, gtsam.Pose3(T))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-14)
    parameters.setAbsoluteErrorTol(1e-14)
    answer = gtsam.LevenbergMarquardtOptimizer(factors, values, parameters).optimize()
    return np.array([answer.atPose3(k).matrix() for k in range(len(graph.poses))])


def test_poses_are_those_of_gtsam(graph: PoseGraph) -> None:
    ours, theirs = solve_poses(graph), solved_by_gtsam(graph)
    assert ours.converged
    moved = np.linalg.norm((graph.poses - theirs)[:, :3, 3], axis=1).max()
    assert moved > 0.05  # the start was off
    assert np.linalg.norm((ours.poses - theirs)[:, :3, 3], axis=1).max() < 1e-5
    assert max(rotation_angle(a[:3, :3].T @ b[:3, :3]) for a, b in zip(ours.poses, theirs)) < 1e-5


def test_the_sum_of_squares_is_no_larger_than_that_of_gtsam(graph: PoseGraph) -> None:
    errors = edge_errors(graph, solved_by_gtsam(graph))
    theirs = float(np.einsum("ni,nij,nj->", errors, graph.information, errors))
    assert solve_poses(graph).chi2 == pytest.approx(theirs, rel=1e-6)
