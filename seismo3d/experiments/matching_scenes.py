"""Images and the known motions that matchers are tested on."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array
from seismo3d.errors import FileAccessError

PHOTOS = (
    "astronaut.png", "brick.png", "camera.png", "cell.png", "chelsea.png", "clock_motion.png", "coffee.png",
    "coins.png", "grass.png", "gravel.png", "hubble_deep_field.jpg", "ihc.png", "microaneurysms.png", "moon.png",
    "motorcycle_left.png", "page.png", "retina.jpg", "rocket.jpg", "text.png",
)  # fmt: skip
"""Photographs and micrographs that come with scikit-image."""

Warp = Callable[[tuple[int, int]], Float64Array]
"""Makes the homography from the original to the warped image, in pixels, for a shape (rows, columns)."""


def load_photos(*, longest: int = 640) -> dict[str, AnyArray]:
    """Return the real images that scikit-image and matplotlib ship, grey, uint8, with no side longer than given."""
    import cv2
    import matplotlib as mpl
    import skimage

    folder = Path(skimage.__file__).parent / "data"
    photos = {Path(name).stem: _read_grey(folder / name) for name in PHOTOS}
    samples = Path(mpl.get_data_path()) / "sample_data"
    photos["grace_hopper"] = _read_grey(samples / "grace_hopper.jpg")
    photos["jacksboro"] = _hillshade(
        np.load(samples / "jacksboro_fault_dem.npz", allow_pickle=False)["elevation"].astype(np.float32)
    )
    for name, image in photos.items():
        ratio = longest / max(image.shape)
        if ratio < 1.0:
            shape = (round(image.shape[1] * ratio), round(image.shape[0] * ratio))
            photos[name] = cv2.resize(image, shape, interpolation=cv2.INTER_AREA)
    return photos


def _read_grey(path: Path) -> AnyArray:
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("L"))
    except OSError as error:
        raise FileAccessError(
            f"{path} cannot be read as an image; expected one that the installed packages ship."
        ) from error


def _hillshade(elevation: Float32Array) -> AnyArray:
    gy, gx = np.gradient(elevation / 60.0)
    light = (gx - gy + 1.0) / np.sqrt(3.0 * (1.0 + gx**2 + gy**2))
    return np.asarray(255.0 * np.clip(light, 0.0, 1.0)).astype(np.uint8)


def _about_centre(linear: Float64Array, shape: tuple[int, int]) -> Float64Array:
    centre = np.array([shape[1] - 1.0, shape[0] - 1.0]) / 2.0
    H = np.eye(3)
    H[:2, :2] = linear
    H[:2, 2] = centre - linear @ centre
    return H


def rotation(angle_deg: float) -> Warp:
    """In-plane rotation about the image's centre (x right, y down: clockwise on the screen)."""
    a = math.radians(angle_deg)
    return lambda shape: _about_centre(np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]), shape)


def scaling(factor: float) -> Warp:
    """Zoom about the image's centre."""
    return lambda shape: _about_centre(np.eye(2) * factor, shape)


def tilt(angle_deg: float) -> Warp:
    """Off-plane rotation about the vertical through the centre; the camera's focal length is the image's width."""

    def warp(shape: tuple[int, int]) -> Float64Array:
        a, f = math.radians(angle_deg), float(shape[1])
        K = np.array([[f, 0.0, (shape[1] - 1) / 2.0], [0.0, f, (shape[0] - 1) / 2.0], [0.0, 0.0, 1.0]])
        R = np.array([[math.cos(a), 0.0, math.sin(a)], [0.0, 1.0, 0.0], [-math.sin(a), 0.0, math.cos(a)]])
        offset = np.array([0.0, 0.0, 1.0]) - R @ np.array([0.0, 0.0, 1.0])  # turn about the image plane's own axis
        return np.asarray(K @ (R + np.outer(offset, [0.0, 0.0, 1.0])) @ np.linalg.inv(K))

    return warp


def warp_image(image: AnyArray, H: Float64Array) -> AnyArray:
    """Carry an image by a homography onto a canvas of the same shape, smoothed first where it shrinks."""
    import cv2

    grey = np.asarray(image, dtype=np.float32)
    rows, columns = grey.shape
    centre = np.array([(columns - 1) / 2.0, (rows - 1) / 2.0, 1.0])
    w = float(H[2] @ centre)
    jacobian = (H[:2, :2] - np.outer(H[:2] @ centre / w, H[2, :2])) / w
    _, stretch, vt = np.linalg.svd(jacobian)
    blur = np.sqrt(np.maximum(1.0 / stretch**2 - 1.0, 0.0)) * 0.5
    if blur.max() > 0.05:
        grey = _blur_along(grey, np.asarray(vt.T @ np.diag(blur**2) @ vt))
    return cv2.warpPerspective(grey, H, (columns, rows), flags=cv2.INTER_CUBIC, borderValue=0.0)


def _blur_along(image: Float32Array, covariance: Float64Array) -> Float32Array:
    """Gaussian blur with a full 2 x 2 covariance, in pixels squared."""
    import cv2

    reach = max(1, math.ceil(3.0 * math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))))
    grid = np.stack(np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1)), axis=-1).astype(float)
    precision = np.linalg.inv(covariance + 0.01 * np.eye(2))
    kernel = np.exp(-0.5 * np.einsum("...i,ij,...j", grid, precision, grid))
    return np.asarray(cv2.filter2D(image, cv2.CV_32F, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT_101))


def add_noise(image: AnyArray, sigma: float, rng: np.random.Generator) -> AnyArray:
    """Add white noise to a grey image and round it to uint8."""
    noisy = np.asarray(image, dtype=np.float32) + rng.normal(0.0, sigma, image.shape).astype(np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def project(H: Float64Array, points: Float64Array) -> Float64Array:
    """Carry points (n, 2) by a homography."""
    carried = np.column_stack([points, np.ones(len(points))]) @ H.T
    return np.asarray(carried[:, :2] / carried[:, 2:])


def as_grey_levels(amplitudes: AnyArray) -> AnyArray:
    """Show amplitudes as grey levels, uint8, between their 1st and 99th percentile."""
    low, high = np.percentile(amplitudes, [1.0, 99.0])
    return np.clip((amplitudes - low) * (255.0 / max(high - low, 1e-30)), 0.0, 255.0).astype(np.uint8)


def load_sections(*, seed: int = 40) -> dict[str, AnyArray]:
    """Return synthetic seismic sections of all kinds as pictures (sample, trace), uint8."""
    from seismo3d.synthetic import KINDS, fault_section

    kinds = [kind for kind in KINDS if kind != "demo"]
    sections = (fault_section(kind, seed=seed, shape=(64, 320, 256)) for kind in kinds)
    return {kind: as_grey_levels(np.nan_to_num(made.seismic.T)) for kind, made in zip(kinds, sections)}
