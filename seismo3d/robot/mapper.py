"""The mapper: frames in; poses, a dense map and remembered places out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
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
from seismo3d.robot.ekf import MotionFilter, adjoint, exp_motion, log_motion
from seismo3d.robot.frames import Measured, Measurer, Timing
from seismo3d.robot.ground import make_ground, make_occupancy
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import PlaceMemory, correct_poses, find_closures, make_graph, make_keyframe
from seismo3d.robot.landmarks import make_view, sight_landmarks, time_sightings
from seismo3d.robot.mesh import Mesh, extract_mesh
from seismo3d.robot.moving import MotionMemory
from seismo3d.robot.occupancy import Occupancy
from seismo3d.robot.results import Closed, MapperSettings, Tracked
from seismo3d.robot.state import MapState
from seismo3d.robot.tracking import Located, locate
from seismo3d.robot.trajectory import TimedPose, Trajectory
from seismo3d.robot.tsdf import Prediction, SurfaceMap

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
    the next ones are compared with the places that the map remembers until one is found again.
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
    def trajectory(self) -> Trajectory:
        """Poses of the located frames."""
        return Trajectory.of(self.state.poses)

    @property
    def graph(self) -> PoseGraph:
        """Keyframes as poses, their order and the closures found so far as edges."""
        return make_graph(self.state.key_poses, self.state.closures)

    def mesh(self) -> Mesh:
        """Return the mapped surface as triangles with colours."""
        return extract_mesh(self.state.surface)

    def occupancy(self, *, cell: float = 0.05) -> Occupancy:
        """Return the map from above: free, occupied, unknown; see :func:`seismo3d.robot.ground.make_occupancy`."""
        return make_occupancy(self.mesh(), cell=cell)

    def elevation(self, *, cell: float = 0.05) -> Any:
        """Return the mapped ground as an elevation map; see :func:`seismo3d.robot.ground.make_ground`."""
        return make_ground(self.mesh(), cell=cell)

    def close_loops(self) -> Closed:
        """Find keyframes that show the same place, solve the graph of all, and make the map anew from its poses.

        Returns
        -------
        Closed
            Poses and map change only where a keyframe moves by more than a closure is sure of: 12 mm or half a degree.
        """
        closures = find_closures(self.state.memory)
        before = self.state.key_poses
        self.state.closures = closures
        if not closures:
            return Closed(0, 0, 0.0, 0.0)
        solved = solve_poses(make_graph(before, closures))
        change = [log_motion(invert_transform(a) @ b) for a, b in zip(before, solved.poses)]
        turn = float(max(np.linalg.norm(c[:3]) for c in change))
        shift = float(max(np.linalg.norm(c[3:]) for c in change))
        if turn > 0.009 or shift > 0.012:
            self._move_to(solved.poses)
        n_kept = int((solved.weights[-len(closures) :] > 0.25).sum())
        return Closed(len(closures), n_kept, turn, shift)

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
        surface = SurfaceMap(s.voxel_size, s.band_voxels * s.voxel_size)
        self.state = MapState(surface, PlaceMemory([camera.lens for camera in self.cameras]))
        self._moving = [MotionMemory() for _ in self.cameras]
        self._filter: MotionFilter | None = None

    def _map(self, frame: RgbdFrame) -> Tracked:
        camera = self.cameras[frame.camera]
        number, self.state.count = self.state.count, self.state.count + 1
        timing = Timing(camera.readout or 0.0, frame.time - frame.depth_time + (camera.depth_delay or 0.0))
        is_first = not self.state.poses
        motion = self._predict(frame, camera)
        T = motion.T_world_body @ camera.T_body_camera
        twist = _camera_twist(motion, camera)
        measured = self._measurers[frame.camera].measure(frame, twist, timing)
        state, located = "empty", None
        if measured.n_normals >= _LEAST_NORMALS:
            state, located = ("started", None) if is_first else self._find(measured, frame.camera, T, twist, timing)
        if located is not None and state != "lost":
            T, twist = located.T_world_camera, _camera_twist(motion, camera)
        if state in ("started", "tracked", "relocated"):
            self.state.n_lost = 0
            stamp = frame.time + camera.clock_offset
            self.state.poses.append(TimedPose(stamp, motion.time, T, twist, number, frame.camera))
            self._fuse(measured, frame.camera, T, twist, timing, number)
        else:
            self.state.n_lost += 1
            motion.twist *= 0.95
            if is_first:
                self._filter = None
        T_stamp = T @ exp_motion(twist * (timing.colour_lead + 0.5 * timing.readout))
        return Tracked(state, freeze(T_stamp), freeze(motion.covariance[:6, :6].copy()), located)

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

    def _find(
        self, measured: Measured, number: int, T: Float64Array, twist: Float64Array, timing: Timing
    ) -> tuple[str, Located | None]:
        """Locate a frame near the predicted pose, else at a place that looks like it."""
        camera = self.cameras[number]
        located = self._locate(measured, camera, T, twist, timing)
        if self._accept(located, camera, T):
            return "tracked", located
        if self.state.n_lost % _RELOCATE_EVERY == 0:
            for place in self._places(measured, number):
                again = self._locate(measured, camera, place, np.zeros(6), timing)
                if again.share > 0.4 and self._accept(again, camera, place, anew=True):
                    return "relocated", again
        return "lost", located

    def _places(self, measured: Measured, number: int) -> list[Float64Array]:
        """Poses at which remembered keyframes say that a frame may have been taken."""
        if measured.grey is None:
            return []
        asked = make_keyframe(-1, number, np.eye(4), measured.grey, measured.depth)
        poses = []
        for place in self.state.memory.recall(asked.features):
            found = self.state.memory.compare(int(place), asked)
            if found is not None:
                poses.append(self.state.memory.keyframes[place].T_world_camera @ found.T_target_source)
        return poses

    def _locate(
        self, measured: Measured, camera: Camera, T: Float64Array, twist: Float64Array, timing: Timing
    ) -> Located:
        prediction = self._cast(measured, camera, T, coarser=3)
        shape = measured.depth.shape
        if measured.grey is None or self.settings.terms == "planes":
            seen = time_sightings(np.empty((0, 3)), np.empty((0, 2)), camera.lens, twist, timing, shape)
        else:
            seen = sight_landmarks(self.state.views, measured.grey, camera.lens, T, twist, timing)
        return locate(measured, prediction, seen, T, camera.lens, terms=self.settings.terms)

    def _accept(self, located: Located, camera: Camera, T: Float64Array, *, anew: bool = False) -> bool:
        """Judge a located frame by its support and its innovation, and take it into the filter if it is sound."""
        motion = self._filter
        if motion is None or not located.converged:
            return False
        jump = log_motion(invert_transform(T) @ located.T_world_camera)
        reach = 1.0 + min(self.state.n_lost, 30) / 15.0
        near = np.linalg.norm(jump[:3]) < 0.25 * reach and np.linalg.norm(jump[3:]) < 0.2 * reach
        doubt = self.state.n_lost > 0
        enough = located.share > (0.3 if doubt else 0.15) or located.n_landmarks >= (40 if doubt else 20)
        if not (near and enough):
            return False
        T_world_body = located.T_world_camera @ invert_transform(camera.T_body_camera)
        if anew:
            self._filter = MotionFilter(motion.time, T_world_body)
            return True
        motion.update(T_world_body, located.covariance, gate=None)
        motion.T_world_body = T_world_body
        return True

    def _fuse(
        self, measured: Measured, number: int, T: Float64Array, twist: Float64Array, timing: Timing, frame: int
    ) -> None:
        """Put a located frame into the map, less what moves in it, and remember it where it shows something new."""
        camera = self.cameras[number]
        moving = self._moving[number].watch(measured, camera.lens, T)
        carve = frame % 3 == 0
        self.state.surface.fuse(measured, camera.lens, T, carve=carve, pool=self._pool, n_threads=self._n_threads)
        T_colour = T @ exp_motion(twist * timing.colour_lead)
        keyframes = self.state.memory.keyframes
        new = all(
            view.camera != number or view.apart(T_colour) > self.settings.view_distance for view in self.state.views
        )
        if new and moving.mean() < 0.1:
            self.state.memory.add(make_keyframe(frame, number, T, measured.grey, measured.depth))
            prediction = self._cast(measured, camera, T, coarser=1)
            self.state.views.append(make_view(measured.grey, camera.lens, prediction, twist, timing, camera=number))
        if frame % self.settings.keep_every == 0 or (new and keyframes):
            self.state.kept.append(KeptFrame.of(measured, len(self.state.poses) - 1, number))

    def _cast(self, measured: Measured, camera: Camera, T: Float64Array, *, coarser: int) -> Prediction:
        k, lens = 2 * coarser, camera.lens
        expected = np.ascontiguousarray(measured.vertices[coarser // 2 :: coarser, coarser // 2 :: coarser, 2])
        numbers = np.array([lens.fx / k, lens.fy / k, (lens.cx + 0.5) / k - 0.5, (lens.cy + 0.5) / k - 0.5])
        return self.state.surface.cast(expected, numbers, T, pool=self._pool, n_threads=self._n_threads)

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
        before, keys = self.state.key_poses, np.array([k.frame for k in self.state.memory.keyframes])
        poses = np.array([pose.T_world_camera for pose in self.state.poses])
        moved = correct_poses(poses, np.array([pose.frame for pose in self.state.poses]), before, key_poses, keys)
        self.state.poses = [replace(pose, T_world_camera=T) for pose, T in zip(self.state.poses, moved)]
        changes = [a @ invert_transform(b) for a, b in zip(key_poses, before)]
        self.state.views = [view.moved(change) for view, change in zip(self.state.views, changes)]
        self.state.memory.move(key_poses)
        self.state.surface = SurfaceMap(self.state.surface.voxel_size, self.state.surface.band)
        for kept in self.state.kept:
            measured = kept.unpacked(self._measurers[kept.camera])
            lens, T = self.cameras[kept.camera].lens, moved[kept.pose]
            self.state.surface.fuse(measured, lens, T, carve=True, pool=self._pool, n_threads=self._n_threads)
        if self._filter is not None:
            self._filter.T_world_body = moved[-1] @ invert_transform(poses[-1]) @ self._filter.T_world_body
        for memory in self._moving:
            memory.forget()


def _camera_twist(motion: MotionFilter, camera: Camera) -> Float64Array:
    """Velocity of a camera in its own frame."""
    return adjoint(invert_transform(camera.T_body_camera)) @ motion.twist
