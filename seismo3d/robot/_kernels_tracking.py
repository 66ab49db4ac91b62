"""Kernels of the registration of a frame against the predicted surface; see :mod:`seismo3d.robot.tracking`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.robot._kernels_frame import depth_sigma


@nb.njit(cache=True, nogil=True)
def project_pairs(
    vertices: Float32Array,
    normals: Float32Array,
    step: int,
    R: Float64Array,
    t: Float64Array,
    R_seen: Float64Array,
    t_seen: Float64Array,
    lens: Float64Array,
    points_seen: Float32Array,
    normals_seen: Float32Array,
    reach: float,
    cosine: float,
    source: Float64Array,
    target: Float64Array,
    normal: Float64Array,
    turned: Float64Array,
    sigma: Float64Array,
    residual: Float64Array,
) -> tuple[int, int]:
    """Pair vertices with what the prediction shows at their pixel.

    Returned are how many pairs there are, and how many were tried.

    (R, t) is the frame's pose, (R_seen, t_seen) and ``lens`` those of the prediction. Pairs farther apart than
    ``reach`` or whose normals differ by more than the angle of ``cosine`` are left out. ``normal`` is the prediction's,
    ``turned`` the frame's in the world; ``sigma`` is the standard deviation expected of the residual.
    """
    rows, columns, _ = vertices.shape
    seen_rows, seen_columns, _ = points_seen.shape
    count = 0
    tried = 0
    for r in range(step // 2, rows, step):
        for c in range(step // 2, columns, step):
            if normals[r, c, 0] == 0.0 and normals[r, c, 1] == 0.0 and normals[r, c, 2] == 0.0:
                continue
            tried += 1
            vx, vy, vz = np.float64(vertices[r, c, 0]), np.float64(vertices[r, c, 1]), np.float64(vertices[r, c, 2])
            x = R[0, 0] * vx + R[0, 1] * vy + R[0, 2] * vz + t[0]
            y = R[1, 0] * vx + R[1, 1] * vy + R[1, 2] * vz + t[1]
            z = R[2, 0] * vx + R[2, 1] * vy + R[2, 2] * vz + t[2]
            dx, dy, dz = x - t_seen[0], y - t_seen[1], z - t_seen[2]
            depth = R_seen[0, 2] * dx + R_seen[1, 2] * dy + R_seen[2, 2] * dz
            if depth < 0.1:
                continue
            u = lens[0] * (R_seen[0, 0] * dx + R_seen[1, 0] * dy + R_seen[2, 0] * dz) / depth + lens[2]
            v = lens[1] * (R_seen[0, 1] * dx + R_seen[1, 1] * dy + R_seen[2, 1] * dz) / depth + lens[3]
            cc, rr = math.floor(u + 0.5), math.floor(v + 0.5)
            if cc < 0 or rr < 0 or cc >= seen_columns or rr >= seen_rows:
                continue
            qx = np.float64(points_seen[rr, cc, 0])
            if not math.isfinite(qx):
                continue
            qy, qz = np.float64(points_seen[rr, cc, 1]), np.float64(points_seen[rr, cc, 2])
            if (x - qx) ** 2 + (y - qy) ** 2 + (z - qz) ** 2 > reach * reach:
                continue
            mx = np.float64(normals_seen[rr, cc, 0])
            my, mz = np.float64(normals_seen[rr, cc, 1]), np.float64(normals_seen[rr, cc, 2])
            ax, ay, az = np.float64(normals[r, c, 0]), np.float64(normals[r, c, 1]), np.float64(normals[r, c, 2])
            nx = R[0, 0] * ax + R[0, 1] * ay + R[0, 2] * az
            ny = R[1, 0] * ax + R[1, 1] * ay + R[1, 2] * az
            nz = R[2, 0] * ax + R[2, 1] * ay + R[2, 2] * az
            if nx * mx + ny * my + nz * mz < cosine:
                continue
            source[count, 0], source[count, 1], source[count, 2] = vx, vy, vz
            target[count, 0], target[count, 1], target[count, 2] = qx, qy, qz
            normal[count, 0], normal[count, 1], normal[count, 2] = mx, my, mz
            turned[count, 0], turned[count, 1], turned[count, 2] = nx, ny, nz
            residual[count] = mx * (x - qx) + my * (y - qy) + mz * (z - qz)
            facing = abs(ax * vx + ay * vy + az * vz) / math.sqrt(vx * vx + vy * vy + vz * vz)
            sigma[count] = depth_sigma(vz) * max(facing, 0.3) + 0.0005
            count += 1
    return count, tried


@nb.njit(cache=True, nogil=True, error_model="numpy")
def miss_rays(
    T: Float64Array,
    T_depth_pixel: Float64Array,
    points: Float64Array,
    rays: Float64Array,
    fx: float,
    fy: float,
    depth: Float64Array,
    miss: Float64Array,
) -> None:
    """Write the depth of points (n, 3) in the cameras ``T @ T_depth_pixel``, at least 0.1, and their pixels' misses."""
    local = np.empty(3)
    for n in range(points.shape[0]):
        for a in range(3):
            local[a] = 0.0
        for b in range(3):
            origin = T[b, 3]
            for c in range(3):
                origin += T[b, c] * T_depth_pixel[n, c, 3]
            off = points[n, b] - origin
            for a in range(3):
                axis = 0.0
                for c in range(3):
                    axis += T[b, c] * T_depth_pixel[n, c, a]
                local[a] += axis * off
        depth[n] = max(local[2], 0.1)
        u, v = fx * (local[0] / depth[n] - rays[n, 0]), fy * (local[1] / depth[n] - rays[n, 1])
        miss[n] = math.sqrt(u * u + v * v)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def place_on_rays(
    T: Float64Array,
    T_depth_pixel: Float64Array,
    rays: Float64Array,
    depth: Float64Array,
    weights: Float64Array,
    fx: float,
    source: Float64Array,
    information: Float64Array,
) -> None:
    """Write points (n, 3) at some depths on rays, in the depth's camera, and what is known across each ray, (n, 3, 3).

    The information is in the world's axes: the weight of the pixel's miss, over the pixel's size at that depth.
    """
    direction = np.empty(3)
    for n in range(rays.shape[0]):
        size = 0.0
        for b in range(3):
            source[n, b] = T_depth_pixel[n, b, 3]
            for c in range(3):
                source[n, b] += T_depth_pixel[n, b, c] * rays[n, c] * depth[n]
            direction[b] = 0.0
        for b in range(3):
            for c in range(3):
                direction[b] += T[b, c] * (source[n, c] - T_depth_pixel[n, c, 3])
            size += direction[b] * direction[b]
        known = weights[n] * (fx / depth[n]) ** 2
        for a in range(3):
            for b in range(3):
                information[n, a, b] = known * ((1.0 if a == b else 0.0) - direction[a] * direction[b] / size)
