"""The mapper: frames in; poses, a dense map and remembered places out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._settings import as_settings
from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_kind, freeze
from seismo3d.errors import ParameterError
from seismo3d.geometry.rotations import invert_transform
from seismo3d.graph.poses import PoseGraph, solve_poses
from seismo3d.robot.calibration import calibrate_timing
from seismo3d.robot.camera import Camera, RgbdFrame, as_robot_camera
from seismo3d.robot.closures import LEAST_WEIGHT, find_closures, is_strained
from seismo3d.robot.ekf import exp_motion, log_motion
from seismo3d.robot.follower import Follower
from seismo3d.robot.frames import Measurer, Timing
from seismo3d.robot.ground import UPWARD, make_ground, make_occupancy
from seismo3d.robot.keyframes import PlaceMemory
from seismo3d.robot.local_maps import LocalMaps, change_poses
from seismo3d.robot.locator import Locator
from seismo3d.robot.mesh import Mesh, extract_mesh
from seismo3d.robot.occupancy import Occupancy
from seismo3d.robot.recorder import Recorder
from seismo3d.robot.results import Closed, MapperSettings, Tracked
from seismo3d.robot.state import MapState
from seismo3d.robot.trajectory import TimedPose, Trajectory
from seismo3d.robot.tsdf import SurfaceMap


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
        self.settings = as_settings(settings, MapperSettings)
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
            If there is no such camera, or `frame` is no :class:`~seismo3d.robot.RgbdFrame`.
        """
        as_kind(frame, RgbdFrame, "frame", remedy="Give seismo3d.robot.RgbdFrame.of(rgb, depth, time).")
        if not 0 <= frame.camera < len(self.cameras):
            raise ParameterError(
                f"frame.camera is {frame.camera}; the mapper has cameras 0 to {len(self.cameras) - 1}. "
                "Give the mapper all cameras of the rig."
            )
        tracked = self._map(frame)
        if self._rehearsal is not None:
            self._rehearsal.append(frame)
            if len(self._rehearsal) >= self.settings.calibrate_frames:
                return self._calibrate(tracked)
        return tracked

    def settle(self) -> None:
        """Wait until nothing goes on beside the frames: the last one is fused, places are described, frames packed.

        What reads the map waits for as much of that as it needs by itself.
        """
        for state in self.maps.every:
            state.settle()

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

    def occupancy(self, *, cell: float = 0.05, up: ArrayLike = UPWARD) -> Occupancy:
        """Return the map from above: free, occupied, unknown; see :func:`seismo3d.robot.ground.make_occupancy`."""
        return make_occupancy(self.mesh(), cell=cell, up=up)

    def elevation(self, *, cell: float = 0.05, up: ArrayLike = UPWARD) -> Any:
        """Return the mapped ground as an elevation map; see :func:`seismo3d.robot.ground.make_ground`."""
        return make_ground(self.mesh(), cell=cell, up=up)

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
        n_kept = int((solved.weights[-n_links:] > LEAST_WEIGHT).sum())
        state.tie_covariances(graph, solved.weights)
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
        # one thread has nothing beside it
        beside = ThreadPoolExecutor(1, thread_name_prefix="seismo3d-measure") if self._n_threads > 1 else None
        self._measurers = [Measurer(camera.lens, s.measure, self._pool, beside) for camera in self.cameras]
        locator = Locator(self.cameras, s, self._pool, self._n_threads)
        self.maps = LocalMaps(self._empty_map)
        self._follower = Follower(self.cameras, s, locator, self.maps)
        self.n_frames = 0
        self._recorder = Recorder(self.cameras, s, self._measurers, locator, self._pool, self._n_threads)

    def _empty_map(self, number: int) -> MapState:
        s = self.settings
        surface = SurfaceMap(s.voxel_size, s.band_voxels * s.voxel_size)
        lenses = [camera.lens for camera in self.cameras]
        return MapState(surface, PlaceMemory(lenses), number=number, part=number)

    def _map(self, frame: RgbdFrame) -> Tracked:
        camera, follower = self.cameras[frame.camera], self._follower
        number, self.n_frames = self.n_frames, self.n_frames + 1
        timing = Timing(camera.readout or 0.0, frame.time - frame.depth_time + (camera.depth_delay or 0.0))
        follower.predict(frame)
        coming = self._measurers[frame.camera].begin(frame, follower.twist(frame.camera), timing)
        state, located, T = follower.find(coming, frame.camera, timing)
        motion, twist = follower.motion, follower.twist(frame.camera)
        if state in ("started", "relocated", "sliding"):
            self._recorder.forget()
        if state in ("lost", "empty"):
            follower.lose(state)
        else:
            follower.n_lost = follower.n_unplaced = 0
            stamp = frame.time + camera.clock_offset
            self.state.poses.append(TimedPose(stamp, motion.time, T, twist, number, frame.camera, self.state.part))
            new = self._recorder.record(
                self.state, coming.measured(), frame.camera, T, twist, timing, number, motion.errors
            )
            change = self._join() if new and self.maps.resting else None
            if change is not None:
                state, T = "joined", change @ T
        ahead = timing.colour_lead + 0.5 * timing.readout
        T_stamp = T @ exp_motion(twist * ahead)
        covariance = motion.covariance_at(ahead) + camera.errors.spread(motion.of_map.by_lens)
        return Tracked(state, freeze(T_stamp), freeze(covariance), located, self.state.number)

    def _join(self) -> Float64Array | None:
        """Join the map with another that its newest keyframe shows; return the change of the pose where one is."""
        change = self.maps.join_by(len(self.state.memory.keyframes) - 1, self._recorder.put)
        if change is not None:
            self._shift(change)
        return change

    def _shift(self, change: Float64Array) -> None:
        """Carry a change of the world's frame where the camera is now over to what follows it."""
        self._follower.shift(change)
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
