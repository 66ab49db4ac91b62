"""A long loss, a new local map, and the two made one: the camera comes back after a stretch in the dark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, invert_transform, make_transform
from seismo3d.graph.poses import edge_errors
from seismo3d.robot import Camera, Mapper, MapperSettings, RgbdFrame, Tracked
from seismo3d.robot.closures import Closure
from seismo3d.robot.keyframes import CommonPoints, align_common
from seismo3d.robot.local_maps import turned
from seismo3d.synthetic.rgbd import RgbdSequence, rgbd_sequence

DARK = -1
AWAY = [*range(0, 30, 2), *[DARK] * 6, *range(110, 170, 2)]
"""Frames of a walk: one wall, in the dark, the wall opposite."""
BACK = [*range(170, 240, 2), *range(0, 30, 2)]


@pytest.fixture(scope="module")
def sequence() -> RgbdSequence:
    return rgbd_sequence("room", frames=240, size=(240, 180), period=8.0, seed=3)


def new_mapper(sequence: RgbdSequence) -> Mapper:
    settings = MapperSettings(voxel_size=0.02, keep_every=2, new_map_after=5)
    return Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)


def walk(mapper: Mapper, sequence: RgbdSequence, order: list[int], *, first: int = 0) -> list[Tracked]:
    found = []
    for k, number in enumerate(order, start=first):
        frame = sequence[max(number, 0)]
        seen = number != DARK
        shown = RgbdFrame.of(frame.colour * seen, np.nan_to_num(frame.depth) * seen, 1000.0 + k / 30.0)
        found.append(mapper.add(shown))
    return found


def shift_errors(mapper: Mapper, sequence: RgbdSequence, order: list[int]) -> np.ndarray:
    found = mapper.trajectory
    first = invert_transform(sequence.poses[0])
    truth = np.array([(first @ sequence.poses[order[frame]])[:3, 3] for frame in found.frames])
    return np.asarray(np.linalg.norm(found.T_world_camera[:, :3, 3] - truth, axis=1))


@pytest.fixture(scope="module")
def away(sequence: RgbdSequence, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Tracked]]:
    """The map after the walk to the other wall, saved, and what became of its frames."""
    mapper = new_mapper(sequence)
    states = walk(mapper, sequence, AWAY)
    return mapper.save(tmp_path_factory.mktemp("map") / "away.npz"), states


def test_an_unseen_place_after_a_loss_becomes_a_new_local_map(away: tuple[Path, list[Tracked]]) -> None:
    path, found = away
    states = [t.state for t in found]
    assert states[:21] == ["started", *["tracked"] * 14, *["empty"] * 6]
    assert states[21:25] == ["lost"] * 4
    assert states[25] == "started"
    assert set(states[26:]) == {"tracked"}
    assert [t.local_map for t in found] == [0] * 25 + [1] * (len(found) - 25)
    mapper = Mapper.load(path)
    assert mapper.trajectory.maps.tolist() == [0] * 15 + [1] * (len(found) - 25)
    assert [len(state.poses) for state in mapper.maps.every] == [15, len(found) - 25]
    # nothing ties the two graphs together
    joined = mapper.graph.edges < len(mapper.maps.every[0].key_poses)
    assert (joined[:, 0] == joined[:, 1]).all()


def test_a_new_map_begins_in_motion(sequence: RgbdSequence, away: tuple[Path, list[Tracked]]) -> None:
    """Its second frame has turned by 3.7 degrees since the first one, and nothing foretold it."""
    found, truth = away[1][25:35], sequence.poses[AWAY[25:35]]
    assert found[0].state == "started"
    for tracked, T in zip(found, truth):
        between = invert_transform(truth[0]) @ T
        since = invert_transform(found[0].T_world_camera) @ tracked.T_world_camera
        assert np.linalg.norm((since - between)[:3, 3]) < 0.01


def test_local_maps_become_one_when_the_old_place_is_seen_again(
    sequence: RgbdSequence, away: tuple[Path, list[Tracked]]
) -> None:
    mapper = Mapper.load(away[0])
    found = walk(mapper, sequence, BACK, first=len(AWAY))
    states = [t.state for t in found]
    assert states.count("joined") == 1
    at = states.index("joined")
    assert set(states[:at]) | set(states[at + 1 :]) == {"tracked"}
    assert [t.local_map for t in found] == [1] * at + [0] * (len(found) - at)
    assert not mapper.maps.resting
    trajectory = mapper.trajectory
    assert trajectory.maps.tolist() == [0] * len(trajectory)
    assert (np.diff(trajectory.frames) > 0).all()
    # all poses are in the first frame's world: the filter's guess across the dark was wrong by metres
    # (a joint is good to 8 mm and 6 mrad, which carry over 3 m), and the first one after a pause to begin with, too
    assert shift_errors(mapper, sequence, AWAY + BACK).max() < 0.02
    assert len(mapper.state.joints) >= 2
    errors = edge_errors(mapper.graph, mapper.graph.poses)
    assert np.linalg.norm(errors[:, 3:], axis=1).max() < 0.03
    # one surface, true all over: the second part was put into the first map's
    points = mapper.mesh().points
    T = sequence.poses[0]
    off = np.abs(sequence.scene.distance_to_surface((points @ T[:3, :3].T + T[:3, 3])[::5]))
    assert np.median(off) < 0.005
    assert np.percentile(off, 99) < 0.04
    closed = mapper.close_loops()
    assert closed.n_agreeing >= 2
    assert shift_errors(mapper, sequence, AWAY + BACK).max() < 0.05


def test_seeing_the_old_place_after_a_second_loss_goes_on_with_the_old_map(
    sequence: RgbdSequence, away: tuple[Path, list[Tracked]]
) -> None:
    mapper = Mapper.load(away[0])
    after = [DARK] * 3 + list(range(4, 24, 2))
    found = walk(mapper, sequence, after, first=len(AWAY))
    states = [t.state for t in found]
    assert "relocated" in states
    at = states.index("relocated")
    assert found[at].local_map == 0
    assert {t.local_map for t in found[at:]} == {0}
    trajectory = mapper.trajectory
    old = trajectory.maps == 0
    order = np.array(AWAY + after)[trajectory.frames[old]]
    truth = invert_transform(sequence.poses[0]) @ sequence.poses[order]
    assert np.linalg.norm((trajectory.T_world_camera[old] - truth)[:, :3, 3], axis=1).max() < 0.03
    assert set(np.unique(trajectory.maps)) == {0, 1}


def test_maps_that_show_nothing_in_common_stay_apart(away: tuple[Path, list[Tracked]]) -> None:
    mapper = Mapper.load(away[0])
    closed = mapper.close_loops()
    assert closed.n_joined == 0
    assert len(mapper.maps.resting) == 1


def test_pairs_in_common_are_found_among_strangers(rng: np.random.Generator) -> None:
    T = make_transform(exp_rotation([0.3, -0.5, 0.2]), [0.4, -0.1, 0.2])
    source = rng.uniform([-1.0, -1.0, 1.0], [1.0, 1.0, 3.0], (40, 3))
    target = source @ T[:3, :3].T + T[:3, 3]
    target[22:] = rng.uniform([-1.0, -1.0, 1.0], [1.0, 1.0, 3.0], (18, 3))
    found = align_common(CommonPoints(target, source, np.full(40, 0.03)))
    assert found is not None
    np.testing.assert_allclose(found, T, atol=1e-2)
    assert align_common(CommonPoints(target[22:], source[22:], np.full(18, 0.03))) is None
    assert align_common(CommonPoints(target[:5], source[:5], np.full(5, 0.03))) is None


def test_a_link_seen_from_its_other_end_weighs_the_same(rng: np.random.Generator) -> None:
    T = make_transform(exp_rotation([0.3, -0.5, 0.2]), [0.4, -0.1, 0.2])
    A = rng.normal(size=(6, 6))
    link = Closure(3, 7, T, A @ A.T + np.eye(6))
    back = turned(link)
    assert (back.target, back.source) == (7, 3)
    np.testing.assert_allclose(turned(back).information, link.information, rtol=1e-9)
    # one small error of the relative pose costs the same from both ends
    from seismo3d.robot.ekf import exp_motion, log_motion

    off = exp_motion(1e-5 * rng.normal(size=6))
    e = log_motion(invert_transform(T) @ (T @ off))
    f = log_motion(invert_transform(back.T_target_source) @ invert_transform(T @ off))
    assert f @ back.information @ f == pytest.approx(e @ link.information @ e, rel=1e-3)
