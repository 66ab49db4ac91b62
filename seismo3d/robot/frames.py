"""Measure: what mapping needs of a frame - depth without shutter and lens effects, vertices, normals, colours."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

import numpy as np

from seismo3d._settings import Share, check_fields
from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array
from seismo3d._validate import as_real_array
from seismo3d.errors import ShapeError
from seismo3d.geometry._kernels_camera import straighten_rows
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot import _kernels_frame as kernels
from seismo3d.robot import _kernels_shutter as shutter
from seismo3d.robot._kernels_kept import unpack_colours
from seismo3d.robot.camera import RgbdFrame, lens_numbers
from seismo3d.robot.room import Room

_PARTS = 4
"""Parts that a frame's rows are measured in, side by side."""


@dataclass(frozen=True, slots=True)
class MeasureSettings:
    """How depth is read.

    Attributes
    ----------
    near, far : float in [0, 60), (near, 60)
        Depths outside are left out, metres.
    total_variation : float in [0, 1]
        Weight of total-variation denoising of the depth before all else, in metres; 0 for none. It costs more than all
        the rest together.
    """

    near: Annotated[float, f"[0, {kernels.FARTHEST:g})"] = 0.3
    far: Annotated[float, f"(near, {kernels.FARTHEST:g})"] = 4.0
    total_variation: Share = 0.0

    def __post_init__(self) -> None:
        check_fields(self)


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
    n_normals : int
        Number of vertices with a normal.
    pixels : ndarray of shape (rows * columns,), uint64
        Depth, slope, weight for fusion and colour, packed, 0 for what is not fused; see
        :func:`seismo3d.robot._kernels_frame.pack_pixels`. The weight is 1 for a surface seen frontally at a metre.
    has_colour : bool
        Whether the pixels have colours.
    grey : ndarray of shape (rows, columns), uint8, or None
        The colour image as it was taken.
    """

    depth: Float32Array
    vertices: Float32Array
    normals: Float32Array
    n_normals: int
    pixels: AnyArray
    has_colour: bool
    grey: AnyArray | None

    @property
    def colour(self) -> AnyArray:
        """Colour (rows, columns, 3), uint8, of each depth pixel that is fused; (0, 0, 3) without colours."""
        if not self.has_colour:
            return np.zeros((0, 0, 3), dtype=np.uint8)
        out = np.empty((*self.depth.shape, 3), dtype=np.uint8)
        unpack_colours(self.pixels, out.reshape(-1, 3))
        return out


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
        check_frame(frame, self.lens)
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
        if frame.rgb is None:
            return self._packed(depth, None, grey)
        # the motion from the depth's time to a row's: of the first row, and how much more of each one after it
        lead, spacing = timing.colour_lead - 0.5 * timing.readout, timing.readout / len(depth)
        return self._packed(depth, frame.rgb, grey, (-twist, lead, spacing))

    def measured(self, depth: Float32Array, colour: AnyArray, grey: AnyArray | None = None) -> Measured:
        """Measure a depth image in metres, free of the shutter's effect, with the colour of each pixel."""
        return self._packed(depth, colour if colour.size else None, grey)

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

    def _packed(
        self,
        depth: Float32Array,
        rgb: AnyArray | None,
        grey: AnyArray | None,
        motion: tuple[Float64Array, float, float] = (np.zeros(6), 0.0, 0.0),
    ) -> Measured:
        """Return what is fused of a depth image, with the colours of an image to whose rows a motion leads."""
        near, far, focal, rays = self.settings.near, self.settings.far, self._focal, self.rays(depth.shape)
        spacing, noise = 2.0 / float(self._focal.min()), kernels.noise_of(depth, near, far)
        vertices = self._room.empty((depth.shape[0] // 2, depth.shape[1] // 2, 3), np.float32)
        normals, pixels = self._room.empty(vertices.shape, np.float32), self._room_for(depth.shape, np.uint64)
        flat, colours = pixels.reshape(-1), None if rgb is None else self._whole_colours(rgb)

        def face_and_pack(first: int, last: int) -> int:
            count = kernels.grid_normals(first, last, vertices, 2, spacing, noise, normals)
            kernels.pack_pixels(first, last, depth, vertices, normals, far, noise, flat)
            if colours is not None:
                shutter.colour_pixels(first, last, colours, vertices, *motion, focal, flat)
            return count

        self._by_rows(len(vertices), lambda a, b: kernels.halve(a, b, depth, rays, near, far, noise, vertices))
        n_normals = sum(self._by_rows(len(vertices), face_and_pack))
        return Measured(depth, vertices, normals, n_normals, flat, colours is not None, grey)

    def _whole_colours(self, rgb: AnyArray) -> AnyArray:
        """Return an image's colours (rows, columns) as whole numbers, red in the lowest byte."""
        import cv2

        out = self._room.empty((*rgb.shape[:2], 4), np.uint8)
        cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2RGBA, out)
        return out.view(np.uint32)[:, :, 0]

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

    def _by_rows(self, rows: int, work: Callable[[int, int], Any]) -> list[Any]:
        """Do work on rows in parts on the pool; return what each gave."""
        edges = [rows * k // _PARTS for k in range(_PARTS + 1)]
        return [part.result() for part in [self._pool.submit(work, a, b) for a, b in pairwise(edges)]]

    def _metres(self, frame: RgbdFrame) -> Float32Array:
        raw, scale = as_real_array(frame.depth, "depth", ndim=2), self.lens.depth_scale
        if not raw.dtype.isnative or raw.dtype in (np.float16, np.longdouble):  # no compiled loop reads these
            raw = raw.astype(np.float64)
        depth = self._room.empty(raw.shape, np.float32)
        self._by_rows(len(raw), lambda a, b: kernels.read_depth(a, b, raw, scale, depth))
        if self.settings.total_variation > 0.0:
            depth = smooth_depth(depth, self.settings.total_variation)
        return depth


def check_frame(frame: RgbdFrame, lens: PinholeCamera) -> None:
    """Refuse a frame whose depth and colour do not fit each other or the camera, or are too small."""
    raw = as_real_array(frame.depth, "depth", ndim=2)
    if min(raw.shape) < 16:
        raise ShapeError(f"depth has shape {raw.shape}; expected at least 16 x 16 pixels.")
    if frame.rgb is not None and frame.rgb.shape != (*raw.shape, 3):
        raise ShapeError(
            f"rgb has shape {frame.rgb.shape} and depth {raw.shape}; expected (rows, columns, 3) of the same size. "
            "Register them first."
        )
    lens.check_size(raw)


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
