"""Files at the door: refuse what cannot be read in one clear line, and write so that nothing is ever half-written."""

from __future__ import annotations

import os
import platform
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from seismo3d._validate import told
from seismo3d.errors import FileAccessError, ParameterError

_ASIDE = ".part"
_PARTICIPLE = {"read": "read", "write": "written"}
# how often a folder that writing failed in is removed, as long as others still write to it
_LOOKS, _SECONDS_BETWEEN_LOOKS = 20, 0.25


def as_path(path: Any, name: str = "path") -> Path:
    """Return the path that a name tells, or refuse what is none."""
    if not isinstance(path, (str, os.PathLike)) or "\0" in str(path):
        raise ParameterError(f"{name} is {told(path)}; expected the name of a file or folder, as text or a Path.")
    return Path(path)


def as_readable_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of an ordinary file that can be opened for reading, or refuse it."""
    file = as_path(path)
    with refuse_os_errors(file, "read"):
        if file.is_dir():
            raise FileAccessError(f"{file} is a directory; expected a file.")
        if file.exists() and not file.is_file():
            raise FileAccessError(f"{file} is a pipe or a device; expected an ordinary file. Save it to disk first.")
        with file.open("rb"):
            pass
    return file


@contextmanager
def refuse_os_errors(path: Path, verb: str) -> Iterator[None]:
    """Turn the system's errors about one file into one clear line."""
    try:
        yield
    except FileNotFoundError as error:
        if verb == "write":
            raise FileAccessError(f"{path} cannot be made there. Choose another folder.") from error
        raise FileAccessError(f"{path} does not exist. Check the path.") from error
    except PermissionError as error:
        raise FileAccessError(
            f"{path} cannot be {_PARTICIPLE[verb]}: permission denied. Ask its owner for access."
        ) from error
    except FileAccessError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"{path} cannot be {_PARTICIPLE[verb]}: {reason}.") from error


@contextmanager
def written_aside(path: str | os.PathLike[str], *, folder: bool = False) -> Iterator[Path]:
    """Give a name beside ``path`` to write to, and move it into place at the end; on any error, leave no trace.

    What processes that are gone left half-written of it goes first.

    Parameters
    ----------
    path : path
        The file, or the folder, to make; one that is there is replaced, and only at the end.
    folder : bool
        Whether it is a folder.

    Raises
    ------
    FileAccessError
        If it cannot be written: no such folder, no permission, no space left; or if it is a folder that another process
        is writing, or has made meanwhile.
    """
    final = as_path(path)
    _check_place(final, folder=folder)
    _clear_beside(final, alone=folder)
    aside = final.parent / f"{_aside_of(final)}{os.getpid()}{_ASIDE}"
    was_there = final.exists()
    try:
        with refuse_os_errors(final, "write"):
            yield aside
            if folder and not was_there:
                _refuse_made_meanwhile(final)
            replace_path(aside, final, folder=folder)
    except BaseException as error:
        (_remove_for_good if aside.is_dir() else _remove)(aside)
        if isinstance(error, FileAccessError) and str(aside) in str(error):  # of a file in the folder
            raise FileAccessError(str(error).replace(str(aside), str(final))) from error
        raise


def _refuse_made_meanwhile(final: Path) -> None:
    if final.exists():
        raise FileAccessError(
            f"{final} was made by another run meanwhile; it is not replaced. Give the command again with another name."
        )


def _aside_of(final: Path) -> str:
    """Return how names beside `final` begin that processes of this machine write to; a number and an ending follow."""
    return f".{final.name}.{platform.node()}."


def _clear_beside(final: Path, *, alone: bool) -> None:
    """Remove what processes of this machine that are gone left of `final`; if `alone`, refuse what one is writing."""
    with refuse_os_errors(final, "write"), os.scandir(final.parent) as entries:
        names = [entry.name for entry in entries if entry.name.startswith(_aside_of(final))]
    for name in names:
        process = name.removeprefix(_aside_of(final)).removesuffix(_ASIDE)
        if not process.isdecimal() or int(process) == os.getpid():
            continue
        if not _is_running(int(process)):
            _remove(final.parent / name)
        elif alone:
            raise FileAccessError(
                f"{final} is being written by process {process}. Wait for it, or choose another name."
            )


def refuse_rival(final: Path, *, folder: bool) -> None:
    """Refuse a file, or a folder, that cannot be made there, or that another process of this machine is writing."""
    _check_place(final, folder=folder)
    _clear_beside(final, alone=True)


def _is_running(process: int) -> bool:
    if os.name != "posix":  # a signal of 0 would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _check_place(final: Path, *, folder: bool) -> None:
    with refuse_os_errors(final, "write"):
        if not final.parent.is_dir():
            raise FileAccessError(
                f"{final.parent} is not a folder; expected one to write {final.name} into. Make it first."
            )
        if final.is_dir() and not folder:
            raise FileAccessError(f"{final} is a directory; expected a file name.")


def check_output(
    path: str | os.PathLike[str], *, endings: Sequence[str], inputs: Iterable[str | os.PathLike[str]] = ()
) -> Path:
    """Return the path of a file to write, or refuse it before there is work to lose.

    Parameters
    ----------
    path : path
        The file.
    endings : sequence of str
        What its name may end in, such as ``.png``; small letters.
    inputs : iterable of path
        Files that are read: it must be none of them.

    Raises
    ------
    ParameterError
        If its name ends in something else, or it is an input.
    FileAccessError
        If there is no such folder, or it is a folder.
    """
    final = as_path(path)
    if final.suffix.lower() not in endings:
        listed = f"{', '.join(endings[:-1])} or {endings[-1]}" if len(endings) > 1 else endings[0]
        raise ParameterError(f"{final} ends in {final.suffix!r}; expected {listed}. Choose another name.")
    _check_place(final, folder=False)
    for other in inputs:
        if final.exists() and Path(other).exists() and final.samefile(other):
            raise ParameterError(f"{final} is an input too; expected another name for the result.")
    return final


def replace_path(aside: Path, final: Path, *, folder: bool) -> None:
    """Move what was written aside into its place; a folder that is there goes only once the new one is in place."""
    if not folder or not final.exists():
        aside.replace(final)
        return
    old = final.parent / f".{final.name}.{os.getpid()}.old"
    final.replace(old)
    try:
        aside.replace(final)
    except BaseException:
        old.replace(final)
        raise
    _remove(old)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _remove_for_good(path: Path) -> None:
    """Remove a folder that writing failed in, with what a library's threads that still run put into it meanwhile."""
    for _ in range(_LOOKS):
        shutil.rmtree(path, ignore_errors=True)
        time.sleep(_SECONDS_BETWEEN_LOOKS)
        if not path.exists():
            return
    shutil.rmtree(path)
