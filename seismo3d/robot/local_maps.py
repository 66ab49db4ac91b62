"""Local maps and how they are joined: a map for each stretch without a loss, one map where two show the same place.

After a long loss nothing says where a frame lies in the map, so that a new local map is begun. Its keyframes are
compared with those of the maps at rest by their looks; once two of them agree on where it lies, both become one: the
graph of all keyframes is solved with the older ones held, and the newer part is put into the older map.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import adjoint, invert_transform
from seismo3d.graph.poses import PoseGraph, solve_poses
from seismo3d.robot.closures import Closure, closure_information, correct_poses
from seismo3d.robot.ekf import log_motion
from seismo3d.robot.keyframes import Keyframe
from seismo3d.robot.landmarks import View
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.state import MapState
from seismo3d.robot.trajectory import Trajectory
from seismo3d.robot.tsdf import SurfaceMap

_LEAST_FRAMES = 10
"""A local map with fewer frames, that is lost, is given up where there is another one."""
_SAME_TURN, _SAME_SHIFT = 0.06, 0.12
"""Two keyframes agree on where a local map lies within this, rad and m."""

Fuse = Callable[[SurfaceMap, MapState, int], None]
"""Puts a kept frame of a state, by its row, into a surface."""


@dataclass(frozen=True, slots=True, eq=False)
class _Hint:
    """A keyframe of one map that shows what a keyframe of another one shows."""

    numbers: tuple[int, int]
    link: Closure
    T_target_source: Float64Array


class LocalMaps:
    """The local map that frames go into, and those at rest.

    Parameters
    ----------
    make : callable
        Returns an empty local map of a number.
    """

    def __init__(self, make: Callable[[int], MapState]) -> None:
        self.empty = make
        self.current = make(0)
        self.resting: list[MapState] = []
        self._n_made = 1
        self._hints: list[_Hint] = []

    @property
    def every(self) -> list[MapState]:
        """All local maps, by their number."""
        return sorted([self.current, *self.resting], key=lambda state: state.number)

    @property
    def trajectory(self) -> Trajectory:
        """Poses of all located frames, each in its local map."""
        rows = [(pose, state.number) for state in self.every for pose in state.poses]
        rows.sort(key=lambda row: row[0].frame)
        return Trajectory.of([pose for pose, _ in rows], maps=[number for _, number in rows])

    @property
    def graph(self) -> PoseGraph:
        """Graphs of all local maps, one after the other; nothing ties one to the other until they are joined."""
        poses: list[Float64Array] = []
        edges = []
        for state in self.every:
            graph, first = state.graph, len(poses)
            poses += list(graph.poses)
            parts = zip(graph.edges + first, graph.measured, graph.information, graph.doubtful)
            edges += [(int(i), int(j), T, W, bool(doubtful)) for (i, j), T, W, doubtful in parts]
        return PoseGraph.of(poses, edges)

    def begin(self) -> None:
        """Let the current map rest, and go on with an empty one."""
        if len(self.current.poses) >= _LEAST_FRAMES or not self.resting:
            self.resting.append(self.current)
        self.current = self.empty(self._n_made)
        self._n_made += 1

    def restore(self, states: list[MapState], current: int, n_made: int) -> None:
        """Take over local maps that were read; ``current`` is the place of the one that frames go into."""
        self.current = states[current]
        self.resting = [state for k, state in enumerate(states) if k != current]
        self._n_made = n_made

    def go_to(self, state: MapState) -> None:
        """Go on with a map, which may be one at rest."""
        if state is self.current:
            return
        self.resting = [other for other in self.resting if other is not state]
        if self.current.poses:
            self.resting.append(self.current)
        self.current = state

    def join_by(self, index: int, fuse: Fuse) -> Float64Array | None:
        """Compare a keyframe of the current map with the maps at rest, and join those that it, too, places.

        Returns
        -------
        ndarray of shape (4, 4), float64, or None
            Change of the current map's newest pose; None where nothing was joined.
        """
        change = None
        for other in list(self.resting):
            keyframe = self.current.memory.keyframes[index]
            places = other.memory.recall(keyframe.features, n_best=1).tolist() if other.memory.keyframes else []
            hint = self._compare(other, places[0], index, keyframe) if places else None
            if hint is None:
                continue
            agreeing = [h for h in self._hints if h.numbers == hint.numbers and _agree(h, hint)]
            self._hints.append(hint)
            if agreeing:
                moved = self._join(other, [*agreeing[-4:], hint], fuse)
                change = moved if change is None else moved @ change
        return change

    def join_all(self, fuse: Fuse) -> int:
        """Compare all keyframes of the current map with the maps at rest; return how many were joined."""
        before = len(self.resting)
        index = 0
        while self.resting and index < len(self.current.memory.keyframes):
            tried = {h.link.source for h in self._hints if h.numbers[1] == self.current.number}
            if index not in tried and self.join_by(index, fuse) is not None:
                index = -1  # the map has become another one
            index += 1
        return before - len(self.resting)

    def _compare(self, other: MapState, place: int, index: int, keyframe: Keyframe) -> _Hint | None:
        found = other.memory.compare(place, keyframe)
        if found is None:
            return None
        link = Closure(place, index, found.T_target_source, closure_information(found))
        between = other.memory.keyframes[place].T_world_camera @ found.T_target_source
        T = between @ invert_transform(keyframe.T_world_camera)
        return _Hint((other.number, self.current.number), link, T)

    def _join(self, other: MapState, hints: list[_Hint], fuse: Fuse) -> Float64Array:
        """Make one map of the current one (source of the hints) and another; return the newest pose's change."""
        current, T_other_current = self.current, hints[-1].T_target_source
        last = current.poses[-1].T_world_camera
        links = [hint.link for hint in hints]
        if other.number < current.number:
            base, part, T = other, current, T_other_current
        else:
            base, part, T = current, other, invert_transform(T_other_current)
            links = [turned(link) for link in links]
        absorb(base, part, T, links, fuse)
        base.part = current.part
        self.resting = [state for state in self.resting if state is not other]
        self.current = base
        self._hints = []
        newest = next(pose for pose in reversed(base.poses) if pose.part == base.part)
        return newest.T_world_camera @ invert_transform(last)


