"""Maps to files and back, to go on mapping another day."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FormatError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.io._files import as_path, as_readable_file, written_aside
from seismo3d.io.numpy_files import read_npz, refuse_damage
from seismo3d.robot.camera import Camera, LensErrors
from seismo3d.robot.closures import Closure
from seismo3d.robot.frames import MeasureSettings
from seismo3d.robot.kept import KeptFrame
from seismo3d.robot.keyframes import describe_keyframe
from seismo3d.robot.landmarks import View
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.results import MapperSettings
from seismo3d.robot.state import MapState
from seismo3d.robot.trajectory import TimedPose

if TYPE_CHECKING:
    from seismo3d.robot.mapper import Mapper

_VERSION = 6


def save_mapper(path: str | Path, mapper: Mapper) -> Path:
    """Write a mapper's state to an .npz file, without pickle.

    Raises
    ------
    FileAccessError
        If it cannot be written.
    """
    maps = mapper.maps.every
    header = {
        "version": _VERSION,
        "settings": asdict(mapper.settings),
        "cameras": [_camera_fields(camera) for camera in mapper.cameras],
        "frames": mapper.n_frames,
        "maps": [{"number": state.number, "part": state.part} for state in maps],
        "current": next(k for k, state in enumerate(maps) if state is mapper.state),
    }
    arrays: dict[str, Any] = {"header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)}
    for place, state in enumerate(maps):
        arrays |= {f"map{place}_{name}": array for name, array in _packed(state).items()}
    final = as_path(path)
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
    arrays = read_npz(file)
    with refuse_damage(file, "map that Mapper.save wrote"):
        header = json.loads(arrays["header"].tobytes())
        if header["version"] != _VERSION:
            raise FormatError(f"{file.name} is of version {header['version']}; expected {_VERSION}. Map anew.")
        return _restored(header, arrays, kind)


def _packed(state: MapState) -> dict[str, Any]:
    """Arrays of a local map, by name."""
    surface, n = state.surface, state.surface.n_blocks
    keys = state.memory.keyframes
    arrays: dict[str, Any] = {
        "keys": surface.keys[:n],
        "distance": surface.distance[:n],
        "root": surface.root[:n],
        "colour": surface.colour[:n, :, :3],
        "times_shown": surface.times_shown[:n],
        "poses": np.array([pose.T_world_camera for pose in state.poses]).reshape(-1, 4, 4),
        "times": np.array([[p.stamp, p.time, *p.twist, p.frame, p.camera, p.part] for p in state.poses]).reshape(
            -1, 11
        ),
        "key_numbers": np.array([[k.frame, k.camera, k.grey is not None, k.part] for k in keys]).reshape(-1, 4),
        "key_poses": state.key_poses,
        "kept_numbers": np.array([[k.pose, k.camera, *k.shape] for k in state.kept], dtype=np.int64).reshape(-1, 4),
        "view_poses": np.array([v.T_world_camera for v in state.views]).reshape(-1, 4, 4),
        "view_cameras": np.array([v.camera for v in state.views], dtype=np.int64),
        "view_covariances": np.array([v.errors.covariance for v in state.views]).reshape(-1, 6, 6),
        "view_alike": np.array([v.errors.alike for v in state.views]).reshape(-1, 6, 6),
        "view_by_lens": np.array([v.errors.by_lens for v in state.views]).reshape(-1, 6, 4),
    }
    arrays |= _joined("key_grey", [_png(k.grey) for k in keys])
    arrays |= _joined("key_depth", [_png(k.depth) for k in keys])
    arrays |= _joined("kept_depth", [k.depth for k in state.kept])
    arrays |= _joined("kept_colour", [k.colour for k in state.kept])
    arrays |= _joined("view_grey", [_png(v.grey) for v in state.views])
    arrays |= _joined("view_pixels", [v.pixels.ravel() for v in state.views])
    arrays |= _joined("view_points", [v.points.ravel() for v in state.views])
    for name, links in (("joints", state.joints), ("closures", state.closures)):
        arrays[f"{name}_ends"] = np.array([[c.target, c.source] for c in links], dtype=np.int64).reshape(-1, 2)
        arrays[f"{name}_poses"] = np.array([c.T_target_source for c in links]).reshape(-1, 4, 4)
        arrays[f"{name}_information"] = np.array([c.information for c in links]).reshape(-1, 6, 6)
    return arrays


def _restored(header: dict[str, Any], arrays: dict[str, AnyArray], kind: type[Mapper]) -> Mapper:
    fields = header["settings"]
    settings = MapperSettings(**{**fields, "measure": MeasureSettings(**fields["measure"])})
    mapper = kind([_as_camera(c) for c in header["cameras"]], settings=settings)
    states = []
    for place, numbers in enumerate(header["maps"]):
        prefix = f"map{place}_"
        own = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
        state = mapper.maps.empty(int(numbers["number"]))
        state.part = int(numbers["part"])
        _check(own, len(mapper.cameras))
        _fill(state, own)
        states.append(state)
    mapper.n_frames = int(header["frames"])
    n_made = 1 + max(max(state.number, state.part) for state in states)
    mapper.maps.restore(states, int(header["current"]), n_made)
    return mapper


def _check(arrays: dict[str, AnyArray], n_cameras: int) -> None:
    """Refuse arrays of a local map that do not fit each other, by a ValueError that says which."""
    n, n_poses, n_keys, n_kept = (len(arrays[name]) for name in ("keys", "poses", "key_numbers", "kept_numbers"))
    shapes: dict[str, tuple[int, ...]] = {
        "keys": (n,), "distance": (n, 512), "root": (n, 512), "colour": (n, 512, 3), "times_shown": (n,),
        "poses": (n_poses, 4, 4), "times": (n_poses, 11), "key_numbers": (n_keys, 4), "key_poses": (n_keys, 4, 4),
        "kept_numbers": (n_kept, 4), "view_poses": (n_keys, 4, 4), "view_cameras": (n_keys,),
        "view_covariances": (n_keys, 6, 6), "view_alike": (n_keys, 6, 6), "view_by_lens": (n_keys, 6, 4),
    }  # fmt: skip
    counts = {"key_grey": n_keys, "key_depth": n_keys, "kept_depth": n_kept, "kept_colour": n_kept}
    counts |= {f"view_{name}": n_keys for name in ("grey", "pixels", "points")}
    shapes |= {f"{name}_ends": (count,) for name, count in counts.items()}
    shapes |= {name: (len(arrays[name]),) for name in counts}
    for name in ("joints", "closures"):
        n_links = len(arrays[f"{name}_ends"])
        shapes |= {f"{name}_ends": (n_links, 2), f"{name}_poses": (n_links, 4, 4)}
        shapes[f"{name}_information"] = (n_links, 6, 6)
    wrong = [name for name, shape in shapes.items() if arrays[name].shape != shape]
    wrong += [name for name in counts if not _is_split(arrays[f"{name}_ends"], len(arrays[name]))]
    finite = ("poses", "key_poses", "view_poses", "view_covariances", "view_alike", "view_by_lens")
    wrong += [name for name in finite if not np.isfinite(arrays[name]).all()]
    cameras = arrays["times"][:, 9], arrays["key_numbers"][:, 1], arrays["kept_numbers"][:, 1], arrays["view_cameras"]
    wrong += ["cameras"] * any(not np.isin(held, np.arange(n_cameras)).all() for held in cameras)
    wrong += ["kept_numbers"] * (not np.isin(arrays["kept_numbers"][:, 0], np.arange(n_poses)).all())
    wrong += ["links"] * any(
        not np.isin(arrays[f"{name}_ends"], np.arange(n_keys)).all() for name in ("joints", "closures")
    )
    if wrong:
        raise ValueError(f"{', '.join(wrong)} do not fit the rest")


def _is_split(ends: AnyArray, size: int) -> bool:
    """Whether ends cut an array of a size into parts."""
    return bool(ends[-1] == size and ends[0] >= 0 and (np.diff(ends) >= 0).all()) if len(ends) else size == 0


def _fill(state: MapState, arrays: dict[str, AnyArray]) -> None:
    """Put what :func:`_packed` gave into an empty local map."""
    surface = state.surface
    surface.add_blocks(arrays["keys"])
    n = surface.n_blocks
    surface.distance[:n], surface.root[:n] = arrays["distance"], arrays["root"]
    surface.colour[:n, :, :3] = arrays["colour"]
    surface.times_shown[:n] = arrays["times_shown"]
    for T, row in zip(arrays["poses"], arrays["times"]):
        numbers = (int(v) for v in row[8:11])
        state.poses.append(TimedPose(float(row[0]), float(row[1]), T, row[2:8], *numbers))
    greys, depths = _split(arrays, "key_grey"), _split(arrays, "key_depth")
    for row, T, grey, depth in zip(arrays["key_numbers"], arrays["key_poses"], greys, depths):
        frame, camera, has_grey, part = (int(v) for v in row)
        image = _image(grey) if has_grey else None
        state.memory.add(describe_keyframe(frame, camera, T, image, _image(depth), part=part))
    for (pose, camera, rows, columns), depth, colour in zip(
        arrays["kept_numbers"], _split(arrays, "kept_depth"), _split(arrays, "kept_colour")
    ):
        state.packing.append(KeptFrame(int(pose), int(camera), (int(rows), int(columns)), depth, colour))
    parts = (_split(arrays, name) for name in ("view_grey", "view_pixels", "view_points"))
    held = (arrays[f"view_{name}"] for name in ("poses", "cameras", "covariances", "alike", "by_lens"))
    for T, camera, covariance, alike, by_lens, grey, pixels, points in zip(*held, *parts):
        image = _image(grey) if grey.size else np.empty((0, 0), np.uint8)
        places = pixels.reshape(-1, 2), points.reshape(-1, 3)
        state.views.append(View(T, image, *places, int(camera), PoseErrors(covariance, alike, by_lens)))
    for name, links in (("joints", state.joints), ("closures", state.closures)):
        ends = (arrays[f"{name}_{part}"] for part in ("ends", "poses", "information"))
        links += [Closure(int(i), int(j), T, W) for (i, j), T, W in zip(*ends)]


def _camera_fields(camera: Camera) -> dict[str, Any]:
    fields = {name: getattr(camera, name) for name in ("clock_offset", "readout", "depth_delay", "name")}
    parts = {"lens": asdict(camera.lens), "errors": asdict(camera.errors)}
    return {**fields, **parts, "T_body_camera": camera.T_body_camera.tolist()}


def _as_camera(fields: dict[str, Any]) -> Camera:
    lens = {**fields["lens"], "distortion": tuple(fields["lens"]["distortion"])}
    parts = {"lens": PinholeCamera(**lens), "errors": LensErrors(**fields["errors"])}
    return Camera(**{**fields, **parts, "T_body_camera": np.array(fields["T_body_camera"])})


def _png(image: AnyArray | None) -> AnyArray:
    if image is None or image.size == 0:
        return np.empty(0, dtype=np.uint8)
    return np.asarray(cv2.imencode(".png", image)[1]).ravel()


def _image(data: AnyArray) -> AnyArray:
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if image is None:
        raise ValueError("an image cannot be unpacked")
    return np.asarray(image)


def _joined(name: str, parts: list[AnyArray]) -> dict[str, AnyArray]:
    """Arrays of different lengths as one, with where each ends."""
    joined = np.concatenate(parts) if parts else np.empty(0, dtype=np.uint8)
    return {name: joined, f"{name}_ends": np.cumsum([len(part) for part in parts], dtype=np.int64)}


def _split(arrays: dict[str, AnyArray], name: str) -> list[AnyArray]:
    ends = arrays[f"{name}_ends"]
    return np.split(arrays[name], ends[:-1]) if len(ends) else []
