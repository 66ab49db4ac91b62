"""What moves is not mapped: a short memory of depth images, and the test against it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot import _kernels_motion as kernels
from seismo3d.robot.frames import Measured

_EVERY, _MOST = 8, 4
_LEAST_SHARE = 0.003
_REACH = 2
_WHOLE = 0.12
"""Share of a connected surface that must be seen to move for all of it to count as moving."""
_THICK = 2
"""Vertices, by two, around one that must be marked with it: what is thinner may be an edge that is a little off."""
_LARGEST = 0.45
"""Largest share of the view of a surface that is taken to move as a whole."""
_LEAP = 0.15
"""Change of depth from one frame to the next, at one pixel, of something that moves, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class _Glance:
    depth: Float32Array
    T_world_camera: Float64Array
    lens: Float64Array


class MotionMemory:
    """Depth images of the last second, and what moved in the last frame.

    A place that is occupied now and that one of the images saw through is taken for something that moves, and with it
    the whole surface that it is part of, and what of it is seen in the frames after. It is mapped once it has stood
    still for as long as the memory reaches.
    """

    def __init__(self) -> None:
        self._glances: deque[_Glance] = deque(maxlen=_MOST)
        self._followed: Float32Array | None = None
        self._since = 0
        self._count = 0

    def watch(self, measured: Measured, lens: PinholeCamera, T_world_camera: Float64Array) -> BoolArray:
        """Return which vertices (rows / 2, columns / 2) move, take their weight in ``measured``, remember the frame."""
        marked = np.zeros(measured.vertices.shape[:2], dtype=np.bool_)
        R, t = (np.ascontiguousarray(part) for part in (T_world_camera[:3, :3], T_world_camera[:3, 3]))
        for glance in self._glances:
            R_before, t_before = (
                np.ascontiguousarray(part) for part in (glance.T_world_camera[:3, :3], glance.T_world_camera[:3, 3])
            )
            kernels.mark_intruders(measured.vertices, R, t, glance.depth, R_before, t_before, glance.lens, marked)
        self._spread(measured, marked)
        if self._count % _EVERY == 0:
            half = np.array([lens.fx / 2, lens.fy / 2, (lens.cx + 0.5) / 2 - 0.5, (lens.cy + 0.5) / 2 - 0.5])
            rows, columns, _ = measured.vertices.shape
            depth = measured.depth[: 2 * rows : 2, : 2 * columns : 2]  # what is too far to be mapped is seen, too
            self._glances.append(_Glance(np.where(marked, np.float32(0.0), depth), T_world_camera, half))
        self._count += 1
        return marked

    def forget(self) -> None:
        """Drop all images: poses have changed."""
        self._glances.clear()
        self._followed = None

    def _spread(self, measured: Measured, marked: BoolArray) -> None:
        """Extend the marks to whole surfaces, also those that moved a frame ago, and take the weight of what moves."""
        solid = kernels.erode_marked(marked, _THICK)
        evident = bool(solid.mean() >= _LEAST_SHARE)
        self._since = 0 if evident else self._since + 1
        z = measured.vertices[:, :, 2]
        if self._followed is not None and self._since <= _EVERY:
            solid |= (self._followed > 0.0) & (np.abs(z - self._followed) < _LEAP)
        elif not evident:
            solid[:] = False
        if marked.mean() < _LEAST_SHARE:
            marked[:] = False
        grown = np.zeros_like(marked)
        kernels.grow_marked(measured.vertices, solid, _WHOLE if evident else 2.0 * _WHOLE, _LARGEST, grown)
        marked |= grown
        self._followed = np.where(grown, z, np.float32(0.0)) if grown.any() else None
        if marked.any():
            kernels.veto_pixels(marked, _REACH, measured.depth.shape[1], measured.pixels)
