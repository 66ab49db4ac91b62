"""A local map: the surface, where its frames were, and the places that it remembers."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, field, replace

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.graph.poses import PoseGraph
from seismo3d.robot.closures import LEAST_WEIGHT, Closure, make_graph
from seismo3d.robot.drift import tie_covariances
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import PlaceMemory
from seismo3d.robot.landmarks import View
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.trajectory import TimedPose
from seismo3d.robot.tsdf import SurfaceMap


@dataclass(slots=True, eq=False)
class MapState:
    """A local map, in its own world frame.

    Attributes
    ----------
    held : SurfaceMap
        What :attr:`surface` returns, into which a frame is perhaps still being fused.
    memory : PlaceMemory
    views : list of View
        One a keyframe of the memory, in its order.
    poses : list of TimedPose
        Of the located frames.
    packing : list of KeptFrame or Future
        Frames that are kept, the last ones perhaps still being packed.
    closures : list of Closure
        What closing loops found last.
    joints : list of Closure
        What the map was joined by from local maps.
    number : int
        Which local map it is, from 0; the least of those that were joined.
    part : int
        Local map that new frames belong to; parts are tied to each other by closures and joints alone.
    fusing : Future or None
        What puts the last frame into the map, where it may not have ended.
    """

    held: SurfaceMap
    memory: PlaceMemory
    views: list[View] = field(default_factory=list)
    poses: list[TimedPose] = field(default_factory=list)
    packing: list[KeptFrame | Future[KeptFrame]] = field(default_factory=list)
    closures: list[Closure] = field(default_factory=list)
    joints: list[Closure] = field(default_factory=list)
    number: int = 0
    part: int = 0
    fusing: Future[None] | None = None

    @property
    def surface(self) -> SurfaceMap:
        """The surface with all frames so far in it: waits for the last one."""
        self._end_fusing()
        return self.held

    @surface.setter
    def surface(self, surface: SurfaceMap) -> None:
        self._end_fusing()
        self.held = surface

    @property
    def kept(self) -> list[KeptFrame]:
        """Frames that are kept, all packed."""
        return list(self._end_packing())

    def settle(self) -> None:
        """Wait until the last frame is fused, all that are kept are packed, and all places are described."""
        self._end_packing()
        self.memory.settle()

    def _end_fusing(self) -> None:
        if self.fusing is not None:
            fusing, self.fusing = self.fusing, None
            fusing.result()

    def _end_packing(self) -> list[KeptFrame]:
        self._end_fusing()  # which may keep a frame
        packed = [frame.result() if isinstance(frame, Future) else frame for frame in self.packing]
        self.packing = list(packed)
        return packed

    @property
    def key_poses(self) -> Float64Array:
        """Poses of the keyframes, (n, 4, 4)."""
        return np.array([k.T_world_camera for k in self.memory.keyframes]).reshape(-1, 4, 4)

    @property
    def graph(self) -> PoseGraph:
        """Keyframes as poses, their order, closures and joints as edges."""
        parts, errors = [k.part for k in self.memory.keyframes], [view.errors for view in self.views]
        return make_graph(self.key_poses, self.joints + self.closures, parts=parts, errors=errors)

    def tie_covariances(self, graph: PoseGraph, weights: Float64Array, *, known: int | None = None) -> None:
        """Make the views surer that a graph's edges, by their weights in its solution, tie to surer ones.

        ``known`` is the number of the views, from the first, whose covariances mean something yet; all by default.
        """
        is_known = np.arange(len(self.views)) < (len(self.views) if known is None else known)
        before = np.array([view.errors.total for view in self.views])
        after = tie_covariances(graph, before, known=is_known, used=weights > LEAST_WEIGHT)
        self.views = [
            view if (held == C).all() else replace(view, errors=PoseErrors(C, by_lens=view.errors.by_lens))
            for view, held, C in zip(self.views, before, after)
        ]
