"""What is written aside leaves nothing when it fails, even where a library's threads go on writing."""

import threading
import time

import pytest

from seismo3d.errors import FileAccessError
from seismo3d.io._files import written_aside


def test_threads_that_still_write_leave_nothing(tmp_path):
    started = threading.Event()

    def write_on(folder):
        end = time.monotonic() + 0.2
        n = 0
        while time.monotonic() < end:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{n % 7}.json").write_text("{}")
            n += 1
            started.set()

    def write(folder):
        while True:
            try:
                write_on(folder)
            except FileNotFoundError:  # the folder went between the two lines
                continue
            return

    writers: list[threading.Thread] = []

    def fail():
        with written_aside(tmp_path / "out.zarr", folder=True) as aside:
            writers.append(threading.Thread(target=write, args=(aside,)))
            writers[0].start()
            started.wait()
            raise OSError(28, "no room")

    with pytest.raises(FileAccessError, match=r"out\.zarr cannot be written: no room"):
        fail()
    writers[0].join()
    assert list(tmp_path.iterdir()) == []
