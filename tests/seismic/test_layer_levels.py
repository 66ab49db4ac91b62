"""Layer time that is off beyond faults, put right by the waveforms of many traces."""

from __future__ import annotations

import numpy as np
import pytest
from laid_out_layers import SHAPE, THROW, WALL, lay_out

from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.layer_levels import LevelMoves, find_level_moves, join_levels, mend_times
from seismo3d.seismic.layer_time import LayerModel


def throw_layers(rng: np.random.Generator, wrong: float, noise: float) -> LayerModel:
    """Return layers that a vertical fault throws, with layer time off by so much beyond it."""
    beyond = np.arange(SHAPE[1]) >= WALL
    times = np.arange(SHAPE[2]) + np.where(beyond, wrong - THROW, 0.0)[:, None]
    return lay_out(rng, np.where(beyond, THROW, 0.0), times, cut=True, noise=noise)


def find_all(layers: LayerModel, settings: LayerTimeSettings) -> LevelMoves:
    found = dict(find_level_moves(layers, settings))
    return join_levels([found[n] for n in range(len(found))])


@pytest.mark.parametrize("noise", [0.05, 1.0])
@pytest.mark.parametrize("wrong", [-7.0, 0.0, 4.0])
def test_layer_time_beyond_a_fault_is_put_right(rng: np.random.Generator, wrong: float, noise: float) -> None:
    settings = LayerTimeSettings()
    layers = throw_layers(rng, wrong, noise)
    times = layers.times.copy()
    mend_times(times, layers.cuts, find_all(layers, settings), settings.least)
    truth = throw_layers(rng, 0.0, 0.0).times
    apart = (times - truth)[:, :, 16:-16]
    # as a whole it may be moved: layer time has no zero of its own
    np.testing.assert_allclose(apart[:, WALL:].mean(), apart[:, :WALL].mean(), atol=0.3)
    assert np.abs(apart - np.median(apart)).max() < 1.0


def test_a_run_goes_by_its_own_levels() -> None:
    """Of two runs of a trace, one is moved, more the deeper, and the other stays; trends go on to a run's ends."""
    times = np.broadcast_to(np.arange(64.0), (1, 1, 64)).astype(np.float32)
    cuts = np.zeros((1, 1, 64), np.uint8)
    cuts[0, 0, 29] = 4
    depth = np.array([[[10.0, 20.0, 40.0]]], np.float32)
    move = np.array([[[2.0, 4.0, np.nan]]], np.float32)
    mended = times.copy()
    mend_times(mended, cuts, LevelMoves(depth, move), 1e-3)
    np.testing.assert_array_equal(mended[0, 0, 30:], times[0, 0, 30:])
    # what lay at 10 is now at 12, what lay at 20 at 24
    np.testing.assert_allclose(mended[0, 0, [12, 24]], [10.0, 20.0], atol=1e-5)
    np.testing.assert_allclose(mended[0, 0, [0, 29]], [-2.0, 25.0], atol=1e-5)


@pytest.mark.parametrize("strays", [[1], [1, 2], [3], [4], [5]])
def test_levels_that_would_change_places_with_most_others_are_left_out(strays: list[int]) -> None:
    """Six levels of a run move alike; some of them, at its top, in it or at its foot, are told a cycle and more off."""
    times = np.broadcast_to(np.arange(64.0), (1, 1, 64)).astype(np.float32)
    depth = np.arange(8.0, 56.0, 8.0, dtype=np.float32).reshape(1, 1, -1)
    move = np.full((1, 1, 6), -3.0, np.float32)
    right = times.copy()
    mend_times(right, np.zeros((1, 1, 64), np.uint8), LevelMoves(depth, move), 1e-3)
    np.testing.assert_allclose(right[0, 0, 5:50], np.arange(8.0, 53.0), atol=1e-4)
    move[0, 0, strays] = [33.0 if stray < 3 else -36.0 for stray in strays]
    mended = times.copy()
    mend_times(mended, np.zeros((1, 1, 64), np.uint8), LevelMoves(depth, move), 1e-3)
    np.testing.assert_allclose(mended, right, atol=1e-4)


def test_of_as_many_levels_those_stay_that_move_alike() -> None:
    times = np.broadcast_to(np.arange(64.0), (1, 1, 64)).astype(np.float32)
    depth = np.array([[[10.0, 20.0, 30.0]]], np.float32)
    move = np.array([[[12.0, 1.0, 1.0]]], np.float32)
    mend_times(times, np.zeros((1, 1, 64), np.uint8), LevelMoves(depth, move), 1e-3)
    np.testing.assert_allclose(times[0, 0, 12:40], np.arange(11.0, 39.0), atol=1e-4)


def test_a_cube_that_leaves_nothing_to_be_compared_stays(rng: np.random.Generator) -> None:
    """Noise on both sides: nothing fits, and hardly anything is moved."""
    settings = LayerTimeSettings()
    layers = throw_layers(rng, 0.0, 0.0)
    layers.volume[...] = rng.normal(size=SHAPE)
    times = layers.times.copy()
    mend_times(times, layers.cuts, find_all(layers, settings), settings.least)
    moved = np.abs(times - layers.times)
    assert (moved > 0.5).mean() < 0.05
