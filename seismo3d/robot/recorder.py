"""Put located frames into local maps: the surface, the views and places to be remembered, the frames to be kept."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from seismo3d._typing import Float64Array
from seismo3d.robot.camera import Camera
from seismo3d.robot.ekf import exp_motion
from seismo3d.robot.frames import Measured, Measurer, Timing
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import make_keyframe
from seismo3d.robot.landmarks import make_view
from seismo3d.robot.locator import Locator
from seismo3d.robot.moving import MotionMemory
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.state import MapState
from seismo3d.robot.tsdf import SurfaceMap

_CARVE_EVERY = 4
_STEADY = 0.1
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

    def record(
        self,
        state: MapState,
        measured: Measured,
        number: int,
        T: Float64Array,
        twist: Float64Array,
        timing: Timing,
        frame: int,
    ) -> bool:
        """Put a frame of a camera, the last one among the map's poses, into the map, less what moves in it.

        Returns
        -------
        bool
            Whether it shows something new, and so became a keyframe.
        """
        lens, settings = self._cameras[number].lens, self._settings
        moving = self._moving[number].watch(measured, lens, T)
        T_colour = T @ exp_motion(twist * timing.colour_lead)
        new = all(v.camera != number or v.apart(T_colour) > settings.view_distance for v in state.views)
        new = new and bool(moving.mean() < _STEADY)
        packed = None
        if frame % settings.keep_every == 0 or (new and state.views):
            # while the pool packs it, the frame is fused
            packed = self._pool.submit(KeptFrame.of, measured, len(state.poses) - 1, number)
        self._fuse(state.surface, measured, number, T, carve=frame % _CARVE_EVERY == 0)
        if new:
            state.memory.add(make_keyframe(frame, number, T, measured.grey, measured.depth, part=state.part))
            prediction = self._locator.cast(state.surface, measured, number, T, coarser=2)
            state.views.append(make_view(measured.grey, lens, prediction, twist, timing, camera=number))
        if packed is not None:
            state.kept.append(packed.result())
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
        for memory in self._moving:
            memory.forget()

    def _fuse(self, surface: SurfaceMap, measured: Measured, number: int, T: Float64Array, *, carve: bool) -> None:
        lens = self._cameras[number].lens
        surface.fuse(measured, lens, T, carve=carve, pool=self._pool, n_threads=self._n_threads)
