"""Groups of vertices: their correction is symmetric, exact on small graphs, and tells what whole regions are off by."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from seismo3d._typing import AnyArray
from seismo3d.graph.groups import GroupCorrection


def link_grid(n: int, rng: np.random.Generator, *, wall: float) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Links of a grid of n by n vertices, of weights from 1 to 1000; those across its middle are `wall`."""
    number = np.arange(n * n).reshape(n, n)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    weight = 10.0 ** rng.uniform(0.0, 3.0, len(first))
    weight[: n * (n - 1)].reshape(n, n - 1)[:, n // 2 - 1] = wall
    return first, second, weight


def laplacian(first: AnyArray, second: AnyArray, weight: AnyArray, n: int) -> sparse.csr_matrix:
    rows = np.arange(len(first))
    ends = np.concatenate([rows, rows]), np.concatenate([first, second])
    incidence = sparse.coo_matrix((np.repeat([-1.0, 1.0], len(first)), ends), shape=(len(first), n)).tocsr()
    return (incidence.T @ sparse.diags(weight) @ incidence).tocsr()


def correct(groups: GroupCorrection, gradient: AnyArray) -> AnyArray:
    moved = np.zeros(len(gradient), np.float32)
    groups.add(groups.solve(gradient)[0], moved)
    return moved.astype(np.float64)


def test_small_graphs_are_solved(rng: np.random.Generator) -> None:
    links = link_grid(12, rng, wall=0.1)
    matrix = laplacian(*links, 144)
    true = rng.normal(size=144)
    true -= true.mean()
    groups = GroupCorrection.of(*links, 144)
    found = correct(groups, matrix @ true)
    assert len(np.unique(groups.group)) == 144
    np.testing.assert_allclose(found - found.mean(), true, atol=1e-3)


def test_the_correction_is_symmetric(rng: np.random.Generator) -> None:
    groups = GroupCorrection.of(*link_grid(60, rng, wall=0.01), 3600)
    assert 3600 / 6 < groups.n_groups < 3600 / 2
    one, other = rng.normal(size=(2, 3600))
    # gradients of links add up to nothing
    one, other = one - one.mean(), other - other.mean()
    assert correct(groups, one) @ other == pytest.approx(correct(groups, other) @ one, rel=1e-4)
    assert groups.solve(one)[1] == pytest.approx(correct(groups, one) @ one, rel=1e-4)
    assert groups.solve(one)[1] > 0.0


def test_halves_that_hardly_hang_together_take_few_steps(rng: np.random.Generator) -> None:
    n = 60 * 60
    links = link_grid(60, rng, wall=1e-3)
    matrix = laplacian(*links, n)
    true = np.where(np.arange(n) % 60 < 30, -5.0, 5.0) + rng.normal(size=n)
    true -= true.mean()
    groups = GroupCorrection.of(*links, n)
    diagonal = matrix.diagonal()

    def errors_after(steps: int, precondition: LinearOperator) -> float:
        found, _ = cg(matrix, matrix @ true, maxiter=steps, rtol=1e-12, M=precondition)
        return float(np.abs(found - found.mean() - true).max())

    alone = LinearOperator((n, n), lambda r: r / diagonal)
    both = LinearOperator((n, n), lambda r: r / diagonal + correct(groups, r))
    assert errors_after(40, both) < 0.05
    assert errors_after(150, alone) > 1.0


def test_a_region_without_links_to_the_rest_stays_about_where_it_is(rng: np.random.Generator) -> None:
    """What it is pulled by adds up to nothing but for rounding."""
    n = 60 * 60
    first, second, weight = link_grid(60, rng, wall=1.0)
    held = weight != 1.0
    links = first[held], second[held], weight[held]
    true = rng.normal(size=n)
    gradient = (laplacian(*links, n) @ true).astype(np.float32)
    moved = correct(GroupCorrection.of(*links, n), gradient).reshape(60, 60)
    assert np.abs(moved).max() < 10.0
    assert abs(moved[:, :30].mean()) < 1.0


def test_a_graph_without_links_is_left_alone() -> None:
    none = np.zeros(0, np.int64)
    groups = GroupCorrection.of(none, none, np.zeros(0), 5)
    np.testing.assert_array_equal(correct(groups, np.zeros(5)), 0.0)
