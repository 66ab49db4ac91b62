"""Bricks of whole traces on disk, each with a checksum: a damaged or missing one is noticed when it is read."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.io._files import refuse_os_errors
from seismo3d.seismic.blocks.plan import Box

_CHECKSUM = 4
"""Bytes of the checksum that follows a brick."""


class DamagedBlock(Exception):  # noqa: N818 - not an error of the run: what it names is computed again
    """A stored block is missing or does not match its checksum.

    Parameters
    ----------
    name : str
        The array, or the stage whose record it is.
    place : tuple of int
        A trace of the brick, or the number of the record.
    """

    def __init__(self, name: str, place: tuple[int, ...]) -> None:
        super().__init__(name, place)
        self.name, self.place = name, place

    def __str__(self) -> str:
        return f"the stored block of {self.name} at {self.place} is damaged or missing"


class BrickStore:
    """Arrays of a cube's shape in a folder, in Zarr, as bricks of whole traces.

    Bricks that are not packed are read and written here, not by zarr: into one room of memory for all of a box, where
    zarr takes a new one for every step of every brick, which costs more than what is done with them.

    Parameters
    ----------
    folder : Path
        Where they lie.
    brick : int
        Inlines and crosslines of a brick.
    """

    def __init__(self, folder: Path, brick: int) -> None:
        self.folder, self.brick = folder, brick
        self._open: dict[str, Any] = {}

    def make(self, name: str, shape: tuple[int, int, int], dtype: Any, *, packed: bool = False) -> None:
        """Make an array, unless it is there; `packed` is for values that repeat a lot."""
        import zarr
        from zarr.codecs import Crc32cCodec, ZstdCodec

        if (self.folder / name / "zarr.json").is_file():
            return
        codecs: list[Any] = [ZstdCodec(level=1), Crc32cCodec()] if packed else [Crc32cCodec()]
        with refuse_os_errors(self.folder / name, "write"):
            shutil.rmtree(self.folder / name, ignore_errors=True)
            zarr.create_array(
                str(self.folder / name), shape=shape, dtype=np.dtype(dtype),
                chunks=(min(self.brick, shape[0]), min(self.brick, shape[1]), shape[2]), compressors=codecs,
                fill_value=0,
            )  # fmt: skip

    def remove(self, *names: str) -> None:
        """Remove arrays that are needed no more."""
        for name in names:
            self._open.pop(name, None)
            shutil.rmtree(self.folder / name, ignore_errors=True)

    def write(self, name: str, box: Box, values: AnyArray) -> None:
        """Write a box whose corners are those of bricks."""
        with refuse_os_errors(self.folder / name, "write"):
            array = self._array(name)
            if _is_packed(array):
                array[box.i0 : box.i1, box.j0 : box.j1] = values
                return
            room, brick = _make_room(array)
            for row, column in self._bricks(box):
                part = self._box_of(row, column, array.shape)
                n0, n1 = part.shape
                if (n0, n1) != brick.shape[:2]:
                    brick[...] = 0
                brick[:n0, :n1] = values[part.within(box)]
                self._write_brick(self._path(name, row, column), room)

    def read(self, name: str, box: Box) -> AnyArray:
        """Read a box.

        Raises
        ------
        DamagedBlock
            If a brick of it is missing or damaged.
        """
        self._find_missing(name, box)
        array = self._array(name)
        if _is_packed(array):
            try:
                return np.asarray(array[box.i0 : box.i1, box.j0 : box.j1])
            except (ValueError, RuntimeError, OSError) as error:
                raise self._find_damaged(name, box) from error
        values = np.empty((*box.shape, array.shape[2]), array.dtype)
        room, brick = _make_room(array)
        for row, column in self._bricks(box):
            part = self._box_of(row, column, array.shape)
            if not _read_brick(self._path(name, row, column), room):
                raise DamagedBlock(name, (part.i0, part.j0))
            both = Box(max(part.i0, box.i0), min(part.i1, box.i1), max(part.j0, box.j0), min(part.j1, box.j1))
            values[both.within(box)] = brick[both.within(part)]
        return values

    def _write_brick(self, path: Path, room: AnyArray) -> None:
        """Write a brick, and its checksum after it as Zarr has it."""
        import google_crc32c

        room[-_CHECKSUM:] = np.frombuffer(
            google_crc32c.value(room[:-_CHECKSUM]).to_bytes(_CHECKSUM, "little"), np.uint8
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb", buffering=0) as stream:
            left = room.data
            while left:
                left = left[stream.write(left) or 0 :]

    def _path(self, name: str, row: int, column: int) -> Path:
        return self.folder / name / "c" / str(row) / str(column) / "0"

    def _box_of(self, row: int, column: int, shape: tuple[int, ...]) -> Box:
        i, j = row * self.brick, column * self.brick
        return Box(i, min(i + self.brick, shape[0]), j, min(j + self.brick, shape[1]))

    def _array(self, name: str) -> Any:
        import zarr

        if name not in self._open:
            if not (self.folder / name / "zarr.json").is_file():
                raise DamagedBlock(name, (0, 0))
            # each brick is written as it is, be it all zeros: an absent one is a lost one
            with zarr.config.set({"array.write_empty_chunks": True}):
                self._open[name] = zarr.open_array(str(self.folder / name), mode="r+")
        return self._open[name]

    def _bricks(self, box: Box) -> list[tuple[int, int]]:
        rows = range(box.i0 // self.brick, -(-box.i1 // self.brick))
        columns = range(box.j0 // self.brick, -(-box.j1 // self.brick))
        return [(row, column) for row in rows for column in columns]

    def _find_missing(self, name: str, box: Box) -> None:
        for row, column in self._bricks(box):
            if not self._path(name, row, column).is_file():
                raise DamagedBlock(name, (row * self.brick, column * self.brick))

    def _find_damaged(self, name: str, box: Box) -> DamagedBlock:
        """Return which brick of a box cannot be read."""
        for row, column in self._bricks(box):
            i, j = row * self.brick, column * self.brick
            try:
                self._array(name)[i : i + self.brick, j : j + self.brick]
            except (ValueError, RuntimeError, OSError):
                return DamagedBlock(name, (i, j))
        return DamagedBlock(name, (box.i0, box.j0))


def _is_packed(array: Any) -> bool:
    return len(array.compressors) > 1


def _make_room(array: Any) -> tuple[AnyArray, AnyArray]:
    """Return memory for a stored brick with its checksum, and the brick in it."""
    dtype = array.dtype.newbyteorder("<")
    size = int(np.prod(array.chunks)) * dtype.itemsize
    room = np.empty(size + _CHECKSUM, np.uint8)
    return room, room[:size].view(dtype).reshape(array.chunks)


def _read_brick(path: Path, room: AnyArray) -> bool:
    """Read a brick, and tell whether it matches its checksum."""
    import google_crc32c

    view, n_read = room.data, 0
    try:
        with path.open("rb", buffering=0) as stream:
            while n_read < len(view) and (n := stream.readinto(view[n_read:])):
                n_read += n
            whole = n_read == len(view) and not stream.read(1)
    except OSError:
        return False
    checksum = int.from_bytes(room[-_CHECKSUM:].tobytes(), "little")
    return whole and bool(google_crc32c.value(room[:-_CHECKSUM]) == checksum)
