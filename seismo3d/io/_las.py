"""LAS and LAZ files of points; what a header says is checked against the size before anything is allocated for it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FormatError, MissingDependencyError

_LEAST_HEADER = 227
_VLR, _EVLR = 54, 60
# of points that are decoded at a time
_BYTES_AT_ONCE = 64 * 2**20


def read_las(path: Path) -> tuple[AnyArray, AnyArray | None]:
    """Return the points of a LAS or LAZ file, which has no normals."""
    try:
        import laspy
    except ImportError as error:
        raise MissingDependencyError(
            f"{path.name} needs laspy, which is not installed. Install it with: pip install 'seismo3d[las]'."
        ) from error
    check_las(path)
    try:
        # the decoder of several threads gives memory to whatever the table of chunks says, and ends the process
        with laspy.open(path, laz_backend=[laspy.LazBackend.Lazrs]) as file:
            n_at_once = max(1, _BYTES_AT_ONCE // file.header.point_format.size)
            parts = [np.column_stack([part.x, part.y, part.z]) for part in file.chunk_iterator(n_at_once)]
            expected = int(file.header.point_count)
    except BaseException as error:
        # the decoder of LAZ panics on what it does not understand, which is no Exception
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise FormatError(f"{path.name} is not a readable LAS or LAZ file: {error}. Get it again.") from error
    points = np.concatenate([np.zeros((0, 3)), *parts])
    if len(points) != expected:
        raise FormatError(f"{path.name} is cut short: {len(points)} points of {expected}. Get the file again.")
    return points, None


def check_las(path: Path) -> None:
    """Refuse a LAS or LAZ file whose header announces more than the file can hold.

    Raises
    ------
    FormatError
        If it does, or is no LAS file.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375)
        if len(head) < _LEAST_HEADER or head[:4] != b"LASF":
            raise FormatError(f"{path.name} is not a readable LAS or LAZ file: it has no LAS header. Get it again.")
        header_size, offset, n_records = struct.unpack_from("<HII", head, 94)
        point_format, width, n_points = struct.unpack_from("<BHI", head, 104)
        extended, n_extended = 0, 0
        if head[25] >= 4 and len(head) >= 255:
            extended, n_extended, n_points = struct.unpack_from("<QIQ", head, 235)
        is_packed = point_format >= 128
        room = offset - header_size
        if header_size < _LEAST_HEADER or offset > size or room < n_records * _VLR or width == 0:
            raise _wrong(path, f"{n_records} records before its points at byte {offset} of {size}")
        if not is_packed and offset + n_points * width > size:
            raise _wrong(path, f"{n_points} points of {width} bytes in {size - offset} bytes")
        if is_packed:
            _check_chunks(path, file, offset, size, width, n_points)
        at = extended
        for _ in range(n_extended):
            if at + _EVLR > size:
                raise _wrong(path, f"{n_extended} extended records behind byte {extended} of {size}")
            file.seek(at + 20)
            at += _EVLR + int.from_bytes(file.read(8), "little")
        if n_extended and at > size:
            raise _wrong(path, f"{n_extended} extended records behind byte {extended} of {size}")


def _check_chunks(path: Path, file: Any, offset: int, size: int, width: int, n_points: int) -> None:
    """Check the table of a LAZ file's chunks: each holds at least one point as it is."""
    file.seek(offset)
    (table,) = struct.unpack("<q", _read_exactly(path, file, 8))
    if table == -1:
        file.seek(size - 8)
        (table,) = struct.unpack("<q", _read_exactly(path, file, 8))
    if n_points and not offset + 8 <= table <= size - 8:
        raise _wrong(path, f"a table of chunks at byte {table} of {size}")
    if n_points:
        file.seek(table)
        _, n_chunks = struct.unpack("<II", _read_exactly(path, file, 8))
        if n_chunks > n_points or n_chunks * width > table - offset:
            raise _wrong(path, f"{n_chunks} chunks of {n_points} points in {table - offset} bytes")


def _read_exactly(path: Path, file: Any, n: int) -> bytes:
    data: bytes = file.read(n)
    if len(data) < n:
        raise _wrong(path, "points behind its end")
    return data


def _wrong(path: Path, words: str) -> FormatError:
    return FormatError(f"{path.name} announces {words}; expected no more than it holds. It is cut short, or damaged.")
