"""Find how long a shutter takes to run down the image and how late depth is stamped, from the frames alone.

Consumer depth cameras expose row by row, and their drivers stamp colour and depth with different lags. A turning
camera shows both: mapped with the wrong timing, frames fit the map and its landmarks less well. So a stretch of the
sequence is mapped under several hypotheses, at half the resolution, and the fit decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import Progress
from seismo3d._validate import as_kind, told
from seismo3d.errors import ParameterError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot.camera import Camera, RgbdFrame
from seismo3d.robot.frames import check_frame

_DELAY_STEP = 0.02
_NARROW = 0.4
"""Width of the second search for the readout, over that of the first: the misfit is no parabola over the whole width,
and the first was searched with the wrong delay."""
_LEAST_GAIN = 0.04
"""Gain in the mean logarithm of the misfits below which a hypothesis does not replace a simpler one."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The timing that fits best.

    Attributes
    ----------
    readout, depth_delay : float
        Seconds; see :class:`seismo3d.robot.camera.Camera`.
    misfit : float
        Mean logarithm of the spreads of planes (over the sensor's) and landmarks (pixels) with it.
    misfit_before : float
        The same without readout and delay.
    """

    readout: float
    depth_delay: float
    misfit: float
    misfit_before: float

    def applied(self, camera: Camera) -> Camera:
        """Return the camera with this timing."""
        return replace(camera, readout=self.readout, depth_delay=self.depth_delay)


def calibrate_timing(frames: Sequence[RgbdFrame], camera: Camera, *, progress: Progress | None = None) -> Calibration:
    """Find the readout and the delay of depth of a camera from frames that it took while it turned.

    Parameters
    ----------
    frames : sequence of RgbdFrame
        Two to four seconds of one camera; the turning should change its direction.
    camera : Camera
        What it states is kept.
    progress : callable, optional
        Called with "timing" and the share done.

    Returns
    -------
    Calibration
        Zeros where nothing fits clearly better.

    Raises
    ------
    ShapeError
        If depth and colour of a frame do not fit each other or the camera.
    ParameterError
        If `frames` is no list of frames, or `camera` no camera.
    """
    report = as_progress(progress)
    as_kind(camera, Camera, "camera", remedy="Give one of a sequence's cameras, or seismo3d.robot.Camera(lens).")
    if not isinstance(frames, (list, tuple)):
        raise ParameterError(f"frames is {told(frames)}; expected a list of RgbdFrame. Give list(sequence)[:90].")
    for frame in frames:
        as_kind(frame, RgbdFrame, "frame", remedy="Give what a sequence yields.")
        check_frame(frame, camera.lens)
    small = [halve_frame(frame) for frame in frames]
    stamps = np.array([frame.depth_time for frame in frames])
    slowest = float(np.clip(np.median(np.diff(stamps)), 0.0, 0.05)) if len(frames) > 1 else 0.0
    misfits: dict[tuple[float, float], float] = {}
    first = (camera.readout or 0.0, camera.depth_delay or 0.0)

    def misfit(timing: tuple[float, float]) -> float:
        if timing not in misfits:
            rehearsed = replace(_halve_camera(camera), readout=timing[0], depth_delay=timing[1])
            misfits[timing] = _rehearse(small, rehearsed) - _LEAST_GAIN * (timing == first)
            report("timing", min(0.95, len(misfits) / 10))
        return misfits[timing]

    best = first
    if camera.depth_delay is None:
        best = min([(best[0], best[1] + k * _DELAY_STEP) for k in (0, 1, -1)], key=misfit)
    for width in (1.0, _NARROW):
        delay = best[1]
        if camera.readout is None and slowest > 0.0 and (width == 1.0 or best != first):
            middle = 0.5 if width == 1.0 else float(np.clip(best[0] / slowest, 0.5 * width, 1.0 - 0.5 * width))
            tried = [((middle + 0.5 * k * width) * slowest, delay) for k in (-1.0, 0.0, 1.0)]
            best = min([best, *tried], key=misfit)
            if best != first:
                best = (_vertex([k[0] for k in tried], [misfit(k) for k in tried]), delay)
        if camera.depth_delay is None and best != first:
            tried = [(best[0], best[1] + k * _DELAY_STEP) for k in (-1.0, -0.5, 0.0, 0.5, 1.0)]
            best = (best[0], _vertex([k[1] for k in tried], [misfit(k) for k in tried]))
        if camera.readout is not None and abs(best[1] - delay) < 0.5 * _DELAY_STEP:
            break
    report("timing", 1.0)
    before = misfit(first) + _LEAST_GAIN
    return Calibration(best[0], best[1], before if best == first else misfit(best), before)


def _vertex(places: Sequence[float], values: Sequence[float]) -> float:
    """Place of a parabola's least value within the points' range; of the least point where it opens downwards."""
    a, b, _ = np.polyfit(places, values, 2)
    if not a > 0.0:
        return float(places[int(np.argmin(values))])
    return float(np.clip(-b / (2.0 * a), min(places), max(places)))


def halve_frame(frame: RgbdFrame) -> RgbdFrame:
    """Return a frame of half the size: depth of every second pixel, colour smoothed."""
    rgb = None
    if frame.rgb is not None:
        import cv2

        rgb = cv2.pyrDown(frame.rgb)
    return replace(frame, rgb=rgb, depth=np.ascontiguousarray(frame.depth[::2, ::2]))


def _halve_camera(camera: Camera) -> Camera:
    lens = camera.lens
    half = PinholeCamera(
        lens.fx / 2, lens.fy / 2, lens.cx / 2, lens.cy / 2, lens.distortion, lens.depth_scale,
        (lens.width + 1) // 2, (lens.height + 1) // 2,
    )  # fmt: skip
    return replace(camera, lens=half, T_body_camera=np.eye(4), clock_offset=0.0)


def _rehearse(frames: Sequence[RgbdFrame], camera: Camera) -> float:
    """Map frames roughly; return the mean logarithm of the misfits."""
    from seismo3d.robot.mapper import Mapper
    from seismo3d.robot.results import MapperSettings

    # their spread is to tell small differences apart: more of them than it takes to locate a frame
    settings = MapperSettings(voxel_size=0.016, landmarks_in_state=False, enough_landmarks=200)
    mapper = Mapper(camera, settings=settings)
    logs = []
    for frame in frames:
        found = mapper.add(replace(frame, camera=0))
        if found.located is not None:
            planes, marks = found.located.plane_spread, found.located.landmark_spread
            logs.append([np.log(np.clip(planes, 0.3, 20.0)), np.log(np.clip(marks, 0.3, 20.0))])
    return float(np.mean(logs, axis=0).sum()) if logs else np.inf
