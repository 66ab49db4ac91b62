"""Textured depth maps seen from another side, with occlusion: rotation off the image plane in true 3D."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array
from seismo3d.experiments import _kernels
from seismo3d.experiments.matching_scenes import _hillshade, _read_grey, load_photos


@dataclass(frozen=True, slots=True, eq=False)
class DepthScene:
    """A grey image (rows, columns), the depth of each pixel (NaN: unknown) and the pinhole camera's fx, fy, cx, cy."""

    name: str
    image: AnyArray
    depth: Float64Array
    camera: tuple[float, float, float, float]


def load_depth_scenes() -> list[DepthScene]:
    """Return scenes from what scikit-image and matplotlib ship: one measured, a terrain, and photographs on relief."""
    import matplotlib as mpl
    import skimage

    data = Path(skimage.__file__).parent / "data"
    scenes = [_motorcycle(data)]
    samples = Path(mpl.get_data_path()) / "sample_data"
    jacksboro = np.load(samples / "jacksboro_fault_dem.npz", allow_pickle=False)["elevation"].astype(np.float32)
    scenes.append(_terrain("jacksboro", jacksboro, 60.0))
    photos = load_photos()
    for seed, name in enumerate(("coffee", "astronaut", "gravel", "rocket")):
        scenes.append(_relief(name, photos[name], seed))
    return scenes


def _motorcycle(data: Path) -> DepthScene:
    from scipy.ndimage import distance_transform_edt

    image = _read_grey(data / "motorcycle_left.png")
    disparity = np.load(data / "motorcycle_disp.npz", allow_pickle=False)["arr_0"].astype(np.float64)
    nearest = distance_transform_edt(~np.isfinite(disparity), return_distances=False, return_indices=True)
    disparity = disparity[tuple(nearest)]
    return DepthScene(
        "motorcycle", image, 994.978 * 193.001 / (disparity + 31.086), (994.978, 994.978, 311.193, 254.877)
    )


def _terrain(name: str, elevation: Float32Array, spacing: float) -> DepthScene:
    """Show a terrain from above, its relief exaggerated three times, from as high as the map is wide."""
    shade = _hillshade(elevation)
    high = 3.0 * (elevation.astype(np.float64) - float(elevation.mean())) / spacing
    width = float(elevation.shape[1])
    return DepthScene(name, shade, width - high, _camera(elevation.shape))


def _relief(name: str, image: AnyArray, seed: int) -> DepthScene:
    """Lay a photograph over smooth hills with a step: a block that stands out of the plane."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    rows, columns = image.shape
    hills = gaussian_filter(rng.normal(size=image.shape), 0.12 * min(image.shape))
    depth = columns * (1.0 + 0.06 * hills / np.abs(hills).max())
    y, x = rng.uniform(0.2, 0.5, 2) * (rows, columns)
    depth[int(y) : int(y + 0.3 * rows), int(x) : int(x + 0.3 * columns)] -= 0.08 * columns
    return DepthScene(name, image, depth, _camera(image.shape))


def _camera(shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    return float(shape[1]), float(shape[1]), (shape[1] - 1) / 2.0, (shape[0] - 1) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class SideView:
    """A turned scene: image, where anything is seen, and where each pixel went, (rows, columns, 2)."""

    image: Float32Array
    seen: BoolArray
    place: Float64Array


def turn(scene: DepthScene, angle_deg: float) -> SideView:
    """Render a scene as if it had turned, hidden parts hidden; what is uncovered shows the nearest pixel seen."""
    from scipy.ndimage import distance_transform_edt

    fx, fy, cx, cy = scene.camera
    rows, columns = scene.image.shape
    v, u = np.mgrid[:rows, :columns].astype(np.float64)
    points = np.stack([(u - cx) / fx * scene.depth, (v - cy) / fy * scene.depth, scene.depth], axis=-1)
    centre = np.array([0.0, 0.0, float(np.nanmedian(scene.depth))])
    a = math.radians(angle_deg)
    R = np.array([[math.cos(a), 0.0, math.sin(a)], [0.0, 1.0, 0.0], [-math.sin(a), 0.0, math.cos(a)]])
    moved = (points - centre) @ R.T + centre
    place = np.stack([fx * moved[..., 0] / moved[..., 2] + cx, fy * moved[..., 1] / moved[..., 2] + cy], axis=-1)
    jump = 0.02 * float(np.nanmedian(scene.depth))
    image, depth = _kernels.render(scene.image.astype(np.float32), place, moved[..., 2].copy(), scene.depth, jump)
    seen = np.isfinite(depth)
    nearest = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    return SideView(image[tuple(nearest)], seen, place)


def distance_to_truth(view: SideView, points: Float64Array, found: Float64Array) -> Float64Array:
    """Distance of matches (n, 2) from where the points of the scene's image went, in pixels.

    A point on the rim of an object belongs to it and to what is behind it: of the 3 x 3 pixels around, the one that
    moved likest counts.
    """
    rows, columns = view.place.shape[:2]
    best = np.full(len(points), np.inf)
    at = np.rint(points).astype(int)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            x, y = np.clip(at[:, 0] + dx, 0, columns - 1), np.clip(at[:, 1] + dy, 0, rows - 1)
            expected = view.place[y, x] + points - np.column_stack([x, y])
            best = np.minimum(best, np.linalg.norm(expected - found, axis=1))
    return best
