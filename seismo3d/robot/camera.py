"""A depth camera on a robot: lens, place on the body, clock and shutter."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import as_kind, as_number, as_real_array, as_whole_number, freeze
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.camera import PinholeCamera, as_camera

_OF_ARRAYS = "Make the frame by RgbdFrame.of(rgb, depth, time)."


@dataclass(frozen=True, slots=True)
class LensErrors:
    """How far what is stated of a lens may be off, standard deviations; 0 for what is known exactly.

    The defaults are what cameras have that were calibrated once, or whose maker's numbers are used.

    Attributes
    ----------
    scale : float
        Of the depth, as a share of it.
    focal : float
        Of the focal length, as a share of it.
    centre : float
        Of the principal point, in focal lengths.
    """

    scale: float = 0.01
    focal: float = 0.01
    centre: float = 0.005

    def __post_init__(self) -> None:
        for name in ("scale", "focal", "centre"):
            as_number(getattr(self, name), name, low=0.0, high=0.5)

    def spread(self, by_lens: Float64Array) -> Float64Array:
        """Return the covariance (6, 6) of a pose that changes with the lens's constants as told, (6, 4)."""
        root = by_lens * [self.scale, self.focal, self.centre, self.centre]
        return np.asarray(root @ root.T)


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A colour and depth camera, its depth registered to its colour.

    Attributes
    ----------
    lens : PinholeCamera
    T_body_camera : ndarray of shape (4, 4), float64
        Place of the camera on the robot's body; the identity for a camera alone.
    clock_offset : float
        Seconds to add to the camera's stamps to get the body's time.
    readout : float or None
        Seconds between the exposure of the first and the last row (rolling shutter), 0 for a global shutter. Stamps are
        those of the last row: drivers give them when an image is complete. None: found while mapping.
    depth_delay : float or None
        Seconds from the exposure of depth to its stamp, more than of colour: depth takes longer to compute. None:
        found while mapping.
    name : str
    errors : LensErrors
        How far the lens may be otherwise than stated: what poses may be off by it is in their covariance.
    """

    lens: PinholeCamera
    T_body_camera: Float64Array = field(default_factory=lambda: np.eye(4))
    clock_offset: float = 0.0
    readout: float | None = None
    depth_delay: float | None = None
    name: str = "camera"
    errors: LensErrors = field(default_factory=LensErrors)

    def __post_init__(self) -> None:
        as_kind(self.lens, PinholeCamera, "lens", remedy="Give seismo3d.geometry.camera.PinholeCamera(fx, fy, cx, cy).")
        T = np.array(as_real_array(self.T_body_camera, "T_body_camera", ndim=2), dtype=np.float64)
        if not _is_motion(T):
            raise ParameterError(
                "T_body_camera is no rigid homogeneous matrix; expected shape (4, 4) with a rotation, which does not "
                "mirror, and a last row of 0 0 0 1."
            )
        object.__setattr__(self, "T_body_camera", freeze(T))
        as_kind(self.errors, LensErrors, "errors", remedy="Give seismo3d.robot.LensErrors(...), or leave it out.")
        as_number(self.clock_offset, "clock_offset")
        if self.readout is not None:
            as_number(self.readout, "readout", low=0.0, high=0.2)
        if self.depth_delay is not None:
            as_number(self.depth_delay, "depth_delay", low=-0.2, high=0.2)


def _is_motion(T: Float64Array) -> bool:
    """Return whether an array is a homogeneous matrix that turns and shifts, and does nothing else."""
    if T.shape != (4, 4) or not np.isfinite(T).all() or not np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], atol=1e-6):
        return False
    R = T[:3, :3]
    return bool(np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0.0)


def as_robot_camera(camera: object) -> Camera:
    """Return a robot's camera from one, from a lens, or from a dict or object with a lens's fields."""
    return camera if isinstance(camera, Camera) else Camera(as_camera(camera))


@dataclass(frozen=True, slots=True, eq=False)
class RgbdFrame:
    """One colour and depth image of a camera.

    Attributes
    ----------
    time, depth_time : float
        Stamps of colour and depth in the camera's clock, seconds.
    rgb : ndarray of shape (rows, columns, 3), uint8, or None
    depth : ndarray of shape (rows, columns)
        ``lens.depth_scale`` of its values are a metre; 0 or NaN where there is none.
    camera : int
        Which of the sequence's cameras.
    """

    time: float
    depth_time: float
    rgb: np.ndarray | None
    depth: np.ndarray
    camera: int = 0

    def __post_init__(self) -> None:
        as_number(self.time, "time")
        as_number(self.depth_time, "depth_time")
        as_whole_number(self.camera, "camera", low=0)
        as_kind(self.depth, np.ndarray, "depth", remedy=_OF_ARRAYS)
        if self.rgb is None:
            return
        as_kind(self.rgb, np.ndarray, "rgb", remedy=_OF_ARRAYS)
        if self.rgb.dtype != np.uint8:
            raise ShapeError(
                f"rgb has elements of type {self.rgb.dtype}; expected uint8, 0 to 255. Scale and convert it."
            )

    @classmethod
    def of(cls, rgb: ArrayLike | None, depth: ArrayLike, time: float, *, camera: int = 0) -> RgbdFrame:
        """Return a frame of arrays, colour (0 to 255) and depth taken at one time."""
        stamp = as_number(time, "time")
        return cls(
            stamp, stamp, None if rgb is None else _as_colour(rgb), as_real_array(depth, "depth", ndim=2), camera
        )


def _as_colour(rgb: ArrayLike) -> AnyArray:
    """Return whole numbers from 0 to 255 as bytes; refuse shares of one and 16 bits, which would come out black."""
    values = np.asarray(rgb)
    if values.dtype == np.uint8:
        return np.ascontiguousarray(values)
    if values.dtype.kind not in "iu" or (values.size and (values.min() < 0 or values.max() > 255)):
        span = f" from {values.min():g} to {values.max():g}" if values.dtype.kind in "iuf" and values.size else ""
        raise ShapeError(
            f"rgb has elements of type {values.dtype}{span}; expected whole numbers from 0 to 255. Scale and convert "
            "it."
        )
    return np.ascontiguousarray(values, dtype=np.uint8)


def lens_numbers(camera: PinholeCamera) -> Float64Array:
    """Return fx, fy, cx, cy, k1, k2, p1, p2, k3 as kernels take them."""
    distortion = (*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *distortion])
