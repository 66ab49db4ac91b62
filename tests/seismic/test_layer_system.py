"""The equations of the layer graph against scipy's sparse solver, and where finer graphs start."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from seismo3d.graph.scalars import ScalarEdges
from seismo3d.seismic._kernels_layer_solve import DIAGONAL, GRADIENT, NORMAL
from seismo3d.seismic.layer_system import LayerSystem, LinkFields
from seismo3d.seismic.linking import InMemory

SHAPE, STEP = (5, 6, 7), 4


def build(rng: np.random.Generator, shift: np.ndarray, variance: np.ndarray, breaks: np.ndarray) -> LayerSystem:
    """Return links to the next row and the next trace, in this order, and ties that measure noise."""
    links = LinkFields.empty([(0, 1), (1, 1)], SHAPE, InMemory())
    links.shift[...], links.variance[...] = shift, variance
    links.variance[0, -1], links.variance[1, :, -1] = np.inf, np.inf
    system = LayerSystem.of(links, breaks, ScalarEdges.none(), InMemory(), step=STEP)
    system.thickness[...] = rng.normal(0.0, 0.5, SHAPE)
    return system


@pytest.mark.parametrize("grouped", [False, True])
@pytest.mark.parametrize("stiff", [1e-3, 1.0, 1e4])
def test_the_solution_is_that_of_a_direct_solver(rng: np.random.Generator, stiff: float, grouped: bool) -> None:
    """Ties down the traces from far weaker than the links between them to far stiffer."""
    breaks = np.where(rng.random(SHAPE) < 0.1, 2, 0).astype(np.uint8)
    shift = rng.normal(0.0, 0.3, (2, *SHAPE)).astype(np.float32)
    system = build(rng, shift, np.ones((2, *SHAPE), np.float32), breaks)
    found = np.zeros(SHAPE, np.float32)
    system.weigh(found, np.inf, 1.0 / stiff)
    system.improve(found, 2000, grouped=grouped, tolerance=1e-3)
    rows, columns, entries, right = [], [], [], []

    def add(ends: list[tuple[int, float]], measured: float, weight: float) -> None:
        n = len(right)
        for vertex, share in ends:
            rows.append(n)
            columns.append(vertex)
            entries.append(share * np.sqrt(weight))
        right.append(measured * np.sqrt(weight))

    number = np.arange(np.prod(SHAPE)).reshape(SHAPE)
    for i, j, k in np.ndindex(*SHAPE):
        for f, (a, b) in enumerate([(i + 1, j), (i, j + 1)]):
            ahead = k * STEP + shift[f, i, j, k]
            if a >= SHAPE[0] or b >= SHAPE[1] or not 0.0 <= ahead <= (SHAPE[2] - 1) * STEP:
                continue
            low = min(int(ahead / STEP), SHAPE[2] - 2)
            part = ahead / STEP - low
            if breaks[a, b, low]:
                part = float(ahead >= low * STEP + breaks[a, b, low] - 0.5)
            ends = [(number[a, b, low], 1.0 - part), (number[a, b, low + 1], part), (number[i, j, k], -1.0)]
            add(ends, -shift[f, i, j, k], 1.0)
        if k < SHAPE[2] - 1 and not breaks[i, j, k]:
            add([(number[i, j, k + 1], 1.0), (number[i, j, k], -1.0)], system.thickness[i, j, k], stiff)
    matrix = coo_matrix((entries, (rows, columns)), shape=(len(right), found.size)).tocsr()
    # values are told but for one constant: the mean of the start, which stays
    normal = (matrix.T @ matrix + 1e-9 * coo_matrix(np.eye(found.size))).tocsc()
    best = spsolve(normal, matrix.T @ np.array(right))
    residual = matrix @ found.ravel().astype(np.float64) - right
    assert np.linalg.norm(matrix.T @ residual) < 2e-3 * np.linalg.norm(matrix.T @ np.array(right))
    np.testing.assert_allclose(matrix @ found.ravel(), matrix @ best, atol=0.02 * max(1.0, np.sqrt(stiff)))


def wide_system(rng: np.random.Generator, *, bytes_at_a_time: int = 2**62) -> LayerSystem:
    """Links of several lengths either way, faults, and links across them, on more columns than are kept at a time."""
    shape = (13, 37, 9)
    kinds = [(axis, hop) for hop in (1, 2, 4) for axis in (0, 1)]
    links = LinkFields.empty(kinds, shape, InMemory())
    links.shift[...] = rng.normal(0.0, 3.0, links.shift.shape)
    links.variance[...] = rng.uniform(0.5, 2.0, links.variance.shape)
    links.variance[rng.random(links.variance.shape) < 0.1] = np.inf
    breaks = np.where(rng.random(shape) < 0.1, rng.integers(1, STEP + 1, shape), 0).astype(np.uint8)
    number, n = np.arange(np.prod(shape)).reshape(shape)[:, :, :-1].ravel(), 60
    listed = ScalarEdges(
        rng.choice(number, n), rng.choice(number, n), rng.normal(size=n), np.ones(n), rng.random(n).round(1),
        rng.random(n).round(1),
    )  # fmt: skip
    system = LayerSystem.of(links, breaks, listed, InMemory(), step=STEP, bytes_at_a_time=bytes_at_a_time)
    system.thickness[...] = rng.normal(0.0, 0.5, shape)
    system.weigh(np.zeros(shape, np.float32), 3.0, 1.0)
    return system


def pulled(system: LayerSystem, kind: int, values: np.ndarray, rows: int = 10**9) -> np.ndarray:
    """Return what all links pull, worked out so many rows at a time."""
    out, sums = np.full(system.shape, np.nan, np.float32), np.full(system.shape[0], np.nan)
    for start in range(0, system.shape[0], rows):
        system.pull(kind, values, start, min(start + rows, system.shape[0]), out, values, sums)
    assert sums.sum() == pytest.approx(float((out.astype(float) * values).sum()), rel=1e-5)
    return out


def test_gradient_matrix_and_diagonal_are_of_one_system(rng: np.random.Generator) -> None:
    system = wide_system(rng)
    one, other = rng.normal(size=(2, *system.shape)).astype(np.float32)
    product = pulled(system, NORMAL, one)
    assert float((product * other).sum()) == pytest.approx(float((pulled(system, NORMAL, other) * one).sum()), rel=1e-4)
    measured = pulled(system, GRADIENT, np.zeros_like(one))
    np.testing.assert_allclose(pulled(system, GRADIENT, one), measured - product, atol=2e-4)
    diagonal = pulled(system, DIAGONAL, one)
    for at in rng.integers(0, system.shape, (40, 3)):
        unit = np.zeros_like(one)
        unit[tuple(at)] = 1.0
        assert pulled(system, NORMAL, unit)[tuple(at)] == pytest.approx(float(diagonal[tuple(at)]), rel=1e-5)


@pytest.mark.parametrize("kind", [NORMAL, GRADIENT, DIAGONAL])
def test_a_row_is_the_same_whichever_are_worked_on_beside_it(rng: np.random.Generator, kind: int) -> None:
    system = wide_system(rng)
    values = rng.normal(size=system.shape).astype(np.float32)
    whole = pulled(system, kind, values)
    for rows in (1, 3, 5):
        np.testing.assert_array_equal(pulled(system, kind, values, rows), whole)


def test_groups_tell_what_lies_beyond_a_fault_in_few_steps() -> None:
    """Some links across it, each a millionth as sure as those along layers, and among many traces."""
    shape, throw = (40, 40, 8), 9.0
    links = LinkFields.empty([(0, 1), (1, 1)], shape, InMemory())
    links.shift[...], links.variance[...] = 0.0, 1e-3
    links.variance[0, -1], links.variance[1, :, -1], links.variance[1, :, 19] = np.inf, np.inf, np.inf
    number = np.arange(np.prod(shape)).reshape(shape)
    across = ScalarEdges.from_arrays(number[::8, 19, 3], number[::8, 20, 3], measured=throw, variance=1e3)
    system = LayerSystem.of(links, np.zeros(shape, np.uint8), across, InMemory(), step=STEP)
    system.thickness[...] = 0.0
    found = {}
    for grouped in (False, True):
        values = np.zeros(shape, np.float32)
        system.weigh(values, np.inf, 1.0)
        system.improve(values, 30, grouped=grouped)
        found[grouped] = values[:, 20:].mean() - values[:, :20].mean()
    assert found[True] == pytest.approx(throw, abs=0.05)
    assert found[False] < 0.7 * throw


def test_new_traces_start_on_their_own_side_of_a_fault(rng: np.random.Generator) -> None:
    """Without it those with odd numbers would start with the value of the trace before, beyond the fault or not."""
    wall, throw = 3, 9.0
    values = np.zeros(SHAPE, np.float32)
    values[:, wall:] = -throw
    variance = np.full((2, *SHAPE), 0.1, np.float32)
    variance[1, :, wall - 1] = np.inf
    system = build(rng, np.zeros((2, *SHAPE), np.float32), variance, np.zeros(SHAPE, np.uint8))
    start = values.copy()
    start[1::2], start[:, 1::2] = 77.0, 77.0
    system.lead(start)
    np.testing.assert_array_equal(start, values)


def test_new_traces_follow_shifts_and_surer_links(rng: np.random.Generator) -> None:
    """Values fall by what layers go down from trace to trace; a wild link that is less sure is not followed."""
    slope = 0.75
    shift = np.zeros((2, *SHAPE), np.float32)
    shift[1] = slope
    variance = np.full((2, *SHAPE), 0.1, np.float32)
    shift[1, :, 2], variance[1, :, 2] = 3.0, 0.5
    system = build(rng, shift, variance, np.zeros(SHAPE, np.uint8))
    values = np.broadcast_to(-slope * np.arange(SHAPE[1])[:, None], SHAPE).astype(np.float32)
    start = values.copy()
    start[1::2], start[:, 1::2] = 77.0, 77.0
    system.lead(start)
    # a link from the last sample leaves the cube
    np.testing.assert_allclose(start[:, :, :-1], values[:, :, :-1], atol=1e-6)


def test_a_run_that_no_link_leads_to_goes_with_what_no_fault_parts_it_from(rng: np.random.Generator) -> None:
    variance = np.full((2, *SHAPE), 0.1, np.float32)
    variance[:, :, :, 2:] = np.inf
    breaks = np.zeros(SHAPE, np.uint8)
    breaks[:, :, 4] = 1
    system = build(rng, np.zeros((2, *SHAPE), np.float32), variance, breaks)
    start = np.full(SHAPE, 5.0, np.float32)
    start[1::2], start[:, 1::2] = 77.0, 77.0
    system.lead(start)
    assert (start[1::2, :, :5] == 5.0).all()
    assert (start[:, 1::2, :5] == 5.0).all()
    assert (start[1::2, :, 5:] == 77.0).all()
