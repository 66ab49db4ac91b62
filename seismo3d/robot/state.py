"""What a mapper knows at a moment: the map, where the frames were, and the places that it remembers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import Closure, PlaceMemory
from seismo3d.robot.landmarks import View
from seismo3d.robot.trajectory import TimedPose
from seismo3d.robot.tsdf import SurfaceMap


@dataclass(slots=True, eq=False)
class MapState:
    """The state of a mapper between two frames, less its filter.

    Attributes
    ----------
    surface : SurfaceMap
    memory : PlaceMemory
    views : list of View
        One a keyframe of the memory, in its order.
    poses : list of TimedPose
        Of the located frames.
    kept : list of KeptFrame
    closures : list of Closure
    count : int
        Frames given so far.
    n_lost : int
        Frames since the last one that was located.
    """

    surface: SurfaceMap
    memory: PlaceMemory
    views: list[View] = field(default_factory=list)
    poses: list[TimedPose] = field(default_factory=list)
    kept: list[KeptFrame] = field(default_factory=list)
    closures: list[Closure] = field(default_factory=list)
    count: int = 0
    n_lost: int = 0

    @property
    def key_poses(self) -> Float64Array:
        """Poses of the keyframes, (n, 4, 4)."""
        return np.array([k.T_world_camera for k in self.memory.keyframes]).reshape(-1, 4, 4)
