"""Arrays on disk that are worked on as if they were in memory, and leave it when they are asked to."""

from __future__ import annotations

import mmap
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.io._files import refuse_os_errors


class OnDisk:
    """Keeps arrays in files of a folder, mapped into memory.

    Parameters
    ----------
    folder : Path
        Made anew; what an earlier run left there is removed.

    Attributes
    ----------
    most : int
        Points that are worked on between two rests: so many draw a few hundred megabytes into memory, as each has its
        neighbours on other pages.
    """

    most = 250_000

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._maps: list[mmap.mmap] = []
        with refuse_os_errors(folder, "write"):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)

    def array(self, shape: tuple[int, ...], dtype: Any) -> AnyArray:
        """Return an array to write to."""
        size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
        if size == 0:
            return np.empty(shape, dtype)
        path = self._folder / f"{len(self._maps):03d}.bin"
        with refuse_os_errors(path, "write"), path.open("w+b") as stream:
            _claim(stream.fileno(), size)
            mapped = mmap.mmap(stream.fileno(), size)
        self._maps.append(mapped)
        return np.frombuffer(mapped, dtype).reshape(shape)

    def rest(self) -> None:
        """Give memory back: what is mapped stays on disk, and comes back when it is asked for."""
        for mapped in self._maps:
            mapped.madvise(mmap.MADV_DONTNEED)

    def remove(self) -> None:
        """Remove the files; arrays that are still in use keep theirs until they are not."""
        self._maps.clear()
        shutil.rmtree(self._folder, ignore_errors=True)


def _claim(file: int, size: int) -> None:
    """Take the space at once: a disk that is full later would end the process without a word."""
    import os

    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.truncate(file, size)
