"""Remember: frames that the camera moved on from, the places they show, and which of them show the same place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import AnyArray, Float64Array, Int64Array
from seismo3d.features.describing import Features, describe
from seismo3d.features.matching import match
from seismo3d.features.places import PlaceIndex
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import invert_transform, rotation_angle
from seismo3d.graph.poses import PoseGraph
from seismo3d.registration.register import register
from seismo3d.registration.result import Registration
from seismo3d.robot.ekf import adjoint, exp_motion, log_motion
from seismo3d.scan import Scan

_STEP_TURN, _STEP_SHIFT = 0.002, 0.003
"""Standard deviations of the pose from one keyframe to the next, rad and m."""
_CLOSURE_TURN, _CLOSURE_SHIFT = 0.006, 0.008
"""The same that a closure has at least."""
_N_POINTS = 300
_LEAST_AGREEING = 8


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


class PlaceMemory:
    """Keyframes and the index that finds those alike.

    Parameters
    ----------
    lenses : list of PinholeCamera
        Of the cameras, at full size.
    """

    def __init__(self, lenses: list[PinholeCamera]) -> None:
        self.keyframes: list[Keyframe] = []
        self._lenses = [
            replace(
                lens, fx=lens.fx / 2, fy=lens.fy / 2, cx=lens.cx / 2, cy=lens.cy / 2, depth_scale=1e4, width=0, height=0
            )
            for lens in lenses
        ]
        self._index = PlaceIndex()

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe."""
        self.keyframes.append(keyframe)
        self._index.add(keyframe.features)

    def move(self, poses: Float64Array) -> None:
        """Give all keyframes new poses (n, 4, 4)."""
        self.keyframes = [replace(k, T_world_camera=T) for k, T in zip(self.keyframes, poses)]

    def recall(self, features: Features, *, n_best: int = 3, until: int | None = None) -> Int64Array:
        """Return the keyframes that look most like some features, best first."""
        return self._index.query(features, n_best=n_best, until=until).index

    def near(self, number: int, *, gap: int, turn: float = 0.6, shift: float = 0.7) -> list[int]:
        """Return earlier keyframes, at least ``gap`` before, that looked the same way from nearly the same place."""
        T = self.keyframes[number].T_world_camera
        found = []
        for other, keyframe in enumerate(self.keyframes[: max(0, number - gap + 1)]):
            between = invert_transform(keyframe.T_world_camera) @ T
            if rotation_angle(between[:3, :3]) < turn and np.linalg.norm(between[:3, 3]) < shift:
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
            Where the registration starts; the identity by default.
        far : bool
            Whether the transform is looked for far from the start, too.

        Returns
        -------
        Registration or None
        """
        scans = [self._scan(self.keyframes[target]), self._scan(source)]
        if scans[0] is None or scans[1] is None:
            return None
        stages = ("local", "global", "polish") if far else ("local",)
        found = register(scans[0], scans[1], voxel_size=0.04, start=start, stages=stages)
        sound = found.converged and found.certificate is not None and found.certificate.holds
        if not sound or found.unobservable or found.overlap < 0.33 or found.rmse > 0.025:
            return None
        return found if self._looks_agree(self.keyframes[target], source, found.T_target_source) else None

    def _looks_agree(self, target: Keyframe, source: Keyframe, T_target_source: Float64Array) -> bool:
        """Whether the features that the two images have in common lie where the transform puts them."""
        matches = match(target.features, source.features)
        p, q = self._points(target, matches.points_target), self._points(source, matches.points_source)
        known = np.isfinite(p).all(axis=1) & np.isfinite(q).all(axis=1)
        p, q = p[known], q[known]
        off = np.linalg.norm(q @ T_target_source[:3, :3].T + T_target_source[:3, 3] - p, axis=1)
        agreeing = int((off < 0.02 + 0.02 * q[:, 2]).sum())
        return agreeing >= _LEAST_AGREEING and agreeing >= 0.4 * len(p)

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


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """Two keyframes that show the same place.

    Attributes
    ----------
    target, source : int
    T_target_source : ndarray of shape (4, 4), float64
    information : ndarray of shape (6, 6), float64
        For a perturbation on the right, (rotation, translation).
    """

    target: int
    source: int
    T_target_source: Float64Array
    information: Float64Array


def find_closures(memory: PlaceMemory, *, gap: int = 8, every: int = 2) -> list[Closure]:
    """Find keyframes that show the same place, by position and by looks, and verify each pair.

    A pair that lies near by the poses is registered from there. Only where none does, the keyframe that looks most
    alike is registered from anywhere.

    Parameters
    ----------
    memory : PlaceMemory
    gap : int
        Keyframes nearer in order are not compared: tracking ties them already.
    every : int
        Every so many keyframes one is compared.

    Returns
    -------
    list of Closure
        At most one a keyframe.
    """
    out = []
    for number in range(gap, len(memory.keyframes), every):
        keyframe = memory.keyframes[number]
        alike = memory.recall(keyframe.features, n_best=2, until=number - gap + 1).tolist()
        near = memory.near(number, gap=gap)
        both = [other for other in alike if other in near] or near[:1]
        for other, far in [*((k, False) for k in both[:1]), *((k, True) for k in alike[:1])]:
            guess = invert_transform(memory.keyframes[other].T_world_camera) @ keyframe.T_world_camera
            found = memory.compare(other, keyframe, start=guess, far=far)
            if found is not None:
                out.append(Closure(other, number, found.T_target_source, closure_information(found)))
                break
    return out


def make_graph(poses: Float64Array, closures: list[Closure], *, parts: Sequence[int] | None = None) -> PoseGraph:
    """Return the graph of keyframes (n, 4, 4) with their closures, which count as doubtful.

    Each is tied to the one before it of the same part; all are one part by default.
    """
    step = np.diag([_STEP_TURN**-2] * 3 + [_STEP_SHIFT**-2] * 3)
    last: dict[int, int] = {}
    edges = []
    for k, part in enumerate([0] * len(poses) if parts is None else parts):
        if part in last:
            edges.append((last[part], k, invert_transform(poses[last[part]]) @ poses[k], step, False))
        last[part] = k
    doubtful = [(c.target, c.source, c.T_target_source, c.information, True) for c in closures]
    return PoseGraph.of(list(poses), edges + doubtful)


def correct_poses(
    T_world_camera: Float64Array, frames: Int64Array, before: Float64Array, after: Float64Array, keys: Int64Array
) -> Float64Array:
    """Carry a correction of keyframes over to all frames, evenly from one keyframe to the next.

    Parameters
    ----------
    T_world_camera : ndarray of shape (n, 4, 4), float64
    frames : ndarray of shape (n,), int64
        Numbers of the frames.
    before, after : ndarray of shape (m, 4, 4), float64
        The keyframes' poses.
    keys : ndarray of shape (m,), int64
        Numbers of the keyframes' frames, ascending.

    Returns
    -------
    ndarray of shape (n, 4, 4), float64
    """
    change = np.array([a @ invert_transform(b) for a, b in zip(after, before)])
    out = np.empty_like(T_world_camera)
    for i, (T, frame) in enumerate(zip(T_world_camera, frames)):
        k = int(np.clip(np.searchsorted(keys, frame, side="right") - 1, 0, len(keys) - 1))
        C = change[k]
        if k + 1 < len(keys) and frame > keys[k]:
            share = (frame - keys[k]) / (keys[k + 1] - keys[k])
            C = C @ exp_motion(share * log_motion(invert_transform(C) @ change[k + 1]))
        out[i] = C @ T
    return out


def closure_information(found: Registration) -> Float64Array:
    """Return the information (6, 6) of a registration of two keyframes, with the errors that two of them share."""
    least = np.diag([_CLOSURE_TURN**2] * 3 + [_CLOSURE_SHIFT**2] * 3)
    turned = adjoint(invert_transform(found.T_target_source))
    return np.asarray(np.linalg.inv(turned @ found.covariance @ turned.T + least))
