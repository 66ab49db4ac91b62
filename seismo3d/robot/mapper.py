"""The mapper: frames in; poses, a dense map and remembered places out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import freeze
from seismo3d.errors import ParameterError
from seismo3d.geometry.rotations import invert_transform
from seismo3d.graph.poses import PoseGraph, solve_poses
from seismo3d.robot.calibration import calibrate_timing
from seismo3d.robot.camera import Camera, RgbdFrame, as_robot_camera
from seismo3d.robot.closures import find_closures, is_strained
from seismo3d.robot.ekf import MotionFilter, adjoint, exp_motion, log_motion
from seismo3d.robot.frames import Measured, Measurer, Timing
from seismo3d.robot.ground import make_ground, make_occupancy
from seismo3d.robot.keyframes import PlaceMemory
from seismo3d.robot.landmarks import Sightings
from seismo3d.robot.local_maps import LocalMaps, change_poses
from seismo3d.robot.locator import Locator, is_certain, is_sound
from seismo3d.robot.mesh import Mesh, extract_mesh
from seismo3d.robot.occupancy import Occupancy
from seismo3d.robot.recorder import Recorder
from seismo3d.robot.results import Closed, MapperSettings, Tracked
from seismo3d.robot.semantic_landmarks import LandmarkBook
from seismo3d.robot.state import MapState
from seismo3d.robot.tracking import Located
from seismo3d.robot.trajectory import TimedPose, Trajectory
from seismo3d.robot.tsdf import SurfaceMap

_LEAST_NORMALS = 300
_RELOCATE_EVERY = 4


class Mapper:
    """Maps frames of one or several cameras as they come.

    Parameters
    ----------
    camera : Camera, PinholeCamera, dict or object with its fields; or a sequence of them
        Several cameras sit on one body, each with its place on it and its own clock.
    settings : MapperSettings, optional

    Notes
    -----
    Each frame passes five steps: predict (filter), measure, locate (against the ray-cast map and the landmarks of the
    nearest views), update (filter), fuse. A frame that cannot be located is a state, not an error, and is not fused;
    the next ones are compared with the places that all local maps remember until one is found again. After a long loss
    a new local map is begun, and joined with an older one when two of its keyframes show places of it.
    """

    def __init__(self, camera: object, *, settings: MapperSettings | None = None) -> None:
        given = list(camera) if isinstance(camera, Sequence) else [camera]
        if not given:
            raise ParameterError("camera is an empty sequence; expected at least one camera.")
        self.cameras: list[Camera] = [as_robot_camera(c) for c in given]
        self.settings = settings or MapperSettings()
        self._n_threads = self.settings.n_threads or min(8, os.cpu_count() or 1)
        self._pool = ThreadPoolExecutor(self._n_threads, thread_name_prefix="seismo3d-map")
        self._start_afresh()
        open_ends = [c.readout is None or c.depth_delay is None for c in self.cameras]
        self._rehearsal: list[RgbdFrame] | None = [] if any(open_ends) and self.settings.calibrate_frames else None

    def add(self, frame: RgbdFrame) -> Tracked:
        """Map a frame.

        Parameters
        ----------
        frame : RgbdFrame
            In the order of time; frames of several cameras may interleave.

        Returns
        -------
        Tracked
            Never an exception for a frame that cannot be located: its state says so.

        Raises
        ------
        ShapeError
            If the images do not fit each other or the camera.
        ParameterError
            If there is no such camera.
        """
        if not 0 <= frame.camera < len(self.cameras):
            raise ParameterError(
                f"frame.camera is {frame.camera}; the mapper has cameras 0 to {len(self.cameras) - 1}."
            )
        tracked = self._map(frame)
        if self._rehearsal is not None:
            self._rehearsal.append(frame)
            if len(self._rehearsal) >= self.settings.calibrate_frames:
                return self._calibrate(tracked)
        return tracked

    @property
    def state(self) -> MapState:
        """The local map that frames go into."""
        return self.maps.current

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the located frames."""
        return self.maps.trajectory

    @property
    def graph(self) -> PoseGraph:
        """Keyframes of all local maps as poses; their order, the closures and the joints found so far as edges."""
        return self.maps.graph

    def mesh(self) -> Mesh:
        """Return the mapped surface as triangles with colours: of the current local map, as all that follow."""
        return extract_mesh(self.state.surface)

    def occupancy(self, *, cell: float = 0.05) -> Occupancy:
        """Return the map from above: free, occupied, unknown; see :func:`seismo3d.robot.ground.make_occupancy`."""
        return make_occupancy(self.mesh(), cell=cell)

    def elevation(self, *, cell: float = 0.05) -> Any:
        """Return the mapped ground as an elevation map; see :func:`seismo3d.robot.ground.make_ground`."""
        return make_ground(self.mesh(), cell=cell)

    def close_loops(self) -> Closed:
        """Find keyframes that show the same place, solve the graph of all, and make the map anew from its poses.

        Local maps at rest that show a place of the current one are joined with it first.

        Returns
        -------
        Closed
            Poses and map change only where the trajectory strains a closure by more than its covariance explains.
        """
        n_joined = self.maps.join_all(self._recorder.put)
        state = self.state
        state.closures = find_closures(state.memory)
        n_links = len(state.closures) + len(state.joints)
        if n_links == 0:
            return Closed(0, 0, 0.0, 0.0)
        graph = state.graph
        solved = solve_poses(graph)
        n_kept = int((solved.weights[-n_links:] > 0.25).sum())
        if not is_strained(graph, solved.weights):
            return Closed(n_links, n_kept, 0.0, 0.0, n_joined)
        change = [log_motion(invert_transform(a) @ b) for a, b in zip(graph.poses, solved.poses)]
        self._move_to(solved.poses)
        turn, shift = (float(max(np.linalg.norm(c[part]) for c in change)) for part in (slice(3), slice(3, 6)))
        return Closed(n_links, n_kept, turn, shift, n_joined)

    def save(self, path: str | Path) -> Path:
        """Write all that is needed to go on mapping to an .npz file; see :func:`Mapper.load`."""
        from seismo3d.robot.storage import save_mapper

        return save_mapper(path, self)

    @classmethod
    def load(cls, path: str | Path) -> Mapper:
        """Read a map and go on with it: the next frame is looked for near the last pose, then in all places.

        Raises
        ------
        FileAccessError, FormatError
            If the file cannot be read, or is not such a map.
        """
        from seismo3d.robot.storage import load_mapper

        return load_mapper(path, cls)

    def _start_afresh(self) -> None:
        s = self.settings
        self._measurers = [Measurer(camera.lens, s.measure, self._pool) for camera in self.cameras]
        self._locator = Locator(self.cameras, s, self._pool, self._n_threads)
        self.maps = LocalMaps(self._empty_map)
        self.n_frames = 0
        self._n_lost = self._n_unplaced = 0
        self._recorder = Recorder(self.cameras, s, self._measurers, self._locator, self._pool, self._n_threads)
        self._filter: MotionFilter | None = None
        self._book = LandmarkBook()

    def _empty_map(self, number: int) -> MapState:
        s = self.settings
        surface = SurfaceMap(s.voxel_size, s.band_voxels * s.voxel_size)
        lenses = [camera.lens for camera in self.cameras]
        return MapState(surface, PlaceMemory(lenses), number=number, part=number)

    def _map(self, frame: RgbdFrame) -> Tracked:
        camera = self.cameras[frame.camera]
        number, self.n_frames = self.n_frames, self.n_frames + 1
        timing = Timing(camera.readout or 0.0, frame.time - frame.depth_time + (camera.depth_delay or 0.0))
        motion = self._predict(frame, camera)
        measured = self._measurers[frame.camera].measure(frame, _camera_twist(motion, camera), timing)
        motion, T, seen = self._sight(measured, frame.camera, motion, timing)
        state, located = "empty", None
        if measured.n_normals >= _LEAST_NORMALS:
            state, located = self._place(measured, frame.camera, T, seen, timing)
            motion = self._filter or motion
        twist = _camera_twist(motion, camera)
        if state in ("lost", "empty"):
            self._lose(motion, state)
        else:
            T = T if located is None else located.T_world_camera
            self._n_lost = self._n_unplaced = 0
            stamp = frame.time + camera.clock_offset
            self.state.poses.append(TimedPose(stamp, motion.time, T, twist, number, frame.camera, self.state.part))
            change = self._record(measured, frame.camera, T, twist, timing, number)
            if change is not None:
                state, T = "joined", change @ T
        T_stamp = T @ exp_motion(twist * (timing.colour_lead + 0.5 * timing.readout))
        covariance = freeze(motion.covariance[:6, :6].copy())
        return Tracked(state, freeze(T_stamp), covariance, located, self.state.number)

    def _lose(self, motion: MotionFilter, state: str) -> None:
        self._n_lost += 1
        self._n_unplaced += state == "lost"
        if not self._book.sees_any:
            motion.twist *= 0.95
        if not self.state.poses:
            self._filter = None

    def _predict(self, frame: RgbdFrame, camera: Camera) -> MotionFilter:
        now = frame.depth_time + camera.clock_offset - (camera.depth_delay or 0.0) - 0.5 * (camera.readout or 0.0)
        if self._filter is None:
            T = invert_transform(camera.T_body_camera)
            if self.state.poses:  # a map that was read: near its last pose
                T = self.state.poses[-1].T_world_camera @ T
            self._filter = MotionFilter(now, T)
        if not self.settings.filtered:
            self._filter.twist[:] = 0.0
        self._filter.predict(now)
        return self._filter

    def _sight(
        self, measured: Measured, number: int, motion: MotionFilter, timing: Timing
    ) -> tuple[MotionFilter, Float64Array, Sightings]:
        """Update the filter by its landmarks; return it, the camera's pose, and the sightings that are left."""
        camera = self.cameras[number]
        T, twist = motion.T_world_body @ camera.T_body_camera, _camera_twist(motion, camera)
        seen = self._locator.sight(self.state, measured, number, T, twist, timing, also=self._book.names)
        if not (self.settings.filtered and self.settings.landmarks_in_state):
            return motion, T, seen
        own = self._book.take_in(motion, seen, camera.lens, camera.T_body_camera)
        return motion, motion.T_world_body @ camera.T_body_camera, seen.only(~own)

    def _place(
        self, measured: Measured, number: int, T: Float64Array, seen: Sightings, timing: Timing
    ) -> tuple[str, Located | None]:
        """Locate a frame near the predicted pose, else at a place that looks like it, else begin a new local map."""
        if not self.state.poses:
            return "started", None
        located = self._locator.locate(self.state, measured, number, T, seen)
        sound = is_sound(located, T, n_lost=self._n_lost)
        if not (sound and is_certain(located)):
            found = self._place_elsewhere(measured, number, timing, located.share + 0.1 if sound else 0.0)
            if found is not None:
                return found
        if sound:
            self._take(located, number, seen)
            return "tracked", located
        if self._n_unplaced + 1 >= self.settings.new_map_after > 0:
            self.maps.begin()
            self._go_on(self.state, T, number)
            return "started", None
        return "lost", located

    def _place_elsewhere(
        self, measured: Measured, number: int, timing: Timing, least_share: float
    ) -> tuple[str, Located] | None:
        """Locate a frame at a place that looks like it: when it fits badly, and now and then after a loss."""
        if self._n_lost >= _RELOCATE_EVERY and self._n_lost % _RELOCATE_EVERY:
            return None
        for state, place in self._locator.places(self.maps.every[::-1], measured, number):
            there = self._locator.sight(state, measured, number, place, np.zeros(6), timing)
            again = self._locator.locate(state, measured, number, place, there)
            if again.share > max(0.4, least_share) and is_sound(again, place, n_lost=self._n_lost):
                if state is self.state and self._n_lost == 0:  # it moved faster than foreseen: that says how fast
                    self._take(again, number, there)
                    return "tracked", again
                self._go_on(state, again.T_world_camera, number)
                return "relocated", again
        return None

    def _take(self, located: Located, number: int, seen: Sightings) -> None:
        """Take a located frame into the filter; the pose is the registration's, so that it fits the map."""
        if self._filter is None:
            return
        T_world_body = located.T_world_camera @ invert_transform(self.cameras[number].T_body_camera)
        self._filter.update(T_world_body, located.covariance, gate=None)
        self._filter.T_world_body = T_world_body
        if self.settings.filtered and self.settings.landmarks_in_state and len(seen):
            self._book.learn(self._filter, seen, located.landmark_weights, located.T_world_camera)

    def _go_on(self, state: MapState, T_world_camera: Float64Array, number: int) -> None:
        """Go on from a pose in a local map, with nothing known of the velocity."""
        if state is not self.state:
            self.maps.go_to(state)
        T_world_body = T_world_camera @ invert_transform(self.cameras[number].T_body_camera)
        self._book.forget(None)
        self._filter = MotionFilter(0.0 if self._filter is None else self._filter.time, T_world_body)
        self._recorder.forget()

    def _record(
        self, measured: Measured, number: int, T: Float64Array, twist: Float64Array, timing: Timing, frame: int
    ) -> Float64Array | None:
        """Put a located frame into the map; return the change of its pose where that joined the map with another."""
        new = self._recorder.record(self.state, measured, number, T, twist, timing, frame)
        if not (new and self.maps.resting):
            return None
        change = self.maps.join_by(len(self.state.memory.keyframes) - 1, self._recorder.put)
        if change is not None:
            self._shift(change)
        return change

    def _shift(self, change: Float64Array) -> None:
        """Carry a change of the world's frame where the camera is now over to the filter."""
        self._book.forget(self._filter)
        if self._filter is not None:
            self._filter.T_world_body = change @ self._filter.T_world_body
        self._recorder.forget()

    def _calibrate(self, tracked: Tracked) -> Tracked:
        """Find the open timing of each camera from the frames so far, and map them anew with it."""
        frames, self._rehearsal = self._rehearsal or [], None
        changed = False
        for number, camera in enumerate(self.cameras):
            if camera.readout is not None and camera.depth_delay is not None:
                continue
            found = calibrate_timing([frame for frame in frames if frame.camera == number], camera)
            changed |= (found.readout, found.depth_delay) != (camera.readout or 0.0, camera.depth_delay or 0.0)
            self.cameras[number] = found.applied(camera)
        if not changed:
            return tracked
        self._start_afresh()
        for frame in frames:
            tracked = self._map(frame)
        return tracked

    def _move_to(self, key_poses: Float64Array) -> None:
        """Carry everything over to corrected keyframes, and make the map anew from the frames that are kept."""
        state = self.state
        last = state.poses[-1].T_world_camera
        change_poses(state, key_poses)
        self._recorder.remake(state)
        self._shift(state.poses[-1].T_world_camera @ invert_transform(last))


def _camera_twist(motion: MotionFilter, camera: Camera) -> Float64Array:
    """Velocity of a camera in its own frame."""
    return adjoint(invert_transform(camera.T_body_camera)) @ motion.twist
