"""Maps to files and back, to go on mapping another day."""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FileAccessError, FormatError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.io._files import as_readable_file, written_aside
from seismo3d.robot.camera import Camera
from seismo3d.robot.frames import MeasureSettings
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import describe_keyframe
from seismo3d.robot.landmarks import View
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.trajectory import TimedPose

if TYPE_CHECKING:
    from seismo3d.robot.mapper import Mapper

_VERSION = 1


def save_mapper(path: str | Path, mapper: Mapper) -> Path:
    """Write a mapper's state to an .npz file, without pickle.

    Raises
    ------
    FileAccessError
        If it cannot be written.
    """
    state = mapper.state
    surface, n = state.surface, state.surface.n_blocks
    header = {
        "version": _VERSION,
        "settings": asdict(mapper.settings),
        "cameras": [_camera_fields(camera) for camera in mapper.cameras],
        "frames": state.count,
    }
    arrays: dict[str, Any] = {
        "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8),
        "keys": surface.keys[:n],
        "distance": surface.distance[:n],
        "weight": surface.weight[:n],
        "colour": surface.colour[:n],
        "poses": np.array([pose.T_world_camera for pose in state.poses]).reshape(-1, 4, 4),
        "times": np.array([[p.stamp, p.time, *p.twist, p.frame, p.camera] for p in state.poses]).reshape(-1, 10),
        "key_numbers": np.array([[k.frame, k.camera, k.grey is not None] for k in state.memory.keyframes]).reshape(
            -1, 3
        ),
        "key_poses": state.key_poses,
        "kept_numbers": np.array([[k.pose, k.camera] for k in state.kept], dtype=np.int64).reshape(-1, 2),
        "view_poses": np.array([v.T_world_camera for v in state.views]).reshape(-1, 4, 4),
        "view_cameras": np.array([v.camera for v in state.views], dtype=np.int64),
    }
    arrays |= _joined("key_grey", [_png(k.grey) for k in state.memory.keyframes])
    arrays |= _joined("key_depth", [_png(k.depth) for k in state.memory.keyframes])
    arrays |= _joined("kept_depth", [k.depth for k in state.kept])
    arrays |= _joined("kept_colour", [k.colour for k in state.kept])
    arrays |= _joined("view_grey", [_png(v.grey) for v in state.views])
    arrays |= _joined("view_pixels", [v.pixels.ravel() for v in state.views])
    arrays |= _joined("view_points", [v.points.ravel() for v in state.views])
    final = Path(path)
    with written_aside(final) as aside, aside.open("wb") as file:
        np.savez_compressed(file, **arrays)
    return final


def load_mapper(path: str | Path, kind: type[Mapper]) -> Mapper:
    """Read what :func:`save_mapper` wrote.

    Raises
    ------
    FileAccessError, FormatError
        If the file cannot be read, or is not such a map.
    """
    file = as_readable_file(path)
    try:
        with file.open("rb") as opened, np.load(opened, allow_pickle=False) as held:
            arrays = {name: held[name] for name in held.files}
        header = json.loads(arrays["header"].tobytes())
        version = header["version"]
        mapper = _restored(header, arrays, kind) if version == _VERSION else None
    except OSError as error:
        raise FileAccessError(f"{file} cannot be read: {error}.") from error
    except (ValueError, KeyError, TypeError, IndexError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise FormatError(f"{file} is no map that Mapper.save wrote ({error}).") from error
    if mapper is None:
        raise FormatError(f"{file.name} is of version {version}; expected {_VERSION}. Map anew.")
    return mapper


def _restored(header: dict[str, Any], arrays: dict[str, AnyArray], kind: type[Mapper]) -> Mapper:
    fields = header["settings"]
    settings = MapperSettings(**{**fields, "measure": MeasureSettings(**fields["measure"])})
    mapper = kind([_as_camera(c) for c in header["cameras"]], settings=settings)
    state = mapper.state
    state.count = int(header["frames"])
    surface = state.surface
    surface.add_blocks(arrays["keys"])
    n = surface.n_blocks
    for name in ("distance", "weight", "colour"):
        getattr(surface, name)[:n] = arrays[name]
    for T, row in zip(arrays["poses"], arrays["times"]):
        state.poses.append(TimedPose(float(row[0]), float(row[1]), T, row[2:8], int(row[8]), int(row[9])))
    greys, depths = _split(arrays, "key_grey"), _split(arrays, "key_depth")
    for (frame, camera, has_grey), T, grey, depth in zip(arrays["key_numbers"], arrays["key_poses"], greys, depths):
        image = _image(grey) if has_grey else None
        state.memory.add(describe_keyframe(int(frame), int(camera), T, image, _image(depth)))
    for (pose, camera), depth, colour in zip(
        arrays["kept_numbers"], _split(arrays, "kept_depth"), _split(arrays, "kept_colour")
    ):
        state.kept.append(KeptFrame(int(pose), int(camera), depth, colour))
    parts = (_split(arrays, name) for name in ("view_grey", "view_pixels", "view_points"))
    for T, camera, grey, pixels, points in zip(arrays["view_poses"], arrays["view_cameras"], *parts):
        image = _image(grey) if grey.size else np.empty((0, 0), np.uint8)
        state.views.append(View(T, image, pixels.reshape(-1, 2), points.reshape(-1, 3), int(camera)))
    return mapper


def _camera_fields(camera: Camera) -> dict[str, Any]:
    fields = {name: getattr(camera, name) for name in ("clock_offset", "readout", "depth_delay", "name")}
    return {**fields, "lens": asdict(camera.lens), "T_body_camera": camera.T_body_camera.tolist()}


def _as_camera(fields: dict[str, Any]) -> Camera:
    lens = {**fields["lens"], "distortion": tuple(fields["lens"]["distortion"])}
    return Camera(**{**fields, "lens": PinholeCamera(**lens), "T_body_camera": np.array(fields["T_body_camera"])})


def _png(image: AnyArray | None) -> AnyArray:
    if image is None or image.size == 0:
        return np.empty(0, dtype=np.uint8)
    return np.asarray(cv2.imencode(".png", image)[1]).ravel()


def _image(data: AnyArray) -> AnyArray:
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))


def _joined(name: str, parts: list[AnyArray]) -> dict[str, AnyArray]:
    """Arrays of different lengths as one, with where each ends."""
    joined = np.concatenate(parts) if parts else np.empty(0, dtype=np.uint8)
    return {name: joined, f"{name}_ends": np.cumsum([len(part) for part in parts], dtype=np.int64)}


def _split(arrays: dict[str, AnyArray], name: str) -> list[AnyArray]:
    ends = arrays[f"{name}_ends"]
    return np.split(arrays[name], ends[:-1]) if len(ends) else []
