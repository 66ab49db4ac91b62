"""Pairs of depth frames with a known rotation between them, from real frames or from a drawn room.

The source is what a second camera at the same place would see, turned about its optical axis: colour and depth are
sampled anew at its own pixels, both frames get noise of their own, and a part of each is cut off, so that no point
occurs twice and the frames overlap in part only.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import FileAccessError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import exp_rotation, make_transform
from seismo3d.scan import Scan

COLOUR_NOISE = 4.0
DEPTH_NOISE = 0.0015
"""Standard deviation of depth in metres at one metre; it grows with the square of depth."""
CUT = 0.15
"""Share of the columns that is cut off: on the right of the source, on the left of the target."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One colour and depth frame: grey uint8 image, depth in metres (NaN where there is none), camera."""

    grey: AnyArray
    depth: Float64Array
    camera: PinholeCamera


@dataclass(frozen=True, slots=True, eq=False)
class FramePair:
    """Two frames with the transform between them.

    Attributes
    ----------
    image_target, image_source : ndarray of uint8
    target, source : Scan
    T_target_source : ndarray of shape (4, 4)
    spacing : float
        Median distance of neighbouring points in metres.
    """

    image_target: AnyArray
    image_source: AnyArray
    target: Scan
    source: Scan
    T_target_source: Float64Array
    spacing: float


def read_frames(folder: Path, *, n_frames: int) -> list[Frame]:
    """Read frames, evenly spread, of a sequence in the TUM layout with ``camera.json`` and ``associations.txt``."""
    import cv2

    try:
        fields = json.loads((folder / "camera.json").read_text())
        rows = [r.split() for r in (folder / "associations.txt").read_text().splitlines() if r and r[0] != "#"]
    except OSError as error:
        raise FileAccessError(f"{folder} is no sequence: {error}.") from error
    camera = PinholeCamera(
        fields["fx"], fields["fy"], fields["cx"], fields["cy"], tuple(fields.get("distortion", ())), 1.0
    )
    frames = []
    for k in np.linspace(0, len(rows) - 1, n_frames).astype(int):
        grey = cv2.imread(str(folder / rows[k][1]), cv2.IMREAD_GRAYSCALE)
        depth = cv2.imread(str(folder / rows[k][3]), cv2.IMREAD_UNCHANGED)
        if grey is None or depth is None:
            raise FileAccessError(f"{folder / rows[k][1]} or {rows[k][3]} cannot be read; expected images.")
        metres = np.where(depth > 0, depth / fields["depth_scale"], np.nan)
        frames.append(Frame(grey, metres, camera))
    return frames


def draw_room(*, seed: int = 0, size: tuple[int, int] = (240, 320)) -> Frame:
    """Return the view into a textured room with boxes and a ball, drawn by casting rays; depth in metres."""
    rng = np.random.default_rng(seed)
    rows, columns = size
    camera = PinholeCamera(0.82 * columns, 0.82 * columns, columns / 2 - 0.5, rows / 2 - 0.5)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    rays = np.concatenate([camera.rays(grid.astype(np.float64)), np.ones((grid.shape[0], 1))], axis=1)
    rays = rays @ exp_rotation([0.15, 0.25 + 0.2 * rng.uniform(), 0.0]).T
    boxes = [(np.array([-2.0, -1.3, -1.0]), np.array([2.2, 1.2, 3.2]))]
    for _ in range(5):
        low = np.array([rng.uniform(-1.5, 1.0), 0.2 * rng.uniform(), rng.uniform(1.4, 2.4)])
        boxes.append((low, low + rng.uniform(0.3, 0.8, size=3)))
    depth = np.full(len(rays), np.inf)
    colour = np.zeros(len(rays))
    for number, (low, high) in enumerate(boxes):
        near, far = _slab(rays, low, high)
        hit = far if number == 0 else np.where((near < far) & (near > 0), near, np.inf)
        closer = hit < depth
        depth[closer] = hit[closer]
        colour[closer] = _texture(rays[closer] * hit[closer, None], seed + 7 * number)
    centre, radius = np.array([0.5 * rng.uniform(), -0.4, 1.9]), 0.35
    along = rays @ centre / (rays**2).sum(axis=1)
    off = radius**2 - ((rays * along[:, None] - centre) ** 2).sum(axis=1)
    hit = np.where(off > 0, along - np.sqrt(np.maximum(off, 0)) / np.linalg.norm(rays, axis=1), np.inf)
    closer = hit < depth
    depth[closer] = hit[closer]
    colour[closer] = _texture(rays[closer] * hit[closer, None], seed + 99)
    return Frame(np.clip(colour, 0, 255).astype(np.uint8).reshape(size), depth.reshape(size), camera)


