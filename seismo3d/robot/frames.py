"""Measure: what mapping needs of a frame - depth without shutter and lens effects, vertices, normals, colours."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int32Array
from seismo3d._validate import as_number, as_real_array
from seismo3d.errors import ShapeError
from seismo3d.geometry._kernels_camera import straighten_rows
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot import _kernels_frame as kernels
from seismo3d.robot import _kernels_shutter as shutter
from seismo3d.robot.camera import RgbdFrame, lens_numbers
from seismo3d.robot.room import Room


@dataclass(frozen=True, slots=True)
class MeasureSettings:
    """How depth is read.

    Attributes
    ----------
    near, far : float
        Depths outside are left out, metres.
    total_variation : float
        Weight of total-variation denoising of the depth before all else, in metres; 0 for none. It costs more than all
        the rest together.
    """

    near: float = 0.3
    far: float = 4.0
    total_variation: float = 0.0

    def __post_init__(self) -> None:
        as_number(self.near, "near", low=0.0)
        as_number(self.far, "far", low=self.near, high=kernels.FARTHEST, strict=True)
        as_number(self.total_variation, "total_variation", low=0.0, high=1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """Where rows and colour lie in time.

    Attributes
    ----------
    readout : float
        Seconds from the first to the last row.
    colour_lead : float
        Seconds from the depth to the colour image of the frame.
    """

    readout: float = 0.0
    colour_lead: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A frame, measured; the camera's frame at the depth's time.

    Attributes
    ----------
    depth : ndarray of shape (rows, columns), float32
        Metres, 0 where there is none, as if all rows had been exposed at once.
    vertices, normals : ndarray of shape (rows / 2, columns / 2, 3), float32
        Points, and unit normals towards the camera; zero where there are none.
    pixels : ndarray of shape (rows * columns,), uint64
        Depth, slope and weight for fusion, packed, 0 for what is not fused; see
        :func:`seismo3d.robot._kernels_frame.pack_pixels`. The weight is 1 for a surface seen frontally at a metre.
    colour : ndarray of shape (rows, columns, 3) or (0, 0, 3), uint8
        Colour of each depth pixel.
    grey : ndarray of shape (rows, columns), uint8, or None
        The colour image as it was taken.
    """

    depth: Float32Array
    vertices: Float32Array
    normals: Float32Array
    pixels: AnyArray
    colour: AnyArray
    grey: AnyArray | None

    @property
    def n_normals(self) -> int:
        """Number of vertices with a normal."""
        return int(np.count_nonzero(self.normals[:, :, 2]))

    @property
    def trusted(self) -> BoolArray:
        """Which pixels (rows, columns) are fused."""
        return np.asarray(self.pixels.reshape(self.depth.shape) > 0)


@dataclass(frozen=True, slots=True, eq=False)
class Coming:
    """A frame that is being measured.

    Attributes
    ----------
    grey : ndarray of shape (rows, columns), uint8, or None
        As in :class:`Measured`.
    measuring : Future of Measured
    """

    grey: AnyArray | None
    measuring: Future[Measured]

    def measured(self) -> Measured:
        """Wait for the measured frame."""
        return self.measuring.result()


