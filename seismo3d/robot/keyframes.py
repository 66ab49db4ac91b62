"""Remember: frames that the camera moved on from, the places they show, and whether two show the same place."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float64Array, Int64Array
from seismo3d.errors import GeometryError
from seismo3d.features.describing import Features, describe
from seismo3d.features.matching import match
from seismo3d.features.places import PlaceIndex
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import invert_transform, rotation_angle
from seismo3d.registration.align import align_pairs
from seismo3d.registration.register import register
from seismo3d.registration.result import Registration
from seismo3d.scan import Scan

_N_POINTS = 300
_LEAST_AGREEING = 8
_SEEDS = 5
_NEAR_TURN, _NEAR_SHIFT = 0.6, 0.7
"""Radians and metres within which two keyframes looked the same way from nearly the same place."""


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A frame that is remembered.

    Attributes
    ----------
    frame : int
        Number among all frames.
    camera : int
    T_world_camera : ndarray of shape (4, 4), float64
        At the time of its depth.
    grey : ndarray of shape (rows, columns), uint8, or None
        Half the size of the image; None without colour.
    depth : ndarray of shape (rows, columns), uint16
        Tenths of a millimetre, of every second pixel.
    features : Features
        Of the grey image.
    part : int
        Local map that it was made in.
    """

    frame: int
    camera: int
    T_world_camera: Float64Array
    grey: AnyArray | None
    depth: AnyArray
    features: Features
    part: int = 0


def make_keyframe(
    frame: int, camera: int, T_world_camera: Float64Array, grey: AnyArray | None, depth: AnyArray, *, part: int = 0
) -> Keyframe:
    """Return a keyframe of an image (rows, columns), or None, and its depth in metres, both of full size."""
    import cv2

    small = None if grey is None else cv2.pyrDown(grey)
    kept = np.ascontiguousarray(np.clip(depth[::2, ::2] * 1e4 + 0.5, 0, 65535).astype(np.uint16))
    return describe_keyframe(frame, camera, T_world_camera, small, kept, part=part)


def describe_keyframe(
    frame: int, camera: int, T_world_camera: Float64Array, grey: AnyArray | None, depth: AnyArray, *, part: int = 0
) -> Keyframe:
    """Return a keyframe of images that have its size already."""
    features = describe(np.zeros(depth.shape, np.uint8) if grey is None else grey, n_points=_N_POINTS)
    return Keyframe(frame, camera, T_world_camera, grey, depth, features, part)


@dataclass(frozen=True, slots=True, eq=False)
class CommonPoints:
    """Points that two images may have in common.

    Attributes
    ----------
    target, source : ndarray of shape (n, 3), float64
        Each in its camera's frame, metres.
    reach : ndarray of shape (n,), float64
        Distance within which a pair agrees.
    """

    target: Float64Array
    source: Float64Array
    reach: Float64Array

    def near(self, T_target_source: Float64Array) -> BoolArray:
        """Return which pairs agree with a transform."""
        moved = self.source @ T_target_source[:3, :3].T + T_target_source[:3, 3]
        return np.asarray(np.linalg.norm(moved - self.target, axis=1) < self.reach)

    def agree(self, T_target_source: Float64Array) -> bool:
        """Whether enough pairs agree with a transform: eight, and four in ten."""
        agreeing = int(self.near(T_target_source).sum())
        return agreeing >= _LEAST_AGREEING and agreeing >= 0.4 * len(self.target)


def align_common(common: CommonPoints) -> Float64Array | None:
    """Return the rigid transform with which enough of the pairs agree; None where there is none.

    Pairs that belong together keep their distances from each other. The pair that keeps most of them says which.
    """
    if len(common.target) < _LEAST_AGREEING:
        return None
    between = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (common.target, common.source)]
    kept = np.abs(between[0] - between[1]) < common.reach[:, None] + common.reach[None]
    for row in np.argsort(-kept.sum(axis=1), kind="stable")[:_SEEDS]:
        members = kept[row] & (kept[:, kept[row]].mean(axis=1) > 0.5)
        for _ in range(4):
            if members.sum() < _LEAST_AGREEING:
                break
            try:
                T = align_pairs(common.target[members], common.source[members]).T_target_source
            except GeometryError:  # all on a line: no transform from these
                break
            members = common.near(T)
            if common.agree(T):
                return T
    return None


