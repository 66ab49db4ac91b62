"""Parts of a layer carried on to the traces they lack, on layer times that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.track_growing import grow_parts, keep_sides

SHAPE = (12, 20, 64)
FAULT = 11
"""A fault passes before the crossline after this one, at all depths."""


def dipping(*, jump: float = 0.0) -> LayerModel:
    """Return layers that dip by a quarter of a sample a crossline; at an upright fault times jump by so much."""
    _, j, k = np.indices(SHAPE)
    times = (k - 0.25 * j + jump * (j > FAULT)).astype(np.float32)
    cuts = np.zeros(SHAPE, np.uint8)
    cuts[:, FAULT] = 2
    live = np.ones(SHAPE[:2], bool)
    closure = LoopClosure(0.0, 0.0, 0, 1, np.zeros(SHAPE[:2], np.float32))
    return LayerModel(times, cuts, times, np.ones(SHAPE, bool), live, "samples", 0.0, closure)


def start(*places: tuple[int, int, float]) -> tuple[np.ndarray, np.ndarray]:
    depth, parts = np.full(SHAPE[:2], np.nan), np.full(SHAPE[:2], -1)
    for number, (i, j, z) in enumerate(places):
        depth[i, j], parts[i, j] = z, number
    return depth, parts


def test_a_part_goes_on_to_the_fault_and_no_farther() -> None:
    depth, parts = grow_parts(dipping(), *start((4, 5, 30.5)))
    expected = 30.5 + 0.25 * (np.arange(FAULT + 1) - 5.0)
    np.testing.assert_allclose(depth[:, : FAULT + 1], np.broadcast_to(expected, (12, FAULT + 1)), atol=1e-4)
    assert np.isnan(depth[:, FAULT + 1 :]).all()
    assert (parts[:, : FAULT + 1] == 0).all()
    assert (parts[:, FAULT + 1 :] == -1).all()


@pytest.mark.parametrize("jump", [0.0, -9.0])
def test_each_part_keeps_the_level_where_it_was_placed(jump: float) -> None:
    depth, parts = grow_parts(dipping(jump=jump), *start((4, 5, 30.5), (9, 15, 20.0)))
    assert np.isfinite(depth).all()
    np.testing.assert_allclose(depth[0, FAULT + 1 :], 20.0 + 0.25 * (np.arange(FAULT + 1, 20) - 15.0), atol=1e-4)
    assert (parts == np.where(np.arange(20) > FAULT, 1, 0)).all()


def test_what_is_there_and_dead_traces_stay() -> None:
    layers = dipping()
    layers.live[7] = False
    depth, parts = start((4, 5, 30.5))
    depth[2, :3], parts[2, :3] = 50.0, 5
    grown, numbers = grow_parts(layers, depth, parts)
    np.testing.assert_array_equal(grown[2, :3], 50.0)
    assert (numbers[2, :3] == 5).all()
    assert np.isnan(grown[7:]).all()
    assert np.isnan(depth).sum() == np.size(depth) - 4


def test_a_layer_ends_where_it_leaves_the_cube() -> None:
    depth, _ = grow_parts(dipping(), *start((4, 5, 0.5)))
    assert np.isfinite(depth[:, 3 : FAULT + 1]).all()
    assert np.isnan(depth[:, :3]).all()


def test_what_moves_past_a_fault_or_off_the_cube_is_left_out() -> None:
    layers = dipping()
    layers.cuts[3, :, 40] |= 4
    before = np.full((1, *SHAPE[:2]), 38.0)
    after = before + 4.0
    after[0, 5, 5], after[0, 6, 6] = -2.0, np.nan
    keep_sides(layers, before, after)
    gone = np.zeros(SHAPE[:2], bool)
    gone[3] = gone[5, 5] = gone[6, 6] = True
    np.testing.assert_array_equal(np.isnan(after[0]), gone)
