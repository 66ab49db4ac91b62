"""Damaged files: valid ones of every format, the ways in which they are damaged, and what reading one may end in."""

from __future__ import annotations

import io
import re
import struct
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import seismo3d as s3
from seismo3d.errors import Seismo3dError
from seismo3d.graph.poses import read_g2o
from seismo3d.io.archive import read_archive
from seismo3d.io.elevation import make_elevation, read_elevation, write_elevation
from seismo3d.io.grids import read_grid
from seismo3d.io.points import read_points
from seismo3d.io.zarr_store import write_zarr

KINDS = ("flip", "set", "cut", "drop", "double", "number", "word", "swap", "grow")
_EXTREMES = (0, 1, 0x7F, 0x80, 0xFF)
_WORDS = (0, 1, -1, 2**15 - 1, -(2**15), 2**31 - 1, -(2**31), 2**20, 65535, 10**9)
_TEXTS = (b"-1", b"0", b"999999999999", b"1e308", b"nan", b"-9999999999999999999999", b"x", b"", b"1e-320", b"65536")


@dataclass(frozen=True, slots=True)
class Damage:
    """One way to damage bytes.

    Attributes
    ----------
    kind : str
        One of ``KINDS``.
    place : float
        Where, as a share of the file, 0 to 1; small ones hit headers.
    value : int
        What is put there, of what the kind knows.
    """

    kind: str
    place: float
    value: int

    def apply(self, data: bytes) -> bytes:
        """Return the damaged bytes."""
        if not data:
            return data
        at, value = min(int(self.place * len(data)), len(data) - 1), self.value
        if self.kind == "flip":
            return data[:at] + bytes([data[at] ^ (1 << value % 8)]) + data[at + 1 :]
        if self.kind == "set":
            return data[:at] + bytes([_EXTREMES[value % len(_EXTREMES)]]) + data[at + 1 :]
        if self.kind == "cut":
            return data[:at]
        if self.kind == "drop":
            return data[:at] + data[at + 1 + value % 64 :]
        if self.kind == "double":
            part = data[at : at + 1 + value % 512]
            return data[:at] + part + data[at:]
        if self.kind == "number":
            return _exchange_number(data, at, _TEXTS[value % len(_TEXTS)])
        if self.kind == "word":
            return _exchange_word(data, at, value)
        if self.kind == "swap":
            other = (at + 1 + value % max(len(data) - 1, 1)) % len(data)
            n = min(16, len(data) - max(at, other))
            mutable = bytearray(data)
            mutable[at : at + n], mutable[other : other + n] = data[other : other + n], data[at : at + n]
            return bytes(mutable)
        return data + data[:1] * (1 + value % 4096)


def _exchange_number(data: bytes, at: int, text: bytes) -> bytes:
    """Put another number in place of the first one written out at or after a place."""
    found = re.compile(rb"[-+]?\d+(\.\d+)?").search(data, at)
    return data if found is None else data[: found.start()] + text + data[found.end() :]


