"""Landmarks worth a place in the filter's state: those that were seen often, and always where they should be.

The filter takes them in before a frame is registered, at the time of each row of the colour image; what it has taken
in, the registration does not use again. So the prediction is better where the camera moves unevenly, and where depth
fails the colour alone still says where the camera is.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot._kernels_frame import depth_sigma
from seismo3d.robot.ekf import Glimpses, MotionFilter
from seismo3d.robot.landmarks import Sightings

N_MOST = 16
"""Landmarks in the state at most: its covariance is 60 x 60."""
_OFTEN = 4
"""Sightings in agreement with the registration, less ten times those against it, that make a landmark worth it."""
_PATIENCE = 30
"""Frames without an accepted sighting after which a landmark is marginalised."""
_PIXEL = 1.0
"""Standard deviation of a sighting, pixels; patches that are followed share their errors."""
_GATE = 9.21
"""Squared Mahalanobis distance that one in a hundred exceeds (chi-square, 2 degrees)."""


class LandmarkBook:
    """Which landmarks the filter holds, how they fare, and which are to be next."""

    def __init__(self) -> None:
        self.names: list[tuple[int, int]] = []
        self._idle: list[int] = []
        self._votes: Counter[tuple[int, int]] = Counter()

    def forget(self, motion: MotionFilter | None) -> None:
        """Begin anew: landmarks have moved or are of another map."""
        if motion is not None:
            motion.drop_landmarks(np.ones(len(motion.landmarks), dtype=bool))
        self.names, self._idle = [], []
        self._votes.clear()

    @property
    def sees_any(self) -> bool:
        """Whether the last frame showed a landmark of the state where it was expected."""
        return 0 in self._idle

    def take_in(
        self, motion: MotionFilter, seen: Sightings, lens: PinholeCamera, T_body_camera: Float64Array
    ) -> BoolArray:
        """Update the filter by the landmarks of its state among some sightings.

        Returns
        -------
        ndarray of shape (n,), bool
            Which sightings are of the state's landmarks.
        """
        rows = {name: row for row, name in enumerate(self.names)}
        own = np.array([tuple(name) in rows for name in seen.names.tolist()], dtype=bool)
        self._idle = [idle + 1 for idle in self._idle]
        if own.any():
            mine = seen.only(own)
            index = np.array([rows[tuple(name)] for name in mine.names.tolist()], dtype=np.int64)
            glimpses = Glimpses(index, mine.rays[:, :2], mine.delay, _PIXEL / lens.fx)
            for row in index[motion.sight(glimpses, T_body_camera, gate=_GATE)]:
                self._idle[row] = 0
        self._marginalise(motion)
        return own

    def learn(self, motion: MotionFilter, seen: Sightings, weights: Float64Array, T_world_camera: Float64Array) -> None:
        """Note which landmarks agreed with a registration (weights above zero), and add the best to the state."""
        for name, weight in zip(seen.names.tolist(), weights):
            self._votes[tuple(name)] += 1 if weight > 0.0 else -10
        steady = [k for k, name in enumerate(seen.names.tolist()) if self._votes[tuple(name)] >= _OFTEN]
        steady.sort(key=lambda k: -self._votes[tuple(seen.names[k].tolist())])
        for k in steady:
            if len(self.names) >= N_MOST:
                break
            name = (int(seen.names[k, 0]), int(seen.names[k, 1]))
            if name in self.names or self._crowded(motion, seen.points[k]):
                continue
            ray = seen.points[k] - T_world_camera[:3, 3]
            far = float(np.linalg.norm(ray))
            along = np.outer(ray, ray) / far**2
            motion.add_landmark(seen.points[k], 0.004**2 * np.eye(3) + 0.25 * depth_sigma(far) ** 2 * along)
            self.names.append(name)
            self._idle.append(0)

    def _crowded(self, motion: MotionFilter, point: Float64Array) -> bool:
        """Whether the state has a landmark near a point already: far from each other they say more."""
        return bool((np.linalg.norm(motion.landmarks - point, axis=1) < 0.1).any())

    def _marginalise(self, motion: MotionFilter) -> None:
        drop = np.array(self._idle, dtype=np.int64) > _PATIENCE
        if not drop.any():
            return
        motion.drop_landmarks(drop)
        for name in [name for name, gone in zip(self.names, drop) if gone]:
            self._votes[name] = 0
        self.names = [name for name, gone in zip(self.names, drop) if not gone]
        self._idle = [idle for idle, gone in zip(self._idle, drop) if not gone]