def absorb(base: MapState, part: MapState, T_base_part: Float64Array, links: list[Closure], fuse: Fuse) -> None:
    """Put a local map into another, which stays where it is.

    Parameters
    ----------
    base, part : MapState
        ``base`` is changed; ``part`` is of no use afterwards.
    T_base_part : ndarray of shape (4, 4), float64
        Where it lies, nearly; the links say exactly.
    links : list of Closure
        From keyframes of ``base`` to keyframes of ``part``.
    fuse : callable
    """
    first = len(base.memory.keyframes)
    base.joints += [replace(link, source=link.source + first) for link in links]
    base.joints += [replace(link, target=link.target + first, source=link.source + first) for link in part.joints]
    base.closures += [replace(link, target=link.target + first, source=link.source + first) for link in part.closures]
    for keyframe in part.memory.keyframes:
        base.memory.add(replace(keyframe, T_world_camera=T_base_part @ keyframe.T_world_camera))
    base.views += [view.moved(T_base_part) for view in part.views]
    graph = base.graph
    solution = solve_poses(graph, fixed=range(first))
    solved = solution.poses
    change_poses(part, np.array([invert_transform(T_base_part) @ T for T in solved[first:]]))
    base.memory.move(solved)
    base.views[first:] = _hung_on(base.views, [view.moved(T_base_part) for view in part.views], links)
    base.tie_covariances(graph, solution.weights, known=first)
    old, new = len(base.poses), [replace(p, T_world_camera=T_base_part @ p.T_world_camera) for p in part.poses]
    both = base.poses + new
    order = sorted(range(len(both)), key=lambda k: both[k].frame)
    row = {k: place for place, k in enumerate(order)}
    base.poses = [both[k] for k in order]
    kept = [replace(k, pose=row[k.pose]) for k in base.kept]
    joined = [replace(k, pose=row[k.pose + old]) for k in part.kept]
    base.packing = [*kept, *joined]
    for number in range(len(kept), len(base.packing)):
        fuse(base.surface, base, number)


def _hung_on(base: list[View], part: list[View], links: list[Closure]) -> list[View]:
    """Return a part's views with what the lens does to them told from where the base began: by the links' mean."""
    between = [base[link.target].errors.by_lens - part[link.source].errors.by_lens for link in links]
    off = PoseErrors(by_lens=np.mean(between, axis=0))
    return [replace(view, errors=view.errors.beyond(off)) for view in part]


def change_poses(state: MapState, key_poses: Float64Array) -> None:
    """Carry new poses of the keyframes (n, 4, 4) over to all that hangs on them, but the surface."""
    before = state.key_poses
    parts = np.array([k.part for k in state.memory.keyframes])
    keys = np.array([k.frame for k in state.memory.keyframes])
    frames = np.array([pose.frame for pose in state.poses])
    of_pose = np.array([pose.part for pose in state.poses])
    poses = np.array([pose.T_world_camera for pose in state.poses])
    for part in np.unique(parts):
        mine, held = of_pose == part, parts == part
        poses[mine] = correct_poses(poses[mine], frames[mine], before[held], key_poses[held], keys[held])
    state.poses = [replace(pose, T_world_camera=T) for pose, T in zip(state.poses, poses)]
    changes = [a @ invert_transform(b) for a, b in zip(key_poses, before)]
    state.views = [view.moved(change) for view, change in zip(state.views, changes)]
    state.memory.move(key_poses)


def _agree(one: _Hint, two: _Hint) -> bool:
    if one.link.source == two.link.source:
        return False
    off = log_motion(invert_transform(one.T_target_source) @ two.T_target_source)
    return bool(np.linalg.norm(off[:3]) < _SAME_TURN and np.linalg.norm(off[3:]) < _SAME_SHIFT)


def turned(link: Closure) -> Closure:
    """Return the same link seen from its other end."""
    T = link.T_target_source
    turn = adjoint(invert_transform(T))
    return Closure(link.source, link.target, invert_transform(T), turn.T @ link.information @ turn)
