"""Where a frame is placed after the camera was carried elsewhere."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from seismo3d.geometry.rotations import make_transform
from seismo3d.robot import Camera, Mapper, MapperSettings, RgbdFrame, follower
from seismo3d.robot.frames import Measurer
from seismo3d.robot.locator import Locator
from seismo3d.robot.tracking import Located
from seismo3d.synthetic.rgbd import RgbdSequence, rgbd_sequence


@pytest.fixture(scope="module")
def turn() -> tuple[RgbdSequence, list[RgbdFrame]]:
    """Sixty frames of a room, a sixth of the way round."""
    sequence = rgbd_sequence("room", frames=60, size=(160, 120), period=12.0, seed=3)
    return sequence, [RgbdFrame.of(f.colour, f.depth, f.stamp) for f in sequence]


def map_turn(turn: tuple[RgbdSequence, list[RgbdFrame]]) -> Mapper:
    sequence, frames = turn
    settings = MapperSettings(voxel_size=0.02, keep_every=2)
    mapper = Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)
    for frame in frames:
        assert mapper.add(frame).is_located
    mapper.settle()
    return mapper


def carried_back(turn: tuple[RgbdSequence, list[RgbdFrame]], number: int, late: int) -> RgbdFrame:
    """A frame of the turn's beginning, so many frames after its end."""
    frames = turn[1]
    return replace(frames[number], time=frames[-1].time + late / 30.0, depth_time=frames[-1].time + late / 30.0)


def double_map(mapper: Mapper, shift: np.ndarray) -> None:
    """Let a map show all that it shows at another place as well."""
    state, lens, settings = mapper.state, mapper.cameras[0].lens, mapper.settings
    with ThreadPoolExecutor(1) as pool:
        measurer = Measurer(lens, settings.measure, pool)
        for kept in state.kept:
            T = shift @ state.poses[kept.pose].T_world_camera
            state.surface.fuse(kept.unpacked(measurer), lens, T, carve=False, pool=pool, n_threads=1)
    for keyframe in list(state.memory.keyframes):
        state.memory.add(replace(keyframe, T_world_camera=shift @ keyframe.T_world_camera))
    state.views += [view.moved(shift) for view in state.views]


def test_a_frame_that_is_not_found_at_once_is_looked_for_from_where_the_first_look_led(
    turn: tuple[RgbdSequence, list[RgbdFrame]], monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence, frames = turn
    mapper = map_turn((sequence, frames[:30]))
    judge, starts, locate = follower.is_sound, [], Locator.locate
    monkeypatch.setattr(Locator, "places", lambda *_: [])
    monkeypatch.setattr(follower, "is_sound", lambda *a, **more: len(starts) > 1 and judge(*a, **more))

    def watched(self: Locator, *given: Any, **more: Any) -> Located:
        starts.append(given[3])
        return locate(self, *given, **more)

    monkeypatch.setattr(Locator, "locate", watched)
    tracked = mapper.add(frames[30])
    truth = np.linalg.inv(sequence.poses[0]) @ sequence.poses[30]
    assert tracked.state == "tracked"
    assert len(starts) == 2
    off = [np.linalg.norm(T[:3, 3] - truth[:3, 3]) for T in starts]
    assert off[1] < max(0.5 * off[0], 0.01)  # from where the first look led, not from what was expected
    assert not np.array_equal(starts[0], starts[1])
    np.testing.assert_allclose(tracked.T_world_camera[:3, 3], truth[:3, 3], atol=0.02)


def test_a_leap_within_a_map_says_nothing_of_the_speed(turn: tuple[RgbdSequence, list[RgbdFrame]]) -> None:
    mapper = map_turn(turn)
    found = [mapper.add(carried_back(turn, 5 + k, 1 + k)) for k in range(4)]
    assert [tracked.state for tracked in found] == ["relocated", *["tracked"] * 3]
    truth = np.linalg.inv(turn[0].poses[0]) @ turn[0].poses[8]
    np.testing.assert_allclose(found[-1].T_world_camera[:3, 3], truth[:3, 3], atol=0.02)


def test_where_two_places_look_alike_a_frame_is_placed_at_neither(
    turn: tuple[RgbdSequence, list[RgbdFrame]],
) -> None:
    mapper = map_turn(turn)
    double_map(mapper, make_transform(np.eye(3), [0.0, 0.0, 15.0]))
    before = mapper.state.surface.n_blocks
    assert mapper.add(carried_back(turn, 5, 1)).state == "lost"
    assert mapper.state.surface.n_blocks == before
