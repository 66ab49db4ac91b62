"""Put located frames into local maps: the surface, the views and places to be remembered, the frames to be kept."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial

from seismo3d._typing import Float64Array
from seismo3d.robot.camera import Camera
from seismo3d.robot.ekf import exp_motion
from seismo3d.robot.frames import Measured, Measurer, Timing
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import make_keyframe
from seismo3d.robot.landmarks import make_view, views_apart
from seismo3d.robot.locator import Locator
from seismo3d.robot.moving import MotionMemory, without
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.state import MapState
from seismo3d.robot.tsdf import SurfaceMap

_CARVE_EVERY = 4
_STEADY = 0.5
"""Share of the view that may move in a frame that is remembered as a view."""


class Recorder:
    """Puts frames of some cameras into local maps.

    Parameters
    ----------
    cameras : list of Camera
    settings : MapperSettings
    measurers : list of Measurer
        One a camera.
    locator : Locator
    pool : ThreadPoolExecutor
    n_threads : int
    """

    def __init__(
        self,
        cameras: list[Camera],
        settings: MapperSettings,
        measurers: list[Measurer],
        locator: Locator,
        pool: ThreadPoolExecutor,
        n_threads: int,
    ) -> None:
        self._cameras = cameras
        self._settings = settings
        self._measurers = measurers
        self._locator = locator
        self._pool = pool
        self._n_threads = n_threads
        self._moving = [MotionMemory() for _ in cameras]
        # one thread hands out the parts, to threads of their own: the next frame's work is not to wait behind them
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="seismo3d-fuse")
        self._parts = ThreadPoolExecutor(n_threads, thread_name_prefix="seismo3d-fuse")
        self._entering: Future[None] | None = None

    def record(
        self,
        state: MapState,
        measured: Measured,
        number: int,
        T: Float64Array,
        twist: Float64Array,
        timing: Timing,
        frame: int,
        errors: PoseErrors,
    ) -> bool:
        """Put a frame of a camera, the last one among the map's poses, into the map, less what moves in it.

        The errors of its pose are remembered with what it shows.

        Returns
        -------
        bool
            Whether it shows something new, and so became a keyframe.
        """
        T_colour = T @ exp_motion(twist * timing.colour_lead)
        distance, carve = self._settings.view_distance, frame % _CARVE_EVERY == 0
        keep = frame % self._settings.keep_every == 0
        apart = bool((views_apart([v for v in state.views if v.camera == number], T_colour) > distance).all())
        if not apart:
            self._enter_beside(state, measured, number, T, carve=carve, keep=keep)
            return False
        self._end_beside()
        surface = state.surface
        moving = self._moving[number].watch(measured, self._cameras[number].lens, T)
        new = bool(moving.mean() < _STEADY)
        if keep or (new and state.views):
            self._pack(state, measured, number, len(state.poses) - 1)
        self._fuse(surface, measured, number, T, carve=carve)
        if new:
            prediction, lens = self._locator.cast(surface, measured, number, T, coarser=2), self._cameras[number].lens
            view = make_view(measured.grey, lens, prediction, twist, timing, camera=number, moving=moving)
            state.views.append(replace(view, errors=errors))
            described = partial(make_keyframe, frame, number, T, measured.grey, part=state.part)
            state.memory.expect(self._pool.submit(described, without(measured.depth, moving)))
        return new

    def put(self, surface: SurfaceMap, state: MapState, row: int) -> None:
        """Put a frame that a local map keeps into a surface."""
        kept = state.kept[row]
        measured = kept.unpacked(self._measurers[kept.camera])
        self._fuse(surface, measured, kept.camera, state.poses[kept.pose].T_world_camera, carve=True)

    def remake(self, state: MapState) -> None:
        """Make a local map's surface anew from the frames that it keeps, where their poses are now."""
        state.surface = SurfaceMap(state.surface.voxel_size, state.surface.band)
        for row in range(len(state.kept)):
            self.put(state.surface, state, row)

    def forget(self) -> None:
        """Forget what moved: poses have changed."""
        self._end_beside()
        for memory in self._moving:
            memory.forget()

    def _enter_beside(
        self, state: MapState, measured: Measured, number: int, T: Float64Array, *, carve: bool, keep: bool
    ) -> None:
        """Put a frame that shows nothing new into the map while the next one is measured and its landmarks are found.

        Neither needs the surface. One thread has nothing beside it.
        """
        surface, row, lens = state.surface, len(state.poses) - 1, self._cameras[number].lens
        alone = self._n_threads == 1

        def enter() -> None:
            self._moving[number].watch(measured, lens, T)
            if keep:
                self._pack(state, measured, number, row)
            pool = self._pool if alone else self._parts
            surface.fuse(measured, lens, T, carve=carve, pool=pool, n_threads=self._n_threads)

        if alone:
            enter()
        else:
            state.fusing = self._entering = self._beside.submit(enter)

    def _end_beside(self) -> None:
        """Wait for the last frame that was entered beside, into whichever map."""
        if self._entering is not None:
            entering, self._entering = self._entering, None
            entering.result()

    def _pack(self, state: MapState, measured: Measured, number: int, row: int) -> None:
        """Keep a frame: the pool packs it while what follows is done."""
        state.packing.append(self._pool.submit(KeptFrame.of, measured, row, number))

    def _fuse(self, surface: SurfaceMap, measured: Measured, number: int, T: Float64Array, *, carve: bool) -> None:
        lens = self._cameras[number].lens
        surface.fuse(measured, lens, T, carve=carve, pool=self._pool, n_threads=self._n_threads)
