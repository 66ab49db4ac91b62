"""Where the camera was: poses by time, and the file that others read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import Float64Array, Int64Array
from seismo3d._validate import freeze
from seismo3d.geometry.rotations import invert_transform, quaternion_from_rotation
from seismo3d.io._files import as_path, written_aside
from seismo3d.robot.ekf import exp_motion, log_motion


@dataclass(frozen=True, slots=True, eq=False)
class TimedPose:
    """Pose of a located frame.

    Attributes
    ----------
    stamp, time : float
        Of its colour, and of the exposure that the pose is of, seconds in one clock.
    T_world_camera : ndarray of shape (4, 4), float64
    twist : ndarray of shape (6,), float64
        Velocity in the camera's frame.
    frame, camera, part : int
        Part is the local map that the frame was located in first.
    """

    stamp: float
    time: float
    T_world_camera: Float64Array
    twist: Float64Array
    frame: int
    camera: int = 0
    part: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses of the located frames, in the order they came.

    Attributes
    ----------
    times : ndarray of shape (n,), float64
        Stamps of colour, seconds.
    T_world_camera : ndarray of shape (n, 4, 4), float64
    frames : ndarray of shape (n,), int64
        Number of each frame among all that were given, from 0.
    maps : ndarray of shape (n,), int64
        Number of the local map that each pose is in. Those of maps that were not joined lie to each other as the filter
        foresaw across the loss.
    """

    times: Float64Array
    T_world_camera: Float64Array
    frames: Int64Array
    maps: Int64Array

    def __len__(self) -> int:
        return len(self.times)

    @classmethod
    def of(cls, poses: Sequence[TimedPose], *, maps: Sequence[int] | None = None) -> Trajectory:
        """Return the poses at the colours' stamps, interpolated between exposures that are less than 0.15 s apart.

        ``maps`` gives each pose's local map; one for all by default.
        """
        T = np.array([_at_stamp(poses, i) for i in range(len(poses))]).reshape(-1, 4, 4)
        times, frames = np.array([p.stamp for p in poses]), np.array([p.frame for p in poses], dtype=np.int64)
        numbers = np.array([0] * len(poses) if maps is None else maps, dtype=np.int64)
        return cls(freeze(times), freeze(T), freeze(frames), freeze(numbers))

    def of_map(self, number: int) -> Trajectory:
        """Return the poses that are in one local map."""
        own = self.maps == number
        parts = (self.times, self.T_world_camera, self.frames, self.maps)
        return Trajectory(*(freeze(part[own]) for part in parts))

    @property
    def length(self) -> float:
        """Length of the path in metres, without the leaps from one local map to another."""
        steps = np.linalg.norm(np.diff(self.T_world_camera[:, :3, 3], axis=0), axis=1)
        return float(steps[np.diff(self.maps) == 0].sum())

    def save_tum(self, path: str | Path) -> Path:
        """Write one line a pose: time, position, quaternion (x y z w), camera to world.

        Where there are several local maps, a comment tells before each stretch which one it is in.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Path
            The file.
        """
        path = as_path(path)
        with written_aside(path) as aside, aside.open("w", encoding="ascii") as file:
            file.write("# timestamp tx ty tz qx qy qz qw\n")
            is_one, current = len(np.unique(self.maps)) < 2, None
            for time, T, number in zip(self.times, self.T_world_camera, self.maps):
                if not is_one and number != current:
                    file.write(f"# local map {number}\n")
                    current = number
                x, y, z = T[:3, 3]
                w, qx, qy, qz = quaternion_from_rotation(T[:3, :3])
                file.write(f"{time:.6f} {x:.6f} {y:.6f} {z:.6f} {qx:.8f} {qy:.8f} {qz:.8f} {w:.8f}\n")
        return path


def _at_stamp(poses: Sequence[TimedPose], i: int) -> Float64Array:
    """Pose of the i-th frame's camera at its stamp, by its pose at another time where there is one."""
    pose = poses[i]
    ahead = pose.stamp - pose.time
    step = 1 if ahead > 0.0 else -1
    j = i + step
    while 0 <= j < len(poses) and (
        (poses[j].camera, poses[j].part) != (pose.camera, pose.part) or poses[j].time == pose.time
    ):
        j += step
    if 0 <= j < len(poses):
        span = poses[j].time - pose.time
        if abs(ahead) <= 1.5 * abs(span) < 0.225:
            move = log_motion(invert_transform(pose.T_world_camera) @ poses[j].T_world_camera)
            return pose.T_world_camera @ exp_motion(move * (ahead / span))
    return pose.T_world_camera @ exp_motion(pose.twist * ahead)
