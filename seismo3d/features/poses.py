"""Rigid poses from matches that each give one, and their refinement against the amplitudes themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, Int32Array
from seismo3d.features import _kernels_volume

# of the patches that a pose is refined by, in voxels; and the steps of that
_RADIUS, _MOST_STEPS = 5, 12


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A rigid motion: x_target = R x_source + t, in voxels."""

    R: Float64Array
    t: Float64Array

    def to_source(self, points: Float64Array) -> Float64Array:
        """Carry target points (n, 3) into the source."""
        return np.asarray((points - self.t) @ self.R)

    def to_target(self, points: Float64Array) -> Float64Array:
        """Carry source points (n, 3) into the target."""
        return np.asarray(points @ self.R.T + self.t)


def fit_pose(target: Float64Array, source: Float64Array) -> Pose:
    """Least-squares rigid motion of matched points (n, 3), n >= 3 (Kabsch)."""
    p, q = target.mean(axis=0), source.mean(axis=0)
    u, _, vt = np.linalg.svd((target - p).T @ (source - q))
    R = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return Pose(R, p - R @ q)


def agree_on_pose(
    rotations: Float64Array, target: Float64Array, source: Float64Array, *, distance: float = 4.0, min_inliers: int = 5
) -> tuple[Pose, BoolArray] | None:
    """Find the pose that most matches support; each match proposes the pose that it gives alone.

    Parameters
    ----------
    rotations : ndarray of shape (n, 3, 3)
        Source to target, of each match.
    target, source : ndarray of shape (n, 3)
        Matched points.
    distance : float
        Matches within this of where the pose puts them support it, in voxels.
    min_inliers : int
        With fewer, there is no pose.

    Returns
    -------
    Pose and mask of the inliers, or None
    """
    if len(target) < min_inliers:
        return None
    shifts = target - np.einsum("nij,nj->ni", rotations, source)
    support = _kernels_volume.count_inliers(rotations, shifts, target, source, 1.5 * distance)
    for k in np.argsort(-support, kind="stable")[:5]:
        pose = Pose(rotations[k], shifts[k])
        inlier = np.linalg.norm(pose.to_target(source) - target, axis=1) <= 1.5 * distance
        for limit in (1.5 * distance, distance, distance):
            if inlier.sum() < min_inliers:
                break
            pose = fit_pose(target[inlier], source[inlier])
            inlier = np.linalg.norm(pose.to_target(source) - target, axis=1) <= limit
        if inlier.sum() >= min_inliers and _spans(target[inlier]):
            return pose, np.asarray(inlier)
    return None


def _spans(points: Float64Array) -> bool:
    """Whether points fix a rotation: they don't lie on one line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1.0)


def _patch(radius: int) -> Int32Array:
    grid = np.stack(np.meshgrid(*[np.arange(-radius, radius + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.square(grid).sum(axis=1) <= radius**2 + 1].astype(np.int32)


def refine_pose(
    target: Float32Array,
    source: Float32Array,
    points: Float64Array,
    pose: Pose,
) -> tuple[Pose, Float64Array, Float64Array]:
    """Align patches of both volumes by one rigid motion: Gauss-Newton, each patch weighed by how alike it is.

    Parameters
    ----------
    target, source : ndarray of shape (ni, nj, nk), float32
        Smoothed amplitudes.
    points : ndarray of shape (n, 3), float64
        Centres of patches in the target.
    pose : Pose
        Start, within about half a wavelength.

    Returns
    -------
    pose : Pose
    correlation : ndarray of shape (n,)
        Of each patch at the pose; -1 where it leaves a volume.
    residual : ndarray of shape (n, 3)
        Shift of each patch, in target voxels, that would align it still better, as far as it says: zero along its
        layers.
    """
    n = len(points)
    patch = _patch(_RADIUS)
    normal, right, correlation = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.full(n, -1.0)
    whole = np.floor(points)
    centre = whole.mean(axis=0)
    for _ in range(_MOST_STEPS):
        _kernels_volume.align_patches(
            target,
            source,
            whole,
            np.ascontiguousarray(pose.R.T),
            pose.to_source(whole),
            patch,
            normal,
            right,
            correlation,
        )
        weight = np.maximum(correlation, 0.0) ** 2
        lever = np.zeros((n, 3, 6))
        lever[:, :, 3:] = np.eye(3)
        d = whole - centre
        lever[:, 0, 1], lever[:, 0, 2] = d[:, 2], -d[:, 1]
        lever[:, 1, 0], lever[:, 1, 2] = -d[:, 2], d[:, 0]
        lever[:, 2, 0], lever[:, 2, 1] = d[:, 1], -d[:, 0]
        H = np.einsum("n,nai,nab,nbj->ij", weight, lever, normal, lever, optimize=True)
        g = np.einsum("n,nai,na->i", weight, lever, right)
        H[np.diag_indices(6)] += 1e-9 * np.trace(H) + 1e-12
        step = np.linalg.solve(H, g)
        pose = _composed(pose, _rotation(step[:3]), step[3:], centre)
        if np.abs(step[3:]).max() < 1e-3 and np.abs(step[:3]).max() < 1e-5:
            break
    reliability = normal + 0.3 * np.trace(normal, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3) + 1e-9 * np.eye(3)
    return pose, correlation, np.linalg.solve(reliability, right[:, :, None])[:, :, 0]


def _composed(pose: Pose, turn: Float64Array, shift: Float64Array, centre: Float64Array) -> Pose:
    """Follow a pose by the motion x -> turn (x - centre) + centre + shift in the target."""
    return Pose(turn @ pose.R, turn @ (pose.t - centre) + centre + shift)


def _rotation(vector: Float64Array) -> Float64Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
