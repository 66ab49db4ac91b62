"""What moves is not mapped: a short memory of depth images, and the test against it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import split_transform
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
    vertices: Float32Array
    T_world_camera: Float64Array
    lens: Float64Array


class MotionMemory:
    """Depth images of the last second, and what moved in the last frame.

    A place that is occupied now and that one of the images saw through is taken for something that moves, and so is
    what an image saw at a place that is seen through now; with it the whole surface that it is part of, and what of it
    is seen in the frames after. It is mapped once it has stood still for twice as long as the memory reaches.
    """

    def __init__(self) -> None:
        self._glances: deque[_Glance] = deque(maxlen=_MOST)
        self._followed: Float32Array | None = None
        self._since = 0
        self._count = 0

    def watch(self, measured: Measured, lens: PinholeCamera, T_world_camera: Float64Array) -> BoolArray:
        """Return which vertices (rows / 2, columns / 2) move, take their weight in ``measured``, remember the frame."""
        rows, columns, _ = measured.vertices.shape
        marked = np.zeros((rows, columns), dtype=np.bool_)
        depth = measured.depth[: 2 * rows : 2, : 2 * columns : 2]  # what is too far to be mapped is seen, too
        half = np.array([lens.fx / 2, lens.fy / 2, (lens.cx + 0.5) / 2 - 0.5, (lens.cy + 0.5) / 2 - 0.5])
        now = _Glance(depth, measured.vertices, T_world_camera, half)
        for glance in self._glances:
            _mark_intruders(now, glance, marked)
        self._since += 1
        self._spread(measured, marked, self._gone(now))
        if self._count % _EVERY == 0:
            seen = np.where(marked, np.float32(0.0), depth)
            self._glances.append(_Glance(seen, measured.vertices, T_world_camera, half))
        self._count += 1
        return marked

    def forget(self) -> None:
        """Drop all images: poses have changed."""
        self._glances.clear()
        self._followed = None

    def _gone(self, now: _Glance) -> BoolArray:
        """Return where the surfaces are now that are no longer where one of the images, each in its turn, saw them."""
        past = list(self._glances)
        which = self._count % max(len(past), 1)
        gone = np.zeros(now.depth.shape, dtype=np.bool_)
        if not past:
            return gone
        _mark_intruders(past[which], now, gone)
        gone = kernels.erode_marked(gone, _THICK)
        if gone.mean() < _LEAST_SHARE:
            return np.zeros_like(gone)
        self._since = 0
        gone = _grown(past[which].vertices, gone, _WHOLE)
        for before, after in pairwise([*past[which:], now]):
            gone = _grown(after.vertices, _still_there(gone, before.vertices, after.vertices), 2.0 * _WHOLE)
        return gone

    def _spread(self, measured: Measured, marked: BoolArray, gone: BoolArray) -> None:
        """Extend the marks to whole surfaces, also those that moved a frame ago, and take the weight of what moves."""
        solid = kernels.erode_marked(marked, _THICK) | gone
        evident = bool(solid.mean() >= _LEAST_SHARE)
        self._since = 0 if evident else self._since
        z = measured.vertices[:, :, 2]
        if self._followed is not None and self._since <= _EVERY * _MOST:
            solid |= (self._followed > 0.0) & (np.abs(z - self._followed) < _LEAP)
        elif not evident:
            solid[:] = False
        if marked.mean() < _LEAST_SHARE:
            marked[:] = False
        grown = _grown(measured.vertices, solid, _WHOLE if evident else 2.0 * _WHOLE)
        marked |= grown
        self._followed = np.where(grown, z, np.float32(0.0)) if grown.any() else None
        if marked.any():
            kernels.veto_pixels(marked, _REACH, measured.depth.shape[1], measured.pixels)


def without(depth: Float32Array, moving: BoolArray) -> Float32Array:
    """Return a depth image (rows, columns) without what moves (rows / 2, columns / 2)."""
    if not moving.any():
        return depth
    rows, columns = moving.shape
    left = depth.copy()
    left[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2).transpose(0, 2, 1, 3)[moving] = 0.0
    return left


def _mark_intruders(here: _Glance, there: _Glance, marked: BoolArray) -> None:
    """Mark what one image sees at places that another one saw through."""
    (R, t), (R_there, t_there) = (split_transform(glance.T_world_camera) for glance in (here, there))
    kernels.mark_intruders(here.vertices, R, t, there.depth, R_there, t_there, there.lens, marked)


def _grown(vertices: Float32Array, hints: BoolArray, share: float) -> BoolArray:
    out = np.zeros(hints.shape, dtype=np.bool_)
    kernels.grow_marked(vertices, hints, share, _LARGEST, out)
    return out


def _still_there(marked: BoolArray, before: Float32Array, after: Float32Array) -> BoolArray:
    """Where the camera sees, at the same pixels a little later, what was marked: at nearly the same depth."""
    return marked & (np.abs(after[:, :, 2] - before[:, :, 2]) < _LEAP)