def _exchange_word(data: bytes, at: int, value: int) -> bytes:
    """Put an insane integer of two, four or eight bytes, of either order, at an even place."""
    number = _WORDS[value % len(_WORDS)]
    width = (2, 4, 8)[value // len(_WORDS) % 3]
    order = "<>"[value // (3 * len(_WORDS)) % 2]
    at -= at % 2
    packed = struct.pack(f"{order}q", number)
    packed = packed[:width] if order == "<" else packed[-width:]
    return data[:at] + packed + data[at + width :]


def draw_damages(rng: np.random.Generator) -> list[Damage]:
    """Draw one to four damages, half of them within the first twentieth."""
    count = int(rng.choice([1, 1, 1, 2, 4]))
    places = [float(rng.random() ** 4 if rng.random() < 0.5 else rng.random()) for _ in range(count)]
    return [Damage(str(rng.choice(KINDS)), place, int(rng.integers(2**16))) for place in places]


@dataclass(frozen=True, slots=True)
class Format:
    """A format that is fuzzed.

    Attributes
    ----------
    name : str
        What it is called.
    ending : str
        Of its file.
    make : callable
        Writes a valid one to a path (a folder, for ``is_folder``).
    read : callable
        Reads one, all of it.
    is_folder : bool
        Whether it is a folder of files, one of which is damaged.
    """

    name: str
    ending: str
    make: Callable[[Path], Any]
    read: Callable[[Path], Any]
    is_folder: bool = False


def damage_file(source: Path, target: Path, damages: list[Damage]) -> None:
    """Write a damaged copy of a file; of a folder, one file of it is damaged, which the first damage chooses."""
    if source.is_dir():
        files = sorted(path for path in source.rglob("*") if path.is_file())
        chosen = files[damages[0].value % len(files)]
        for path in files:
            copy = target / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(_apply(path.read_bytes(), damages) if path == chosen else path.read_bytes())
        return
    target.write_bytes(_apply(source.read_bytes(), damages))


def _apply(data: bytes, damages: list[Damage]) -> bytes:
    for damage in damages:
        data = damage.apply(data)
    return data


def read_damaged(form: Format, path: Path) -> str:
    """Read a file and say how that ended: "read", or the kind of the package's own error and its first words.

    Any other exception is let through: it is a defect of a reader.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            form.read(path)
        except Seismo3dError as error:
            return f"{type(error).__name__}: {template(str(error), path)}"
    return "read"


def template(message: str, path: Path) -> str:
    """Take out of a message what differs from file to file."""
    short = message.replace(str(path), "FILE").replace(path.name, "FILE")
    short = re.sub(r"'[^']*'|\"[^\"]*\"|\([^)]*\)|\[[^\]]*\]", "...", short)
    short = re.sub(r"[-+]?\d[\d.e+]*", "N", short)
    return " ".join(short.split())[:90]


def _cube(n: tuple[int, int, int] = (5, 6, 24)) -> Any:
    rng = np.random.default_rng(5)
    cube = s3.as_cube(rng.normal(size=n).astype(np.float32), interval=4.0, start=100.0)
    grid = np.meshgrid(np.arange(n[0]) * 25.0, np.arange(n[1]) * 12.5, indexing="ij")
    dims = ("inline", "crossline")
    return cube.assign_coords(inline=100 + 2 * np.arange(n[0]), cdp_x=(dims, grid[1]), cdp_y=(dims, grid[0]))


def _segy(code: int, *, shuffled: bool = False) -> Callable[[Path], Any]:
    def make(path: Path) -> None:
        cube = _cube()
        if shuffled:
            cube = cube.copy(data=np.where(np.arange(6)[None, :, None] == 2, np.nan, cube.values))
        s3.write_segy(path, cube)
        if code != 5:
            raw = bytearray(path.read_bytes())
            raw[3224:3226] = code.to_bytes(2, "big")
            path.write_bytes(raw)

    return make


def _line(path: Path) -> None:
    section = s3.as_cube(np.random.default_rng(1).normal(size=(30, 40)).astype(np.float32), interval=2.0)
    s3.write_segy(path, section)


def _read_cube(path: Path) -> Any:
    np.asarray(s3.open_cube(path, lazy=True).values)
    return np.asarray(s3.open_cube(path).values)


def _points() -> Any:
    return np.random.default_rng(2).normal(size=(40, 3))


def _ply(form: str, *, faces: bool = False) -> Callable[[Path], Any]:
    def make(path: Path) -> None:
        points = _points().astype("<f4" if form != "binary_big_endian" else ">f4")
        head = f"ply\nformat {form} 1.0\ncomment made\nelement vertex 40\n"
        head += "".join(f"property float {name}\n" for name in "xyz")
        head += "element face 2\nproperty list uchar int vertex_indices\n" if faces else ""
        if form == "ascii":
            body = "\n".join(" ".join(f"{v:.5f}" for v in row) for row in points).encode() + b"\n"
            body += b"3 0 1 2\n3 1 2 3\n" if faces else b""
        else:
            body = points.tobytes()
            body += struct.pack("<BiiiBiii", 3, 0, 1, 2, 3, 1, 2, 3) if faces else b""
        path.write_bytes((head + "end_header\n").encode() + body)

    return make


def _pcd(form: str) -> Callable[[Path], Any]:
    def make(path: Path) -> None:
        points = _points().astype("<f4")
        head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 40\nHEIGHT 1\n"
        head += f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\nDATA {form}\n"
        if form == "ascii":
            body = "\n".join(" ".join(f"{v:.5f}" for v in row) for row in points).encode() + b"\n"
        elif form == "binary":
            body = points.tobytes()
        else:
            plain = points.T.tobytes()  # runs of literals are valid LZF
            runs = [plain[k : k + 32] for k in range(0, len(plain), 32)]
            packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
            body = struct.pack("<II", len(packed), len(plain)) + packed
        path.write_bytes(head.encode() + body)

    return make


def _text(path: Path) -> None:
    lines = ["x,y,z"] * path.name.endswith(".csv")
    lines += [(", " if lines else " ").join(f"{v:.4f}" for v in row) for row in _points()]
    path.write_text("\n".join(lines) + "\n")


def _las(path: Path) -> None:
    import laspy

    made = laspy.create(point_format=3, file_version="1.2")
    made.x, made.y, made.z = _points().T
    made.write(str(path))


def _picture(path: Path) -> None:
    import cv2

    values = (np.random.default_rng(3).random((24, 32)) * 60000).astype(np.uint16)
    written = values if path.suffix in (".png", ".tiff") else (values >> 8).astype(np.uint8)
    path.write_bytes(cv2.imencode(path.suffix, written)[1].tobytes())


def _map(path: Path) -> None:
    values = np.random.default_rng(4).normal(size=(20, 30)).astype(np.float32)
    write_elevation(path, make_elevation(values, (10.0, 0.0, 5e5, 0.0, -10.0, 6e6), crs="EPSG:32633"))


def _npy(values: Any) -> Callable[[Path], Any]:
    return lambda path: np.save(path, values)


def _npz(**arrays: Any) -> Callable[[Path], Any]:
    def make(path: Path) -> None:
        stream = io.BytesIO()
        np.savez_compressed(stream, **arrays)
        path.write_bytes(stream.getvalue())

    return make


def _faultset(path: Path) -> None:
    from fake_faults import make_cube, make_faults

    path.parent.mkdir(parents=True, exist_ok=True)
    make_faults(make_cube((12, 14, 20))).save(path)


def _read_archive(path: Path) -> Any:
    return read_archive(path)


def _archive(path: Path) -> None:
    from seismo3d.io.archive import write_archive

    meta = {"format": "x", "a": (1, 2.5, None), "b": [b"raw", np.arange(3)], "c": {"d": np.float32(2)}}
    write_archive(path, {"depth": np.ones((4, 5), np.float32), "seeds": np.arange(6).reshape(2, 3)}, meta=meta)


def _graph(path: Path) -> None:
    from seismo3d.geometry.rotations import exp_rotation, make_transform
    from seismo3d.graph.poses import PoseGraph, write_g2o

    steps = [make_transform(exp_rotation([0.0, 0.1, 0.2]), [0.3, 0.0, 0.1])] * 3
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    edges = [(k, k + 1, step, np.eye(6) * 50.0, False) for k, step in enumerate(steps)]
    write_g2o(path, PoseGraph.of(poses, [*edges, (0, 3, poses[3], np.eye(6), True)]))


def _occupancy(path: Path) -> None:
    from seismo3d.robot import Occupancy

    cells = np.random.default_rng(6).integers(0, 3, (20, 24)).astype(np.uint8)
    Occupancy(cells, np.zeros((20, 24), np.float32), 0.05, (-0.5, 1.0), np.eye(4)).save(path)


def _read_occupancy(path: Path) -> Any:
    from seismo3d.robot import Occupancy

    return Occupancy.load(path)


def _kept_map(path: Path) -> None:
    from seismo3d.robot import Camera, Mapper, MapperSettings, RgbdFrame

    sequence = s3.synthetic.rgbd_sequence("room", frames=4, size=(96, 72))
    settings = MapperSettings(voxel_size=0.08, keep_every=2, n_threads=1)
    mapper = Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)
    for frame in sequence:
        mapper.add(RgbdFrame.of(frame.colour, frame.depth, frame.stamp))
    mapper.save(path)


def _read_kept_map(path: Path) -> Any:
    from seismo3d.robot import Mapper

    return Mapper.load(path).mesh()


def _frames(path: Path) -> None:
    s3.synthetic.rgbd_sequence("room", frames=3, size=(32, 24)).write(path)


def _read_frames(path: Path) -> Any:
    return list(s3.robot.read_sequence(path))


def _sticks(kind: str) -> Callable[[Path], Any]:
    from seismo3d.io.fault_sticks import FaultStick, write_charisma_sticks, write_opendtect_sticks

    def make(path: Path) -> None:
        nodes = np.column_stack([np.full(5, 3e5), np.full(5, 6e6), np.linspace(800, 1200, 5)])
        lines = np.column_stack([np.full(5, 100.0), 200.0 + np.arange(5)])
        sticks = [FaultStick("A", number, nodes + number, lines + number) for number in (1, 2, 3)]
        (write_opendtect_sticks if kind == "opendtect" else write_charisma_sticks)(path, sticks)

    return make


def _horizon(kind: str) -> Callable[[Path], Any]:
    from seismo3d.io import horizons

    def make(path: Path) -> None:
        i, j = np.meshgrid(np.arange(5.0), np.arange(6.0), indexing="ij")
        grid = horizons.HorizonGrid(3e5 + 25 * i, 6e6 + 25 * j, 900 + i * j, 100 + np.arange(5.0), 200 + np.arange(6.0))
        getattr(horizons, f"write_{kind}")(path, grid)

    return make


FORMATS = (
    Format("SEG-Y IEEE", "a.sgy", _segy(5), _read_cube),
    Format("SEG-Y IBM", "a.segy", _segy(1), _read_cube),
    Format("SEG-Y with holes", "a.sgy", _segy(5, shuffled=True), _read_cube),
    Format("SEG-Y line", "a.sgy", _line, _read_cube),
    Format("PLY ASCII", "a.ply", _ply("ascii", faces=True), read_points),
    Format("PLY little-endian", "a.ply", _ply("binary_little_endian", faces=True), read_points),
    Format("PLY big-endian", "a.ply", _ply("binary_big_endian"), read_points),
    Format("PCD ASCII", "a.pcd", _pcd("ascii"), read_points),
    Format("PCD binary", "a.pcd", _pcd("binary"), read_points),
    Format("PCD compressed", "a.pcd", _pcd("binary_compressed"), read_points),
    Format("XYZ", "a.xyz", _text, read_points),
    Format("CSV", "a.csv", _text, read_points),
    Format("LAS", "a.las", _las, read_points),
    Format("LAZ", "a.laz", _las, read_points),
    Format("NPY cube", "a.npy", _npy(np.zeros((4, 5, 6), np.float32)), _read_cube),
    Format("NPY points", "a.npy", _npy(np.ones((20, 3))), read_points),
    Format("NPZ cube", "a.npz", _npz(cube=np.ones((4, 5, 6), np.float32), extra=np.arange(3)), _read_cube),
    Format("NPZ points", "a.npz", _npz(points=np.ones((20, 3)), normals=np.ones((20, 3))), read_points),
    Format("NPZ map", "a.npz", _map, read_elevation),
    Format("NPZ grid", "a.npz", _npz(a=np.ones((9, 8))), read_grid),
    Format("PNG depth", "a.png", _picture, read_grid),
    Format("JPEG", "a.jpg", _picture, read_grid),
    Format("TIFF", "a.tiff", _picture, read_grid),
    Format("GeoTIFF", "a.tif", _map, read_elevation),
    Format("ESRI ASCII", "a.asc", _map, read_elevation),
    Format("archive", "a.npz", _archive, _read_archive),
    Format("fault set", "faults", _faultset, s3.FaultSet.load, is_folder=True),
    Format("g2o", "a.g2o", _graph, read_g2o),
    Format("occupancy", "a.npz", _occupancy, _read_occupancy),
    Format("kept map", "map.npz", _kept_map, _read_kept_map),
    Format("RGB-D sequence", "frames", _frames, _read_frames, is_folder=True),
    Format("OpendTect sticks", "a.dat", _sticks("opendtect"), s3.read_sticks),
    Format("CHARISMA sticks", "a.dat", _sticks("charisma"), s3.read_sticks),
    Format("XYZ horizon", "a.xyz", _horizon("xyz_horizon"), s3.read_horizon),
    Format("CHARISMA horizon", "a.dat", _horizon("charisma_horizon"), s3.read_horizon),
    Format("IRAP horizon", "a.irap", _horizon("irap_classic"), s3.read_horizon),
    Format("Zarr", "a.zarr", lambda path: write_zarr(path, _cube(), brick=8), _read_cube, is_folder=True),
)
