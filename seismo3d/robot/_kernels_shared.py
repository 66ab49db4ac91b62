"""Kernel that gathers what the residuals of a located frame have in common; see :mod:`seismo3d.robot.shared_errors`."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float64Array

BLOCKS_ACROSS, BLOCKS_DOWN = 4, 3
"""Blocks of the image, in which errors of neighbours may have anything in common."""


@nb.njit(cache=True, nogil=True, inline="always")
def _block_of(x: float, y: float, lens: Float64Array) -> int:
    """Block of the image that a ray (x, y at depth 1) falls into; ``lens`` is fx, fy, cx, cy, width, height."""
    column = math.floor((x * lens[0] + lens[2]) / lens[4] * BLOCKS_ACROSS)
    row = math.floor((y * lens[1] + lens[3]) / lens[5] * BLOCKS_DOWN)
    column, row = min(max(column, 0), BLOCKS_ACROSS - 1), min(max(row, 0), BLOCKS_DOWN - 1)
    return row * BLOCKS_ACROSS + column


@nb.njit(cache=True, nogil=True, inline="always")
def _add_strains(x: Float64Array, T: Float64Array, sign: float, out: Float64Array) -> None:
    """Add to ``out`` (3, 4) by how much a point of the world is moved by what a camera at a pose takes wrongly.

    The columns are: all too small (scale), too narrow (focal length), and the principal point, x and y.
    """
    for b in range(3):
        u = v = w = 0.0
        for a in range(3):
            off = x[a] - T[a, 3]
            u, v, w = u + T[a, 0] * off, v + T[a, 1] * off, w + T[a, 2] * off
        out[b, 0] += sign * (T[b, 0] * u + T[b, 1] * v + T[b, 2] * w)
        out[b, 1] += sign * (T[b, 0] * u + T[b, 1] * v)
        out[b, 2] += sign * T[b, 0] * w
        out[b, 3] += sign * T[b, 1] * w


@nb.njit(cache=True, nogil=True)
def _add_row(
    arm: Float64Array,
    across: Float64Array,
    weight: float,
    strain: Float64Array,
    jacobian: Float64Array,
    H: Float64Array,
    by_lens: Float64Array,
) -> None:
    """Add a residual along ``across`` at a point, ``arm`` from the camera, to the form and its derivative by the lens.

    Its derivative (6) by (rotation, translation) is left in ``jacobian``.
    """
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        jacobian[a] = arm[b] * across[c] - arm[c] * across[b]
        jacobian[3 + a] = across[a]
    for a in range(6):
        for b in range(6):
            H[a, b] += weight * jacobian[a] * jacobian[b]
        for k in range(4):
            told = across[0] * strain[0, k] + across[1] * strain[1, k] + across[2] * strain[2, k]
            by_lens[a, k] += weight * jacobian[a] * told


@nb.njit(cache=True, nogil=True)
def _add_outer(g: Float64Array, own: Float64Array) -> None:
    for a in range(6):
        for b in range(6):
            own[a, b] += g[a] * g[b]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gather_shared(
    T: Float64Array,
    T_plane_view: Float64Array,
    planes: tuple[Float64Array, Float64Array, Float64Array, Float64Array],
    marks: tuple[Float64Array, Float64Array, Float64Array, Float64Array, Float64Array],
    lens: Float64Array,
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Gather the residuals of a frame that was located at ``T``, in the world's axes about the camera.

    ``planes`` are source, normals, weights and residuals of the pairs, that the map has from about ``T_plane_view``;
    ``marks`` are points, the views' poses, ``T_depth_pixel``, rays and weights of the landmarks; ``lens`` is fx, fy,
    cx, cy, width, height.

    Returned are the information (6, 6) on (rotation, translation); the weighed residuals' pull on the pose by blocks of
    the image (12, 6); the same of each pair by itself, squared (6, 6); and the pull (6, 4) of what the lens takes
    wrongly, as :func:`_add_strains` has it.
    """
    H, own, by_lens = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 4))
    blocks = np.zeros((BLOCKS_ACROSS * BLOCKS_DOWN, 6))
    source, normals, weights, residuals = planes
    points, T_views, T_depth_pixel, rays, mark_weights = marks
    jacobian, pull, arm, x = np.empty(6), np.empty(6), np.empty(3), np.empty(3)
    strain, Tc = np.empty((3, 4)), np.eye(4)
    for i in range(source.shape[0]):
        if weights[i] == 0.0:
            continue
        p = source[i]
        for a in range(3):
            arm[a] = T[a, 0] * p[0] + T[a, 1] * p[1] + T[a, 2] * p[2]
            x[a] = arm[a] + T[a, 3]
        strain[:] = 0.0
        _add_strains(x, T, 1.0, strain)
        _add_strains(x, T_plane_view, -1.0, strain)
        _add_row(arm, normals[i], weights[i], strain, jacobian, H, by_lens)
        for a in range(6):
            pull[a] = weights[i] * residuals[i] * jacobian[a]
        _add_outer(pull, own)
        blocks[_block_of(p[0] / p[2], p[1] / p[2], lens)] += pull
    across = np.empty((2, 3))
    for n in range(points.shape[0]):
        if mark_weights[n] == 0.0:
            continue
        for a in range(3):
            for b in range(4):
                Tc[a, b] = T[a, 3] if b == 3 else 0.0
                for c in range(3):
                    Tc[a, b] += T[a, c] * T_depth_pixel[n, c, b]
        u = v = w = 0.0
        for a in range(3):
            x[a] = points[n, a]
            arm[a] = x[a] - T[a, 3]
            off = x[a] - Tc[a, 3]
            u, v, w = u + Tc[a, 0] * off, v + Tc[a, 1] * off, w + Tc[a, 2] * off
        depth = max(w, 0.1)
        strain[:] = 0.0
        _add_strains(x, Tc, 1.0, strain)
        _add_strains(x, T_views[n], -1.0, strain)
        pull[:] = 0.0
        for k in range(2):
            at = (u if k == 0 else v) / depth
            # the frame's point moves with the pose, so that the pixel of the map's goes the other way
            for a in range(3):
                across[k, a] = lens[k] / depth * (Tc[a, k] - Tc[a, 2] * at)
            _add_row(arm, across[k], mark_weights[n], strain, jacobian, H, by_lens)
            miss = lens[k] * (rays[n, k] - at)
            for a in range(6):
                pull[a] += mark_weights[n] * miss * jacobian[a]
        _add_outer(pull, own)
        blocks[_block_of(rays[n, 0], rays[n, 1], lens)] += pull
    return H, blocks, own, by_lens
