"""RGB-D sequences whose every depth, pose and surface is known, rendered frame by frame when asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Progress
from seismo3d._validate import as_kind, as_number, as_numbers, as_whole_number, as_whole_numbers, freeze, is_among, told
from seismo3d.errors import ParameterError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import exp_rotation
from seismo3d.io._files import as_path
from seismo3d.synthetic import _kernels_render as k
from seismo3d.synthetic.camera_paths import room_poses, terrain_poses
from seismo3d.synthetic.depth_noise import NOISE_FREE, DepthNoise
from seismo3d.synthetic.rooms import Scene, make_room, make_terrain, shape_row

__all__ = ["NOISE_FREE", "DepthNoise", "RgbdFrame", "RgbdSequence", "rgbd_sequence"]

FIRST_STAMP = 1000.0
_MOVER_DISTANCE = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class RgbdFrame:
    """One frame with its truth.

    Attributes
    ----------
    colour : ndarray of shape (rows, columns, 3), uint8
        Red, green, blue; all zero while blacked out.
    depth : ndarray of shape (rows, columns), float32
        As measured, metres, NaN where there is none.
    stamp : float
        Seconds.
    T_world_camera : ndarray of shape (4, 4), float64
        The exact pose.
    true_depth : ndarray of shape (rows, columns), float32
        Exact, metres, NaN in the sky; it includes the moving thing, and does not know of a blackout.
    moving : ndarray of shape (rows, columns), bool
        Where the moving thing is seen.
    """

    colour: AnyArray
    depth: Float32Array
    stamp: float
    T_world_camera: Float64Array
    true_depth: Float32Array
    moving: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class RgbdSequence:
    """Frames of a known scene; iterate, or take one by its number: each is rendered when it is asked for.

    Attributes
    ----------
    kind : str
        "room" or "terrain".
    scene : Scene
        What stands still: :meth:`~seismo3d.synthetic.rooms.Scene.distance_to_surface` and ``ground_height``.
    camera : PinholeCamera
        Of the frames as given, whose depth is in metres.
    stamps : ndarray of shape (n,), float64
        Seconds.
    poses : ndarray of shape (n, 4, 4), float64
        ``T_world_camera``, exact.
    noise : DepthNoise
    seed : int
    moving : str or None
        "sphere" or "box" where something crosses the view.
    moving_share : float
        Largest share of the view that it covers.
    moving_span, blackout : (float, float) or None
        Seconds since the first frame.
    """

    kind: str
    scene: Scene
    camera: PinholeCamera
    stamps: Float64Array
    poses: Float64Array
    noise: DepthNoise
    seed: int
    moving: str | None
    moving_share: float
    moving_span: tuple[float, float] | None
    blackout: tuple[float, float] | None
    _rays: Float64Array

    def __len__(self) -> int:
        return len(self.stamps)

    def __iter__(self) -> Iterator[RgbdFrame]:
        return (self[n] for n in range(len(self)))

    @property
    def path_length(self) -> float:
        """Length of the camera's way, metres."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1).sum())

    def __getitem__(self, number: int) -> RgbdFrame:
        """Render one frame, the last ones by negative numbers; the same each time.

        Raises
        ------
        IndexError
            If there is no such frame.
        """
        from seismo3d.synthetic._kernels_depth import measure_colour, measure_depth

        n = range(len(self))[number]
        size = self._rays.shape[:2]
        exact, facing, owner = np.empty(size), np.empty(size), np.empty(size, np.int32)
        paint, colour, depth = np.empty((*size, 3)), np.zeros((*size, 3), np.uint8), np.full(size, np.nan, np.float32)
        shapes, scene = self._shapes(n), self.scene
        pixel = 1.0 / max(self.camera.fx, self.camera.fy)
        k.render(
            self._rays, self.poses[n].copy(), shapes, scene.relief, scene.frame, scene.tiles, scene.ground, scene.light,
            pixel, exact, facing, paint, owner,
        )  # fmt: skip
        if not self._within(self.blackout, n):
            key = int(k.hashed(self.seed, n, 0) >> np.uint64(1))
            noise = self.noise
            measure_depth(exact, facing, noise.settings(), key, depth)
            measure_colour(paint, noise.colour, key, colour)
        moved = owner == len(scene.shapes)  # the mover, where there is one, is the last shape
        return RgbdFrame(
            freeze(colour), freeze(depth), float(self.stamps[n]), self.poses[n], freeze(exact.astype(np.float32)), moved
        )

    def write(self, folder: str | Path, *, progress: Progress | None = None) -> Path:
        """Write the sequence in the layout of the TUM RGB-D benchmark.

        The folder gets rgb/ and depth/ (PNG; 5000 a metre in 16 bits, 0 for none), associations.txt, rgb.txt,
        depth.txt, camera.json and groundtruth.txt (stamp tx ty tz qx qy qz qw, camera to world). It appears when all
        is written, or not at all.

        Parameters
        ----------
        folder : str or Path
            To be made, or replaced.
        progress : callable, optional

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        FileAccessError
            If it cannot be written.
        """
        from seismo3d.synthetic.rgbd_files import write_frames

        out = as_path(folder, "folder")
        write_frames(out, self, self.camera, progress=progress)
        return out

    def _within(self, span: tuple[float, float] | None, n: int) -> bool:
        return span is not None and span[0] <= self.stamps[n] - self.stamps[0] < span[1]

    def _shapes(self, n: int) -> Float64Array:
        """Shapes of the scene with the moving thing as it is now: carried along by the camera, and across its view."""
        if self.moving is None or self.moving_span is None or not self._within(self.moving_span, n):
            return self.scene.shapes.copy()
        start, stop = self.moving_span
        share = (self.stamps[n] - self.stamps[0] - start) / (stop - start)
        tangent = float(np.sqrt(self.moving_share * self.camera.width * self.camera.height / np.pi) / self.camera.fx)
        d = _MOVER_DISTANCE
        radius = d * np.sin(np.arctan(0.97 * tangent))
        side = (0.5 * self.camera.width / self.camera.fx + tangent) * d * 1.1
        place = self.poses[n] @ [side * (2.0 * share - 1.0), 0.04 * np.sin(9.0 * share), d, 1.0]
        R = self.poses[n][:3, :3] @ exp_rotation([2.0 * share, 3.0 * share, share])
        kind, half = (k.SPHERE, [radius] * 3) if self.moving == "sphere" else (k.BOX, [0.58 * radius] * 3)
        row = shape_row(kind, place[:3], half, R, [170.0, 90.0, 70.0], self.seed + 991)
        return np.vstack([self.scene.shapes, row])


