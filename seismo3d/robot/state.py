"""A local map: the surface, where its frames were, and the places that it remembers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.graph.poses import PoseGraph
from seismo3d.robot.closures import Closure, make_graph
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import PlaceMemory
from seismo3d.robot.landmarks import View
from seismo3d.robot.trajectory import TimedPose
from seismo3d.robot.tsdf import SurfaceMap


@dataclass(slots=True, eq=False)
class MapState:
    """A local map, in its own world frame.

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
        What closing loops found last.
    joints : list of Closure
        What the map was joined by from local maps.
    number : int
        Which local map it is, from 0; the least of those that were joined.
    part : int
        Local map that new frames belong to; parts are tied to each other by closures and joints alone.
    """

    surface: SurfaceMap
    memory: PlaceMemory
    views: list[View] = field(default_factory=list)
    poses: list[TimedPose] = field(default_factory=list)
    kept: list[KeptFrame] = field(default_factory=list)
    closures: list[Closure] = field(default_factory=list)
    joints: list[Closure] = field(default_factory=list)
    number: int = 0
    part: int = 0

    @property
    def key_poses(self) -> Float64Array:
        """Poses of the keyframes, (n, 4, 4)."""
        return np.array([k.T_world_camera for k in self.memory.keyframes]).reshape(-1, 4, 4)

    @property
    def graph(self) -> PoseGraph:
        """Keyframes as poses, their order, closures and joints as edges."""
        parts = [k.part for k in self.memory.keyframes]
        return make_graph(self.key_poses, self.joints + self.closures, parts=parts)
