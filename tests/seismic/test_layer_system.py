"""The equations of the layer graph against scipy's sparse solver, and where finer graphs start."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from seismo3d.graph.scalars import ScalarEdges
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
    system.improve(found, 2000, grouped=grouped)
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
