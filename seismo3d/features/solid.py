"""The matcher for volumes, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array
from seismo3d.features.cyclic import compare_descriptors, pick_matches
from seismo3d.features.poses import Pose, agree_on_pose, refine_pose
from seismo3d.features.spheres import SphereLayout, VolumePoints, describe_corners, detect_corners, flip_frames


@dataclass(frozen=True, slots=True)
class SolidSettings:
    """How volumes are matched.

    Attributes
    ----------
    n_points : int
        Corners a volume, at most.
    smoothing : float
        Standard deviation of the Gaussian that precedes all, in voxels.
    max_ratio, apart : float
        Ratio of descriptor distances, best to best competitor more than ``apart`` voxels away.
    distance : float
        Matches within this of the common pose count as first matches, in voxels.
    min_inliers : int
        With fewer first matches there is no common pose, hence no match.
    min_correlation : float
        Of patches at the final pose: smaller ones are no matches.
    max_shift : float
        Largest shift of a match from the common pose, in voxels.
    """

    n_points: int = 300
    smoothing: float = 1.0
    max_ratio: float = 0.97
    apart: float = 6.0
    distance: float = 3.0
    min_inliers: int = 6
    min_correlation: float = 0.4
    max_shift: float = 1.5
    layout: SphereLayout = field(default_factory=SphereLayout)


@dataclass(frozen=True, slots=True, eq=False)
class SolidMatches:
    """Matched points (n, 3) of both volumes, correlation (n,), and the rotation (3, 3) from source to target."""

    target: Float64Array
    source: Float64Array
    correlation: Float64Array
    R: Float64Array


def smooth_volume(volume: Float32Array, smoothing: float) -> Float32Array:
    """Smooth a volume by a short Gaussian."""
    return np.asarray(ndimage.gaussian_filter(volume, smoothing, mode="nearest", truncate=3.0))


def describe_volume(
    volume: Float32Array, valid: BoolArray | None, settings: SolidSettings
) -> tuple[VolumePoints, Float32Array, Float32Array]:
    """Detect the corners of a smoothed volume and describe them for both signs of their axes."""
    corners = detect_corners(volume, valid, n_points=settings.n_points)
    return corners, *describe_corners(volume, valid, corners, settings.layout)


def match_volumes(
    target: Float32Array,
    valid_target: BoolArray | None,
    source: Float32Array,
    valid_source: BoolArray | None,
    settings: SolidSettings,
) -> tuple[SolidMatches, tuple[int, int]]:
    """Match two volumes that a rigid motion carries into each other, as far as they overlap.

    Parameters
    ----------
    target, source : ndarray of shape (ni, nj, nk), float32
        Amplitudes.
    valid_target, valid_source : ndarray of bool, optional
        Where there is data.
    settings : SolidSettings

    Returns
    -------
    matches : SolidMatches
        Empty where no pose has enough support.
    n_points : tuple of int
        Corners of target and source.
    """
    first, second = smooth_volume(target, settings.smoothing), smooth_volume(source, settings.smoothing)
    corners_t, described_t, _ = describe_volume(first, valid_target, settings)
    corners_s, described_s, flipped_s = describe_volume(second, valid_source, settings)
    n_points = (len(corners_t), len(corners_s))
    nothing = SolidMatches(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.eye(3))
    rotations, points_t, points_s = propose_poses(corners_t, described_t, corners_s, described_s, flipped_s, settings)
    found = agree_on_pose(rotations, points_t, points_s, distance=settings.distance, min_inliers=settings.min_inliers)
    if found is None:
        return nothing, n_points
    return _matches_at(first, valid_target, second, valid_source, corners_t, found[0], settings, nothing), n_points


def propose_poses(
    corners_t: VolumePoints,
    described_t: Float32Array,
    corners_s: VolumePoints,
    described_s: Float32Array,
    flipped_s: Float32Array,
    settings: SolidSettings,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Match under both signs of the source's axes: rotations (n, 3, 3), and matched points (n, 3) of each."""
    both = np.concatenate([described_s, flipped_s])
    points_s = np.concatenate([corners_s.points, corners_s.points])
    frames_s = np.concatenate([corners_s.frames, flip_frames(corners_s.frames)])
    compared = compare_descriptors(described_t, both)
    near = pick_matches(compared, corners_t.points, points_s, max_ratio=settings.max_ratio, apart=settings.apart)
    c, s = np.cos(near.shift), np.sin(near.shift)
    turn = np.zeros((len(c), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
    rotations = corners_t.frames[near.target] @ turn @ frames_s[near.source].transpose(0, 2, 1)
    return np.asarray(rotations), corners_t.points[near.target], points_s[near.source]


def _matches_at(
    first: Float32Array,
    valid_t: BoolArray | None,
    second: Float32Array,
    valid_s: BoolArray | None,
    corners: VolumePoints,
    pose: Pose,
    settings: SolidSettings,
    nothing: SolidMatches,
) -> SolidMatches:
    """All corners of the target that the refined pose carries onto something alike in the source."""
    points = np.floor(corners.points)
    pose, correlation, _ = refine_pose(first, second, points, pose)
    points = points[correlation >= settings.min_correlation]
    if len(points) < settings.min_inliers:
        return nothing
    pose, correlation, shift = refine_pose(first, second, points, pose)
    source = pose.to_source(points - shift)
    good = (correlation >= settings.min_correlation) & (np.linalg.norm(shift, axis=1) <= settings.max_shift)
    good &= _on_data(points, valid_t) & _on_data(source, valid_s)
    if good.sum() < settings.min_inliers:
        return nothing
    return SolidMatches(points[good], source[good], correlation[good], pose.R)


def _on_data(points: Float64Array, valid: BoolArray | None) -> AnyArray:
    if valid is None:
        return np.ones(len(points), dtype=np.bool_)
    at = np.clip(np.rint(points).astype(np.int64), 0, np.array(valid.shape) - 1)
    return valid[tuple(at.T)]
