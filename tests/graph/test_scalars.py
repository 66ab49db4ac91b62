"""Relative measurements: known answers, outliers, refusals, kernels against plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ShapeError
from seismo3d.graph._kernels_scalars import apply_normal, gather_gradient, normal_diagonal
from seismo3d.graph.scalars import ScalarEdges, SolveSettings, solve_scalars


def grid_edges(rng: np.random.Generator, truth: np.ndarray, noise: float) -> ScalarEdges:
    numbers = np.arange(truth.size).reshape(truth.shape)
    first = np.concatenate([numbers[:-1].ravel(), numbers[:, :-1].ravel()])
    second = np.concatenate([numbers[1:].ravel(), numbers[:, 1:].ravel()])
    measured = truth.ravel()[second] - truth.ravel()[first] + noise * rng.standard_normal(len(first))
    return ScalarEdges.from_arrays(first, second, measured=measured, variance=max(noise, 0.1) ** 2)


def test_exact_measurements_give_the_truth(rng: np.random.Generator) -> None:
    truth = rng.normal(size=(20, 30))
    found = solve_scalars(truth.size, grid_edges(rng, truth, 0.0))
    assert found.converged
    np.testing.assert_allclose(found.values, truth.ravel() - truth[0, 0], atol=2e-3)  # float32 over a path of 50 edges


def test_outliers_are_rejected_and_leave_the_rest_alone(rng: np.random.Generator) -> None:
    truth = rng.normal(size=(20, 30))
    edges = grid_edges(rng, truth, 0.05)
    measured = edges.measured.copy()
    wrong = rng.choice(len(edges), 60, replace=False)
    measured[wrong] += 4.0
    spoilt = ScalarEdges.from_arrays(edges.first, edges.second, measured=measured, variance=edges.variance)
    settings = SolveSettings(cutoffs=(np.inf, 20.0, 10.0, 5.0, 3.0, 3.0))
    robust = solve_scalars(truth.size, spoilt, settings=settings)
    plain = solve_scalars(truth.size, spoilt, settings=SolveSettings(cutoffs=(np.inf,)))

    def error(values: np.ndarray) -> float:
        error = values - truth.ravel()
        return float(np.quantile(np.abs(error - np.median(error)), 0.9))

    assert error(robust.values) < 0.1 < 0.3 < error(plain.values)
    assert robust.rejected[wrong].mean() > 0.85


def test_an_end_between_two_vertices_is_interpolated() -> None:
    # x1 = x0 + 2; x3 lies 1 above the point a quarter of the way from x1 to x2; x2 = x1 + 4
    edges = ScalarEdges.from_arrays([0, 1, 1], [1, 2, 3], measured=[2.0, 4.0, 1.0], first_share=[0, 0, 0.25])
    np.testing.assert_allclose(solve_scalars(4, edges).values, [0, 2, 6, 4], atol=1e-3)


def test_parts_without_edges_keep_their_start() -> None:
    edges = ScalarEdges.from_arrays([0], [1], measured=[3.0])
    found = solve_scalars(4, edges, start=[1.0, 1.0, 7.0, 9.0])
    np.testing.assert_allclose(found.values, [-0.5, 2.5, 7.0, 9.0], atol=1e-5)


def test_joined_edges_are_all_there() -> None:
    one = ScalarEdges.from_arrays([0], [1], measured=[1.0])
    two = ScalarEdges.from_arrays([1], [2], measured=[1.0])
    np.testing.assert_allclose(solve_scalars(3, ScalarEdges.join(one, two)).values, [0, 1, 2], atol=1e-4)


def test_kernels_equal_the_dense_matrix(rng: np.random.Generator) -> None:
    n, m = 12, 40
    first, second = rng.integers(0, n - 1, (2, m)).astype(np.int32)
    f, g = rng.uniform(0, 1, (2, m)).astype(np.float32)
    f[::3] = 0
    weight, x = rng.uniform(0.5, 2, m).astype(np.float32), rng.normal(size=n).astype(np.float32)
    rows = np.zeros((m, n))
    for e in range(m):
        rows[e, first[e]] -= 1 - f[e]
        rows[e, first[e] + 1] -= f[e]
        rows[e, second[e]] += 1 - g[e]
        rows[e, second[e] + 1] += g[e]
    out = np.empty(n, np.float32)
    apply_normal(x, first, second, f, g, weight, out)
    np.testing.assert_allclose(out, rows.T @ (weight * (rows @ x)), atol=1e-4)
    gather_gradient(first, second, f, g, weight, out)
    np.testing.assert_allclose(out, rows.T @ weight, atol=1e-4)
    normal_diagonal(first, second, f, g, weight, out)
    separate = np.array([abs(a - b) > 1 for a, b in zip(first, second, strict=True)])
    expected = (weight[separate, None] * rows[separate] ** 2).sum(axis=0)
    normal_diagonal(first[separate], second[separate], f[separate], g[separate], weight[separate], out)
    np.testing.assert_allclose(out, expected, atol=1e-4)


def test_refusals() -> None:
    with pytest.raises(ShapeError, match="one length"):
        ScalarEdges.from_arrays([0, 1], [1, 2, 3], measured=[1.0])
    with pytest.raises(ShapeError, match="not positive"):
        ScalarEdges.from_arrays([0], [1], measured=[1.0], variance=0.0)
    edges = ScalarEdges.from_arrays([0], [5], measured=[1.0])
    with pytest.raises(ShapeError, match="expected 0 to 2"):
        solve_scalars(3, edges)
    with pytest.raises(ShapeError, match="one value a vertex"):
        solve_scalars(6, edges, start=[0.0])
