"""Read RGB-D sequences: folders as TUM, 7-Scenes and Open3D lay them out, or colour and depth side by side.

Layouts, by what a folder holds:

- ``associations.txt`` (``time colour time depth``), or ``rgb.txt`` and ``depth.txt`` (``time file``), which are then
  paired by time: TUM. Files are named relative to the folder; times are in seconds.
- ``frame-000000.color.png`` and ``frame-000000.depth.png``: 7-Scenes, 30 frames a second.
- ``color`` (or ``rgb``, ``colour``, ``image``) and ``depth``: paired by time where all names are decimal numbers of
  seconds, else by the number that each name ends in, or by the whole name, 30 frames a second: Open3D and others.
- ``rig.json``: several cameras, ``{"cameras": [{"folder": ..., "T_body_camera": 4 x 4, "clock_offset": seconds}]}``,
  each folder in one of the layouts above.

Intrinsics are in ``camera.json`` (fx, fy, cx, cy, distortion, depth_scale, width, height; perhaps readout,
depth_delay, and in ``errors`` how far scale, focal and centre may be off), or in a JSON file with Open3D's
``intrinsic_matrix``. 7-Scenes has none: 585, 585, 320, 240 of its authors hold. Depth is in ``depth_scale`` values a
metre: 5000 in TUM, else 1000, unless the file says so.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_number
from seismo3d.errors import FileAccessError, FormatError, Seismo3dError, Seismo3dWarning
from seismo3d.io._files import as_path, refuse_os_errors
from seismo3d.robot.camera import Camera, RgbdFrame, as_robot_camera
from seismo3d.robot.sequence_files import (
    as_rgb,
    as_stamp,
    find_camera,
    is_cut_short,
    is_there,
    last_number,
    natural,
    read_image,
    read_json,
    read_rows,
)

_RATE = 1.0 / 30.0
_LEAST_SPACING, _MOST_SPACING = 1e-3, 5.0
"""Seconds between frames, in the median, that a camera can have."""
_COLOUR_FOLDERS = ("rgb", "color", "colour", "image")
_IMAGES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".tif", ".tiff", ".bmp")


@dataclass(frozen=True, slots=True)
class _Entry:
    time: float
    rgb: Path
    depth_time: float
    depth: Path
    camera: int = 0


class RgbdSequence(Sequence[RgbdFrame]):
    """Frames in the order of time; each is read when it is asked for.

    Attributes
    ----------
    cameras : tuple of Camera
    path : Path
        The folder.
    """

    def __init__(self, path: Path, cameras: tuple[Camera, ...], entries: list[_Entry]) -> None:
        self.path = path
        self.cameras = cameras
        self._entries = entries

    @property
    def camera(self) -> Camera | tuple[Camera, ...]:
        """The camera, or all of them where there are several: what ``Mapper`` takes."""
        return self.cameras[0] if len(self.cameras) == 1 else self.cameras

    @property
    def times(self) -> Float64Array:
        """Stamps of colour, in each camera's own clock, seconds."""
        return np.array([entry.time for entry in self._entries])

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[RgbdFrame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return RgbdSequence(self.path, self.cameras, self._entries[index])
        entry = self._entries[index]
        depth = read_image(entry.depth)
        if depth.ndim != 2:
            raise FormatError(f"{entry.depth} has shape {depth.shape}; expected a depth image of one channel.")
        depth = np.where(depth == 65535, 0, depth) if depth.dtype == np.uint16 else depth
        return RgbdFrame(entry.time, entry.depth_time, as_rgb(read_image(entry.rgb)), depth, entry.camera)


def read_sequence(path: str | Path, *, camera: object = None, max_difference: float = 0.02) -> RgbdSequence:
    """Open a folder of colour and depth images.

    Parameters
    ----------
    path : str or Path
        In one of the layouts that are listed in :mod:`seismo3d.robot.sequence`.
    camera : Camera, PinholeCamera, dict, or object with its fields, optional
        In place of the intrinsics in the folder. Not for several cameras.
    max_difference : float
        Stamps of colour and depth that are farther apart are no pair, seconds; of an ``associations.txt`` too.

    Returns
    -------
    RgbdSequence
        Iterable; with ``.camera``.

    Raises
    ------
    FileAccessError
        If the folder or a file in it cannot be read.
    FormatError
        If it is in none of the layouts, has no intrinsics, no colour and depth belong together, or its stamps are in
        another unit than seconds.

    Warns
    -----
    Seismo3dWarning
        If a list has rows twice, or pairs that are too far apart in time.
    """
    folder = as_path(path)
    as_number(max_difference, "max_difference", low=0.0)
    with refuse_os_errors(folder, "read"):
        if not folder.is_dir():
            raise FileAccessError(f"{folder} is not a folder; expected one with a sequence of colour and depth images.")
        if (folder / "rig.json").is_file() and camera is None:
            return _read_rig(folder, max_difference)
        entries, layout = _find_entries(folder, max_difference)
    made = find_camera(folder, layout) if camera is None else as_robot_camera(camera)
    return RgbdSequence(folder, (made,), entries)


def associate(target: Float64Array, source: Float64Array, *, max_difference: float = 0.02) -> AnyArray:
    """Pair stamps, nearest first, each used once.

    Parameters
    ----------
    target, source : ndarray of shape (n,) and (m,), float64
        Seconds.
    max_difference : float
        Farther ones are no pair.

    Returns
    -------
    ndarray of shape (k, 2), int64
        Rows of both, in the order of ``target``.

    Examples
    --------
    >>> import numpy as np
    >>> associate(np.array([0.0, 0.1, 0.2]), np.array([0.09, 0.205])).tolist()
    [[1, 0], [2, 1]]
    """
    order = np.argsort(source, kind="stable")
    sorted_source = source[order]
    first = np.searchsorted(sorted_source, target - max_difference)
    last = np.searchsorted(sorted_source, target + max_difference, side="right")
    pairs = [(abs(target[i] - sorted_source[j]), i, j) for i in range(len(target)) for j in range(first[i], last[i])]
    used_target, used_source, out = set(), set(), []
    for _, i, j in sorted(pairs):
        if i not in used_target and j not in used_source:
            used_target.add(i)
            used_source.add(j)
            out.append((i, int(order[j])))
    return np.array(sorted(out), dtype=np.int64).reshape(-1, 2)


def _find_entries(folder: Path, max_difference: float) -> tuple[list[_Entry], str]:
    if (folder / "associations.txt").is_file():
        rows = read_rows(folder / "associations.txt", 4)
        entries = [_Entry(float(a), folder / b, float(c), folder / d) for a, b, c, d in rows]
        return _sorted(_near(entries, folder, max_difference), folder), "tum"
    if (folder / "rgb.txt").is_file() and (folder / "depth.txt").is_file():
        colour, depth = (
            [(float(t), folder / name) for t, name in read_rows(folder / file, 2)] for file in ("rgb.txt", "depth.txt")
        )
        return _by_time(colour, depth, folder, max_difference), "tum"
    seven = sorted(folder.glob("frame-*.color.*"))
    if seven:
        depth_of = {p.name.split(".")[0]: p for p in folder.glob("frame-*.depth.*")}
        numbers = [(int(re.sub(r"\D", "", p.name.split(".")[0])), p) for p in seven]
        found = [(n * _RATE, p, depth_of.get(p.name.split(".")[0])) for n, p in numbers]
        return _sorted([_Entry(t, p, t, d) for t, p, d in found if d is not None], folder), "7-scenes"
    colour_folder = next((folder / name for name in _COLOUR_FOLDERS if (folder / name).is_dir()), None)
    if colour_folder is None or not (folder / "depth").is_dir():
        raise FormatError(
            f"{folder} holds no sequence; expected associations.txt, rgb.txt and depth.txt, frame-*.color.png, or the "
            "folders color and depth."
        )
    return _side_by_side(colour_folder, folder / "depth", folder, max_difference), "folders"


def _side_by_side(colour: Path, depth: Path, folder: Path, max_difference: float) -> list[_Entry]:
    listed = [[p for p in sorted(f.iterdir()) if p.suffix.lower() in _IMAGES] for f in (colour, depth)]
    stamps = [[as_stamp(p) for p in images] for images in listed]
    if all(t is not None for row in stamps for t in row) and all(stamps):
        timed = [[(float(t or 0.0), p) for t, p in zip(row, images)] for row, images in zip(stamps, listed)]
        return _by_time(sorted(timed[0]), sorted(timed[1]), folder, max_difference)
    return _sorted(_by_name(listed[0], listed[1], folder), folder)


def _by_name(colour: list[Path], depth: list[Path], folder: Path) -> list[_Entry]:
    """Pair images of one number, or of one name where some have no number; those without a partner keep their time."""
    have_numbers = all(last_number(path) is not None for path in [*colour, *depth])
    colour_of, depth_of = (
        {last_number(path) if have_numbers else path.stem: path for path in images} for images in (colour, depth)
    )
    if len(colour_of) < len(colour) or len(depth_of) < len(depth):
        raise FormatError(
            f"{folder} holds images whose names end in the same number; expected one of each in a folder. Rename them, "
            "or write an associations.txt."
        )
    together = colour_of.keys() & depth_of.keys()
    n_most = max(len(colour), len(depth))
    if n_most and len(together) < (1 if have_numbers else n_most):
        raise FormatError(
            f"{folder} holds {len(colour)} colour and {len(depth)} depth images without stamps, {len(together)} of "
            "them of one name; expected names that end in the frame's number, or the same names in both folders. "
            "Rename them, or write an associations.txt."
        )
    order = sorted(colour_of.keys() | depth_of.keys(), key=lambda name: natural(str(name)))
    times = {name: i * _RATE for i, name in enumerate(order)}
    return [_Entry(times[name], colour_of[name], times[name], depth_of[name]) for name in together]


def _by_time(
    colour: list[tuple[float, Path]], depth: list[tuple[float, Path]], folder: Path, max_difference: float
) -> list[_Entry]:
    stamps = [np.array([t for t, _ in images]) for images in (colour, depth)]
    for times in stamps:
        _check_spacing(times, folder)
    entries = [_Entry(*colour[i], *depth[j]) for i, j in associate(*stamps, max_difference=max_difference)]
    if not entries and colour and depth:
        raise _no_pairs(len(colour), len(depth), folder, max_difference)
    return _sorted(entries, folder)


def _near(entries: list[_Entry], folder: Path, max_difference: float) -> list[_Entry]:
    """Return the listed pairs whose stamps are close to each other; warn of the others."""
    _check_spacing(np.array([entry.time for entry in entries]), folder)
    near = [entry for entry in entries if abs(entry.time - entry.depth_time) <= max_difference]
    if entries and not near:
        raise _no_pairs(len(entries), len(entries), folder, max_difference)
    if len(near) < len(entries):
        warnings.warn(
            f"{folder / 'associations.txt'} has {len(entries) - len(near)} pairs of {len(entries)} more than "
            f"{max_difference:g} s apart; they are left out. Raise max_difference to take them.",
            Seismo3dWarning,
            stacklevel=4,
        )
    return near


def _no_pairs(n_colour: int, n_depth: int, folder: Path, max_difference: float) -> FormatError:
    return FormatError(
        f"{folder} holds {n_colour} colour and {n_depth} depth images, none within {max_difference:g} s "
        "of each other; expected synchronised stamps in seconds. Raise max_difference, or correct the stamps."
    )


def _check_spacing(times: Float64Array, folder: Path) -> None:
    """Refuse stamps that are in another unit than seconds, or the same on all frames, as their spacing tells."""
    if len(times) < 2:
        return
    spacing = float(np.median(np.diff(np.sort(times))))
    if not _LEAST_SPACING <= spacing <= _MOST_SPACING:
        is_long = spacing > _MOST_SPACING
        remedy = "Convert them: milliseconds by 1e-3, nanoseconds by 1e-9" if is_long else "Give each frame its own"
        raise FormatError(
            f"{folder} has stamps {spacing:.3g} apart in the median; expected seconds, {_LEAST_SPACING:g} to "
            f"{_MOST_SPACING:g} apart. {remedy}."
        )


def _sorted(entries: list[_Entry], folder: Path) -> list[_Entry]:
    if not entries:
        raise FormatError(f"{folder} holds no pair of a colour and a depth image. Check the lists' times and files.")
    missing = next((p for e in entries for p in (e.rgb, e.depth) if not is_there(p)), None)
    if missing is not None:
        raise FileAccessError(f"{missing} is listed but not there; expected an image. Check the sequence's lists.")
    cut = next((p for e in entries for p in (e.rgb, e.depth) if is_cut_short(p)), None)
    if cut is not None:
        raise FormatError(f"{cut} is cut short. Get it again, or take it out of the sequence.")
    return sorted(entries, key=lambda e: e.time)


def _read_rig(folder: Path, max_difference: float) -> RgbdSequence:
    described = read_json(folder / "rig.json")
    rows = described.get("cameras") if isinstance(described, dict) else None
    if not rows or not all(isinstance(row, dict) and "folder" in row for row in rows):
        raise FormatError(f"{folder / 'rig.json'} lists no cameras; expected cameras, each with a folder.")
    cameras, entries = [], []
    for number, row in enumerate(rows):
        part = read_sequence(folder / str(row["folder"]), max_difference=max_difference)
        camera = _placed(part.cameras[0], row, folder / "rig.json")
        cameras.append(camera)
        entries += [(e.depth_time + camera.clock_offset, replace(e, camera=number)) for e in part._entries]  # noqa: SLF001
    entries.sort(key=lambda pair: pair[0])
    return RgbdSequence(folder, tuple(cameras), [entry for _, entry in entries])


def _placed(camera: Camera, row: dict[str, Any], path: Path) -> Camera:
    """Return a camera with the place, clock and name that a rig gives it."""
    name = str(row.get("name", row["folder"]))
    try:
        place = row.get("T_body_camera", np.eye(4))
        offset = as_number(row.get("clock_offset", 0.0), "clock_offset")
        return replace(camera, T_body_camera=place, clock_offset=offset, name=name)
    except (TypeError, ValueError, Seismo3dError) as error:
        raise FormatError(f"{path} does not describe camera {name!r}: {error}") from error
