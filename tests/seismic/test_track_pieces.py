"""Pieces of a track: what hangs together, on steep flanks too, and what is too small to be trusted."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.track_pieces import are_joined, keep_pieces, label_pieces

SHAPE = (30, 40)
SEED = np.array([[15.0, 5.0, 60.0]])


def flank(slope: float) -> np.ndarray:
    _, j = np.indices(SHAPE)
    return 60.0 + slope * (j - 5.0)


def test_steps_join_where_they_are_small_or_go_on_alike() -> None:
    depth = np.array([0.0, 3.0, 23.0, 3.0, 13.0, 24.0, np.nan, 30.0])
    joined = are_joined(depth, 4.0)
    assert joined.tolist() == [True, False, False, True, True, False, False]
    np.testing.assert_array_equal(are_joined(depth[:, None], 4.0, axis=0)[:, 0], joined)


@pytest.mark.parametrize("slope", [0.0, 2.0, 9.0, -9.0])
def test_a_flank_is_one_piece_however_steep(slope: float) -> None:
    assert keep_pieces(flank(slope), SEED, step=4.0, least=40).all()


def test_a_fault_leaves_two_pieces_and_both_stay() -> None:
    depth = flank(0.5)
    depth[:, 20:] += 15.0
    depth[:, 19] = np.nan
    kept = keep_pieces(depth, SEED, step=4.0, least=40)
    np.testing.assert_array_equal(kept, np.isfinite(depth))


def test_what_jumps_away_from_its_surroundings_is_left_out() -> None:
    depth = flank(0.5)
    scrap = np.zeros(SHAPE, bool)
    scrap[10:14, 20:23] = scrap[2, 30] = True
    depth[scrap] -= 20.0
    np.testing.assert_array_equal(keep_pieces(depth, SEED, step=4.0, least=40), ~scrap)
    # as many as are asked for stay, and so does a scrap that a seed lies on
    np.testing.assert_array_equal(keep_pieces(depth, SEED, step=4.0, least=12)[10:14], np.ones((4, 40), bool))
    on_it = np.array([[11.0, 21.0, float(depth[11, 21])]])
    assert keep_pieces(depth, on_it, step=4.0, least=40)[10:14].all()


def test_a_seed_on_a_trace_without_the_horizon_keeps_nothing_there() -> None:
    depth = flank(0.0)
    depth[10:20, :10] = np.nan
    np.testing.assert_array_equal(keep_pieces(depth, SEED, step=4.0, least=40), np.isfinite(depth))
    nothing = np.full(SHAPE, np.nan)
    assert not keep_pieces(nothing, SEED, step=4.0, least=40).any()


def test_pieces_are_numbered_by_where_the_track_jumps():
    depth = np.zeros((4, 6))
    depth[:, 3:] = 20.0
    depth[0, 0] = np.nan
    labels = label_pieces(depth, 4.0)
    assert len(np.unique(labels)) == 3
    assert len(np.unique(labels[:, 3:])) == len(np.unique(labels[1:, :3])) == 1
    assert labels[0, 0] not in labels[1:, :]
