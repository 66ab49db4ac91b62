"""Follow the camera from frame to frame: predict where it is, find it there or elsewhere, and learn how it moves."""

from __future__ import annotations

from collections import Counter

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.geometry.rotations import adjoint, invert_transform
from seismo3d.robot.camera import Camera, RgbdFrame
from seismo3d.robot.drift import surest_view
from seismo3d.robot.ekf import MotionFilter, of_measurement
from seismo3d.robot.frames import Coming, Measured, Timing
from seismo3d.robot.keyframes import Keyframe
from seismo3d.robot.landmarks import Sightings
from seismo3d.robot.local_maps import LocalMaps
from seismo3d.robot.locator import Locator, is_certain, is_denied, is_reached, is_sound
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.semantic_landmarks import LandmarkBook
from seismo3d.robot.shared_errors import find_shared_errors
from seismo3d.robot.state import MapState
from seismo3d.robot.tracking import Located

_LEAST_NORMALS = 300
_FASTER = 2.5
"""How many times as far as tracking reaches a camera may have come by mere speed: farther is a leap."""
_AS_WELL = 0.8
"""Share of the vertices that agree, over that at the place found first, with which another place fits as well."""
_USUAL = 1.0 / 30.0
"""Seconds from one frame of a camera to the next, where their stamps are equal."""
_RELOCATE_EVERY = 4
_LEAST_SHOWN = 12
"""Landmarks of a view that agree with where a frame was located, from which on they say that it shows that view."""
_PAUSE = 0.1
"""Standard deviation of where a camera is about where it was when the map it goes on with was saved, rad and m."""
_LOOSE = 0.01
"""Standard deviation of the predicted turn from which on the prediction is but a guess, rad."""


