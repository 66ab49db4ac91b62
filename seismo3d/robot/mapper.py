"""The mapper: frames in; poses, a dense map and landmarks out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_number, freeze
from seismo3d.errors import ParameterError
from seismo3d.geometry.rotations import invert_transform
from seismo3d.robot.calibration import calibrate_timing
from seismo3d.robot.camera import Camera, RgbdFrame, as_robot_camera
from seismo3d.robot.ekf import MotionFilter, adjoint, exp_motion, log_motion
from seismo3d.robot.frames import Measured, Measurer, MeasureSettings, Timing
from seismo3d.robot.ground import make_ground, make_occupancy
from seismo3d.robot.landmarks import View, make_view, sight_landmarks, time_sightings
from seismo3d.robot.mesh import Mesh, extract_mesh
from seismo3d.robot.occupancy import Occupancy
from seismo3d.robot.tracking import TERMS, Located, locate
from seismo3d.robot.trajectory import TimedPose, Trajectory
from seismo3d.robot.tsdf import Prediction, SurfaceMap

STATES = ("started", "tracked", "lost", "empty")
"""States of a frame: the first one; located; not located; without depth to locate it by."""


@dataclass(frozen=True, slots=True)
class MapperSettings:
    """How a map is made.

    Attributes
    ----------
    voxel_size : float
        Edge of the map's voxels, metres.
    band_voxels : float
        Signed distances are kept up to so many voxels from the surface.
    measure : MeasureSettings
    terms : str
        What frames are located by, one of ``tracking.TERMS``.
    filtered : bool
        Whether a frame's pose is predicted by the filter's velocity; else it starts where the last one was.
    calibrate_frames : int
        After so many frames, the timing that cameras leave open is found from them, and they are mapped anew with it;
        0 leaves it at zero.
    view_distance : float
        A view is remembered where it is farther from all others: radians plus half the metres.
    n_threads : int
        Threads; 0 for one a core. The result doesn't depend on it.
    """

    voxel_size: float = 0.01
    band_voxels: float = 4.0
    measure: MeasureSettings = field(default_factory=MeasureSettings)
    terms: str = "fused"
    filtered: bool = True
    calibrate_frames: int = 90
    view_distance: float = 0.14
    n_threads: int = 0

    def __post_init__(self) -> None:
        as_number(self.voxel_size, "voxel_size", low=1e-4, high=1.0)
        as_number(self.band_voxels, "band_voxels", low=2.0, high=20.0)
        as_number(self.calibrate_frames, "calibrate_frames", low=0)
        as_number(self.view_distance, "view_distance", low=0.0, strict=True)
        as_number(self.n_threads, "n_threads", low=0, high=1024)
        if self.terms not in TERMS:
            raise ParameterError(f"terms is {self.terms!r}; expected one of {', '.join(TERMS)}.")


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """What became of a frame.

    Attributes
    ----------
    state : str
        One of ``STATES``.
    T_world_camera : ndarray of shape (4, 4), float64
        Pose at the colour's stamp; the world is the first frame's camera. The prediction where the frame is not
        located.
    covariance : ndarray of shape (6, 6), float64
        Of a perturbation on the left, (rotation, translation): the filter's, so that it grows while frames are lost.
    located : Located or None
        Details of the registration; None for the first frame and where there was none.
    """

    state: str
    T_world_camera: Float64Array
    covariance: Float64Array
    located: Located | None = None

    @property
    def is_located(self) -> bool:
        """Whether the pose comes from the frame itself."""
        return self.state in ("started", "tracked")


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
    nearest views), update (filter), fuse. A frame that cannot be located is a state, not an error, and is not fused.
    """

    def __init__(self, camera: object, *, settings: MapperSettings | None = None) -> None:
        given = list(camera) if isinstance(camera, Sequence) else [camera]
        if not given:
            raise ParameterError("camera is an empty sequence; expected at least one camera.")
        self.cameras: list[Camera] = [as_robot_camera(c) for c in given]
        self.settings = settings or MapperSettings()
        n_threads = self.settings.n_threads or min(8, os.cpu_count() or 1)
        self._pool = ThreadPoolExecutor(n_threads, thread_name_prefix="seismo3d-map")
        self._n_threads = n_threads
        self._start_afresh()
        open_ends = [c.readout is None or c.depth_delay is None for c in self.cameras]
        self._kept: list[RgbdFrame] | None = [] if any(open_ends) and self.settings.calibrate_frames else None

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
        if self._kept is not None:
            self._kept.append(frame)
            if len(self._kept) >= self.settings.calibrate_frames:
                return self._calibrate(tracked)
        return tracked

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the located frames."""
        return Trajectory.of(self._poses)

    def mesh(self) -> Mesh:
        """Return the mapped surface as triangles with colours."""
        return extract_mesh(self.surface)

    def occupancy(self, *, cell: float = 0.05) -> Occupancy:
        """Return the map from above: free, occupied, unknown; see :func:`seismo3d.robot.ground.make_occupancy`."""
        return make_occupancy(self.mesh(), cell=cell)

    def elevation(self, *, cell: float = 0.05) -> Any:
        """Return the mapped ground as an elevation map; see :func:`seismo3d.robot.ground.make_ground`."""
        return make_ground(self.mesh(), cell=cell)

    def _start_afresh(self) -> None:
        s = self.settings
        self._measurers = [Measurer(camera.lens, s.measure) for camera in self.cameras]
        self.surface = SurfaceMap(s.voxel_size, s.band_voxels * s.voxel_size)
        self.views: list[View] = []
        self._filter: MotionFilter | None = None
        self._poses: list[TimedPose] = []
        self._count = 0

    def _map(self, frame: RgbdFrame) -> Tracked:
        camera = self.cameras[frame.camera]
        number, self._count = self._count, self._count + 1
        timing = Timing(camera.readout or 0.0, frame.time - frame.depth_time + (camera.depth_delay or 0.0))
        is_first = self._filter is None
        motion = self._predict(frame, camera)
        T = motion.T_world_body @ camera.T_body_camera
        twist = _camera_twist(motion, camera)
        measured = self._measurers[frame.camera].measure(frame, twist, timing)
        located = None
        if measured.n_normals < 300:
            state = "empty"
        elif is_first:
            state = "started"
        else:
            located = self._locate(measured, camera, T, twist, timing)
            state = "tracked" if self._update(motion, located, camera) else "lost"
        if state == "tracked" and located is not None:
            T, twist = located.T_world_camera, _camera_twist(motion, camera)
        T_colour = T @ exp_motion(twist * timing.colour_lead)
        T_stamp = T @ exp_motion(twist * (timing.colour_lead + 0.5 * timing.readout))
        if state in ("started", "tracked"):
            self.surface.fuse(measured, camera.lens, T, pool=self._pool, n_threads=self._n_threads)
            self._remember(measured, frame.camera, T, T_colour, twist, timing)
            stamp = frame.time + camera.clock_offset
            self._poses.append(TimedPose(stamp, motion.time, T, twist, number, frame.camera))
        elif is_first:
            self._filter = None
        return Tracked(state, freeze(T_stamp), freeze(motion.covariance[:6, :6].copy()), located)

    def _predict(self, frame: RgbdFrame, camera: Camera) -> MotionFilter:
        now = frame.depth_time + camera.clock_offset - (camera.depth_delay or 0.0) - 0.5 * (camera.readout or 0.0)
        if self._filter is None:
            self._filter = MotionFilter(now, invert_transform(camera.T_body_camera))
        if not self.settings.filtered:
            self._filter.twist[:] = 0.0
        self._filter.predict(now)
        return self._filter

    def _locate(
        self, measured: Measured, camera: Camera, T: Float64Array, twist: Float64Array, timing: Timing
    ) -> Located:
        prediction = self._cast(measured, camera, T, coarser=2)
        shape = measured.depth.shape
        if measured.grey is None or self.settings.terms == "planes":
            seen = time_sightings(np.empty((0, 3)), np.empty((0, 2)), camera.lens, twist, timing, shape)
        else:
            seen = sight_landmarks(self.views, measured.grey, camera.lens, T, twist, timing)
        return locate(measured, prediction, seen, T, camera.lens, terms=self.settings.terms)

    def _update(self, motion: MotionFilter, located: Located, camera: Camera) -> bool:
        """Judge a located frame, and take it into the filter if it is sound."""
        enough = located.share > 0.2 or located.n_landmarks >= 20
        T_world_body = located.T_world_camera @ invert_transform(camera.T_body_camera)
        jump = log_motion(invert_transform(motion.T_world_body) @ T_world_body)
        near = np.linalg.norm(jump[:3]) < 0.35 and np.linalg.norm(jump[3:]) < 0.25
        if not (located.converged and enough and near):
            return False
        motion.update(T_world_body, located.covariance, gate=None)
        motion.T_world_body = T_world_body
        return True

    def _remember(
        self,
        measured: Measured,
        number: int,
        T: Float64Array,
        T_colour: Float64Array,
        twist: Float64Array,
        timing: Timing,
    ) -> None:
        """Keep the frame as a view where no other is near."""
        if measured.grey is None or any(v.apart(T_colour) <= self.settings.view_distance for v in self.views):
            return
        camera = self.cameras[number]
        prediction = self._cast(measured, camera, T, coarser=1)
        self.views.append(make_view(measured.grey, camera.lens, prediction, twist, timing, camera=number))

    def _cast(self, measured: Measured, camera: Camera, T: Float64Array, *, coarser: int) -> Prediction:
        rows, columns, _ = measured.vertices.shape
        k, lens = 2 * coarser, camera.lens
        numbers = np.array([lens.fx / k, lens.fy / k, (lens.cx + 0.5) / k - 0.5, (lens.cy + 0.5) / k - 0.5])
        return self.surface.cast(
            (rows // coarser, columns // coarser), numbers, T, pool=self._pool, n_threads=self._n_threads
        )

    def _calibrate(self, tracked: Tracked) -> Tracked:
        """Find the open timing of each camera from the frames kept so far, and map them anew with it."""
        frames, self._kept = self._kept or [], None
        changed = False
        for number, camera in enumerate(self.cameras):
            own = [frame for frame in frames if frame.camera == number]
            if camera.readout is not None and camera.depth_delay is not None:
                continue
            found = calibrate_timing(own, camera)
            changed |= (found.readout, found.depth_delay) != (camera.readout or 0.0, camera.depth_delay or 0.0)
            self.cameras[number] = found.applied(camera)
        if not changed:
            return tracked
        self._start_afresh()
        for frame in frames:
            tracked = self._map(frame)
        return tracked


def _camera_twist(motion: MotionFilter, camera: Camera) -> Float64Array:
    """Velocity of a camera in its own frame."""
    return adjoint(invert_transform(camera.T_body_camera)) @ motion.twist