class Measurer:
    """Turns frames of one camera into measured ones; keeps the camera's table of rays.

    Parameters
    ----------
    lens : PinholeCamera
    settings : MeasureSettings
    pool : ThreadPoolExecutor
        Where work on rows goes.
    beside : ThreadPoolExecutor, optional
        Where frames are measured that are begun with; by default that is done at once.
    """

    def __init__(
        self,
        lens: PinholeCamera,
        settings: MeasureSettings,
        pool: ThreadPoolExecutor,
        beside: ThreadPoolExecutor | None = None,
    ) -> None:
        self.lens = lens
        self.settings = settings
        self._pool = pool
        self._beside = beside
        self._focal = np.array([lens.fx, lens.fy], dtype=np.float32)
        self._rays: Float32Array | None = None
        self._moved: tuple[Int32Array, Float32Array] | None = None
        self._room = Room()

    def rays(self, shape: tuple[int, ...]) -> Float32Array:
        """Return the ray (x, y at depth 1) of each pixel of an image of a shape."""
        if self._rays is None or self._rays.shape[:2] != shape:
            numbers, rays = lens_numbers(self.lens), np.empty((*shape, 2), dtype=np.float32)
            self._by_rows(shape[0], lambda a, b: straighten_rows(a, b, numbers[:4], numbers[4:], rays))
            self._rays = rays
        return self._rays

    def measure(self, frame: RgbdFrame, twist: Float64Array, timing: Timing) -> Measured:
        """Measure a frame.

        Parameters
        ----------
        frame : RgbdFrame
        twist : ndarray of shape (6,), float64
            Velocity of the camera in its own frame, (rotation, translation) a second.
        timing : Timing

        Returns
        -------
        Measured

        Raises
        ------
        ShapeError
            If depth and colour do not fit each other or the camera.
        """
        return self.begin(frame, twist, timing).measured()

    def begin(self, frame: RgbdFrame, twist: Float64Array, timing: Timing) -> Coming:
        """Measure a frame beside what the caller does next; parameters and errors are those of :meth:`measure`."""
        self._check(frame)
        grey = None if frame.rgb is None else _grey_of(frame.rgb)
        if self._beside is not None:
            return Coming(grey, self._beside.submit(self._measure, frame, grey, twist, timing))
        measuring: Future[Measured] = Future()
        measuring.set_result(self._measure(frame, grey, twist, timing))
        return Coming(grey, measuring)

    def _measure(self, frame: RgbdFrame, grey: AnyArray | None, twist: Float64Array, timing: Timing) -> Measured:
        depth = self._metres(frame)
        if timing.readout > 0.0 and np.any(twist):
            depth = self._frozen(depth, twist, timing)
        colour = np.zeros((0, 0, 3), dtype=np.uint8)
        vertices = self._vertices_of(depth)
        if frame.rgb is None:
            self._by_rows(len(vertices), lambda a, b: self._halve(a, b, depth, vertices))
        else:
            rgb, colour = np.ascontiguousarray(frame.rgb), self._room_for(frame.rgb.shape, np.uint8)
            # the motion from the depth's time to a row's: of the first row, and how much more of each one after it
            lead, spacing = timing.colour_lead - 0.5 * timing.readout, timing.readout / len(depth)
            motion = (-twist, lead, spacing, self._focal)

            def halve_and_colour(first: int, last: int) -> None:
                self._halve(first, last, depth, vertices)
                shutter.colour_at_depth(first, last, rgb, depth, vertices, *motion, colour)

            self._by_rows(len(vertices), halve_and_colour)
        return self._packed(depth, vertices, colour, grey)

    def measured(self, depth: Float32Array, colour: AnyArray, grey: AnyArray | None = None) -> Measured:
        """Measure a depth image in metres, free of the shutter's effect, with the colour of each pixel."""
        vertices = self._vertices_of(depth)
        self._by_rows(len(vertices), lambda a, b: self._halve(a, b, depth, vertices))
        return self._packed(depth, vertices, colour, grey)

    def _frozen(self, depth: Float32Array, twist: Float64Array, timing: Timing) -> Float32Array:
        """Return a depth image as if all rows had been exposed at the time of the middle one."""
        rays = self.rays(depth.shape)
        spacing, focal = timing.readout / len(depth), self._focal
        place, moved = self._buffers(depth.shape)
        motion = (depth, rays, twist, -0.5 * timing.readout, spacing, focal)
        self._by_rows(len(depth), lambda a, b: shutter.move_rows(a, b, *motion, place, moved))
        out = self._room.empty(depth.shape, np.float32)
        shutter.splat_rows(place, moved, out)
        return out

    def _vertices_of(self, depth: Float32Array) -> Float32Array:
        """Return memory for the vertices of a depth image, its rays made known before the threads ask for them."""
        self.rays(depth.shape)
        return self._room.empty((depth.shape[0] // 2, depth.shape[1] // 2, 3), np.float32)

    def _halve(self, first: int, last: int, depth: Float32Array, vertices: Float32Array) -> None:
        near, far = self.settings.near, self.settings.far
        kernels.halve(first, last, depth, self.rays(depth.shape), near, far, vertices)

    def _packed(self, depth: Float32Array, vertices: Float32Array, colour: AnyArray, grey: AnyArray | None) -> Measured:
        far = self.settings.far
        normals = self._room.empty(vertices.shape, np.float32)
        pixels = self._room_for(depth.shape, np.uint64).reshape(-1)

        def face_and_pack(first: int, last: int) -> None:
            kernels.grid_normals(first, last, vertices, 2, normals)
            kernels.pack_pixels(first, last, depth, vertices, normals, far, pixels)

        self._by_rows(len(vertices), face_and_pack)
        return Measured(depth, vertices, normals, pixels, colour, grey)

    def _room_for(self, shape: tuple[int, ...], kind: Any) -> AnyArray:
        """Return an image to be filled two by two pixels; a last row or column that is left over is zero."""
        out = self._room.empty(shape, kind)
        out[shape[0] // 2 * 2 :] = 0
        out[:, shape[1] // 2 * 2 :] = 0
        return out

    def _buffers(self, shape: tuple[int, ...]) -> tuple[Int32Array, Float32Array]:
        """Return memory for places and depths that is kept from frame to frame."""
        if self._moved is None or self._moved[0].shape != shape:
            self._moved = np.empty(shape, dtype=np.int32), np.empty(shape, dtype=np.float32)
        return self._moved

    def _by_rows(self, rows: int, work: Callable[[int, int], None]) -> None:
        """Do work on rows in parts on the pool."""
        edges = np.linspace(0, rows, 5).astype(int).tolist()
        for part in [self._pool.submit(work, a, b) for a, b in pairwise(edges)]:
            part.result()

    def _check(self, frame: RgbdFrame) -> None:
        raw = as_real_array(frame.depth, "depth", ndim=2)
        if min(raw.shape) < 16:
            raise ShapeError(f"depth has shape {raw.shape}; expected at least 16 x 16 pixels.")
        if frame.rgb is not None and frame.rgb.shape != (*raw.shape, 3):
            raise ShapeError(
                f"rgb has shape {frame.rgb.shape} and depth {raw.shape}; expected (rows, columns, 3) of the same size. "
                "Register them first."
            )
        if self.lens.width and (self.lens.height, self.lens.width) != raw.shape:
            raise ShapeError(
                f"depth has shape {raw.shape}; the camera says ({self.lens.height}, {self.lens.width}). "
                "Give the intrinsics of these images."
            )

    def _metres(self, frame: RgbdFrame) -> Float32Array:
        raw = as_real_array(frame.depth, "depth", ndim=2)
        depth = self._room.empty(raw.shape, np.float32)
        np.divide(raw, np.float32(self.lens.depth_scale), out=depth, dtype=np.float32)
        if raw.dtype.kind != "u":
            depth[~np.isfinite(depth) | (depth < 0.0)] = 0.0
        if self.settings.total_variation > 0.0:
            depth = smooth_depth(depth, self.settings.total_variation)
        return depth


def _grey_of(rgb: AnyArray) -> AnyArray:
    import cv2

    return cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)


def smooth_depth(depth: Float32Array, weight: float) -> Float32Array:
    """Denoise a depth image by total variation (Chambolle), holes kept.

    Parameters
    ----------
    depth : ndarray of shape (rows, columns), float32
        Metres, 0 where there is none.
    weight : float
        Strength, in metres.

    Returns
    -------
    ndarray of depth's shape, float32
    """
    from scipy.ndimage import distance_transform_edt
    from skimage.restoration import denoise_tv_chambolle

    hole = ~(depth > 0.0)
    if hole.all():
        return depth
    nearest = distance_transform_edt(hole, return_distances=False, return_indices=True)
    smooth = denoise_tv_chambolle(depth[tuple(nearest)], weight=weight)
    return np.where(hole, np.float32(0.0), smooth.astype(np.float32))
