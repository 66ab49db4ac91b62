"""The matcher for volumes, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from seismo3d._typing import BoolArray, Float32Array, Float64Array
from seismo3d.features.cyclic import compare_descriptors, pick_matches
from seismo3d.features.inputs import Grey, look_up
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
        Largest ratio of descriptor distances, best to best competitor more than ``apart`` voxels away.
    distance : float
        Matches within this of the common pose count as first matches, in voxels.
    min_inliers : int
        With fewer first matches there is no common pose, hence no match.
    min_correlation : float
        Of patches at the final pose: smaller ones are no matches.
    max_shift : float
        Largest shift of a match from the common pose, in voxels.
    layout : SphereLayout
        Spheres by which a corner is described.
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


@dataclass(frozen=True, slots=True, eq=False)
class SolidFeatures:
    """A volume, described: smoothed amplitudes, where there is data, corners, and descriptors for both axis signs."""

    volume: Float32Array
    known: BoolArray | None
    corners: VolumePoints
    descriptors: Float32Array
    flipped: Float32Array

    def __len__(self) -> int:
        return len(self.corners)


def describe_solid(grey: Grey, settings: SolidSettings) -> SolidFeatures:
    """Smooth a volume, detect its corners and describe them for both signs of their axes."""
    smooth = smooth_volume(grey.values, settings.smoothing)
    corners = detect_corners(smooth, grey.valid, n_points=settings.n_points)
    return SolidFeatures(smooth, grey.known, corners, *describe_corners(smooth, grey.valid, corners, settings.layout))


def match_volumes(target: SolidFeatures, source: SolidFeatures, settings: SolidSettings) -> SolidMatches:
    """Match two described volumes that a rigid motion carries into each other, as far as they overlap.

    Returns
    -------
    SolidMatches
        Empty where no pose has enough support.
    """
    nothing = SolidMatches(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.eye(3))
    rotations, points_t, points_s = propose_poses(target, source, settings)
    found = agree_on_pose(rotations, points_t, points_s, distance=settings.distance, min_inliers=settings.min_inliers)
    return nothing if found is None else _matches_at(target, source, found[0], settings, nothing)


def propose_poses(
    target: SolidFeatures, source: SolidFeatures, settings: SolidSettings
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Match under both signs of the source's axes: rotations (n, 3, 3), and matched points (n, 3) of each."""
    corners_t, corners_s = target.corners, source.corners
    both = np.concatenate([source.descriptors, source.flipped])
    points_s = np.concatenate([corners_s.points, corners_s.points])
    frames_s = np.concatenate([corners_s.frames, flip_frames(corners_s.frames)])
    compared = compare_descriptors(target.descriptors, both)
    near = pick_matches(compared, corners_t.points, points_s, max_ratio=settings.max_ratio, apart=settings.apart)
    c, s = np.cos(near.shift), np.sin(near.shift)
    turn = np.zeros((len(c), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
    rotations = corners_t.frames[near.target] @ turn @ frames_s[near.source].transpose(0, 2, 1)
    return np.asarray(rotations), corners_t.points[near.target], points_s[near.source]


def _matches_at(
    target: SolidFeatures, source: SolidFeatures, pose: Pose, settings: SolidSettings, nothing: SolidMatches
) -> SolidMatches:
    """All corners of the target that the refined pose carries onto something alike in the source."""
    first, second = target.volume, source.volume
    points = np.floor(target.corners.points)
    pose, correlation, _ = refine_pose(first, second, points, pose)
    points = points[correlation >= settings.min_correlation]
    if len(points) < settings.min_inliers:
        return nothing
    pose, correlation, shift = refine_pose(first, second, points, pose)
    places = pose.to_source(points - shift)
    good = (correlation >= settings.min_correlation) & (np.linalg.norm(shift, axis=1) <= settings.max_shift)
    good &= look_up(target.known, points) & look_up(source.known, places)
    if good.sum() < settings.min_inliers:
        return nothing
    return SolidMatches(points[good], places[good], correlation[good], pose.R)
