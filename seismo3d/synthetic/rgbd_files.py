"""RGB-D sequences on disk, in the layout of the TUM RGB-D benchmark."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import Progress
from seismo3d.errors import ParameterError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import quaternion_from_rotation
from seismo3d.io._files import written_aside

if TYPE_CHECKING:
    from seismo3d.synthetic.rgbd import RgbdFrame, RgbdSequence

PNG_DEPTH_SCALE = 5000.0
_HEADS: dict[str, list[str]] = {
    "rgb": ["# timestamp filename"],
    "depth": ["# timestamp filename"],
    "associations": [],
    "groundtruth": ["# timestamp tx ty tz qx qy qz qw"],
}


def write_frames(
    folder: Path, frames: RgbdSequence, camera: PinholeCamera, *, progress: Progress | None = None
) -> None:
    """Write frames to a folder that appears when all is written, or not at all.

    Parameters
    ----------
    folder : Path
        To be made, or replaced.
    frames : RgbdSequence
    camera : PinholeCamera
    progress : callable, optional

    Raises
    ------
    FileAccessError
        If it cannot be written.
    """
    report = as_progress(progress)
    with written_aside(folder, folder=True) as aside:
        (aside / "rgb").mkdir(parents=True)
        (aside / "depth").mkdir()
        lines: dict[str, list[str]] = {name: [] for name in _HEADS}
        for number, frame in enumerate(frames):
            _write_frame(aside, frame, lines)
            report("frames", (number + 1) / len(frames))
        for name, held in lines.items():
            (aside / f"{name}.txt").write_text("\n".join([*_HEADS[name], *held]) + "\n")
        words = asdict(replace(camera, depth_scale=PNG_DEPTH_SCALE))
        (aside / "camera.json").write_text(json.dumps(words, indent=1) + "\n")


def _write_frame(folder: Path, frame: RgbdFrame, lines: dict[str, list[str]]) -> None:
    import cv2

    stamp = f"{frame.stamp:.6f}"
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    depth = np.nan_to_num(frame.depth) * PNG_DEPTH_SCALE + 0.5
    depth[depth >= 65536.0] = 0.0  # farther than 16 bits can say
    images = {"rgb": frame.colour[:, :, ::-1], "depth": depth.astype(np.uint16)}
    for name, image in images.items():
        done, data = cv2.imencode(".png", image, fast)
        if not done:
            raise ParameterError(f"{name} of frame {stamp} has shape {image.shape}: PNG cannot hold it.")
        (folder / name / f"{stamp}.png").write_bytes(data.tobytes())
        lines[name].append(f"{stamp} {name}/{stamp}.png")
    lines["associations"].append(f"{stamp} rgb/{stamp}.png {stamp} depth/{stamp}.png")
    t, (w, x, y, z) = frame.T_world_camera[:3, 3], quaternion_from_rotation(frame.T_world_camera[:3, :3])
    lines["groundtruth"].append(" ".join([stamp, *(f"{value:.9f}" for value in (*t, x, y, z, w))]))
