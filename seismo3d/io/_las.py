"""What a LAS header says, checked against the file's size before anything is allocated for it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

from seismo3d.errors import FormatError

_LEAST_HEADER = 227
_VLR, _EVLR = 54, 60


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
            raise FormatError(f"{path.name} is not a readable LAS or LAZ file: it has no LAS header.")
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
