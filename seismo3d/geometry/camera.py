"""The pinhole camera with lens distortion: pixels to rays and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import as_number, as_numbers, as_points, as_real_array, as_whole_number, told
from seismo3d.errors import ParameterError, ShapeError


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """Intrinsics of a camera whose depth images are registered to its colour images.

    The camera's frame has x to the right, y down and z forwards, in metres; pixels are (column, row).

    Attributes
    ----------
    fx, fy, cx, cy : float
        Focal lengths and principal point in pixels.
    distortion : tuple of float
        Brown's coefficients k1, k2, p1, p2, k3; missing ones are zero.
    depth_scale : float
        Value of a depth image that stands for one metre.
    width, height : int
        Size of the images in pixels; 0 where it is not known.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    depth_scale: float = 1.0
    width: int = 0
    height: int = 0

    def __post_init__(self) -> None:
        as_number(self.fx, "fx", low=0.0, strict=True)
        as_number(self.fy, "fy", low=0.0, strict=True)
        as_number(self.depth_scale, "depth_scale", low=0.0, strict=True)
        as_number(self.cx, "cx")
        as_number(self.cy, "cy")
        as_whole_number(self.width, "width", low=0)
        as_whole_number(self.height, "height", low=0)
        if not isinstance(self.distortion, (tuple, list, np.ndarray)) or np.ndim(self.distortion) != 1:
            raise ParameterError(f"distortion is {told(self.distortion)}; expected up to five: k1 k2 p1 p2 k3.")
        if len(self.distortion) > 5:
            raise ParameterError(
                f"distortion has {len(self.distortion)} coefficients; expected at most 5: k1 k2 p1 p2 k3."
            )
        given = as_numbers(self.distortion, "distortion", n=len(self.distortion))
        object.__setattr__(self, "distortion", given)

    def rays(self, pixels: ArrayLike) -> Float64Array:
        """Return the points at depth 1 that pixels (column, row) look at; shape (n, 2) in, (n, 2) out."""
        p = as_points(pixels, "pixels", dim=2)
        distorted = (p - [self.cx, self.cy]) / [self.fx, self.fy]
        if not any(self.distortion):
            return distorted
        from seismo3d.geometry._kernels_camera import straighten_points

        return np.asarray(straighten_points(distorted, np.array((*self.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5])))

    def project(self, points: ArrayLike) -> Float64Array:
        """Return the pixels (column, row) of points of shape (n, 3) in the camera's frame, NaN behind it."""
        p = as_points(points, "points", dim=3)
        depth = np.where(p[:, 2] > 1e-9, p[:, 2], np.nan)
        xy = p[:, :2] / depth[:, None]
        if any(self.distortion):
            factor, shift = self._bend(xy)
            xy = xy * factor + shift
        return np.asarray(xy * [self.fx, self.fy] + [self.cx, self.cy])

    def back_project(self, depth: ArrayLike) -> Float64Array:
        """Return the points of a depth image of shape (rows, columns), NaN where depth is 0 or not finite.

        Depth is in the image's own values; ``depth_scale`` of them are a metre. The answer has shape (rows, columns,
        3).
        """
        image = np.asarray(as_real_array(depth, "depth", ndim=2), dtype=np.float64) / self.depth_scale
        rows, columns = image.shape
        self.check_size(image)
        grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        xy = self.rays(grid.astype(np.float64)).reshape(rows, columns, 2)
        z = np.where(np.isfinite(image) & (image > 0.0), image, np.nan)
        return np.concatenate([xy * z[:, :, None], z[:, :, None]], axis=2)

    def check_size(self, depth: AnyArray) -> None:
        """Refuse a depth image of another size than the camera's, where that is known."""
        if self.width and (self.height, self.width) != depth.shape:
            raise ShapeError(
                f"depth has shape {depth.shape}; the camera says ({self.height}, {self.width}). Give the intrinsics of "
                "these images."
            )

    def _bend(self, xy: Float64Array) -> tuple[Float64Array, Float64Array]:
        k1, k2, p1, p2, k3 = (*self.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        factor = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        shift = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=1)
        return factor[:, None], shift


def as_camera(camera: object) -> PinholeCamera:
    """Return a camera from a camera, a dict of its fields, or any object that has them."""
    if isinstance(camera, PinholeCamera):
        return camera
    values: dict[str, Any] = {}
    for name in ("fx", "fy", "cx", "cy", "distortion", "depth_scale", "width", "height"):
        value = camera.get(name) if isinstance(camera, dict) else getattr(camera, name, None)
        if value is not None:
            values[name] = value
    missing = [name for name in ("fx", "fy", "cx", "cy") if name not in values]
    if missing:
        raise ParameterError(
            f"camera has no {', '.join(missing)}; expected a PinholeCamera or its fields. "
            "Give PinholeCamera(fx, fy, cx, cy), or the lens of a robot's camera."
        )
    return PinholeCamera(**values)