class Follower:
    """Follows the body that some cameras sit on through local maps.

    Parameters
    ----------
    cameras : list of Camera
    settings : MapperSettings
    locator : Locator
    maps : LocalMaps

    Attributes
    ----------
    n_lost, n_unplaced : int
        Frames in a row that were not located, and those of them that had depth.
    """

    def __init__(self, cameras: list[Camera], settings: MapperSettings, locator: Locator, maps: LocalMaps) -> None:
        self._cameras = cameras
        self._settings = settings
        self._locator = locator
        self._maps = maps
        self._filter: MotionFilter | None = None
        self._book = LandmarkBook()
        self._stamps = [-np.inf] * len(cameras)
        self.n_lost = self.n_unplaced = 0

    @property
    def motion(self) -> MotionFilter:
        """The filter; there is one once a frame was predicted."""
        if self._filter is None:
            raise RuntimeError("no frame was predicted; expected one before its motion is asked for.")
        return self._filter

    def twist(self, number: int) -> Float64Array:
        """Velocity of a camera in its own frame."""
        return adjoint(invert_transform(self._cameras[number].T_body_camera)) @ self.motion.twist

    def predict(self, frame: RgbdFrame) -> None:
        """Carry the filter on to the time of a frame's depth."""
        camera = self._cameras[frame.camera]
        now = frame.depth_time + camera.clock_offset - (camera.depth_delay or 0.0) - 0.5 * (camera.readout or 0.0)
        if self._filter is None:
            T = invert_transform(camera.T_body_camera)
            last = self._maps.current.poses[-1:]  # of a map that was read
            self._filter = MotionFilter(now, last[0].T_world_camera @ T if last else T)
            if last:
                self._filter.covariance[:6, :6] = np.eye(6) * _PAUSE**2
                self._rest_on_map(last[0].T_world_camera)
        if not self._settings.filtered:
            self._filter.twist[:] = 0.0
        self._filter.predict(now)
        if frame.depth_time == self._stamps[frame.camera]:
            self._filter.loosen(_USUAL)
        self._stamps[frame.camera] = frame.depth_time

    def find(self, coming: Coming, number: int, timing: Timing) -> tuple[str, Located | None, Float64Array]:
        """Find where a frame of a camera was taken, near where it is predicted or elsewhere.

        Its landmarks are looked for while it is measured.

        Returns
        -------
        (str, Located or None, ndarray of shape (4, 4))
            State of the frame, how it was located, and the camera's pose; the prediction where it is not known.
        """
        T, seen = self._sight(coming.grey, number, timing)
        measured = coming.measured()
        if measured.n_normals < _LEAST_NORMALS:
            return "empty", None, T
        state, located = self._place(measured, number, T, seen, timing)
        return state, located, T if located is None or state == "lost" else located.T_world_camera

    def lose(self, state: str) -> None:
        """Take note of a frame that was not located; its state is ``lost`` or ``empty``."""
        self.n_lost += 1
        self.n_unplaced += state == "lost"
        if not self._book.sees_any:
            self.motion.twist *= 0.95
        if not self._maps.current.poses:
            self._filter = None

    def shift(self, change: Float64Array) -> None:
        """Carry over a change of the world's frame."""
        self._book.forget(self._filter)
        if self._filter is not None:
            self._filter.turn(change)
            self._rest_on_map(self._filter.T_world_body @ self._cameras[0].T_body_camera)

    def _sight(self, grey: AnyArray | None, number: int, timing: Timing) -> tuple[Float64Array, Sightings]:
        """Update the filter by its landmarks; return the camera's pose, and the sightings that are left."""
        camera, motion = self._cameras[number], self.motion
        T, twist = motion.T_world_body @ camera.T_body_camera, self.twist(number)
        seen = self._locator.sight(self._maps.current, grey, number, T, twist, timing, also=self._book.names)
        if not (self._settings.filtered and self._settings.landmarks_in_state):
            return T, seen
        own = self._book.take_in(motion, seen, camera.lens, camera.T_body_camera)
        return motion.T_world_body @ camera.T_body_camera, seen.only(~own)

    def _place(
        self, measured: Measured, number: int, T: Float64Array, seen: Sightings, timing: Timing
    ) -> tuple[str, Located | None]:
        """Locate a frame near the predicted pose, else at a place that looks like it, else begin a new local map."""
        if not self._maps.current.poses:
            return "started", None
        loose = bool(self.motion.covariance.diagonal()[:3].max() > _LOOSE**2)
        located = self._locator.locate(self._maps.current, measured, number, T, seen, loose=loose)
        sound = is_sound(located, T, n_lost=self.n_lost)
        if not sound and located.converged:
            # what the map shows from there may lead on: the first look was from where the frame was only expected
            seen_there, again = self._look_at(self._maps.current, measured, number, located.T_world_camera, timing)
            if is_sound(again, T, n_lost=self.n_lost):
                located, seen, sound = again, seen_there, True
        if not (sound and is_certain(located)):
            found = self._place_elsewhere(measured, number, timing, located.share + 0.1 if sound else 0.0)
            if found is not None:
                return found
        if sound:
            self._take(located, number, seen)
            return "sliding" if len(located.blind) else "tracked", located
        if self.n_unplaced + 1 >= self._settings.new_map_after > 0:
            self._maps.begin()
            self._go_on(self._maps.current, T, number)
            return "started", None
        return "lost", located

    def _place_elsewhere(
        self, measured: Measured, number: int, timing: Timing, least_share: float
    ) -> tuple[str, Located] | None:
        """Locate a frame at a place that looks like it: when it fits badly, and now and then after a loss."""
        if self.n_lost >= _RELOCATE_EVERY and self.n_lost % _RELOCATE_EVERY:
            return None
        asked = self._locator.describe(measured, number)
        if asked is None:
            return None
        T_expected = self.motion.T_world_body @ self._cameras[number].T_body_camera
        for state, place in self._locator.places(self._maps.every[::-1], asked):
            there, again = self._look_at(state, measured, number, place, timing)
            # bare walls look alike: something there has to tell that it is this place
            if again.share > max(0.4, least_share) and not len(again.blind) and self._fits(again, place):
                if self._is_ambiguous(state, measured, asked, again, timing):
                    return None
                near = is_reached(T_expected, again.T_world_camera, reach=_FASTER)
                if state is self._maps.current and self.n_lost == 0 and near:
                    # it moved faster than foreseen: that says how fast
                    self._take(again, number, there)
                    return "tracked", again
                self._go_on(state, again.T_world_camera, number, found=(again, there))
                return "relocated", again
        return None

    def _look_at(
        self, state: MapState, measured: Measured, number: int, place: Float64Array, timing: Timing
    ) -> tuple[Sightings, Located]:
        """Locate a frame of a camera near a place in a map; return its landmarks, too."""
        there = self._locator.sight(state, measured.grey, number, place, np.zeros(6), timing)
        return there, self._locator.locate(state, measured, number, place, there)

    def _fits(self, located: Located, place: Float64Array) -> bool:
        return is_sound(located, place, n_lost=self.n_lost) and not is_denied(located)

    def _is_ambiguous(
        self, state: MapState, measured: Measured, asked: Keyframe, found: Located, timing: Timing
    ) -> bool:
        """Whether a frame fits elsewhere in a map nearly as well as where it was found: nothing tells which it is."""
        for place in self._locator.rivals(state, asked, found.T_world_camera):
            _, other = self._look_at(state, measured, asked.camera, place, timing)
            if other.share > _AS_WELL * found.share and self._fits(other, place):
                return True
        return False

    def _take(self, located: Located, number: int, seen: Sightings) -> None:
        """Take a located frame into the filter; the pose is the registration's, so that it fits the map."""
        if self._filter is None:
            return
        T_world_body = located.T_world_camera @ invert_transform(self._cameras[number].T_body_camera)
        of_map = self._errors_there(located, number, seen, foreseen=self._filter.pose_covariance)
        self._filter.update(T_world_body, located.covariance, gate=None, blind=located.blind, of_map=of_map)
        self._filter.hold(T_world_body, located.covariance, blind=located.blind)
        if self._settings.filtered and self._settings.landmarks_in_state and len(seen):
            self._book.learn(self._filter, seen, located.landmark_weights, located.T_world_camera)

    def _errors_there(
        self, located: Located, number: int, seen: Sightings, *, foreseen: Float64Array | None = None
    ) -> PoseErrors:
        """Return how far the map, and what a frame that was located by some landmarks has wrong with it, put it off."""
        views = self._maps.current.views
        counts = Counter(seen.names[located.landmark_weights > 0.0, 0].tolist())
        shown = [view for view, count in counts.items() if count >= _LEAST_SHOWN]
        base = surest_view(views, located.T_world_camera, foreseen=foreseen, shown=shown)
        if base is None:
            return PoseErrors()
        return base.errors.beyond(find_shared_errors(located, seen, views, base, self._cameras[number].lens))

    def _rest_on_map(self, T_world_camera: Float64Array) -> None:
        """Let the filter's pose be as far off as the map is where a camera looks."""
        base = surest_view(self._maps.current.views, T_world_camera)
        if base is not None:
            self.motion.of_map = base.errors

    def _go_on(
        self,
        state: MapState,
        T_world_camera: Float64Array,
        number: int,
        *,
        found: tuple[Located, Sightings] | None = None,
    ) -> None:
        """Go on from a pose in a local map, found there by some landmarks, with nothing known of the velocity."""
        if state is not self._maps.current:
            self._maps.go_to(state)
        T_world_body = T_world_camera @ invert_transform(self._cameras[number].T_body_camera)
        self._book.forget(None)
        self._filter = MotionFilter(0.0 if self._filter is None else self._filter.time, T_world_body)
        if found is not None:
            located, seen = found
            self._filter.covariance[:6, :6] = of_measurement(located.covariance)
            self._filter.of_map = self._errors_there(located, number, seen)
            self._filter.hold(T_world_body, located.covariance, blind=located.blind)
