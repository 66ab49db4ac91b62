"""What is written aside leaves nothing when it fails, even where a library's threads go on writing."""

import platform
import subprocess
import sys

import pytest

from seismo3d.errors import FileAccessError, ParameterError
from seismo3d.io import _files
from seismo3d.robot.sequence import read_sequence
from seismo3d.seismic.faultset import FaultSet


def write_and_fail(path, *, folder):
    with _files.written_aside(path, folder=folder) as aside:
        if folder:
            aside.mkdir()
            (aside / "zarr.json").write_text("{}")
        else:
            aside.write_text("half")
        raise OSError(28, "no room")


def test_a_folder_that_cannot_be_made_is_told_as_such_and_not_as_missing(tmp_path):
    told = pytest.raises(FileAccessError, match=r"out cannot be made there\. Choose another folder")
    with told, _files.refuse_os_errors(tmp_path / "out", "write"):
        raise FileNotFoundError(2, "No such file or directory")


def aside(folder, process):
    return folder / f".out.zarr.{platform.node()}.{process}.part"


@pytest.mark.parametrize("folder", [False, True])
def test_a_write_that_fails_leaves_nothing_and_says_why(tmp_path, folder):
    with pytest.raises(FileAccessError, match=r"out\.zarr cannot be written: no room"):
        write_and_fail(tmp_path / "out.zarr", folder=folder)
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_a_file_in_a_folder_names_it_where_it_would_be(tmp_path):
    out = tmp_path / "out"

    def write_a_run():
        with _files.written_aside(out, folder=True) as folder:
            folder.mkdir()
            write_and_fail(folder / "labels.sgy", folder=False)

    with pytest.raises(FileAccessError) as told:
        write_a_run()
    assert str(told.value) == f"{out / 'labels.sgy'} cannot be written: no room."
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_a_thread_still_writes_into_goes_too(tmp_path, monkeypatch):
    left = [3]

    def write_once_more(_seconds):
        if left[0] and not list(tmp_path.iterdir()):
            left[0] -= 1
            folder = aside(tmp_path, _files.os.getpid()) / "amplitude"
            folder.mkdir(parents=True)
            (folder / "zarr.json").write_text("{}")

    monkeypatch.setattr(_files.time, "sleep", write_once_more)
    with pytest.raises(FileAccessError, match="no room"):
        write_and_fail(tmp_path / "out.zarr", folder=True)
    assert left == [0]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_go_is_not_passed_over(tmp_path, monkeypatch):
    def write_again(_seconds):
        (aside(tmp_path, _files.os.getpid()) / "c").mkdir(parents=True, exist_ok=True)

    monkeypatch.setattr(_files.time, "sleep", write_again)
    monkeypatch.setattr(_files.shutil, "rmtree", lambda path, **how: None if how else _refuse(path))
    with pytest.raises(PermissionError):
        write_and_fail(tmp_path / "out.zarr", folder=True)


def _refuse(path):
    raise PermissionError(13, "not ours", str(path))


def test_outputs_are_refused_by_their_names_and_places(tmp_path):
    (tmp_path / "a.png").write_bytes(b"input")
    (tmp_path / "b.png").symlink_to(tmp_path / "a.png")
    (tmp_path / "folder.png").mkdir()
    for name in ("a.png", "b.png"):
        with pytest.raises(ParameterError, match=f"{name} is an input too; expected another name"):
            _files.check_output(tmp_path / name, endings=(".png",), inputs=[tmp_path / "a.png"])
    with pytest.raises(ParameterError, match=r"ends in ''; expected \.png, \.pdf or \.svg"):
        _files.check_output(tmp_path / "a", endings=(".png", ".pdf", ".svg"))
    with pytest.raises(FileAccessError, match="is a directory"):
        _files.check_output(tmp_path / "folder.png", endings=(".png",))
    with pytest.raises(FileAccessError, match="is not a folder"):
        _files.check_output(tmp_path / "none" / "c.png", endings=(".png",))
    assert _files.check_output(tmp_path / "c.PNG", endings=(".png",)) == tmp_path / "c.PNG"


def test_names_that_the_system_does_not_take_are_refused(tmp_path):
    long = tmp_path / ("a" * 300)
    with pytest.raises(FileAccessError, match=r"cannot be written: File name too long"):
        write(long)
    with pytest.raises(FileAccessError, match=r"cannot be written: File name too long"):
        _files.check_output(tmp_path / f"{long.name}.png", endings=(".png",))
    for take in (FaultSet.load, read_sequence):
        with pytest.raises(FileAccessError, match=r"cannot be read: File name too long"):
            take(long)
    with pytest.raises(ParameterError, match=r"path is 'a.x00b'; expected the name of a file or folder"):
        _files.as_path("a\0b")


def write(path, *, meanwhile=lambda: None):
    with _files.written_aside(path, folder=True) as made:
        made.mkdir()
        (made / "mine").touch()
        meanwhile()


@pytest.mark.parametrize("folder", [False, True])
def test_what_a_killed_process_left_goes(tmp_path, folder):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    aside(tmp_path, gone.pid).mkdir()
    (aside(tmp_path, gone.pid) / "half").touch()
    others = [tmp_path / f".out.zarr.another-machine.{gone.pid}.part", tmp_path / f".in.zarr.{gone.pid}.part"]
    for other in others:
        other.touch()
    with pytest.raises(FileAccessError, match="no room"):
        write_and_fail(tmp_path / "out.zarr", folder=folder)
    assert sorted(tmp_path.iterdir()) == sorted(others)


def test_a_folder_that_another_process_writes_is_left_to_it(tmp_path):
    aside(tmp_path, _files.os.getppid()).mkdir()
    with pytest.raises(FileAccessError, match=f"is being written by process {_files.os.getppid()}"):
        write(tmp_path / "out.zarr")
    assert list(tmp_path.iterdir()) == [aside(tmp_path, _files.os.getppid())]


def test_a_folder_that_has_come_meanwhile_is_not_replaced(tmp_path):
    final = tmp_path / "out.zarr"

    def write_meanwhile():
        final.mkdir()
        (final / "theirs").touch()

    with pytest.raises(FileAccessError, match=r"out\.zarr was made by another run meanwhile; it is not replaced"):
        write(final, meanwhile=write_meanwhile)
    assert [path.name for path in tmp_path.rglob("*")] == ["out.zarr", "theirs"]
    write(final)
    assert [path.name for path in final.iterdir()] == ["mine"]
