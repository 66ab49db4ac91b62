"""Which horizons are chosen: strong, followed far, and spread over the cube."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.seismic.horizon_search import _choose, _part, _rank_seeds, find_seeds
from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.tracks import Track

SHAPE = (16, 20, 96)


def track(depth: float, *, share: float = 1.0, confidence: float = 1.0) -> Track:
    depths = np.full((10, 10), depth, np.float32)
    depths[: round(10 * (1.0 - share))] = np.nan
    return Track(depths, np.where(np.isfinite(depths), np.float32(confidence), np.float32(np.nan)), np.zeros((1, 3)))


def layered(amplitudes: dict[int, float]) -> LayerModel:
    """Level layers that are numbered by their samples, with events of one sample."""
    times = np.broadcast_to(np.arange(SHAPE[2], dtype=np.float32), SHAPE).copy()
    volume = np.zeros(SHAPE, np.float32)
    for sample, amplitude in amplitudes.items():
        volume[..., sample] = amplitude
    whole = np.ones(SHAPE, bool)
    closure = LoopClosure(0.0, 0.0, 0, 1, np.zeros(SHAPE[:2], np.float32))
    return LayerModel(times, np.zeros(SHAPE, np.uint8), volume, whole, whole[..., 0], "samples", 0.0, closure)


def test_no_horizon_is_looked_for_in_a_mute() -> None:
    layers = layered({20: 5.0, 50: 3.0, 80: 2.0})
    below = np.broadcast_to(np.arange(SHAPE[2]) >= 30, SHAPE)
    assert find_seeds(replace(layers, valid=below), count=2)[:, 2].tolist() == [50.0, 80.0]


def test_strength_share_and_confidence_count_together() -> None:
    tracks = [track(10.0), track(40.0, share=0.5), track(70.0, confidence=0.4), track(90.0)]
    chosen = _choose(tracks, np.array([1.0, 3.0, 3.0, 0.2]), 4, spread=25.0)
    assert [float(np.nanmedian(one.depth)) for one in chosen] == [40.0, 70.0, 10.0, 90.0]


def test_horizons_spread_first_and_fill_up_then() -> None:
    tracks = [track(depth) for depth in (10.0, 16.0, 18.0, 60.0)]
    strengths = np.array([5.0, 4.0, 3.0, 1.0])
    # 60 before 16, which is nearer to 10 than half of the even distance; 18 runs along 16
    depths = [float(one.depth[0, 0]) for one in _choose(tracks, strengths, 4, spread=24.0)]
    assert depths == [10.0, 60.0, 16.0]
    assert _choose([], np.zeros(0), 3, spread=24.0) == []


@pytest.mark.parametrize("worse", [0, 1])
def test_horizons_do_not_cross(worse: int) -> None:
    upper, lower = track(30.0, confidence=0.8), track(50.0, confidence=0.8)
    depth, confidence = upper.depth.copy(), upper.confidence.copy()
    depth[2:4, 3:6], depth[7, 7], depth[9, :2] = 50.5, 60.0, 49.0
    confidence[:5] = 0.9 if worse else 0.7
    parted = _part([replace(upper, depth=depth, confidence=confidence), lower], least=1.0)
    left_out = np.zeros((2, 10, 10), bool)
    left_out[worse, 2:4, 3:6] = left_out[1, 7, 7] = True  # alike: the later one
    for one, whole, out in zip(parted, (depth, lower.depth), left_out, strict=True):
        np.testing.assert_array_equal(one.depth, np.where(out, np.nan, whole))
        np.testing.assert_array_equal(np.isfinite(one.confidence), ~out)


def test_horizons_without_a_common_trace_stay() -> None:
    one, other = track(30.0), track(30.0)
    one.depth[:5], other.depth[5:] = np.nan, np.nan
    parted = _part([one, other], least=1.0)
    np.testing.assert_array_equal([x.depth for x in parted], [one.depth, other.depth])


def test_a_horizon_that_was_followed_nowhere_is_not_chosen() -> None:
    assert _choose([track(10.0, share=0.0)], np.array([5.0]), 1, spread=10.0) == []


def test_seeds_are_the_strongest_events_off_the_ends_whatever_their_sign() -> None:
    layers = layered({3: 9.0, 20: -4.0, 23: 3.5, 50: 2.0, 70: 1.0, 93: 9.0})
    seeds, strengths = _rank_seeds(layers, 3, gap=5.0)
    assert seeds[:, 2].tolist() == [20.0, 50.0, 70.0]
    assert strengths == pytest.approx([4.0, 2.0, 1.0])
    assert find_seeds(layers, count=2)[:, 2].tolist() == [20.0, 50.0]
