"""A horizon as a stiff surface: what it keeps, where it is led on, and what parts it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse

from seismo3d.seismic._kernels_tracks import weigh_runs
from seismo3d.seismic.track_smoothing import find_rims, find_shares, fit_stiffly, link_traces, weigh_traces

SHAPE = (22, 17)


def all_linked(shape: tuple[int, int] = SHAPE) -> np.ndarray:
    linked = np.full(shape, 3, np.uint8)
    linked[-1] &= 2
    linked[:, -1] &= 1
    return linked


def second_differences(linked: np.ndarray) -> sparse.csr_array:
    """One row each for what bends in a linked grid, written plainly."""
    n0, n1 = linked.shape
    rows = []

    def add(places: list[tuple[int, int]], shares: list[float]) -> None:
        row = np.zeros(linked.shape)
        for place, share in zip(places, shares, strict=True):
            row[place] = share
        rows.append(row.ravel())

    for i in range(n0):
        for j in range(n1):
            if 0 < i < n0 - 1 and linked[i - 1, j] & 1 and linked[i, j] & 1:
                add([(i - 1, j), (i, j), (i + 1, j)], [1, -2, 1])
            if 0 < j < n1 - 1 and linked[i, j - 1] & 2 and linked[i, j] & 2:
                add([(i, j - 1), (i, j), (i, j + 1)], [1, -2, 1])
            if i < n0 - 1 and j < n1 - 1:
                whole = linked[i, j] & 1 and linked[i, j + 1] & 1 and linked[i, j] & 2 and linked[i + 1, j] & 2
                if whole:
                    add([(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)], [2**0.5, -(2**0.5), -(2**0.5), 2**0.5])
    return sparse.csr_array(np.array(rows))


def test_the_surface_solves_the_normal_equations(rng: np.random.Generator) -> None:
    linked = all_linked() & rng.choice([3, 3, 3, 3, 1, 2, 0], SHAPE).astype(np.uint8)
    values, weights = rng.normal(0.0, 3.0, SHAPE), rng.uniform(0.01, 1.0, SHAPE)
    bends = second_differences(linked)
    matrix = 20.0 * (bends.T @ bends) + sparse.diags_array(weights.ravel())
    expected = sparse.linalg.spsolve(matrix.tocsc(), (weights * values).ravel()).reshape(SHAPE)
    np.testing.assert_allclose(fit_stiffly(values, weights, linked, 20.0), expected, atol=2e-4)


def test_a_plane_stays_whatever_its_weights(rng: np.random.Generator) -> None:
    rows, columns = np.indices(SHAPE)
    plane = 40.0 + 0.7 * rows - 1.3 * columns
    found = fit_stiffly(plane, rng.uniform(1e-3, 1.0, SHAPE), all_linked(), 64.0)
    np.testing.assert_allclose(found, plane, atol=1e-6)


def test_a_surface_is_led_on_where_little_is_told() -> None:
    rows, columns = np.indices(SHAPE)
    plane = 40.0 + 0.7 * rows - 0.4 * columns
    values, weights = plane.copy(), np.ones(SHAPE)
    values[:, 12:] += 2.0
    weights[:, 12:] = 1e-3
    found = fit_stiffly(values, weights, all_linked(), 64.0)
    assert np.abs(found - plane)[:, 12:15].max() < 0.1
    assert np.abs(found - plane).max() < 0.4


def test_nothing_is_smoothed_across_what_is_not_linked() -> None:
    values = np.where(np.indices(SHAPE)[1] < 8, 40.0, 46.0)
    values[3, 3] = np.nan
    linked = all_linked()
    linked[:, 7] &= 1
    linked[3, 3] = 0
    linked[2, 3] &= 2
    linked[3, 2] &= 1
    found = fit_stiffly(values, np.ones(SHAPE), linked, 64.0)
    np.testing.assert_allclose(found, values, atol=1e-6)


def layers_with(cuts: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(cuts=cuts, times=np.zeros(cuts.shape, np.float32), live=np.ones(cuts.shape[:2], bool))


def test_traces_are_linked_within_a_part_up_to_a_fault_or_a_jump() -> None:
    cuts = np.zeros((6, 9, 60), np.uint8)
    cuts[:, 3, 18:23] = 2
    depth = np.full((6, 9), 20.0)
    depth[:, 7:] = 27.0
    parts = np.zeros((6, 9), np.int64)
    parts[4:] = 1
    parts[0, 0] = -1
    linked = link_traces(layers_with(cuts), depth, parts, 4.0)
    along, down = (linked & 2) > 0, (linked & 1) > 0
    expected = np.ones((6, 9), bool)
    expected[:, [3, 6, 8]] = False
    expected[0, 0] = False
    np.testing.assert_array_equal(along, expected)
    expected = np.ones((6, 9), bool)
    expected[[3, 5]] = False
    expected[0, 0] = False
    np.testing.assert_array_equal(down, expected)


def test_a_fault_at_another_depth_parts_nothing() -> None:
    cuts = np.zeros((6, 9, 60), np.uint8)
    cuts[:, 3, 30:] = 2
    linked = link_traces(layers_with(cuts), np.full((6, 9), 20.0), np.zeros((6, 9), np.int64), 4.0)
    assert ((linked & 2) > 0)[:, :-1].all()


def test_rims_lie_beside_faults_and_gaps_but_not_at_the_cube_s_edge() -> None:
    cuts = np.zeros((12, 20, 60), np.uint8)
    cuts[:, 7, :] = 2
    parts = np.zeros((12, 20), np.int64)
    parts[:, 16:] = -1
    free = np.zeros((12, 20), bool)
    linked = link_traces(layers_with(cuts), np.full((12, 20), 20.0), parts, 4.0)
    rims = find_rims(linked, parts, free, 2)
    np.testing.assert_array_equal(np.flatnonzero(rims.all(axis=0)), [6, 7, 8, 9, 14, 15])
    assert rims.any(axis=0).sum() == 6
    # where the layer leaves the cube it ends, but no fault is there
    free[:, 16:] = True
    rims = find_rims(linked, parts, free, 2)
    np.testing.assert_array_equal(np.flatnonzero(rims.any(axis=0)), [6, 7, 8, 9])
    assert not find_rims(all_linked(), np.zeros(SHAPE, np.int64), np.zeros(SHAPE, bool), 3).any()


@pytest.mark.parametrize("clear", [0, 2])
def test_shares_are_of_the_window_on_its_side_of_faults(clear: int) -> None:
    cuts = np.zeros((1, 4, 60), np.uint8)
    # faults between samples 24 and 25 of one trace, 13 and 14 of another, and far off
    cuts[0, 1, 24] = cuts[0, 2, 13] = cuts[0, 3, 50] = 4
    depth = np.full((1, 4), 20.0)
    share = find_shares(layers_with(cuts), depth, near=8, clear=clear)[0]
    taper = np.hanning(19)[1:-1]
    below = taper[: 8 + 4 - clear + 1].sum() / taper.sum()
    above = taper[8 - 6 + clear :].sum() / taper.sum()
    np.testing.assert_allclose(share, [1.0, below, above, 1.0], atol=1e-12)


def test_an_end_of_the_cube_takes_nothing_from_a_share() -> None:
    out = np.empty((1, 3))
    depth = np.array([[0.5, 58.9, np.nan]])
    weigh_runs(np.zeros((1, 3, 60), np.uint8), depth, np.hanning(19)[1:-1], 2, out)
    np.testing.assert_allclose(out[0], [1.0, 1.0, 0.0])


def test_a_trace_counts_by_its_share_and_less_in_a_rim() -> None:
    share = np.array([[1.0, 0.8, 0.1, 1.0]])
    rims = np.array([[False, False, False, True]])
    np.testing.assert_allclose(weigh_traces(share, rims), [[1.0, 0.8**5, 1e-3, 0.1]])