def rgbd_sequence(
    kind: str = "room",
    *,
    frames: int = 1000,
    seed: int = 0,
    rate: float = 30.0,
    period: float = 30.0,
    size: tuple[int, int] = (640, 480),
    noise: DepthNoise | None = None,
    moving: str | None = None,
    moving_share: float = 0.3,
    moving_span: tuple[float, float] | None = None,
    blackout: tuple[float, float] | None = None,
    camera: PinholeCamera | None = None,
) -> RgbdSequence:
    """Make a sequence of colour and depth images of a room, or of open ground, with everything about it known.

    The camera goes round, once in ``period`` seconds, and comes back exactly to its start; 1,000 frames at 30 a second
    see the first three seconds' places a second time. Depth has the noise of a structured-light camera.

    Parameters
    ----------
    kind : {"room", "terrain"}
        Indoors, 6.4 x 5.6 m; or outdoors, looking ahead and down.
    frames : int
        Number of frames.
    seed : int
        Same seed, same sequence.
    rate : float
        Frames a second.
    period : float
        Seconds for one round.
    size : (int, int)
        Width and height in pixels; the field of view stays the same.
    noise : DepthNoise, optional
        Kinect-like by default; ``seismo3d.synthetic.rgbd.NOISE_FREE`` for none.
    moving : {"sphere", "box"}, optional
        Something that crosses the view in front of the scene.
    moving_share : float
        Largest share of the view that it covers, 0.01 to 0.6.
    moving_span : (float, float), optional
        When, in seconds since the first frame; by default the middle third.
    blackout : (float, float), optional
        When both images are empty, in seconds since the first frame.
    camera : PinholeCamera, optional
        In place of ``size``; with distortion if so wished. Its depth_scale must be 1.

    Returns
    -------
    RgbdSequence

    Raises
    ------
    ParameterError
        If a setting is outside what it can be.

    Examples
    --------
    >>> sequence = rgbd_sequence("room", frames=2, size=(80, 60))
    >>> sequence[0].depth.shape
    (60, 80)
    """
    if not is_among(kind, ("room", "terrain")):
        raise ParameterError(f"kind is {told(kind)}; expected 'room' or 'terrain'.")
    if moving is not None and not is_among(moving, ("sphere", "box")):
        raise ParameterError(f"moving is {told(moving)}; expected 'sphere', 'box' or None.")
    n = as_whole_number(frames, "frames", low=1, high=1e6)
    lens = _default_camera(size) if camera is None else camera
    as_kind(lens, PinholeCamera, "camera", remedy="Give PinholeCamera(...), or leave it out.")
    if noise is not None:
        as_kind(noise, DepthNoise, "noise", remedy="Give DepthNoise(...), or leave it out.")
    number = as_whole_number(seed, "seed", low=0)
    if lens.depth_scale != 1.0 or lens.width < 2 or lens.height < 2:
        raise ParameterError(
            f"camera has depth_scale {lens.depth_scale:g} and size {lens.width} x {lens.height}; expected 1 and a size."
        )
    seconds = np.arange(n) / as_number(rate, "rate", low=0.1, high=1e4)
    middle = (float(seconds[-1]) / 3.0, 2.0 * float(seconds[-1]) / 3.0)
    span = middle if moving_span is None else moving_span
    rng = np.random.default_rng([number, 71])
    scene = make_room(rng) if kind == "room" else make_terrain(rng)
    phase = seconds / as_number(period, "period", low=0.1, high=1e5)
    poses = room_poses(phase, rng) if kind == "room" else terrain_poses(phase, rng, scene)
    return RgbdSequence(
        kind, scene, lens, freeze(FIRST_STAMP + seconds), freeze(poses), noise or DepthNoise(), number, moving,
        as_number(moving_share, "moving_share", low=0.01, high=0.6), _as_span(span, "moving_span") if moving else None,
        None if blackout is None else _as_span(blackout, "blackout"), freeze(_rays_of(lens)),
    )  # fmt: skip


def _as_span(span: tuple[float, float], name: str) -> tuple[float, float]:
    start, stop = as_numbers(span, name, n=2)
    if not start < stop:
        raise ParameterError(f"{name} is ({start:g}, {stop:g}); expected a start before its end, in seconds.")
    return start, stop


def _default_camera(size: tuple[int, int]) -> PinholeCamera:
    width, height = as_whole_numbers(size, "size", n=2, low=16, high=8192)
    focal = 525.0 * width / 640.0
    return PinholeCamera(focal, focal, 0.5 * (width - 1), 0.5 * (height - 1), (), 1.0, width, height)


def _rays_of(camera: PinholeCamera) -> Float64Array:
    grid = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(camera.rays(grid.astype(np.float64)).reshape(camera.height, camera.width, 2))
