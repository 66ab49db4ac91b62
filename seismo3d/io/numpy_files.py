"""NumPy's files read with care: what a header declares is checked against the file before memory is given to it.

No pickle is ever loaded, and whatever is damaged ends in a :class:`~seismo3d.errors.FormatError`.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FileAccessError, FormatError, Seismo3dError
from seismo3d.io._files import as_readable_file

_DEFLATE = 1032
"""Most that a byte of deflated data can unpack to."""
# bytes that an array may declare whatever the size of its file
_ALWAYS_ALLOWED = 256 * 2**20
_DAMAGE = (
    ValueError, TypeError, KeyError, IndexError, EOFError, OverflowError, RecursionError, SyntaxError, TokenError,
    RuntimeError, AttributeError, ArithmeticError, AssertionError, MemoryError, struct.error, zlib.error,
    zipfile.BadZipFile,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Entry:
    """One array of a file, before it is read.

    Attributes
    ----------
    shape : tuple of int
        Its shape.
    dtype : numpy.dtype
        Type of its elements.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)


def read_npy(path: str | Path, *, mapped: bool = False) -> AnyArray:
    """Read an ``.npy`` file.

    Parameters
    ----------
    path : str or Path
        The file.
    mapped : bool
        Leave it on disk, to be read where it is used.

    Raises
    ------
    FileAccessError
        If it cannot be read.
    FormatError
        If it is no such file, is cut short, or holds Python objects.
    """
    file = as_readable_file(path)
    with refuse_damage(file, "NumPy file of numbers"), file.open("rb") as stream:
        entry, fortran = _read_header(stream, file)
        start, size = stream.tell(), file.stat().st_size
        _check_size(entry, size - start, file.name)
        if mapped and entry.dtype.itemsize and 0 not in entry.shape:
            order: Any = "F" if fortran else "C"
            return np.memmap(file, dtype=entry.dtype, mode="r", offset=start, shape=entry.shape, order=order)
        stream.seek(0)
        array: AnyArray = np.lib.format.read_array(stream, allow_pickle=False)
        return array


def list_npz(path: str | Path) -> dict[str, Entry]:
    """List the arrays of an ``.npz`` file without reading them; errors as of :func:`read_npz`."""
    file = as_readable_file(path)
    with refuse_damage(file, "NPZ archive"), zipfile.ZipFile(file) as archive:
        return {name: _open_entry(archive, member, file) for name, member in _members(archive).items()}


def read_npz(path: str | Path, names: Iterable[str] | None = None) -> dict[str, AnyArray]:
    """Read arrays of an ``.npz`` file.

    Parameters
    ----------
    path : str or Path
        The file.
    names : iterable of str, optional
        Which; all of them by default.

    Returns
    -------
    dict of str to ndarray

    Raises
    ------
    FileAccessError
        If it cannot be read.
    FormatError
        If it is no such file, is damaged, holds Python objects, or has no array of a name.
    """
    file = as_readable_file(path)
    with refuse_damage(file, "NPZ archive"), zipfile.ZipFile(file) as archive:
        members = _members(archive)
        wanted = list(members) if names is None else list(names)
        missing = [name for name in wanted if name not in members]
        if missing:
            held = ", ".join(members) or "none"
            raise FormatError(f"{file.name} has the arrays {held}; expected {', '.join(missing)} among them.")
        return {name: read_member(archive, members[name], file) for name in wanted}


def read_member(archive: zipfile.ZipFile, member: str, file: Path) -> AnyArray:
    """Read one array of an open archive; what is raised is for :func:`refuse_damage` to sort."""
    _open_entry(archive, member, file)
    with archive.open(member) as stream:
        array: AnyArray = np.lib.format.read_array(stream, allow_pickle=False)
        # the checksum is only compared at the end
        stream.read()
        return array


def check_declared(declared: int, size: int, name: str) -> None:
    """Refuse packed data that declare far more than they can hold.

    Parameters
    ----------
    declared : int
        Bytes in memory; up to 256 MiB are always allowed.
    size : int
        Bytes in the file.
    name : str
        For the message.

    Raises
    ------
    FormatError
        If they are more than any usual packing makes of the file.
    """
    if declared > max(_ALWAYS_ALLOWED, _DEFLATE * size):
        raise FormatError(f"{name} declares {declared} bytes, and has {size} on disk; expected more. It is damaged.")


@contextmanager
def refuse_damage(file: Path, kind: str) -> Iterator[None]:
    """Turn whatever damaged files make NumPy and zipfile raise into one clear line.

    Parameters
    ----------
    file : Path
        The file, for the message.
    kind : str
        What it ought to be.
    """
    try:
        yield
    except Seismo3dError:
        raise
    except _DAMAGE as error:
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise FormatError(f"{file} is no {kind}, or is damaged or cut short: {reason}. Get it again.") from error
    except OSError as error:
        if error.errno is None or error.errno == 22:  # not the system's: an offset or a stream that cannot be
            raise FormatError(f"{file} is no {kind}, or is damaged: {error}. Get it again.") from error
        raise FileAccessError(f"{file} cannot be read: {error.strerror}. Check the name and permissions.") from error


def _members(archive: zipfile.ZipFile) -> dict[str, str]:
    return {name.removesuffix(".npy"): name for name in archive.namelist() if name.endswith(".npy")}


def _open_entry(archive: zipfile.ZipFile, member: str, file: Path) -> Entry:
    """Read a member's header, and check that the member can hold what it declares."""
    info = archive.getinfo(member)
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FormatError(f"{file.name} is packed by method {info.compress_type}; expected stored or deflated arrays.")
    with archive.open(member) as stream:
        entry, _ = _read_header(stream, file)
        limit = min(info.file_size, _DEFLATE * max(info.compress_size, 1))
        _check_size(entry, limit - stream.tell(), f"{file.name}: {member}")
    return entry


def _read_header(stream: Any, file: Path) -> tuple[Entry, bool]:
    version = np.lib.format.read_magic(stream)
    readers: dict[tuple[int, int], Any] = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in readers:
        raise FormatError(f"{file.name} has version {version} of NumPy's format; expected 1.0 or 2.0. Save it again.")
    shape, fortran, dtype = readers[version](stream)
    if dtype.hasobject:
        raise FormatError(f"{file.name} holds Python objects; expected numbers. Save an array of numbers.")
    if any(n < 0 for n in shape):
        raise FormatError(f"{file.name} declares the shape {shape}; expected no negative size. It is damaged.")
    return Entry(tuple(int(n) for n in shape), dtype), bool(fortran)


def _check_size(entry: Entry, room: int, name: str) -> None:
    size = entry.dtype.itemsize
    for n in entry.shape:
        size *= n
    if size > max(room, 0):
        raise FormatError(
            f"{name} declares {size} bytes of shape {entry.shape}, and has {max(room, 0)}; expected all of them. "
            "It is cut short, or damaged."
        )
