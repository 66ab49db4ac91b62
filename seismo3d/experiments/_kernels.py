"""Compiled renderer of the experiments: a depth map as triangles, with a depth buffer."""

from __future__ import annotations

import numba
import numpy as np

from seismo3d._typing import Float32Array, Float64Array


@numba.njit(cache=True, nogil=True)
def _draw(p: Float64Array, image: Float32Array, depth: Float64Array) -> None:
    """Draw one triangle, rows (x, y, depth, grey)."""
    area = (p[1, 0] - p[0, 0]) * (p[2, 1] - p[0, 1]) - (p[2, 0] - p[0, 0]) * (p[1, 1] - p[0, 1])
    if abs(area) < 1e-12:
        return
    rows, columns = image.shape
    left, right = max(0, int(np.ceil(p[:, 0].min()))), min(columns - 1, int(np.floor(p[:, 0].max())))
    first, last = max(0, int(np.ceil(p[:, 1].min()))), min(rows - 1, int(np.floor(p[:, 1].max())))
    for y in range(first, last + 1):
        for x in range(left, right + 1):
            b = ((x - p[0, 0]) * (p[2, 1] - p[0, 1]) - (p[2, 0] - p[0, 0]) * (y - p[0, 1])) / area
            c = ((p[1, 0] - p[0, 0]) * (y - p[0, 1]) - (x - p[0, 0]) * (p[1, 1] - p[0, 1])) / area
            a = 1.0 - b - c
            if a < -1e-9 or b < -1e-9 or c < -1e-9:
                continue
            z = a * p[0, 2] + b * p[1, 2] + c * p[2, 2]
            if z < depth[y, x]:
                depth[y, x] = z
                image[y, x] = a * p[0, 3] + b * p[1, 3] + c * p[2, 3]


@numba.njit(cache=True, nogil=True)
def render(
    texture: Float32Array, place: Float64Array, moved_depth: Float64Array, own_depth: Float64Array, jump: float
) -> tuple:
    rows, columns = texture.shape
    image = np.zeros((rows, columns), np.float32)
    depth = np.full((rows, columns), np.inf)
    corner = np.empty((4, 4))
    for y in range(rows - 1):
        for x in range(columns - 1):
            near, far = np.inf, -np.inf
            for k in range(4):
                i, j = y + k // 2, x + k % 2
                near, far = min(near, own_depth[i, j]), max(far, own_depth[i, j])
                corner[k, 0], corner[k, 1] = place[i, j, 0], place[i, j, 1]
                corner[k, 2], corner[k, 3] = moved_depth[i, j], texture[i, j]
            unknown = False
            for k in range(4):
                unknown = unknown or np.isnan(own_depth[y + k // 2, x + k % 2])
            if unknown or far - near > jump:
                continue
            _draw(corner[:3], image, depth)
            _draw(corner[1:], image, depth)
    return image, depth
