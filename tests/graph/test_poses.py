from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FormatError, GeometryError, ParameterError, ShapeError
from seismo3d.geometry.rotations import exp_rotation, left_jacobian, make_transform, random_rotation, rotation_angle
from seismo3d.graph.poses import PoseGraph, edge_errors, read_g2o, solve_poses, write_g2o


def motion(twist: np.ndarray) -> np.ndarray:
    return make_transform(exp_rotation(twist[:3]), left_jacobian(twist[:3]) @ twist[3:])


@pytest.fixture
def ring(rng: np.random.Generator) -> tuple[np.ndarray, PoseGraph]:
    """Twenty poses on a ring, seen twice round, with exact edges and a start that has drifted."""
    angles = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    truth = np.array(
        [make_transform(exp_rotation([0, a, 0.3 * np.sin(a)]), [np.cos(a), 0.1 * a, np.sin(a)]) for a in angles]
    )
    edges = []
    for i, j in [(k, k + 1) for k in range(19)] + [(19, 0), (5, 15)]:
        edges.append((i, j, np.linalg.inv(truth[i]) @ truth[j], np.diag([400.0] * 3 + [100.0] * 3), j != i + 1))
    start = [truth[0]]
    for k in range(19):
        start.append(start[-1] @ edges[k][2] @ motion(0.02 * rng.normal(size=6)))
    return truth, PoseGraph.of(start, edges)


def test_exact_edges_give_back_the_truth(ring: tuple[np.ndarray, PoseGraph]) -> None:
    truth, graph = ring
    solved = solve_poses(graph)
    assert solved.converged
    np.testing.assert_allclose(solved.poses, truth, atol=1e-7)
    assert solved.chi2 < 1e-12
    np.testing.assert_allclose(solved.weights, 1.0, atol=1e-6)


def test_wrong_closures_are_outvoted(ring: tuple[np.ndarray, PoseGraph], rng: np.random.Generator) -> None:
    truth, graph = ring
    edges = list(zip(*graph.edges.T, graph.measured, graph.information, graph.doubtful))
    wrong = [
        (int(i), int(j), make_transform(random_rotation(rng), rng.normal(size=3)), np.eye(6) * 400.0, True)
        for i, j in ((2, 9), (4, 17))
    ]
    solved = solve_poses(PoseGraph.of(list(graph.poses), edges + wrong))
    assert solved.weights[-2:].max() < 0.01
    assert solved.weights[:-2].min() > 0.9
    # a redescending kernel keeps a pull of the order of width / error on the rest
    assert max(rotation_angle(a[:3, :3].T @ b[:3, :3]) for a, b in zip(solved.poses, truth)) < 0.02
    assert np.abs(solved.poses[:, :3, 3] - truth[:, :3, 3]).max() < 0.02


def test_error_spreads_by_information() -> None:
    """Two edges along x that disagree by one metre meet where their information says."""
    step = make_transform(np.eye(3), [1.0, 0.0, 0.0])
    longer = make_transform(np.eye(3), [2.0, 0.0, 0.0])
    graph = PoseGraph.of([np.eye(4), step], [(0, 1, step, 3.0 * np.eye(6), False), (0, 1, longer, np.eye(6), False)])
    assert solve_poses(graph).poses[1, 0, 3] == pytest.approx(1.25, abs=1e-6)


def test_frame_of_the_world_does_not_matter(ring: tuple[np.ndarray, PoseGraph]) -> None:
    _, graph = ring
    T = make_transform(exp_rotation([0.3, -1.0, 0.4]), [5.0, -3.0, 2.0])
    moved = PoseGraph(T @ graph.poses, graph.edges, graph.measured, graph.information, graph.doubtful)
    np.testing.assert_allclose(solve_poses(moved).poses, T @ solve_poses(graph).poses, atol=1e-6)


def test_step_uses_the_true_derivatives(ring: tuple[np.ndarray, PoseGraph], rng: np.random.Generator) -> None:
    from seismo3d.graph.poses import _kernel_weights, _normal_equations, _squares

    _, graph = ring
    free = np.arange(1, 20)

    def cost(poses: np.ndarray) -> float:
        return float(_squares(graph, edge_errors(graph, poses)).sum())

    errors = edge_errors(graph, graph.poses)
    ones = np.ones_like(_kernel_weights(graph, _squares(graph, errors), 1.0))
    _, g = _normal_equations(graph, graph.poses, errors, ones, free)
    for k in rng.integers(0, 114, size=8):
        step = np.zeros(6)
        step[k % 6] = 1e-5
        ahead, behind = graph.poses.copy(), graph.poses.copy()
        ahead[free[k // 6]] = ahead[free[k // 6]] @ motion(step)
        behind[free[k // 6]] = behind[free[k // 6]] @ motion(-step)
        assert (cost(ahead) - cost(behind)) / 2e-5 == pytest.approx(2 * g[k], rel=2e-3, abs=1e-2)


def test_g2o_there_and_back(ring: tuple[np.ndarray, PoseGraph], tmp_path: Path, rng: np.random.Generator) -> None:
    _, graph = ring
    A = rng.normal(size=(len(graph.edges), 6, 6))
    full = PoseGraph(graph.poses, graph.edges, graph.measured, A @ A.transpose(0, 2, 1), graph.doubtful)
    read = read_g2o(write_g2o(tmp_path / "graph.g2o", full))
    np.testing.assert_allclose(read.poses, full.poses, atol=1e-9)
    np.testing.assert_allclose(read.measured, full.measured, atol=1e-9)
    np.testing.assert_allclose(read.information, full.information, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(read.edges, full.edges)
    np.testing.assert_array_equal(read.doubtful, full.doubtful)


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(ShapeError, match="edge 0 joins 0 and 3"):
        PoseGraph.of([np.eye(4)] * 2, [(0, 3, np.eye(4), np.eye(6), False)])
    with pytest.raises(GeometryError, match="fixed names no pose"):
        solve_poses(PoseGraph.of([np.eye(4)], []), fixed=())
    pair = PoseGraph.of([np.eye(4)] * 2, [(0, 1, np.eye(4), np.eye(6), False)])
    assert solve_poses(pair, fixed=np.array([0])).converged  # type: ignore[arg-type]
    for fixed in ([2], [-1], [0.5], ["0"]):
        with pytest.raises(ParameterError, match=r"^fixed is "):
            solve_poses(pair, fixed=fixed)  # type: ignore[arg-type]
    (tmp_path / "bad.g2o").write_text("VERTEX_SE2 0 1 2 3\n")
    with pytest.raises(FormatError, match="line 1"):
        read_g2o(tmp_path / "bad.g2o")
    (tmp_path / "half.g2o").write_text("EDGE_SE3:QUAT 0 1 " + " ".join(["0"] * 6 + ["1"] + ["0"] * 21) + "\n")
    with pytest.raises(FormatError, match="vertex 0"):
        read_g2o(tmp_path / "half.g2o")
