"""Fusion on pairs of real RGB-D frames at growing distance: features, planes, both in turn, both at once."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.experiments.image_matches import match_keypoints
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import make_transform, nearest_rotation, rotation_angle, rotation_from_quaternion
from seismo3d.registration.register import register
from seismo3d.registration.result import Registration
from seismo3d.registration.settings import LoopSettings
from seismo3d.scan import Scan

GAPS = (5, 9, 15, 20, 30, 45, 60)
METHODS = ("planes", "features", "in turn", "alpha 0.5", "fused")
ANGLE_LIMIT_DEG = 5.0
SHIFT_LIMIT = 0.10
"""Metres. The truth of hand-held frames is no better than some degrees: the shutter rolls."""


@dataclass(frozen=True, slots=True)
class FusionFigures:
    """Share of right answers by method at one gap, and the median errors of the right ones."""

    gap: int
    n_pairs: int
    success: dict[str, float]
    angle_deg: dict[str, float]
    shift_mm: dict[str, float]


class Sequence:
    """Frames of a sequence in the TUM layout, with the true poses at their times."""

    def __init__(self, folder: Path) -> None:
        camera = json.loads((folder / "camera.json").read_text())
        self.camera = PinholeCamera(
            camera["fx"],
            camera["fy"],
            camera["cx"],
            camera["cy"],
            tuple(camera.get("distortion", ())),
            camera["depth_scale"],
        )
        self._folder = folder
        rows = [line.split() for line in (folder / "associations.txt").read_text().splitlines() if line[:1] != "#"]
        self.times = np.array([0.5 * (float(row[0]) + float(row[2])) for row in rows])
        self._files = [(row[1], row[3]) for row in rows]
        self._truth = np.loadtxt(folder / "groundtruth.txt")
        self._scans: dict[int, tuple[np.ndarray, Scan]] = {}

    def __len__(self) -> int:
        return len(self._files)

    def frame(self, index: int) -> tuple[np.ndarray, Scan]:
        """Return the grey image and the scan of a frame."""
        if index not in self._scans:
            import cv2 as cv2_module

            cv2: Any = cv2_module

            colour, depth = self._files[index]
            grey = cv2.imread(str(self._folder / colour), cv2.IMREAD_GRAYSCALE)
            values = cv2.imread(str(self._folder / depth), cv2.IMREAD_UNCHANGED)
            if len(self._scans) > 80:
                self._scans.clear()
            self._scans[index] = (grey, Scan.from_rgbd(grey, values, self.camera, max_depth=4.0))
        return self._scans[index]

    def pose(self, index: int) -> Float64Array:
        """Return ``T_world_camera`` half-way between a frame's colour and depth stamps, interpolated in the truth."""
        stamps = self._truth[:, 0]
        after = int(np.clip(np.searchsorted(stamps, self.times[index]), 1, len(stamps) - 1))
        share = np.clip((self.times[index] - stamps[after - 1]) / (stamps[after] - stamps[after - 1]), 0.0, 1.0)
        first, second = self._truth[after - 1], self._truth[after]
        q, r = first[[7, 4, 5, 6]], second[[7, 4, 5, 6]]
        between = (1.0 - share) * q + share * (r if q @ r >= 0.0 else -r)
        return make_transform(rotation_from_quaternion(between), (1.0 - share) * first[1:4] + share * second[1:4])


def align(method: str, target: Scan, source: Scan, matches: object) -> Registration:
    """Align two frames by one method, from the identity."""
    stages = ("local", "global")
    if method == "planes":
        return register(target, source, stages=("local",))
    if method == "features":
        return register_features(target, source, matches)
    if method == "in turn":
        first = register_features(target, source, matches)
        quick = LoopSettings(wide_search=False)
        return register(target, source, start=first.T_target_source, stages=("local",), settings=quick)
    if method == "alpha 0.5":
        return register(target, source, matches=matches, alpha=0.5, stages=("local",))
    return register(target, source, matches=matches, stages=stages)


def register_features(target: Scan, source: Scan, matches: object) -> Registration:
    """Align two frames by their features alone."""
    from seismo3d.registration.align import align_pairs
    from seismo3d.registration.feature_pairs import as_pairs, feature_term
    from seismo3d.registration.initial import poses_by_features
    from seismo3d.registration.quadratic import Frame

    frame = Frame.of(target.points, source.points)
    term = feature_term(matches, target, source, frame, 0.01)
    as_pairs(matches)
    if term is None or len(term.source) < 3:
        return align_pairs(target.points[:3], target.points[:3])
    as_they_stand = np.eye(3), (frame.source_center - frame.target_center) / frame.size
    A, t = next(poses_by_features(term, n_poses=1, reach=0.05 / frame.size), as_they_stand)
    close = np.linalg.norm(term.source @ A.T + t - term.target, axis=1) < 0.05 / frame.size
    if close.sum() < 3:
        close[:] = True
    weights = 1.0 / np.linalg.inv(term.information[close]).trace(axis1=1, axis2=2)
    q = term.target[close] * frame.size + frame.target_center
    p = term.source[close] * frame.size + frame.source_center
    return align_pairs(q, p, weights=weights)


def run_gap(sequence: Sequence, gap: int, *, n_pairs: int, methods: tuple[str, ...] = METHODS) -> FusionFigures:
    """Align pairs of frames that lie a number of frames apart."""
    starts = np.unique(np.linspace(0, len(sequence) - 1 - gap, n_pairs).astype(int))
    right: dict[str, list[bool]] = {m: [] for m in methods}
    angles: dict[str, list[float]] = {m: [] for m in methods}
    shifts: dict[str, list[float]] = {m: [] for m in methods}
    for i in starts:
        (image_q, target), (image_p, source) = sequence.frame(i), sequence.frame(i + gap)
        truth = np.linalg.inv(sequence.pose(i)) @ sequence.pose(i + gap)
        matches = match_keypoints(image_q, image_p)
        for method in methods:
            found = align(method, target, source, matches).T_target_source
            off = np.linalg.inv(truth) @ found
            angle = float(np.degrees(rotation_angle(nearest_rotation(off[:3, :3]))))
            centre = np.append(source.points.mean(axis=0), 1.0)
            shift = float(np.linalg.norm(((found - truth) @ centre)[:3]))
            good = angle < ANGLE_LIMIT_DEG and shift < SHIFT_LIMIT
            right[method].append(good)
            if good:
                angles[method].append(angle)
                shifts[method].append(1e3 * shift)
    return FusionFigures(
        gap,
        len(starts),
        {m: float(np.mean(right[m])) for m in methods},
        {m: float(np.median(angles[m])) if angles[m] else float("nan") for m in methods},
        {m: float(np.median(shifts[m])) if shifts[m] else float("nan") for m in methods},
    )


def report(folder: Path, *, n_pairs: int, gaps: tuple[int, ...] = GAPS) -> list[FusionFigures]:
    """Print and return the figures at all gaps: success, and in brackets the median errors of the right answers."""
    sequence = Sequence(folder)
    rows = []
    print("gap pairs " + "".join(f"{m:>24}" for m in METHODS))
    for gap in gaps:
        f = run_gap(sequence, gap, n_pairs=n_pairs)
        rows.append(f)
        cells = "".join(f"{f.success[m]:8.2f} ({f.angle_deg[m]:5.2f} d {f.shift_mm[m]:4.0f} mm)" for m in METHODS)
        print(f"{gap:3d} {f.n_pairs:5d} {cells}", flush=True)
    return rows
