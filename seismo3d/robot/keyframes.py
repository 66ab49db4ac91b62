"""Remember: frames that the camera moved on from, the places they show, and which of them show the same place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from seismo3d._typing import AnyArray, Float64Array, Int64Array
from seismo3d.features.describing import Features, describe
from seismo3d.features.places import PlaceIndex
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import invert_transform, rotation_angle
from seismo3d.graph.poses import PoseGraph
from seismo3d.registration.register import register
from seismo3d.registration.result import Registration
from seismo3d.robot.ekf import adjoint, exp_motion, log_motion
from seismo3d.scan import Scan

_STEP_TURN, _STEP_SHIFT = 0.001, 0.0015
"""Standard deviations of the pose from one keyframe to the next, rad and m."""
_CLOSURE_TURN, _CLOSURE_SHIFT = 0.003, 0.004
"""The same that a closure has at least."""
_N_POINTS = 300


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
    """

    frame: int
    camera: int
    T_world_camera: Float64Array
    grey: AnyArray | None
    depth: AnyArray
    features: Features


def make_keyframe(
    frame: int, camera: int, T_world_camera: Float64Array, grey: AnyArray | None, depth: AnyArray
) -> Keyframe:
    """Return a keyframe of an image (rows, columns), or None, and its depth in metres, both of full size."""
    import cv2

    small = None if grey is None else cv2.pyrDown(grey)
    kept = np.ascontiguousarray(np.clip(depth[::2, ::2] * 1e4 + 0.5, 0, 65535).astype(np.uint16))
    return describe_keyframe(frame, camera, T_world_camera, small, kept)


def describe_keyframe(
    frame: int, camera: int, T_world_camera: Float64Array, grey: AnyArray | None, depth: AnyArray
) -> Keyframe:
    """Return a keyframe of images that have its size already."""
    features = describe(np.zeros(depth.shape, np.uint8) if grey is None else grey, n_points=_N_POINTS)
    return Keyframe(frame, camera, T_world_camera, grey, depth, features)


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

    def compare(self, target: int, source: Keyframe, *, start: Float64Array | None = None) -> Registration | None:
        """Register a keyframe onto one that is remembered; None where they don't show the same place.

        Accepted are transforms that converge, whose certificate holds, that leave nothing undetermined and on which
        the two overlap by a third and fit within the sensor's noise.
        """
        scans = [self._scan(self.keyframes[target]), self._scan(source)]
        if scans[0] is None or scans[1] is None:
            return None
        found = register(scans[0], scans[1], voxel_size=0.03, start=start)
        sound = found.converged and found.certificate is not None and found.certificate.holds
        if not sound or found.unobservable or found.overlap < 0.33 or found.rmse > 0.025:
            return None
        return found

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


def find_closures(memory: PlaceMemory, *, gap: int = 8, most_each: int = 2) -> list[Closure]:
    """Find keyframes that show the same place, by looks and by position, and verify each pair.

    Parameters
    ----------
    memory : PlaceMemory
    gap : int
        Keyframes nearer in order are not compared: tracking ties them already.
    most_each : int
        Closures of a keyframe, at most.

    Returns
    -------
    list of Closure
    """
    out = []
    for number, keyframe in enumerate(memory.keyframes):
        alike = memory.recall(keyframe.features, until=number - gap + 1) if number >= gap else np.empty(0, np.int64)
        tried = list(dict.fromkeys([*alike.tolist(), *memory.near(number, gap=gap)]))[:4]
        count = 0
        for other in tried:
            T_target = memory.keyframes[other].T_world_camera
            guess = invert_transform(T_target) @ keyframe.T_world_camera
            found = memory.compare(other, keyframe, start=guess)
            if found is None:
                continue
            out.append(Closure(other, number, found.T_target_source, _closure_information(found)))
            count += 1
            if count >= most_each:
                break
    return out


def make_graph(poses: Float64Array, closures: list[Closure]) -> PoseGraph:
    """Return the graph of keyframes (n, 4, 4) in order with their closures, which count as doubtful."""
    step = np.diag([_STEP_TURN**-2] * 3 + [_STEP_SHIFT**-2] * 3)
    edges = [(k, k + 1, invert_transform(poses[k]) @ poses[k + 1], step, False) for k in range(len(poses) - 1)]
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


def _closure_information(found: Registration) -> Float64Array:
    least = np.diag([_CLOSURE_TURN**2] * 3 + [_CLOSURE_SHIFT**2] * 3)
    turned = adjoint(invert_transform(found.T_target_source))
    return np.asarray(np.linalg.inv(turned @ found.covariance @ turned.T + least))