def _slab(rays: Float64Array, low: Float64Array, high: Float64Array) -> tuple[Float64Array, Float64Array]:
    inverse = 1.0 / np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    first, second = low * inverse, high * inverse
    return np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)


def _texture(points: Float64Array, seed: int) -> Float64Array:
    """Return grey values of a texture in space: patches of many sizes with sharp rims."""
    rng = np.random.default_rng(seed)
    value = np.full(len(points), 110.0 + 60.0 * rng.uniform())
    for scale in (0.5, 0.22, 0.1, 0.05):
        turn = exp_rotation(rng.normal(size=3))
        cells = np.floor(points @ turn.T / scale).astype(np.int64)
        mixed = (cells[:, 0] * 73856093) ^ (cells[:, 1] * 19349663) ^ (cells[:, 2] * 83492791) ^ seed
        value += 60.0 * scale**0.3 * ((mixed * 2654435761 % 1024) / 512.0 - 1.0)
    return value


def rotate_frame(frame: Frame, angle_deg: float, rng: np.random.Generator) -> FramePair:
    """Return a pair of frames, the source's camera turned about its optical axis by an angle."""
    import cv2

    rows, columns = frame.depth.shape
    lens = frame.camera
    second = PinholeCamera(lens.fx, lens.fy, lens.cx, lens.cy)
    turn = exp_rotation([0.0, 0.0, np.radians(angle_deg)])
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(np.float64)
    rays = np.concatenate([second.rays(grid), np.ones((len(grid), 1))], axis=1) @ turn.T
    places = lens.project(rays).reshape(rows, columns, 2).astype(np.float32)
    grey = cv2.remap(frame.grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderValue=0)
    depth = _sample_depth(frame.depth, places)
    depth[:, int(columns * (1.0 - CUT)) :] = np.nan
    kept = frame.depth.copy()
    kept[:, : int(columns * CUT)] = np.nan
    images, scans = [], []
    for image, values, camera in ((frame.grey, kept, lens), (grey, depth, second)):
        noisy = values + DEPTH_NOISE * values**2 * rng.normal(size=values.shape)
        images.append(np.clip(image + COLOUR_NOISE * rng.normal(size=image.shape), 0, 255).astype(np.uint8))
        scans.append(Scan.from_rgbd(images[-1], np.where(np.isfinite(noisy), noisy, 0.0), camera, max_depth=5.0))
    spacing = float(np.nanmedian(frame.depth)) / lens.fx
    return FramePair(images[0], images[1], scans[0], scans[1], make_transform(turn, np.zeros(3)), spacing)


def _sample_depth(depth: Float64Array, places: Any) -> Float64Array:
    """Sample depth between its pixels where it is smooth; NaN at holes and jumps."""
    import cv2

    filled = np.nan_to_num(depth, nan=0.0).astype(np.float32)
    linear = cv2.remap(filled, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderValue=0)
    nearest = cv2.remap(filled, places[..., 0], places[..., 1], cv2.INTER_NEAREST, borderValue=0)
    good = (nearest > 0.0) & (np.abs(linear - nearest) < 0.01 * nearest)
    return np.where(good, linear, np.nan).astype(np.float64)
