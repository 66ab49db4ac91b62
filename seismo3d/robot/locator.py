"""Find where a frame was taken: near a predicted pose, or at one of the places that maps remember."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.geometry.rotations import invert_transform
from seismo3d.robot.camera import Camera
from seismo3d.robot.ekf import log_motion
from seismo3d.robot.frames import Measured, Timing
from seismo3d.robot.keyframes import Keyframe, make_keyframe
from seismo3d.robot.landmarks import Sightings, sight_landmarks, time_sightings, views_apart
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.state import MapState
from seismo3d.robot.tracking import Located, fine_step, locate
from seismo3d.robot.tsdf import Prediction, SurfaceMap

_FAIR = 0.4
"""Share of the vertices that agree with the map where nothing is wrong, even with half of the view unseen before."""
_STEADY, _SCATTERED = 5.0, 15.0
"""Spreads of landmarks, pixels: those below agree on a pose, those above on none, however many they are."""
_SHARP = 1.0
"""Spread below which half as many will do: that they meet by chance is the less likely the closer they meet."""
_ALIKE, _RIVALS = 12, 2
"""Keyframes that look most alike, among which other places are sought, and how many of those are compared at most."""
_ELSEWHERE = 1.0
"""How far a keyframe is from a pose that does not show what is seen there, radians plus half the metres."""


class Locator:
    """Locates frames of some cameras in local maps.

    Parameters
    ----------
    cameras : list of Camera
    settings : MapperSettings
    pool : ThreadPoolExecutor
    n_threads : int
    """

    def __init__(
        self, cameras: list[Camera], settings: MapperSettings, pool: ThreadPoolExecutor, n_threads: int
    ) -> None:
        self._cameras = cameras
        self._terms = settings.terms
        self._enough = settings.enough_landmarks
        self._pool = pool
        self._n_threads = n_threads

    def cast(
        self, surface: SurfaceMap, measured: Measured, number: int, T: Float64Array, *, coarser: int
    ) -> Prediction:
        """Return a map's surface as a camera at a pose sees it, every ``coarser``-th pixel of the half image."""
        k, first, lens = 2 * coarser, coarser // 2, self._cameras[number].lens
        expected = np.ascontiguousarray(measured.vertices[first::coarser, first::coarser, 2])
        # the rays go through the very vertices that are paired with what they meet
        middle = 2 * first + 0.5
        numbers = np.array([lens.fx / k, lens.fy / k, (lens.cx - middle) / k, (lens.cy - middle) / k])
        return surface.cast(expected, numbers, T, pool=self._pool, n_threads=self._n_threads)

    def sight(
        self,
        state: MapState,
        grey: AnyArray | None,
        number: int,
        T: Float64Array,
        twist: Float64Array,
        timing: Timing,
        *,
        also: Sequence[tuple[int, int]] = (),
    ) -> Sightings:
        """Find a map's landmarks in an image of a camera that is nearly at a pose; none without one."""
        lens = self._cameras[number].lens
        if grey is None or self._terms == "planes":
            return time_sightings(np.empty((0, 3)), np.empty((0, 2)), lens, twist, timing, (1, 1))
        return sight_landmarks(state.views, grey, lens, T, twist, timing, also=also, enough=self._enough)

    def locate(
        self,
        state: MapState,
        measured: Measured,
        number: int,
        T: Float64Array,
        seen: Sightings,
        *,
        loose: bool = False,
    ) -> Located:
        """Fit a frame of a camera, with landmarks seen in it, to a map from a pose, which may be a ``loose`` guess."""
        prediction = self.cast(state.surface, measured, number, T, coarser=fine_step(measured))
        return locate(measured, prediction, seen, T, self._cameras[number].lens, terms=self._terms, loose=loose)

    def describe(self, measured: Measured, number: int) -> Keyframe | None:
        """Return a frame as what is asked of remembered keyframes; None of one without an image."""
        if measured.grey is None:
            return None
        return make_keyframe(-1, number, np.eye(4), measured.grey, measured.depth)

    def places(self, states: Iterable[MapState], asked: Keyframe) -> Iterable[tuple[MapState, Float64Array]]:
        """Yield maps and poses in them at which remembered keyframes say that a frame may have been taken."""
        for state in states:
            for place in state.memory.recall(asked.features).tolist():
                T = _compared(state, place, asked)
                if T is not None:
                    yield state, T

    def rivals(self, state: MapState, asked: Keyframe, T_world_camera: Float64Array) -> Iterable[Float64Array]:
        """Yield other poses in a map where a frame that was found at one may have been taken as well."""
        alike = state.memory.recall(asked.features, n_best=_ALIKE).tolist()
        views = [state.views[place] for place in alike]
        far = [k for k, apart in zip(alike, views_apart(views, T_world_camera)) if apart > _ELSEWHERE]
        for place in far[:_RIVALS]:
            T = _compared(state, place, asked)
            if T is not None and not is_reached(T_world_camera, T, reach=1.0):
                yield T


def _compared(state: MapState, place: int, asked: Keyframe) -> Float64Array | None:
    """Return the pose at which a keyframe of a map shows what another one does; None where it does not."""
    found = state.memory.compare(place, asked)
    return None if found is None else state.memory.keyframes[place].T_world_camera @ found.T_target_source


def is_reached(T_expected: Float64Array, T_found: Float64Array, *, reach: float) -> bool:
    """Whether a pose lies within a quarter of a radian and 0.2 m, times ``reach``, of where it was expected."""
    jump = log_motion(invert_transform(T_expected) @ T_found)
    return bool(np.linalg.norm(jump[:3]) < 0.25 * reach and np.linalg.norm(jump[3:]) < 0.2 * reach)


def is_sound(located: Located, T_expected: Float64Array, *, n_lost: int) -> bool:
    """Judge a located frame by its support and its distance from where it was expected.

    Parameters
    ----------
    located : Located
    T_expected : ndarray of shape (4, 4), float64
    n_lost : int
        Frames lost before it: more support is asked for after a loss, and a larger distance granted.
    """
    if not located.converged:
        return False
    near = is_reached(T_expected, located.T_world_camera, reach=1.0 + min(n_lost, 30) / 15.0)
    doubt = n_lost > 0
    few = 40 if doubt else 20
    steady = located.n_landmarks >= few and located.landmark_spread < _STEADY
    steady |= located.n_landmarks >= few // 2 and located.landmark_spread < _SHARP
    denied = located.n_landmarks >= 20 and located.landmark_spread > _SCATTERED and located.share < _FAIR
    return bool(near and (steady or located.share > (0.3 if doubt else 0.15)) and not denied)


def is_denied(located: Located) -> bool:
    """Whether landmarks that a frame shows agree on no pose; a place that only looks alike has them elsewhere."""
    return located.n_landmarks >= 20 and located.landmark_spread > _STEADY


def is_certain(located: Located) -> bool:
    """Whether a frame fits so well that it needs not be looked for elsewhere."""
    return located.share > _FAIR or (located.n_landmarks >= 40 and located.landmark_spread < _STEADY)
