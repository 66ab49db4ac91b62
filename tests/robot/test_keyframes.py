from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, invert_transform, make_transform, rotation_angle
from seismo3d.graph.poses import solve_poses
from seismo3d.registration.register import register
from seismo3d.robot import keyframes
from seismo3d.robot.closures import correct_poses, find_closures, make_graph
from seismo3d.robot.keyframes import PlaceMemory, make_keyframe
from seismo3d.synthetic.rgbd import RgbdSequence, rgbd_sequence


@pytest.fixture(scope="module")
def sequence() -> RgbdSequence:
    return rgbd_sequence("room", frames=60, size=(320, 240), period=12.0, seed=5)


def remember(sequence: RgbdSequence, order: list[int], drift: np.ndarray) -> tuple[PlaceMemory, np.ndarray]:
    """Keyframes of some frames, each displaced by one more drift; and the true poses."""
    memory = PlaceMemory([sequence.camera])
    truth = np.array([sequence.poses[k] for k in order])
    off = np.eye(4)
    for number, k in enumerate(order):
        frame = sequence[k]
        depth = np.nan_to_num(frame.depth)
        grey = frame.colour.mean(axis=2).astype(np.uint8)
        memory.add(make_keyframe(number, 0, truth[number] @ off, grey, depth))
        off = off @ drift
    return memory, truth


def shift_errors(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    first = poses[0] @ invert_transform(truth[0])
    return np.linalg.norm((poses - first @ truth)[:, :3, 3], axis=1)


def test_closures_take_the_drift_out_of_a_way_there_and_back(sequence: RgbdSequence) -> None:
    order = [0, 8, 16, 24, 32, 40, 36, 28, 20, 12, 4, 1]
    drift = make_transform(exp_rotation([0.0, 0.003, 0.0]), [0.005, 0.0, 0.003])
    memory, truth = remember(sequence, order, drift)
    closures = find_closures(memory, gap=6, every=1)
    assert len(closures) >= 3
    for closure in closures:
        exact = invert_transform(truth[closure.target]) @ truth[closure.source]
        between = invert_transform(exact) @ closure.T_target_source
        assert np.linalg.norm(between[:3, 3]) < 0.03
        assert rotation_angle(between[:3, :3]) < 0.02
    before = np.array([k.T_world_camera for k in memory.keyframes])
    solved = solve_poses(make_graph(before, closures))
    assert shift_errors(before, truth).max() > 0.04
    assert shift_errors(solved.poses, truth).max() < 0.5 * shift_errors(before, truth).max()


def test_the_place_that_looks_alike_is_found_without_a_pose(sequence: RgbdSequence) -> None:
    memory, truth = remember(sequence, [0, 20, 40, 59], np.eye(4))
    frame = sequence[22]
    asked = make_keyframe(0, 0, np.eye(4), frame.colour.mean(axis=2).astype(np.uint8), np.nan_to_num(frame.depth))
    place = int(memory.recall(asked.features)[0])
    assert place == 1
    found = memory.compare(place, asked)
    assert found is not None
    between = invert_transform(truth[place] @ found.T_target_source) @ sequence.poses[22]
    assert np.linalg.norm(between[:3, 3]) < 0.03


def test_a_place_that_is_one_of_several_closes_no_loop(sequence: RgbdSequence, monkeypatch: pytest.MonkeyPatch) -> None:
    memory, _ = remember(sequence, [20], np.eye(4))
    frame = sequence[22]
    asked = make_keyframe(0, 0, np.eye(4), frame.colour.mean(axis=2).astype(np.uint8), np.nan_to_num(frame.depth))
    assert memory.compare(0, asked) is not None

    def one_of_several(*scans: Any, **settings: Any) -> Any:
        return replace(register(*scans, **settings), state="ambiguous")

    monkeypatch.setattr(keyframes, "register", one_of_several)
    assert memory.compare(0, asked) is None


def test_other_places_are_refused(sequence: RgbdSequence) -> None:
    memory, _ = remember(sequence, [0], np.eye(4))
    elsewhere = rgbd_sequence("terrain", frames=1, size=(320, 240), seed=2)[0]
    asked = make_keyframe(
        0, 0, np.eye(4), elsewhere.colour.mean(axis=2).astype(np.uint8), np.nan_to_num(elsewhere.depth)
    )
    assert memory.compare(0, asked) is None
    nothing = make_keyframe(0, 0, np.eye(4), None, np.zeros((240, 320)))
    assert memory.compare(0, nothing) is None


def test_corrections_spread_evenly_between_keyframes() -> None:
    before = np.array([np.eye(4)] * 3)
    after = before.copy()
    after[1, 0, 3], after[2, 0, 3] = 1.0, 1.0
    frames = np.arange(7)
    T = np.array([np.eye(4)] * 7)
    moved = correct_poses(T, frames, before, after, np.array([0, 2, 4]))
    np.testing.assert_allclose(moved[:, 0, 3], [0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0], atol=1e-12)