class PlaceMemory:
    """Keyframes and the index that finds those alike.

    Parameters
    ----------
    lenses : list of PinholeCamera
        Of the cameras, at full size.
    """

    def __init__(self, lenses: list[PinholeCamera]) -> None:
        self._known: list[Keyframe] = []
        self._coming: list[Future[Keyframe]] = []
        self._lenses = [
            replace(
                lens, fx=lens.fx / 2, fy=lens.fy / 2, cx=lens.cx / 2, cy=lens.cy / 2, depth_scale=1e4, width=0, height=0
            )
            for lens in lenses
        ]
        self._index = PlaceIndex()

    @property
    def keyframes(self) -> list[Keyframe]:
        """All that are remembered, in their order."""
        self.settle()
        return self._known

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe."""
        self.keyframes.append(keyframe)
        self._index.add(keyframe.features)

    def expect(self, keyframe: Future[Keyframe]) -> None:
        """Remember a keyframe that is being made; who asks for keyframes waits for it."""
        self._coming.append(keyframe)

    def move(self, poses: Float64Array) -> None:
        """Give all keyframes new poses (n, 4, 4)."""
        self._known = [replace(k, T_world_camera=T) for k, T in zip(self.keyframes, poses)]

    def recall(self, features: Features, *, n_best: int = 3, until: int | None = None) -> Int64Array:
        """Return the keyframes that look most like some features, best first."""
        self.settle()
        return self._index.query(features, n_best=n_best, until=until).index

    def near(self, number: int, *, gap: int) -> list[int]:
        """Return earlier keyframes, at least ``gap`` before, that looked the same way from nearly the same place."""
        T = self.keyframes[number].T_world_camera
        found = []
        for other, keyframe in enumerate(self.keyframes[: max(0, number - gap + 1)]):
            between = invert_transform(keyframe.T_world_camera) @ T
            if rotation_angle(between[:3, :3]) < _NEAR_TURN and np.linalg.norm(between[:3, 3]) < _NEAR_SHIFT:
                found.append(other)
        return found

    def compare(
        self, target: int, source: Keyframe, *, start: Float64Array | None = None, far: bool = True
    ) -> Registration | None:
        """Register a keyframe onto one that is remembered; None where they don't show the same place.

        Accepted are transforms that converge, whose certificate holds, that leave nothing undetermined, on which the
        two overlap by a third and fit within the sensor's noise, and with which matched features agree.

        Parameters
        ----------
        target : int
        source : Keyframe
        start : ndarray of shape (4, 4), optional
            Where the registration starts if not ``far``.
        far : bool
            Whether it starts where the features that the two have in common put it.

        Returns
        -------
        Registration or None
        """
        common = self._common(self.keyframes[target], source)
        if far:
            start = align_common(common)
        if len(common.target) < _LEAST_AGREEING or start is None:
            return None
        scans = [self._scan(self.keyframes[target]), self._scan(source)]
        if scans[0] is None or scans[1] is None:
            return None
        found = register(scans[0], scans[1], voxel_size=0.04, start=start, stages=("local",))
        sound = found.converged and found.certificate is not None and found.certificate.holds
        if not sound or found.unobservable or found.overlap < 0.33 or found.rmse > 0.025:
            return None
        return found if common.agree(found.T_target_source) else None

    def settle(self) -> None:
        """Take in the keyframes that were being made, in their order."""
        coming, self._coming = self._coming, []
        for keyframe in coming:
            self._known.append(keyframe.result())
            self._index.add(self._known[-1].features)

    def _common(self, target: Keyframe, source: Keyframe) -> CommonPoints:
        """Points that matched features of two images show."""
        matches = match(target.features, source.features, tilts="never")
        p, q = self._points(target, matches.points_target), self._points(source, matches.points_source)
        known = np.isfinite(p).all(axis=1) & np.isfinite(q).all(axis=1)
        return CommonPoints(p[known], q[known], 0.02 + 0.02 * q[known, 2])

    def _points(self, keyframe: Keyframe, pixels: Float64Array) -> Float64Array:
        """Points (n, 3) at pixels (column, row) of a keyframe, NaN where it has no depth."""
        column, row = np.rint(pixels).astype(np.int64).T
        z = keyframe.depth[row, column] * 1e-4
        rays = self._lenses[keyframe.camera].rays(pixels)
        return np.where((z > 0.0)[:, None], np.column_stack([rays * z[:, None], z]), np.nan)

    def _scan(self, keyframe: Keyframe) -> Scan | None:
        if np.count_nonzero(keyframe.depth) < 500:
            return None
        return Scan.from_rgbd(keyframe.grey, keyframe.depth, self._lenses[keyframe.camera], max_depth=6.0)
