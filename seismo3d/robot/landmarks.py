"""Landmarks: corners of views that the map remembers, with their places on the mapped surface.

A corner is found again in a frame by its patch (Lucas-Kanade on a pyramid, from where the predicted pose puts it, and
back), in the views that looked most alike, so that coming back to a place ties the frame to when it was first seen.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float64Array, Int64Array
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import skew
from seismo3d.robot import _kernels_follow as following
from seismo3d.robot.ekf import exp_motion
from seismo3d.robot.frames import Timing
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.tsdf import Prediction

_FARTHEST = 0.9
"""Views that are farther, by ``View.apart``, are not searched."""
_TOP = 3
"""Smallest image that patches are followed in, the whole one being 0: a shift of 40 pixels is one of 5 there."""
_MOST_VIEWS = 3
"""Views that are searched at most, the nearest first."""
_MOST_CORNERS = 500
"""Landmarks that a view has at most."""
_MOST = 150
"""Landmarks of a view that are looked for at most, evenly from the most to the least distinct."""
_LEAST_ALIKE = 0.5
"""Correlation of a patch with what it was found as; the noise of a bare wall, followed to where it fits, has 0.3."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """An image that the map remembers.

    Attributes
    ----------
    T_world_camera : ndarray of shape (4, 4), float64
        Pose when the colour was taken.
    grey : ndarray of shape (rows, columns), uint8
    pixels : ndarray of shape (n, 2), float64
        Landmarks' pixels (column, row).
    points : ndarray of shape (n, 3), float64
        Landmarks in the world.
    camera : int
    errors : PoseErrors
        Of the pose against the map's first frame.
    """

    T_world_camera: Float64Array
    grey: AnyArray
    pixels: Float64Array
    points: Float64Array
    camera: int = 0
    errors: PoseErrors = field(default_factory=PoseErrors)

    def moved(self, change: Float64Array) -> View:
        """Return the view after a change (4, 4) of the world's frame."""
        points = self.points @ change[:3, :3].T + change[:3, 3]
        T = change @ self.T_world_camera
        return replace(self, T_world_camera=T, points=points, errors=self.errors.moved(change))

    def apart(self, T_world_camera: Float64Array) -> float:
        """Return how far another view is: angle between the two in radians plus half the distance in metres."""
        return float(views_apart([self], T_world_camera)[0])


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Landmarks found in a frame.

    Attributes
    ----------
    points : ndarray of shape (n, 3), float64
        In the world.
    pixels : ndarray of shape (n, 2), float64
        In the frame's colour image.
    rays : ndarray of shape (n, 3), float64
        Of the pixels, with third component 1.
    T_depth_pixel : ndarray of shape (n, 4, 4), float64
        Camera's motion between the depth's time and the time of the pixel's row.
    delay : ndarray of shape (n,), float64
        That time, less the depth's, seconds.
    row : ndarray of shape (n,), float64
        Row over the image's rows, less a half.
    names : ndarray of shape (n, 2), int64
        View, and landmark of it.
    """

    points: Float64Array
    pixels: Float64Array
    rays: Float64Array
    T_depth_pixel: Float64Array
    delay: Float64Array
    row: Float64Array
    names: Int64Array

    def __len__(self) -> int:
        return len(self.points)

    def only(self, which: BoolArray) -> Sightings:
        """Return some of them, by a mask (n,)."""
        return Sightings(*(getattr(self, name)[which] for name in self.__slots__))


def views_apart(views: Sequence[View], T_world_camera: Float64Array) -> Float64Array:
    """Return how far each of some views is from a pose (n,), as :meth:`View.apart` says."""
    poses = np.array([view.T_world_camera for view in views]).reshape(-1, 4, 4)
    turn = ((poses[:, :3, :3] * T_world_camera[:3, :3]).sum(axis=(1, 2)) - 1.0) / 2.0
    shift = np.linalg.norm(poses[:, :3, 3] - T_world_camera[:3, 3], axis=1)
    return np.asarray(np.arccos(np.clip(turn, -1.0, 1.0)) + 0.5 * shift)


def sight_landmarks(
    views: list[View],
    grey: AnyArray,
    lens: PinholeCamera,
    T_world_camera: Float64Array,
    twist: Float64Array,
    timing: Timing,
    *,
    also: Sequence[tuple[int, int]] = (),
    enough: int = 100,
) -> Sightings:
    """Find the landmarks of the nearest views, and some named ones, in an image.

    Parameters
    ----------
    views : list of View
    grey : ndarray of shape (rows, columns), uint8
    lens : PinholeCamera
    T_world_camera : ndarray of shape (4, 4), float64
        Predicted pose at the depth's time.
    twist : ndarray of shape (6,), float64
        Camera's velocity in its own frame.
    timing : Timing
    also : sequence of (int, int)
        View and landmark of those that are looked for from other views, too: from two more at most.
    enough : int
        Landmarks after which no other view is searched; three are at most.

    Returns
    -------
    Sightings
    """
    T_colour = T_world_camera @ exp_motion(twist * timing.colour_lead)
    apart = views_apart(views, T_colour)
    found_points, found_pixels = [np.empty((0, 3))], [np.empty((0, 2))]
    found_names, levels = [np.empty((0, 2), dtype=np.int64)], _padded_levels(grey)

    def search(number: int, wanted: Sequence[int] | None) -> None:
        view = views[number]
        expected, visible = _expected(view, lens, T_colour, grey.shape)
        if wanted is not None:
            visible &= np.isin(np.arange(len(visible)), wanted)
        sought = np.flatnonzero(visible)
        if len(sought) < (6 if wanted is None else 1):
            return
        if len(sought) > _MOST:
            sought = sought[np.linspace(0, len(sought) - 1, _MOST).astype(int)]
        pixels, good = _follow(_padded_levels(view.grey), levels, view.pixels[sought], expected[sought])
        which = sought[good]
        found_points.append(view.points[which])
        found_pixels.append(pixels[good])
        found_names.append(np.column_stack([np.full(len(which), number), which]))

    searched = []
    for number in np.argsort(apart, kind="stable")[:_MOST_VIEWS].tolist():
        if apart[number] > _FARTHEST or sum(len(p) for p in found_pixels) > enough:
            break
        search(number, None)
        searched.append(number)
    others = Counter(number for number, _ in also if number not in searched and apart[number] < _FARTHEST)
    for number, _ in others.most_common(2):
        search(number, [k for name, k in also if name == number])
    points, pixels = np.concatenate(found_points), np.concatenate(found_pixels)
    return time_sightings(points, pixels, lens, twist, timing, grey.shape, names=np.concatenate(found_names))


def time_sightings(
    points: Float64Array,
    pixels: Float64Array,
    lens: PinholeCamera,
    twist: Float64Array,
    timing: Timing,
    shape: tuple[int, ...],
    *,
    names: Int64Array | None = None,
) -> Sightings:
    """Return pairs of landmarks (n, 3) and pixels (n, 2), perhaps named, with the ray and the time of each pixel."""
    row = pixels[:, 1] / shape[0] - 0.5
    delay = timing.colour_lead + row * timing.readout
    rays = np.column_stack([lens.rays(pixels), np.ones(len(pixels))])
    called = np.full((len(pixels), 2), -1, dtype=np.int64) if names is None else names
    return Sightings(points, pixels, rays, _motions(twist, delay), delay, row, called)


def make_view(
    grey: AnyArray | None,
    lens: PinholeCamera,
    prediction: Prediction,
    twist: Float64Array,
    timing: Timing,
    *,
    camera: int = 0,
    moving: BoolArray | None = None,
) -> View:
    """Remember an image with the corners that lie on the mapped surface.

    Parameters
    ----------
    grey : ndarray of shape (rows, columns), uint8, or None
    lens : PinholeCamera
    prediction : Prediction
        The map, with this frame in it, cast at the depth's pose.
    twist, timing
        As for :func:`sight_landmarks`.
    camera : int
    moving : ndarray of shape (rows / 2, columns / 2), bool, optional
        Where corners are of no use.

    Returns
    -------
    View
        Without landmarks where nothing stands out.
    """
    import cv2

    T = prediction.T_world_camera
    T_colour = T @ exp_motion(twist * timing.colour_lead)
    if grey is None:
        return View(T_colour, np.empty((0, 0), np.uint8), np.empty((0, 2)), np.empty((0, 3)), camera)
    corners = cv2.goodFeaturesToTrack(grey, _MOST_CORNERS, 0.002, 7, mask=_steady_pixels(moving, grey.shape))
    pixels = np.empty((0, 2)) if corners is None else corners.reshape(-1, 2).astype(np.float64)
    seen = time_sightings(np.zeros((len(pixels), 3)), pixels, lens, twist, timing, grey.shape)
    origins = T[:3, 3] + seen.T_depth_pixel[:, :3, 3] @ T[:3, :3].T
    directions = np.einsum("nij,nj->ni", seen.T_depth_pixel[:, :3, :3], seen.rays) @ T[:3, :3].T
    points, good = meet_surface(prediction, origins, directions)
    return View(T_colour, grey, pixels[good], points[good], camera)


def _steady_pixels(moving: BoolArray | None, shape: tuple[int, ...]) -> AnyArray | None:
    """Mask of the pixels that no patch on something that moves reaches; None for all."""
    import cv2

    if moving is None or not moving.any():
        return None
    near = cv2.dilate(moving.astype(np.uint8), np.ones((9, 9), np.uint8))
    return cv2.resize(1 - near, shape[::-1], interpolation=cv2.INTER_NEAREST)


def meet_surface(
    prediction: Prediction, origins: Float64Array, directions: Float64Array
) -> tuple[Float64Array, BoolArray]:
    """Return where rays, nearly those of the prediction, meet its surface, and whether it is smooth there."""
    rows, columns, _ = prediction.points.shape
    T, lens = prediction.T_world_camera, prediction.lens
    depth = np.ones(len(origins))
    good = np.ones(len(origins), dtype=bool)
    r = c = np.ones(len(origins), dtype=np.int64)
    for _ in range(4):
        at = (origins + depth[:, None] * directions - T[:3, 3]) @ T[:3, :3]
        forward = np.maximum(at[:, 2], 0.05)
        place = np.rint(at[:, :2] / forward[:, None] * lens[:2] + lens[2:])
        inside = (place >= 1).all(axis=1) & (place[:, 0] < columns - 1) & (place[:, 1] < rows - 1)
        good &= inside
        c, r = np.where(inside[:, None], place, 1.0).astype(np.int64).T
        point = prediction.points[r, c].astype(np.float64)
        normal = prediction.normals[r, c].astype(np.float64)
        across = np.einsum("ni,ni->n", directions, normal)
        known = np.isfinite(point[:, 0]) & (across < -0.1)
        good &= known
        far = np.where(known, np.einsum("ni,ni->n", point - origins, normal) / np.where(known, across, 1.0), depth)
        depth = np.where((far > 0.1) & (far < 20.0), far, depth)
    around = np.stack([prediction.points[r + i, c + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]).astype(np.float64)
    # off the surface's own plane: along a wall that is seen aslant depth alone changes from pixel to pixel
    off = np.einsum("kni,ni->kn", around - T[:3, 3], prediction.normals[r, c].astype(np.float64))
    smooth = np.ptp(np.where(np.isfinite(off), off, 1e9), axis=0) < 0.05 * depth
    return origins + depth[:, None] * directions, good & smooth


def _expected(
    view: View, lens: PinholeCamera, T_colour: Float64Array, shape: tuple[int, ...]
) -> tuple[Float64Array, BoolArray]:
    local = (view.points - T_colour[:3, 3]) @ T_colour[:3, :3]
    pixels = lens.project(local)
    with np.errstate(invalid="ignore"):
        inside = (pixels > 5).all(axis=1) & (pixels[:, 0] < shape[1] - 6) & (pixels[:, 1] < shape[0] - 6)
    return pixels, inside & (local[:, 2] > 0.2)


def _padded_levels(grey: AnyArray) -> tuple[AnyArray, ...]:
    """Return an image and its smaller ones, each of half the size, padded as patches are followed in them."""
    import cv2

    levels = [grey]
    for _ in range(_TOP):
        levels.append(cv2.pyrDown(levels[-1]))
    pad = following.PAD
    return tuple(np.asarray(cv2.copyMakeBorder(level, pad, pad, pad, pad, cv2.BORDER_REFLECT_101)) for level in levels)


def _follow(
    before: tuple[AnyArray, ...], now: tuple[AnyArray, ...], pixels: Float64Array, expected: Float64Array
) -> tuple[Float64Array, BoolArray]:
    """Follow patches from one image to another and back; return where they are and whether they came back, alike."""
    there, back = np.array(expected, dtype=np.float64, order="C"), pixels.copy()
    found, returned = np.empty(len(pixels), dtype=np.bool_), np.empty(len(pixels), dtype=np.bool_)
    # no level on which the image is smaller than a patch
    least = (min(now[0].shape) - 2 * following.PAD) / (2 * following.RADIUS + 2)
    following.follow_patches(before, now, min(_TOP, max(0, int(np.log2(least)))), pixels, there, found)
    # where the way back should end is known, so that it needs no smaller images
    following.follow_patches(now, before, 0, there, back, returned)
    good = found & returned & (np.linalg.norm(back - pixels, axis=1) < 0.7)
    likeness = np.empty(np.count_nonzero(good))
    following.compare_patches(before[0], now[0], pixels[good], there[good], likeness)
    good[good] = likeness > _LEAST_ALIKE
    return there, good


def _motions(twist: Float64Array, times: Float64Array) -> Float64Array:
    """Camera's motion (n, 4, 4) over each of some times."""
    speed = float(np.linalg.norm(twist[:3]))
    K = skew(twist[:3] / speed) if speed > 0.0 else np.zeros((3, 3))
    angle = (speed * times)[:, None, None]
    out = np.zeros((len(times), 4, 4))
    out[:, :3, :3] = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    # the path bends with the turn: to second order in the time
    out[:, :3, 3] = times[:, None] * twist[3:] + 0.5 * times[:, None] ** 2 * (speed * K @ twist[3:])
    out[:, 3, 3] = 1.0
    return out
