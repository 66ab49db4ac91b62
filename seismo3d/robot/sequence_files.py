"""The files of an RGB-D sequence: intrinsics, lists, images and the times in their names."""

from __future__ import annotations

import json
import math
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FileAccessError, FormatError, Seismo3dError, Seismo3dWarning
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.io._files import refuse_os_errors
from seismo3d.robot.camera import Camera, LensErrors, as_robot_camera

_SEVEN_SCENES = PinholeCamera(585.0, 585.0, 320.0, 240.0, (), 1000.0, 640, 480)


def find_camera(folder: Path, layout: str) -> Camera:
    """Return the camera that a folder describes, with the depth scale that is usual in its layout."""
    scale = 5000.0 if layout == "tum" else 1000.0
    own = folder / "camera.json"
    candidates = [own] if own.is_file() else sorted(folder.glob("*.json"))
    for path in candidates:
        fields = read_json(path)
        if not isinstance(fields, dict):
            continue
        if "intrinsic_matrix" in fields:
            m = fields["intrinsic_matrix"]
            if not isinstance(m, list) or len(m) != 9:
                raise FormatError(f"{path} has the intrinsic_matrix {m!r:.60}; expected nine numbers, by columns.")
            fields = {**fields, "fx": m[0], "fy": m[4], "cx": m[6], "cy": m[7]}
        lacking = [name for name in ("fx", "fy", "cx", "cy") if name not in fields]
        if not lacking:
            return _as_camera({"depth_scale": scale, **fields}, path)
        if path == own:
            raise FormatError(
                f"{path} has no {', '.join(lacking)}; expected fx, fy, cx and cy, in pixels. Write them into it."
            )
    if layout == "7-scenes":
        return Camera(_SEVEN_SCENES)
    raise FormatError(
        f"{folder} has no camera.json; expected one with fx, fy, cx, cy, distortion, depth_scale, width, height. "
        "Write it, or pass camera=."
    )


def _as_camera(fields: dict[str, Any], path: Path) -> Camera:
    try:
        camera = as_robot_camera(fields)
        times: dict[str, Any] = {
            name: float(fields[name]) for name in ("readout", "depth_delay", "clock_offset") if name in fields
        }
        errors = LensErrors(**fields["errors"]) if "errors" in fields else camera.errors
        return replace(camera, name=str(fields.get("name", "camera")), errors=errors, **times)
    except (TypeError, ValueError, Seismo3dError) as error:
        raise FormatError(f"{path} does not describe a camera: {error}") from error


def read_rows(path: Path, n_columns: int) -> list[list[str]]:
    """Return the words of a list of times and files, without comments and, with a warning, rows that came before."""
    with refuse_os_errors(path, "read"):
        raw = path.read_bytes()
    try:
        lines = raw.decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{path} is not text ({error}); expected a time and a file a line.") from error
    rows = [line.replace(",", " ").split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    for number, row in enumerate(rows, start=1):
        times = row[0::2]
        if len(row) != n_columns or any(_as_number(t) is None for t in times):
            raise FormatError(f"{path}, row {number}: {' '.join(row)!r}; expected {n_columns} columns, time and file.")
    once = [list(row) for row in dict.fromkeys(map(tuple, rows))]
    if len(once) < len(rows):
        warnings.warn(
            f"{path} has {len(rows) - len(once)} rows of {len(rows)} twice; they are taken once. Take them out.",
            Seismo3dWarning,
            stacklevel=4,
        )
    return once


def is_there(path: Path) -> bool:
    """Return whether a file is there; a list may name what is no name of a file, as one too long."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_cut_short(path: Path) -> bool:
    """Return whether a file is empty, or a PNG without its end: what a recording leaves that was interrupted."""
    with refuse_os_errors(path, "read"), path.open("rb") as file:
        head = file.read(8)
        if head != b"\x89PNG\r\n\x1a\n":
            return not head
        file.seek(max(0, file.seek(0, 2) - 64))
        return b"IEND" not in file.read()


def read_json(path: Path) -> Any:
    """Return what a JSON file holds."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileAccessError(f"{path} cannot be read: {error}.") from error
    except ValueError as error:
        raise FormatError(f"{path} is no JSON: {error}. Correct it.") from error


def read_image(path: Path) -> AnyArray:
    """Return an image as it is stored."""
    import cv2

    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise FileAccessError(f"{path} cannot be read: {error}.") from error
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if image is None:
        raise FormatError(
            f"{path} is no image that can be read; it may be cut short. Get it again, or take it out of the sequence."
        )
    return np.asarray(image)


def as_rgb(image: AnyArray) -> AnyArray:
    """Return an image as OpenCV reads it as red, green and blue of 8 bits."""
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.ndim == 2:
        return np.ascontiguousarray(np.repeat(image[:, :, None], 3, axis=2))
    return np.ascontiguousarray(image[:, :, 2::-1])


def as_stamp(path: Path) -> float | None:
    """Return the time that a file is named by; None where its name is no decimal number."""
    return _as_number(path.stem) if "." in path.stem else None


def _as_number(text: str) -> float | None:
    """Return the finite number that a text is; None where it is none, as no time is infinite or NaN."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def natural(name: str) -> list[Any]:
    """Return what sorts names by the numbers in them."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name)]


def last_number(path: Path) -> int | None:
    """Return the last number in a file's name; None where it has none."""
    numbers = re.findall(r"\d+", path.stem)
    return int(numbers[-1]) if numbers else None
