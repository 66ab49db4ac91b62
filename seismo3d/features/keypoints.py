"""Places of an image that can be found again: corners and blobs at every level of its pyramid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int32Array
from seismo3d.features import _kernels
from seismo3d.features.gradients import central_differences
from seismo3d.features.pyramid import STEP, ImagePyramid

# pixels at the sides of an image where no point is taken: windows would reach beyond
_BORDER = 8
# points of a cell that come first, over what it would hold if all were spread evenly
_CROWD = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Keypoints:
    """Points (n, 2) as (column, row) of the full image, the pyramid level (n,) of each, and its strength (n,)."""

    points: Float64Array
    level: Int32Array
    strength: Float64Array


def _peaks(
    response: AnyArray, threshold: float, allowed: BoolArray | None, n_wanted: int
) -> tuple[Float64Array, Float64Array]:
    """Strongest maxima over 3 x 3 pixels, to sub-pixel: places (n, 2) as (column, row), and their height."""
    import cv2

    columns = response.shape[1]
    top = cv2.compare(response, cv2.dilate(response, np.ones((3, 3), np.uint8)), cv2.CMP_GE)
    top[:_BORDER] = top[-_BORDER:] = 0
    top[:, :_BORDER] = top[:, -_BORDER:] = 0
    if allowed is not None:
        top[~allowed] = 0
    at = np.flatnonzero(top.view(np.bool_))
    flat = response.reshape(-1)
    at = at[flat[at] > threshold]
    at = at[_spread(at % columns, at // columns, flat[at], response.shape, n_wanted)]
    height = flat[at].astype(np.float64)
    places = np.column_stack([at % columns, at // columns]).astype(np.float64)
    for axis, step in enumerate((1, columns)):
        before, after = flat[at - step].astype(np.float64), flat[at + step].astype(np.float64)
        bend = 2.0 * height - before - after
        shift = np.divide(after - before, 2.0 * bend, out=np.zeros_like(bend), where=bend > 1e-12)
        places[:, axis] += np.clip(shift, -0.5, 0.5)
    return places, height


def _spread(x: AnyArray, y: AnyArray, height: AnyArray, shape: tuple[int, int], n_wanted: int) -> AnyArray:
    """Order of the points to keep, strongest first: no cell takes more than half as much again as its share."""
    n_kept = min(n_wanted, x.size)
    many = min(x.size, 8 * n_kept)
    order = np.argpartition(-height, many - 1)[:many] if 0 < many < x.size else np.arange(x.size)
    order = order[np.argsort(-height[order], kind="stable")]
    side = max(24.0, math.sqrt(4.0 * shape[0] * shape[1] / max(n_wanted, 1)))
    across = math.ceil(shape[1] / side)
    cell = (y[order] // side).astype(np.int64) * across + (x[order] // side).astype(np.int64)
    by_cell = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[by_cell], cell[by_cell])
    rank = np.empty(order.size, dtype=np.int64)
    rank[by_cell] = np.arange(order.size) - first
    limit = max(1, round(_CROWD * n_wanted * side * side / (shape[0] * shape[1])))
    crowded = rank >= limit
    return np.asarray(np.concatenate([order[~crowded], order[crowded]])[:n_kept])


def detect_keypoints(
    pyramid: ImagePyramid, *, n_points: int, min_contrast: float = 0.3, blob_share: float = 0.6
) -> Keypoints:
    r"""Find corners (Shi and Tomasi) and blobs (difference of Gaussians) at every level.

    Each level gets a share of the points that falls with its pixel size. The strongest are kept.

    Parameters
    ----------
    pyramid : ImagePyramid
        Grey levels about 0 to 255.
    n_points : int
        At most so many.
    min_contrast : float
        Smallest response, in grey levels.
    blob_share : float
        Share of the points that are blobs, on every second level: they are found alike on neighbouring ones.

    Returns
    -------
    Keypoints
        Strongest first within a level; finest level first.
    """
    import cv2

    quota = STEP ** -np.arange(len(pyramid), dtype=float)
    quota *= n_points / quota.sum()
    found: list[tuple[Float64Array, Float64Array, int]] = []
    spare = 0.0
    for k in range(len(pyramid) - 1, -1, -1):
        image = pyramid.level(k)
        if min(image.shape) <= 2 * _BORDER + 2:
            continue
        allowed = None
        if pyramid.valid is not None:
            near = np.ones((7, 7), np.uint8)
            allowed = cv2.erode(pyramid.valid[k].astype(np.uint8), near, borderValue=1).astype(np.bool_)
        wanted = quota[k] + spare
        points, strength = _strongest(image, min_contrast, allowed, round(wanted), blob_share if k % 2 == 0 else 0.0)
        spare = wanted - len(points)
        found.append((pyramid.to_image(points, k), strength, k))
    found.reverse()
    if not found:
        return Keypoints(np.empty((0, 2)), np.empty(0, np.int32), np.empty(0))
    level = np.concatenate([np.full(len(p), k, dtype=np.int32) for p, _, k in found])
    return Keypoints(np.concatenate([p for p, _, _ in found]), level, np.concatenate([s for _, s, _ in found]))


def _strongest(
    image: Float32Array, min_contrast: float, allowed: BoolArray | None, n: int, blob_share: float
) -> tuple[Float64Array, Float64Array]:
    """Find the strongest corners and blobs of a level, ``n`` together; blobs that sit on a corner are left out."""
    import cv2

    corner = _kernels.corner_strength(*central_differences(image))
    points, strength = _peaks(corner, min_contrast**2, allowed, n)
    strength = np.sqrt(strength)
    n_blobs = round(n * blob_share)
    if n_blobs == 0:
        return points, strength
    difference = cv2.absdiff(image, cv2.GaussianBlur(image, (0, 0), 1.4))
    round_enough = corner > min_contrast**2  # on a stripe a place is known across it only
    where = round_enough if allowed is None else round_enough & allowed
    others, heights = _peaks(difference, 0.5 * min_contrast, where, 3 * n_blobs)
    corners = points[: n - min(n_blobs, len(others))]
    if len(corners) and len(others):
        apart = cKDTree(corners).query(others)[0] > 2.0
        others, heights = others[apart], heights[apart]
    others, heights = others[:n_blobs], heights[:n_blobs]
    n_corners = n - len(others)
    return np.concatenate([points[:n_corners], others]), np.concatenate([strength[:n_corners], heights])
